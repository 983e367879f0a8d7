"""What was tried, what survived and what was lost: counted, and written as a table into docs/reliability.md."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest

from motion_gym.benchmarks.reports.marked_block import insert
from motion_gym.benchmarks.reports.table import Table

TRIED: dict[str, list[str]] = {}
"""Outcome of each attempt, ``""`` or the reason of a loss, by what was tried."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--page", type=Path, help="page whose block `soak` gets the table")
    parser.addoption("--tries", type=int, default=12, help="kills of each command, and the like")


@pytest.fixture(scope="session")
def tries(pytestconfig: pytest.Config) -> int:
    """Number of attempts of a kind."""
    return int(pytestconfig.getoption("--tries"))


class Tally:
    """Attempts of one test. An attempt that fails is lost; the test goes on, and fails at its end."""

    def __init__(self) -> None:
        self.lost: list[str] = []

    @contextlib.contextmanager
    def __call__(self, what: str, detail: object = "") -> Iterator[None]:
        """Count an attempt, whose body raises if something was lost."""
        reason = ""
        try:
            yield
        except Exception as error:
            reason = f"{what} {detail}: {type(error).__name__}: {error}"
            self.lost.append(reason)
        TRIED.setdefault(what, []).append(reason)


@pytest.fixture
def tally(pytestconfig: pytest.Config) -> Iterator[Tally]:
    counts = Tally()
    yield counts
    if page := pytestconfig.getoption("--page"):  # after each test, since the whole takes an hour
        rows = [
            [what, str(len(all_)), str(all_.count("")), str(len(all_) - all_.count(""))] for what, all_ in TRIED.items()
        ]
        insert(page, "soak", Table("", ["what", "tried", "survived", "lost"], rows).markdown())
    if counts.lost:
        pytest.fail(f"{len(counts.lost)} lost:\n" + "\n".join(counts.lost[:20]), pytrace=False)
