from __future__ import annotations

import io
import re
from typing import Any

import pytest
from rich.console import Console

import motion_gym
from motion_gym.benchmarks import report
from motion_gym.benchmarks.results import run
from motion_gym.contract import DataError

make: Any = motion_gym.domain

CROWD = make("orca", d=0.6, scenes=30)


@pytest.fixture(scope="module")
def results():
    """k = 1: two predictors and the oracle."""
    return [run(name, CROWD) for name in ("constant_velocity", "stand_still", "orca_oracle")]


@pytest.fixture(scope="module")
def best_of_20():
    return [run(name, CROWD, protocol="paper") for name in ("constant_velocity", "linear")]


def printed(rows, width):
    out = io.StringIO()
    console = Console(file=out, width=width)
    report.print_table(console, rows)
    report.print_conditions(console, rows)
    return out.getvalue()


def number(value):
    return f"{value:.3f}".removeprefix("0")


def test_rows_say_what_the_results_say(results):
    metrics = results[0]["metrics"]
    ade, fde = metrics["ADE"], metrics["FDE"]
    assert report.row(results[0]) == [
        "constant_velocity",
        f"{number(ade['mean'])} [{number(ade['low'])}, {number(ade['high'])}]",
        f"{number(fde['mean'])} [{number(fde['low'])}, {number(fde['high'])}]",
        "-",
    ]
    difference = results[1]["metrics"]["ADE"]["mean"] - ade["mean"]
    assert report.row(results[1])[3].startswith(f"+{number(difference)} [+")
    assert report.row(results[2])[0] == "orca_oracle (oracle)"
    assert report.row(results[2])[3].startswith(f"-{number(ade['mean'])} [-")


def test_numbers_above_1_and_below_0_keep_their_digits():
    assert [report.number(x) for x in (1.2345, 0.5, -0.5, 0.0, 12.0, None)] == [
        "1.234",
        ".500",
        "-.500",
        ".000",
        "12.000",
        "-",
    ]
    assert [report.number(x, sign=True) for x in (0.5, -0.5, 1.5)] == ["+.500", "-.500", "+1.500"]


@pytest.mark.parametrize("width", [80, 120])
def test_every_line_fits(results, best_of_20, width):
    for rows in (results, best_of_20):
        assert max(map(len, printed(rows, width).splitlines())) <= width


def test_table_of_one_sample(results):
    text = printed(results, 120)
    ade = results[0]["metrics"]["ADE"]
    assert f"{ade['agent_windows']} agent-windows of {ade['agents']} agents in {ade['scenes']} scenes" in text
    assert "orca:d=0.6,scenes=30" in text and "protocol honest, k = 1" in text
    assert re.search(rf"constant_velocity +\{number(ade['mean'])} \[", text)
    assert "minADE" not in text
    assert "constant_velocity, stand_still: no weights" in text


@pytest.mark.parametrize("width", [80, 120])
def test_every_number_of_20_samples_has_its_name(best_of_20, width):
    text = printed(best_of_20, width)
    assert "minADE/FDE_20" in text and "JADE/JFDE_20" in text
    metrics = best_of_20[1]["metrics"]
    best = " / ".join(number(metrics[name]["mean"]) for name in ("minADE_20", "minFDE_20"))
    assert re.search(rf"linear +{re.escape(best)} ", text)
    assert "protocol paper, k = 20" in text


def test_names_that_look_like_markup_are_printed_as_they_are(results):
    row = {**results[1], "predictor": "[bold]x[/bold]", "selection": "[red]chosen"}
    text = printed([row], 120)
    assert "[bold]x[/bold]" in text and "[bold]x[/bold]: [red]chosen" in text


def test_seed_is_shown_where_it_is_not_0(results):
    assert report.label({**results[1], "seed": 7}) == "stand_still, seed 7"
    assert report.label({**results[2], "seed": 7}) == "orca_oracle, seed 7 (oracle)"


def test_leaks_stand_under_the_table(results):
    row = {**results[1], "leaks": ["oracle side channel: sigma reads the future"]}
    text = printed([row], 120)
    assert text.index("sigma reads the future") < text.index("95 % intervals")
    assert "sigma reads the future" in report.markdown([row])


def test_markdown_has_a_row_per_domain_and_a_column_per_predictor(results):
    other = run("stand_still", CROWD.replace(d=0.1))
    lines = report.markdown([*results, other]).splitlines()
    assert lines[0] == "| domain | constant_velocity | stand_still | orca_oracle (oracle) | scored |"
    assert lines[1] == "|---|---|---|---|---|"
    assert lines[2].startswith("| `orca:d=0.6,scenes=30` | .") and lines[3].startswith("| `orca:d=0.1,scenes=30` |  | ")
    assert {line.count("|") for line in lines[:4]} == {6}
    ade, fde = (results[1]["metrics"][name] for name in ("ADE", "FDE"))
    cell = f"{number(ade['mean'])} [{number(ade['low'])}, {number(ade['high'])}] / {number(fde['mean'])}"
    assert lines[2].split(" | ")[2] == cell
    assert "- constant_velocity, stand_still: no weights." in lines


def test_markdown_keeps_protocols_and_numbers_of_samples_apart(results, best_of_20):
    first, second = report.markdown([*results, *best_of_20]).split("\n\n| domain")
    assert "protocol honest, k = 1;" in first and "protocol paper, k = 20;" in second
    assert "minADE" not in first and "then minADE_20 / minFDE_20 and JADE_20 / JFDE_20" in second
    mean = best_of_20[1]["metrics"]["JADE_20"]["mean"]
    assert f", {number(mean)} / " in second


def test_insert_replaces_what_is_between_the_markers(tmp_path):
    path = tmp_path / "README.md"
    before = "# Title\n<!-- results: a -->\nold\n<!-- results end -->\nmiddle\n"
    after = "<!-- results: b -->\n<!-- results end -->\nend \\1 é\n"
    path.write_text(before + after, encoding="utf-8")
    assert report.insert(path, "b", "| new \\g<0> |")
    assert path.read_text(encoding="utf-8") == before + after.replace("-->\n<", "-->\n| new \\g<0> |\n<", 1)
    assert not report.insert(path, "b", "| new \\g<0> |")
    assert report.insert(path, "b", "")


@pytest.mark.parametrize(
    "text",
    [
        "nothing",
        "<!-- results: a -->\nno end",
        "<!-- results end -->\n<!-- results: a -->\n",
        "<!-- results: a -->\nno end\n<!-- results: b -->\n<!-- results end -->\n",
    ],
)
def test_missing_markers_are_named_and_nothing_is_written(tmp_path, text):
    path = tmp_path / "README.md"
    path.write_text(text)
    with pytest.raises(DataError, match=r"<!-- results: a -->.*<!-- results end -->.*add them"):
        report.insert(path, "a", "table")
    assert path.read_text() == text


def test_file_that_cannot_be_read_is_named(tmp_path):
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00\x81")
    for path in (tmp_path / "missing.md", tmp_path, tmp_path / "binary"):
        with pytest.raises(DataError, match=f"{re.escape(str(path))} cannot be read"):
            report.insert(path, "a", "table")
