"""The command that tests every claim about results on the stored runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

from motion_gym.benchmarks.claims import claims_page
from motion_gym.cli.output import console, say
from motion_gym.data.storage import write_atomic


def claims(out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None) -> None:
    """Show every claim about results and whether it holds, tested on the stored runs.

    Args:
        out: File to write instead, with the numbers and the test of each claim, as docs/claims.md.
    """
    if out is None:
        for table in claims_page.tables():
            console.print(claims_page.short(table))
        say("The numbers and the test of each claim: motion-gym claims --out claims.md")
    else:
        write_atomic(out, claims_page.page().encode())
        say(f"Written: {out}")
