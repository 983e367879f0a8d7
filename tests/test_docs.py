"""README and docs: tables equal those of the stored runs, code runs, and links have targets."""

import inspect
import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from motion_gym import catalog
from motion_gym.benchmarks import running
from motion_gym.benchmarks.claims import claims_page
from motion_gym.benchmarks.reports import pages
from motion_gym.benchmarks.store import SHIPPED
from motion_gym.metrics.errors import METRICS

ROOT = Path(__file__).resolve().parent.parent
README = ROOT / "README.md"
DRONE_VIDEO = ROOT / "docs" / "drone-video.md"
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


@pytest.mark.parametrize(
    "page, name",
    [(README, "style"), (README, "places"), (DRONE_VIDEO, "sdd"), (DRONE_VIDEO, "sdd_style")],
    ids=lambda value: getattr(value, "name", value),
)
def test_tables_in_pages_are_made_from_the_stored_runs(page, name):
    shown = page.read_text().split(f"<!-- results: {name} -->\n", 1)[1].split("\n<!-- results end -->", 1)[0]
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


@pytest.fixture(scope="module")
def reference():
    """Pages of the reference, by path, as the build of the site makes them."""
    pytest.importorskip("torch")
    return runpy.run_path(str(ROOT / "docs" / "generate.py"))["pages"]()


@pytest.mark.parametrize("kind", ["domains", "predictors", "adapters"])
def test_every_parameter_of_every_name_is_explained_in_the_reference(reference, kind):
    for name, entry in getattr(catalog, kind.upper()).items():
        page = reference[f"reference/{kind}/{name}.md"]
        rows = dict(re.findall(r"^\| `(\w+)` \|(.*)\|$", page, re.MULTILINE))
        parameters = inspect.signature(catalog.load_class(entry.target)).parameters
        assert [key.rstrip("_") for key in parameters] == list(rows), name
        assert all(row.split(" | ")[-1].strip() for row in rows.values()), f"a parameter of {name} has no text"
        assert "Error: got" not in page, name


def test_the_reference_has_defaults_and_allowed_ranges(reference):
    page = reference["reference/domains/orca.md"]
    assert "| `d` | `0.3` | a number, 0.001 or more, and at most 10 | Radius of an agent, metres, > 0. |" in page
    assert "| `sigma` | `False` | true, false or relative |" in reference["reference/predictors/erm_no_sigma.md"]


def test_the_reference_has_every_benchmark_and_metric(reference):
    assert all(f"motion-gym run {name}" in reference[f"reference/benchmarks/{name}.md"] for name in running.BENCHMARKS)
    names = [metric.name.replace("{k}", "k") for metric in METRICS]
    assert all(f"| `{name}` |" in reference["reference/metrics.md"] for name in names)


@pytest.mark.parametrize(("page", "link"), LINKS, ids=lambda value: getattr(value, "name", value))
def test_links_lead_somewhere(page, link, request):
    if link.startswith("reference/"):
        assert link in request.getfixturevalue("reference")
    else:
        assert link.startswith("https://") or (page.parent / link).exists()
