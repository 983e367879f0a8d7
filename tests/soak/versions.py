"""Numerical tests under other versions of Python and of the libraries, and with one and two threads.

``python -m tests.soak.versions PAGE PYTHON [PYTHON ...]`` runs the tests below with each interpreter, which has
motion-gym, pytest and hypothesis, and writes a row for each into a block of the page, beside the rows of other
interpreters that are there. Tests of networks need PyTorch.
"""

from __future__ import annotations

import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

from motion_gym.benchmarks.reports.marked_block import insert
from motion_gym.benchmarks.reports.table import Table

ROOT = Path(__file__).resolve().parents[2]
TESTS = (
    "tests/metrics/test_bootstrap.py",
    "tests/metrics/test_metrics.py",
    "tests/stepping/test_clocks.py",
    "tests/stepping/test_outstanding.py",
    "tests/data/test_windows.py",
    "tests/envs/test_orca_engine.py",
)
WITH_TORCH = ("tests/predictors/test_modular.py", "tests/predictors/test_kernels.py")
VERSIONS = """
import importlib.metadata as m, importlib.util as u, json, platform
names = ("numpy", "scipy", "torch", "gymnasium", "pettingzoo")
print(json.dumps([platform.python_version(), *(m.version(n) if u.find_spec(n) else "-" for n in names)]))
"""


def row(python: str, threads: int) -> list[str]:
    """Versions, number of threads, and numbers of passed, failed and skipped tests."""
    versions = json.loads(subprocess.run([python, "-c", VERSIONS], capture_output=True, text=True, check=True).stdout)
    tests = [*TESTS, *(WITH_TORCH if versions[3] != "-" else ())]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "OMP_NUM_THREADS": str(threads),
        "PYTHONDONTWRITEBYTECODE": "",
    }
    command = [python, "-m", "pytest", "-p", "no:cacheprovider", "--tb=line", *tests]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    print(done.stdout[-3000:], file=sys.stderr)
    counts = {name: number for number, name in re.findall(r"(\d+) (passed|failed|skipped|error)", done.stdout)}
    return [
        *versions,
        str(threads),
        *(counts.get(name, "0") for name in ("passed", "skipped")),
        str(int(counts.get("failed", 0)) + int(counts.get("error", 0))),
    ]


if __name__ == "__main__":
    page, *pythons = sys.argv[1:]
    (block,) = re.findall(r"<!-- results: versions -->(.*?)<!-- results end -->", Path(page).read_text(), re.DOTALL)
    before = [re.findall(r"[^|\s]+", line) for line in block.splitlines() if line.startswith("| 3")]
    columns = [
        "Python",
        "NumPy",
        "SciPy",
        "PyTorch",
        "Gymnasium",
        "PettingZoo",
        "threads",
        "passed",
        "skipped",
        "failed",
    ]
    rows: list[list[str]] = []
    for python, threads in itertools.product(pythons, (1, 2)):
        rows.append(row(python, threads))
        others = [cells for cells in before if cells[0] not in {cells[0] for cells in rows}]
        insert(Path(page), "versions", Table("", columns, [*others, *rows]).markdown())
