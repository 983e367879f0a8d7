"""Commands of motion-gym in folders of their own: run in a forked process, which can be killed at any of its steps.

A fork begins with all libraries imported, so that a command takes a part of a second, and a kill hits its work. Which
file operations a command does is known from Python's audit events.
"""

from __future__ import annotations

import contextlib
import io
import json
import lzma
import os
import re
import shutil
import signal
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from motion_gym.benchmarks.page import page  # noqa: F401
from motion_gym.benchmarks.reports import pages  # noqa: F401
from motion_gym.cli.main import main
from motion_gym.data.storage import LEFTOVER, digest
from motion_gym.predictors.networks import unet
from motion_gym.training import added_weights, weight_files
from tests.walks import walks_file

CROWD = "orca:scenes=40"
OWN = f'''
from motion_gym.benchmarks.objects import Benchmark, Part

COLUMNS = {{"0.3": "{CROWD}", "0.6": "{CROWD},d=0.6"}}
SMALL = Benchmark("small", "A small benchmark", (Part("Small", COLUMNS, ("constant_velocity", "linear")),))
'''
NOT_COMPARED = ("provenance", "seconds", "session", "update_seconds", "tick_seconds", "peak_memory", "commit")
"""Keys of files of JSON whose values differ from run to run."""
PAGE = 4096
CONSTANT = b"a file of somebody else\n"


@dataclass(frozen=True)
class Command:
    """A command, and what it needs.

    Attributes:
        line: Its arguments.
        again: Further arguments when it is repeated after it was killed.
        prepare: Makes what it reads in the folder of the sandbox, before it runs.
        setup: Called in its process before it begins.
    """

    line: str
    again: str = ""
    prepare: Callable[[Path], Any] = lambda root: None
    setup: Callable[[Path], Any] = lambda root: None


def _copy_of_eth_ucy(root: Path) -> None:
    from motion_gym.data import datasets

    for state in datasets.verify("eth_ucy"):
        (root / "source").mkdir(exist_ok=True)
        shutil.copy(state.path, root / "source" / state.file)


def _weights_elsewhere(root: Path) -> None:
    """Weights, and a package that has their card alone."""
    card = {"predictor": "heatmap", "seeds": [0], "trained_on": ["orca:d=0.3"], "dt": 0.4}
    weight_files.write(root / "source/sdd/heatmap.safetensors", unet.initial(0), card)
    (root / "package/sdd").mkdir(parents=True)
    shutil.copy(root / "source/sdd/heatmap.json", root / "package/sdd/heatmap.json")


def _use_package(root: Path) -> None:
    added_weights.WEIGHTS = weight_files.SHIPPED = root / "package"


def _small_benchmark(root: Path) -> None:
    (root / "work/small.py").write_text(OWN)


COMMANDS = {
    "train": Command("train style_erm --domain orca:scenes=70 --seeds 0,1 --epochs 4 --every 1", "--resume"),
    "score": Command(f"score linear kalman_velocity --domain {CROWD} --domain {CROWD},d=0.6 --out out", "--resume"),
    "adapt": Command(
        "adapt modular_invariant:weights=style,seed=0 --adapter hedge --adapter finetune:parts=modulator "
        f"--stream {CROWD} --stream {CROWD},d=0.6 --frames 200 --out out",
        "--resume",
    ),
    "run": Command("run small:SMALL --jobs 1 --out out", "--resume", _small_benchmark),
    "run --pack": Command("run small:SMALL --jobs 1 --pack --out out", "--resume", _small_benchmark),
    "report": Command("report --out page.html"),
    "data add": Command("data add eth_ucy --from ../source", "", _copy_of_eth_ucy),
    "weights add": Command("weights add --from ../source", "", _weights_elsewhere, _use_package),
    "inspect, score (cache)": Command(f"score constant_velocity --domain {CROWD},agents=3"),
    "import of tracks": Command(f"score linear --domain tracks:path={walks_file()},fps=25 --out out", "--resume"),
}


@dataclass
class Sandbox:
    """Folders for a command: ``work``, where it runs, ``data`` and ``cache``; and files that it must not touch."""

    root: Path
    command: Command

    @classmethod
    def fresh(cls, root: Path, command: Command) -> Sandbox:
        """A sandbox with what the command reads, and with files of somebody else."""
        for name in ("work", "work/out", "work/weights", "data", "cache"):
            (root / name).mkdir(parents=True)
            (root / name / "notes.txt").write_bytes(CONSTANT)
        command.prepare(root)
        return cls(root, command)

    def copy(self, root: Path) -> Sandbox:
        """The same sandbox elsewhere, in a folder that may exist."""
        shutil.copytree(self.root, root, symlinks=True, dirs_exist_ok=True)
        return Sandbox(root, self.command)

    def log(self, name: str) -> Path:
        """A file for what the last command printed or did, outside of its folders."""
        return self.root.with_name(f"{self.root.name}.{name}.txt")

    def start(self, again: bool = False, setup: Callable[[], Any] = lambda: None, kill_at: int | None = None) -> int:
        """Begin the command in a fork; returns its process id.

        Args:
            again: Whether the command was begun before.
            setup: Called in the process before the command.
            kill_at: The process kills itself before its file operation of this number, from 1 on.
        """
        sys.stdout.flush()
        sys.stderr.flush()
        process = os.fork()
        if process:
            return process
        code = 70
        try:
            code = self._child(again, setup, kill_at)
        finally:
            os._exit(code)

    def _child(self, again: bool, setup: Callable[[], Any], kill_at: int | None) -> int:
        os.chdir(self.root / "work")
        os.environ.update(MOTION_GYM_CACHE=str(self.root / "cache"), COLUMNS="200")
        if self.command.line.startswith(("data", "weights")):
            os.environ["MOTION_GYM_DATA"] = str(self.root / "data")
        for name, number in (("stdout", 1), ("stderr", 2)):
            file = os.open(self.log(name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            os.dup2(file, number)
            setattr(sys, name, io.TextIOWrapper(io.FileIO(number, "w"), write_through=True))
        self.command.setup(self.root)
        setup()
        operations = 0

        def count(event: str, arguments: tuple[Any, ...]) -> None:
            nonlocal operations
            if _changes_files(event, arguments, self.root):
                operations += 1
                if operations == kill_at:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            main([*self.command.line.split(), *(self.command.again.split() if again else ())])
            code = 0
        except SystemExit as stop:
            code = stop.code if isinstance(stop.code, int) else 1
        done = operations  # of the command alone
        self.log("operations").write_text(str(done))
        return code

    def run(self, **how: Any) -> int:
        """Run the command to its end; returns its exit status, negative for a signal."""
        return finish(self.start(**how))

    def run_and_kill(self, seconds: float, **how: Any) -> int:
        """Run the command, and kill it after a time."""
        process = self.start(**how)
        time.sleep(seconds)
        with contextlib.suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)
        return finish(process)

    @property
    def size(self) -> int:
        """Bytes of all files, each rounded up to whole pages."""
        return sum(-(-path.stat().st_size // PAGE) * PAGE + PAGE for path in self.root.rglob("*"))

    @property
    def said(self) -> str:
        """What the last command printed on both streams."""
        return "".join(self.log(name).read_text() for name in ("stdout", "stderr"))

    @property
    def operations(self) -> int:
        """Number of the file operations of the last command that ended by itself."""
        return int(self.log("operations").read_text())

    def is_whole(self, expected: dict[str, str]) -> bool:
        """Whether the files are the expected ones; an entry of the cache may be missing, but not be another one."""
        result = self.result()
        missing = expected.keys() - result.keys()
        return result.items() <= expected.items() and all(name.startswith("cache/") for name in missing)

    def result(self) -> dict[str, str]:
        """Digest of each file that the command wrote, without what differs from run to run."""
        return {
            path.relative_to(self.root).as_posix(): _digest_of(path)
            for path in sorted(self.root.rglob("*"))
            if path.is_file()
            and not LEFTOVER.fullmatch(path.name)
            and path.name != "checkpoint.key"
            and path.suffix not in (".pyc", ".lock", ".checkpoint")
        }


def finish(process: int) -> int:
    """Wait for a process; its exit status, negative for a signal."""
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def _changes_files(event: str, arguments: tuple[Any, ...], root: Path) -> bool:
    """Whether an audit event is an operation that changes a file of a sandbox."""
    if event == "open":
        path, _, flags = arguments
        if not isinstance(flags, int) or not flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT):
            return False
    elif event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.link", "os.truncate", "os.chmod"):
        path = arguments[0]
    else:
        return False
    return isinstance(path, (str, bytes, os.PathLike)) and os.path.abspath(os.fsdecode(path)).startswith(f"{root}/")


def _digest_of(path: Path) -> str:
    content = path.read_bytes()
    try:
        if path.name.endswith(".jsonl.xz"):
            lines = [json.loads(line) for line in lzma.decompress(content).splitlines()]
            return digest(json.dumps(_without(lines), sort_keys=True))
        if path.suffix == ".json":
            return digest(json.dumps(_without(json.loads(content)), sort_keys=True))
    except (ValueError, EOFError, lzma.LZMAError) as error:
        return f"damaged: {error}"
    if path.suffix in (".html", ".md", ".svg"):
        content = re.sub(rb"\d{4}-\d\d-\d\d[T ][\d:.+]*", b"", content)
    return digest(content)


def _without(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without(inner) for key, inner in value.items() if key not in NOT_COMPARED}
    return [_without(inner) for inner in value] if isinstance(value, list) else value


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Forks have one thread of PyTorch: its pool of threads does not survive a fork."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)
