"""The README is true: its table comes from the result files, its code runs, and what it links to exists."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from motion_gym.benchmarks import pages, running
from motion_gym.benchmarks.store import SHIPPED

ROOT = Path(__file__).resolve().parent.parent
README = (ROOT / "README.md").read_text()


def block(heading, language):
    """The first code block of a language under a heading."""
    under = README.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]
    return re.search(rf"```{language}\n(.*?)```", under, re.DOTALL).group(1)


@pytest.mark.parametrize("name", running.BENCHMARKS)
def test_tables_are_made_from_the_stored_runs(name):
    results = running.run(name, only=["constant_velocity"] if running.benchmark(name).parts else [])
    assert not results.missing
    shown = README.split(f"<!-- results: {name} -->\n", 1)[1].split("\n<!-- results end -->", 1)[0]
    assert shown == "\n\n".join(table.markdown(heading=0) for table in pages.short(results))
    tables = (SHIPPED / name / "tables.md").read_text()
    assert all(table.markdown() in tables for table in pages.everything(results))


def test_ten_lines_run_and_beat_constant_velocity():
    code = block("Ten lines of Python", "python")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    own, baseline = (float(re.search(r"ADE ([\d.]+)", line).group(1)) for line in done.stdout.splitlines())
    assert own < baseline


def test_environments_of_the_readme_are_made(eth_ucy):
    done = subprocess.run(
        [
            sys.executable,
            "-c",
            block("The environments", "python") + "\nprint(picture.shape, len(crowd.possible_agents))",
        ],
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("(540, 720, 3)")


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)\)", README))))
def test_links_lead_somewhere(target):
    assert target.startswith("https://") or (ROOT / target).exists()
