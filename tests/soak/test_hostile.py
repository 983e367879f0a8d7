"""Names and results that would do harm where they are not escaped, and code in files that are not named as code."""

from __future__ import annotations

import copy
import html.parser
import json
import os
import random
import re
import subprocess
import sys
import warnings

from motion_gym.benchmarks.own_rows import with_stored
from motion_gym.benchmarks.page import board, page
from motion_gym.benchmarks.reports import pages, seed_tables
from motion_gym.benchmarks.reports.table import CONTROL
from motion_gym.benchmarks.store import Store
from tests.hostile import TEXTS, run_named
from tests.walks import walks_file

LAZY = "jinja2 pooch requests torch scipy numba matplotlib pandas pyarrow highway_env jsonschema markupsafe lzma pickle"
"""Modules that commands import when they need them."""


class Elements(html.parser.HTMLParser):
    """Names of elements, and attributes that run code."""

    def __init__(self, text):
        super().__init__()
        self.names, self.handlers = [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        self.names.append(tag)
        self.handlers += [
            name for name, value in attributes if name.startswith("on") or "javascript:" in (value or "").lower()
        ]


def test_the_results_page(tmp_path, tally):
    folder = tmp_path / "style"
    folder.mkdir()
    for number, text in enumerate(TEXTS):
        (folder / f"{number}.json").write_text(json.dumps(run_named(text)))
    plain, harmed = (page.html([with_stored("style", place)], {}) for place in (None, tmp_path))
    for text in TEXTS:
        with tally("texts in results that would act in the page", text[:20]):
            assert text not in harmed or "<" not in text
    with tally("texts in results that would act in the page", "elements"):
        one, other = Elements(plain), Elements(harmed)
        assert other.names.count("script") == one.names.count("script") and not other.handlers
        assert set(other.names) == set(one.names) and "title='harm'" not in harmed
    for table in pages.everything(with_stored("style", tmp_path)):
        with tally("texts in results that would act in Markdown", table.title):
            text = re.sub(r"`[^`\n]*`", "", table.markdown())
            assert "\n# Harm" not in text and "<script" not in text and not CONTROL.search(table.markdown())


def test_results_of_another_form(tmp_path, tally, tries):
    """A result whose values are of another type is read, or named in a warning; it does not end a command."""
    values = [None, True, -1, 1e999, "text", [], {}, [None], {"mean": "x"}, [[1]], "2020-01-01", 10**30]
    chance, good = random.Random(0), run_named("own:Predictor")
    for number in range(10 * tries):
        run = copy.deepcopy(good)
        place, key = chance.choice(list(_places(run)))
        place[key] = chance.choice(values)
        folder = tmp_path / str(number) / "style"
        folder.mkdir(parents=True)
        (folder / "own.json").write_text(json.dumps(run).replace("Infinity", "1e999"))
        with tally("results of another form in a folder of results", (key, place[key])), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            results = with_stored("style", tmp_path / str(number))
            board.entries_of(results)
            for part, runs in results.parts:
                seed_tables.short_table(part, runs)


def _places(value):
    for key, inner in value.items():
        yield value, key
        if isinstance(inner, dict):
            yield from _places(inner)


def test_no_code_of_a_file_that_is_not_named_as_code(tmp_path, tally):
    """Modules in the working folder have the names of libraries; results name a module and a function."""
    mark, work = tmp_path / "ran", tmp_path / "work"
    work.mkdir()
    for name in [*LAZY.split(), "planted", "sitecustomize"]:
        (work / f"{name}.py").write_text(f"open({str(mark)!r}, 'a').write({name!r})\nPlanted = object\n")
    for name, predictor in (("a", "planted:Planted"), ("b", f"os:system:command='touch {mark}'")):
        run = next(copy.deepcopy(each) for each in Store("style").runs.values() if each.get("predictor") == "linear")
        run["identity"]["predictor"] = run["predictor"] = predictor
        (work / f"{name}.json").write_text(json.dumps(run))
    start = tmp_path / "start.py"
    start.write_text("from motion_gym.cli.main import main; main()")
    for line in (
        "validate a.json", "validate b.json", "compare a.json a.json", "compare b.json b.json", "ls", "ls orca",
        "score style_erm --domain orca:scenes=20", "score linear --domain orca:scenes=20 --out out",
        f"inspect {walks_file()} --fps 25", "show orca:scenes=20 --out scene.svg", "report . --out page.html",
        "data ls", "weights ls", "adapt modular --adapter hedge --stream orca:scenes=20 --frames 200",
        "run style",
    ):  # fmt: skip
        with tally("commands in a folder with code that nobody named", line):
            environment = {**os.environ, "MOTION_GYM_CACHE": str(tmp_path / "cache")}
            done = subprocess.run(
                [sys.executable, start, *line.split()], cwd=work, env=environment, capture_output=True, text=True
            )
            assert done.returncode in (0, 1, 2) and "Traceback" not in done.stderr, done.stderr
            assert not mark.exists(), mark.read_text()
            mark.unlink(missing_ok=True)
