"""Each tutorial, followed in an empty folder."""

import pytest

from tests.tutorials import ROOT, follow

PAGES = ("score-your-model.md", "your-data.md", "your-adapter.md", "your-benchmark.md", "reproduce-the-paper.md")


def test_every_tutorial_is_followed():
    titles = {page.name for page in (ROOT / "docs").glob("*.md") if page.read_text().startswith("# Tutorial")}
    assert titles == {*PAGES, "train-sb3.md"}  # tests/clients/rl


@pytest.mark.parametrize("page", PAGES)
def test_tutorial(page, tmp_path):
    pytest.importorskip("torch")
    follow(page, tmp_path)
