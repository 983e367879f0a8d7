"""The verb that holds every sentence about results against the stored runs."""

from __future__ import annotations

from motion_gym.benchmarks import pages, running
from motion_gym.benchmarks.claims_page import page, panels_of
from motion_gym.benchmarks.objects import BASELINE
from motion_gym.benchmarks.sentences import CLAIMS
from motion_gym.cli.output import Out, say
from motion_gym.data.storage import write_atomic


def claims(out: Out = None) -> None:
    """Print the page of claims: every sentence, its numbers, its test, and whether it holds. Nothing is computed.

    Args:
        out: File to write instead of printing, as docs/claims.md.
    """
    text = claims_page()
    if out is None:
        print(text, end="")
    else:
        write_atomic(out, text.encode())
        say(f"Written: {out}")


def claims_page() -> str:
    """The page, as Markdown, from the shipped runs."""
    sentences, panels = {}, {}
    for name in running.BENCHMARKS:
        benchmark = running.benchmark(name)
        results = running.run(benchmark, only=[BASELINE] if benchmark.parts or benchmark.shifts else [])
        results.kept.with_curves()
        parts = [(part, runs) for part, runs in results.parts if runs]
        shifts = {
            shift: (
                these.title,
                {kind: rows for kind in these.streams if (rows := pages.stream_rows(results, shift, kind))},
            )
            for shift, these in results.benchmark.shifts.items()
        }
        own = [*results.benchmark.claims, *CLAIMS.get(name, ())]
        sentences[name] = list({claim.sentence: claim for claim in own}.values())
        panels[name] = panels_of(name, parts, results.studies, shifts)
    return page({name: own for name, own in sentences.items() if own}, panels)
