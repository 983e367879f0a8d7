"""Line coverage by package, from the report of pytest-cov: ``python -m tests.soak.coverage_table REPORT PAGE``."""

from __future__ import annotations

import collections
import json
import sys
from pathlib import Path

from motion_gym.benchmarks.reports.marked_block import insert
from motion_gym.benchmarks.reports.table import Code, Table


def write(report: Path, page: Path) -> None:
    """Write a row for each package, and one for all of them, into the block `coverage` of a page."""
    lines: dict[str, list[int]] = collections.defaultdict(lambda: [0, 0])
    for file, content in json.loads(report.read_text())["files"].items():
        package = "/".join(Path(file).parts[:2]) if file.startswith("motion_gym/") else Path(file).parts[0]
        for name in (package.removesuffix(".py"), "all"):
            lines[name][0] += content["summary"]["covered_lines"]
            lines[name][1] += content["summary"]["num_statements"]
    rows = [
        [Code(name), str(most), f"{100 * done / most:.1f} %"] for name, (done, most) in sorted(lines.items()) if most
    ]
    insert(page, "coverage", Table("", ["package", "lines", "covered"], rows).markdown())


if __name__ == "__main__":
    write(Path(sys.argv[1]), Path(sys.argv[2]))
