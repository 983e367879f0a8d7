"""The verb of the command line that adapts a predictor on a stream."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.markup import escape

from motion_gym import catalog
from motion_gym.benchmarks import online_results
from motion_gym.benchmarks.online_benchmark import BASELINE, NONE, ORACLE
from motion_gym.benchmarks.online_tables import stream_table
from motion_gym.cli.output import console, progress_bar, say
from motion_gym.contract import PredictorError, SpecError
from motion_gym.online.evaluation import check_options
from motion_gym.online.streams import stream
from motion_gym.online.target_oracle import TargetOracle
from motion_gym.stepping.harness import ready


def adapt(
    predictor: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PREDICTOR")],
    adapter: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="ADAPTER")],
    on: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(name="stream", metavar="DOMAIN")],
    kind: str = "sudden",
    frames: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None,
    cycles: int = 2,
    split: str = "test",
    labels: str = "matured",
    scope: str = "stream",
    realtime: bool = False,
    cost: Annotated[float | None, tyro.conf.arg(metavar="SECONDS")] = None,
    oracle: Annotated[str | None, tyro.conf.arg(metavar="PREDICTOR")] = None,
    seed: int = 0,
    out: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")] = None,
) -> None:
    """Let adapters learn on a stream, beside constant velocity, the source model that never learns, and an oracle.

    Each forecast is stored, scored when its truth is known, and only then learned from.

    Args:
        predictor: The source model: name or spec, as modular_invariant:weights=style,seed=0.
        adapter: Name or spec of an adapter (see `motion-gym ls`), or your own (module:Class); again for each one.
        on: Domain to play; again for each one, in order.
        kind: sudden: one domain after the other; recurring: and all over again; gradual: in blocks, of which more and
            more are of the next; mixed: in blocks in random order.
        frames: Frames of each visit of a domain, 200 or more where there are blocks; by default as many as the
            shortest one has, at most 4000.
        cycles: Visits of each domain where they recur or mix.
        split: Split of the domains.
        labels: matured: the truth of a scene is told once; stepwise: step by step, as it happens.
        scope: What was learned is forgotten at the end of: stream, place, or agent.
        realtime: The stream does not wait for an update, and truth that comes meanwhile is lost.
        cost: Seconds that an update is declared to take in realtime; measured by default.
        oracle: A predictor that was trained on these domains, for the adaptation gain.
        seed: Seed of the stream and of a predictor's samples.
        out: Folder for one JSON file per run; a run that is there is not run again, one that was stopped goes on.
    """
    if not adapter:
        raise SpecError(f"No adapter was named: add --adapter {next(iter(catalog.ADAPTERS))}, or see `motion-gym ls`.")
    if not on:
        raise SpecError("No domain was named: add --stream orca:d=0.3 --stream orca:d=0.6.")
    check_options(labels, scope, realtime, cost)
    played = stream(list(on), kind, frames, cycles=cycles, seed=seed, split=split)
    source = ready(predictor, played.domains[0], seed)
    who: dict[str, Any] = {BASELINE: catalog.predictor(BASELINE)}
    who |= {row: catalog.adapter(row, source) for row in dict.fromkeys([NONE, *adapter])}
    if oracle is not None:
        who[ORACLE] = TargetOracle(oracle)
    options = {"labels": labels, "scope": scope, "realtime": realtime, "cost": cost, "seed": seed}
    found: dict[str, list[dict[str, Any]]] = {}
    failures = []
    with progress_bar() as progress:
        for row, made in who.items():
            task = progress.add_task(escape(row), total=None)

            def report(done: int, of: int, what: str, task: Any = task) -> None:
                progress.update(task, total=of, completed=done, description=escape(what))

            try:
                found[row] = [online_results.run(row, made, predictor, played, out, report, **options)]
            except PredictorError as error:
                if row in (BASELINE, NONE):
                    raise  # every table needs them
                failures.append(f"{row}: {error}")
            progress.remove_task(task)
    console.print(stream_table(next(iter(found.values()))[0]["stream"], found))
    if failures:
        raise PredictorError("\n".join(failures))
    if out is not None:
        say(f"Results are in {out}.")
