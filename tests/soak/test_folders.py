"""Commands in folders that are full, cannot be written to, or are used by another process; and with a wrong clock."""

from __future__ import annotations

import contextlib
import datetime
import os
import random
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from motion_gym.benchmarks.reports.marked_block import insert
from motion_gym.online.checkpoints import _key
from tests.soak.sandbox import COMMANDS, Sandbox, finish, one_thread

FULL = (0.02, 0.3, 0.6, 0.95)
"""Parts of the space that a command needs that there are."""
YEARS = 3.2e8
"""Seconds by which a clock is wrong."""
root_only = pytest.mark.skipif(os.geteuid() != 0, reason="only root mounts file systems")
quick = pytest.mark.parametrize("name", [name for name in COMMANDS if name != "report"])


@contextlib.contextmanager
def disk(folder: Path, size: int) -> Iterator[None]:
    """A small file system in memory."""
    folder.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder], check=True)
    try:
        yield
    finally:
        subprocess.run(["umount", folder], check=True)


def remount(folder: Path, how: str) -> None:
    subprocess.run(["mount", "-o", f"remount,{how}", folder], check=True)


def in_a_fork(function) -> int:
    process = os.fork()
    if process:
        return process
    try:
        function()
        os._exit(0)
    finally:
        os._exit(1)


@pytest.fixture
def fresh_and_whole(name, tmp_path):
    """A sandbox, one in which the command ran, and its result."""
    with one_thread():
        fresh = Sandbox.fresh(tmp_path / "fresh", COMMANDS[name])
        whole = fresh.copy(tmp_path / "whole")
        assert whole.run() == 0, whole.said
        yield fresh, whole, whole.result()


def unchanged(sandbox: Sandbox, before: dict[str, str]) -> bool:
    """Whether all files of before are as they were."""
    return sandbox.result().items() >= before.items()


@root_only
@quick
def test_a_full_disk(name, fresh_and_whole, tmp_path, tally):
    fresh, whole, expected = fresh_and_whole
    for part in FULL:
        size = fresh.size + int(part * (whole.size - fresh.size))
        with disk(tmp_path / str(part), size), tally(f"`{name}` on a full disk, repeated with more space", part):
            full = fresh.copy(tmp_path / str(part))
            status = full.run()
            assert status in (0, 2) and "Traceback" not in full.said, full.said
            assert status == 0 or "No space left" in full.said, full.said
            assert unchanged(full, fresh.result())
            remount(full.root, "size=1g")
            assert full.run(again=True) == 0, full.said
            assert full.is_whole(expected), full.result()


@root_only
@quick
def test_a_read_only_disk(name, fresh_and_whole, tmp_path, tally):
    fresh, _, expected = fresh_and_whole
    with disk(tmp_path / "locked", 1 << 30), tally(f"`{name}` on a read-only disk, repeated on a writable one"):
        locked = fresh.copy(tmp_path / "locked")
        remount(locked.root, "ro")
        status = locked.run()
        assert status in (0, 2) and "Traceback" not in locked.said, locked.said
        assert status == 0 or "Read-only file system" in locked.said, locked.said
        assert locked.result() == fresh.result()
        remount(locked.root, "rw")
        assert locked.run(again=True) == 0, locked.said
        assert locked.is_whole(expected), locked.result()


@quick
def test_two_processes_with_the_same_command(name, fresh_and_whole, tmp_path, tally):
    fresh, _, expected = fresh_and_whole
    for number in range(3):
        with tally(f"`{name}` in two processes at a time", number):
            both = fresh.copy(tmp_path / str(number))
            processes = [both.start()]
            time.sleep(0.3 * number)
            processes.append(both.start())
            statuses = sorted(map(finish, processes))
            refused = name == "train"  # which says by whom the weights are being trained
            assert statuses in ([0, 0], [0, 2] if refused else [0, 0]), both.said
            assert both.is_whole(expected), both.result()


def test_two_processes_that_pack_different_rows(tmp_path, tally):
    with one_thread():
        fresh = Sandbox.fresh(tmp_path / "fresh", COMMANDS["run --pack"])
        whole = fresh.copy(tmp_path / "whole")
        assert whole.run() == 0, whole.said
        for number in range(4):
            with tally("`run --pack` of different rows in two processes at a time", number):
                both = fresh.copy(tmp_path / str(number))
                halves = [
                    in_a_fork(lambda row=row, both=both: os._exit(_only(both, row)))
                    for row in ("linear", "constant_velocity")
                ]
                assert list(map(finish, halves)) == [0, 0]
                packed = "work/out/small.jsonl.xz"
                assert both.result()[packed] == whole.result()[packed]


def _only(sandbox: Sandbox, row: str) -> int:
    from motion_gym.cli.main import main

    os.chdir(sandbox.root / "work")
    os.environ["MOTION_GYM_CACHE"] = str(sandbox.root / "cache")
    for number in (1, 2):
        os.dup2(os.open(sandbox.log(row), os.O_WRONLY | os.O_CREAT), number)
    main(["run", "small:SMALL", "--jobs", "1", "--pack", "--out", "out", "--only", row])
    return 0


def test_processes_that_write_different_blocks_of_a_page(tmp_path, tally, tries):
    names = [f"block{number}" for number in range(6)]
    for number in range(tries):
        page = tmp_path / f"{number}.md"
        page.write_text("".join(f"<!-- results: {name} -->\n<!-- results end -->\n" for name in names))
        with tally("tables put into one page by six processes at a time", number):
            processes = [in_a_fork(lambda name=name, page=page: insert(page, name, f"of {name}")) for name in names]
            assert list(map(finish, processes)) == [0] * len(names)
            assert all(f"of {name}" in page.read_text() for name in names)


def test_processes_that_make_the_key_of_checkpoints(tmp_path, tally, tries, monkeypatch):
    for number in range(tries):
        monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / str(number)))
        with tally("the key of checkpoints, made by six processes at a time", number):
            keys = [tmp_path / f"{number}.{each}" for each in range(6)]
            processes = [in_a_fork(lambda path=path: path.write_bytes(_key(make=True))) for path in keys]
            assert list(map(finish, processes)) == [0] * len(keys)
            assert len({path.read_bytes() for path in keys}) == 1


@quick
@pytest.mark.parametrize("shift", [-YEARS, YEARS], ids=["back", "forward"])
def test_a_wrong_clock(name, shift, fresh_and_whole, tmp_path, tally):
    """A command is killed, and repeated after the clock was set."""
    fresh, whole, expected = fresh_and_whole
    clock, direction = time.time, "back" if shift < 0 else "forward"

    class Shifted(datetime.datetime):
        @classmethod
        def now(cls, tz=None):
            return datetime.datetime.fromtimestamp(clock() + shift, tz)

    def set_clock():
        time.time = lambda: clock() + shift
        datetime.datetime = Shifted

    points = random.Random(name).sample(range(1, whole.operations + 1), min(3, whole.operations))
    for point in points:
        with tally(f"`{name}` killed, repeated with the clock set {direction} by ten years", point):
            killed = fresh.copy(tmp_path / str(point))
            assert killed.run(kill_at=point) == -9, killed.said
            assert killed.run(again=True, setup=set_clock) == 0, killed.said
            assert killed.is_whole(expected), killed.result()
