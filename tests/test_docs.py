"""README and docs: tables equal those of the stored runs, code runs, and links have targets."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from motion_gym.benchmarks import running
from motion_gym.benchmarks.reports import claims_page, pages
from motion_gym.benchmarks.store import SHIPPED

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
PAGES = [README, ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
LINKS = [(page, link) for page in PAGES for link in sorted(set(re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text())))]


def stored(name):
    """The shipped runs of a benchmark; nothing is computed."""
    benchmark = running.benchmark(name)
    results = running.run(benchmark, only=())
    assert not results.runner.missing
    return results


def code(page, language):
    """The first code block of a language on a page."""
    return re.search(rf"```{language}\n(.*?)```", page.read_text(), re.DOTALL).group(1)


def run(text):
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("name", running.BENCHMARKS)
def test_tables_of_a_benchmark_are_made_from_the_stored_runs(name):
    results = stored(name)
    tables = (SHIPPED / name / "tables.md").read_text()
    assert all(table.markdown() in tables for table in pages.everything(results))


@pytest.mark.parametrize("name", ["style", "places"])
def test_tables_of_the_readme_are_made_from_the_stored_runs(name):
    shown = README.read_text().split(f"<!-- results: {name} -->\n", 1)[1].split("\n<!-- results end -->", 1)[0]
    assert shown == "\n\n".join(table.markdown(heading=0) for table in pages.short(stored(name)))


def test_claims_are_made_from_the_stored_runs():
    assert (ROOT / "docs" / "claims.md").read_text() == claims_page.page()


@pytest.fixture(scope="module")
def pitfalls():
    """The program that writes docs/pitfalls.md."""
    return runpy.run_path(str(ROOT / "docs" / "pitfalls.py"))


def test_pitfalls_are_made_from_the_stored_runs(pitfalls):
    text = (ROOT / "docs" / "pitfalls.md").read_text()
    sections = list(pitfalls["from_runs"]())
    assert len(sections) == 4 and all(f"\n\n{section}\n\n" in text for section in sections)


def test_pitfalls_are_computed_again_from_the_recordings(pitfalls, eth_ucy):
    assert (ROOT / "docs" / "pitfalls.md").read_text() == pitfalls["page"]()


def test_readme_is_short():
    assert len(README.read_bytes()) <= 12_000


def test_ten_lines_run_and_beat_constant_velocity():
    own, baseline = (
        float(re.search(r"ADE ([\d.]+)", line).group(1)) for line in run(code(README, "python")).splitlines()
    )
    assert own < baseline


def test_environments_of_the_docs_are_made(eth_ucy):
    text = code(ROOT / "docs" / "environments.md", "python")
    assert run(f"{text}\nprint(picture.shape, len(crowd.possible_agents))").startswith("(540, 720, 3)")


@pytest.mark.parametrize(("page", "link"), LINKS, ids=lambda value: getattr(value, "name", value))
def test_links_lead_somewhere(page, link):
    assert link.startswith("https://") or (page.parent / link).exists()
