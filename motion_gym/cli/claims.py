"""The command that tests every claim about results on the stored runs."""

from __future__ import annotations

from motion_gym.benchmarks.claims import claims_page
from motion_gym.cli.output import Out, say
from motion_gym.data.storage import write_atomic


def claims(out: Out = None) -> None:
    """Print the page of claims: every sentence, its numbers, its test, and whether it holds.

    Args:
        out: File to write instead of printing, as docs/claims.md.
    """
    text = claims_page.page()
    if out is None:
        print(text, end="")
    else:
        write_atomic(out, text.encode())
        say(f"Written: {out}")
