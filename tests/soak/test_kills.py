"""Commands that are killed at any of their file operations, and at random times."""

from __future__ import annotations

import random
import shutil
import time

import pytest

from tests.soak.sandbox import COMMANDS, Sandbox, one_thread

WHEN = ("before a file operation", "at a random time")

SLOW = 10.0
"""Seconds from which on a command is killed less often."""


@pytest.mark.parametrize("name", COMMANDS)
def test_a_killed_command_that_is_repeated_gives_the_same_files(name, tmp_path, tally, tries):
    """Repeated, a command gives the files of an uninterrupted one, and has touched no other file."""
    with one_thread():
        fresh = Sandbox.fresh(tmp_path / "fresh", COMMANDS[name])
        whole = fresh.copy(tmp_path / "whole")
        began = time.monotonic()
        assert whole.run() == 0, whole.said
        seconds, expected = time.monotonic() - began, whole.result()
        tries = tries if seconds < SLOW else 2
        chance = random.Random(name)
        points = range(1, whole.operations + 1)
        points = sorted(chance.sample(points, tries)) if len(points) > tries else points
        kills = [(WHEN[0], {"kill_at": point}) for point in points]
        kills += [(WHEN[1], {"seconds": chance.uniform(0, seconds)}) for _ in range(tries)]
        for number, (when, how) in enumerate(kills):
            killed = fresh.copy(tmp_path / str(number))
            with tally(f"`{name}` killed (kill -9) {when}", how):
                status = killed.run_and_kill(**how) if "seconds" in how else killed.run(**how)
                assert status in (-9, 0), killed.said
                assert status == -9 or when == WHEN[1], "not killed"
                if status == -9:
                    assert killed.run(again=True) == 0, killed.said
                assert killed.is_whole(expected), killed.result()
            shutil.rmtree(killed.root)
