"""Tables: the same cells in every form, and the number format."""

import io
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from motion_gym.benchmarks.reports.table import (
    Code,
    Strong,
    Table,
    interval,
    number,
    p_text,
    percent,
    span,
    spread,
)
from motion_gym.contract import SpecError
from tests.hostile import TEXTS

TABLE = Table(
    "A title",
    ["method", "ADE [95 %]", "seeds"],
    [[Code("linear:sigma=true"), ".995 [.690, 1.411]", "-"], ["a | b", Strong(".100 ± .001"), "5"]],
    ["first note", "second note"],
    "ADE, m",
)


def printed(table, width):
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


def test_markdown_has_heading_caption_rows_and_notes():
    assert TABLE.markdown() == "\n".join(
        [
            "### A title",
            "",
            "ADE, m",
            "",
            "| method | ADE [95 %] | seeds |",
            "| --- | --- | --- |",
            "| `linear:sigma=true` | .995 [.690, 1.411] | - |",
            r"| a \| b | **.100 ± .001** | 5 |",
            "",
            "- first note.",
            "- second note.",
        ]
    )
    assert TABLE.markdown(0).startswith("**A title.** ADE, m\n\n| method |")
    assert Table("", ["a"], [["1"]]).markdown() == "| a |\n| --- |\n| 1 |"


CELLS = st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Zl", "Zp"]), max_size=12)
ROWS = st.integers(1, 4).flatmap(lambda n: st.lists(st.lists(CELLS, min_size=n, max_size=n), min_size=2, max_size=5))


@given(ROWS)
def test_every_line_of_markdown_has_as_many_cells_as_there_are_columns(rows):
    lines = Table("t", rows[0], rows[1:]).markdown().split("\n\n", 1)[1].split("\n")
    assert {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {len(rows[0]) + 1}


def test_markdown_holds_no_marker_that_a_name_smuggles_in():
    marker = "<!-- results end -->"
    text = Table("t", [marker], [[marker], [Code(marker)]], [marker]).markdown()
    assert marker not in text and text.count("results end") == 4


@pytest.mark.parametrize("text", TEXTS)
def test_no_text_acts_in_markdown_or_on_a_terminal(text):
    table = Table(text, ["a", text], [[text, Code(text)], [Strong(text), "b"]], [text], text)
    markdown = re.sub(r"`[^`\n]*`", "", table.markdown())
    assert not re.search(r"<(?=[A-Za-z/!])|^# |\n# |[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", markdown)
    lines = [line for line in table.markdown().split("\n") if line.startswith("| ")]
    assert len(lines) == 4 and {len(re.findall(r"(?<!\\)\|", line)) for line in lines} == {3}
    assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u202e]", printed(table, 200))


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_terminal_shows_every_cell_within_its_width(width):
    columns = ["method", *(f"column {n}" for n in range(12))]
    rows = [[f"row {r}", *(f"{r}.{c:03d} [.690, 1.411]" for c in range(12))] for r in range(3)]
    text = printed(Table("t", columns, rows), width)
    assert max(map(len, text.splitlines())) <= width
    for row in rows:
        for cell in row[1:]:
            assert cell.split(" ")[0] in text
    assert text.count("row 2") == text.count("method") > 1  # each part begins with the first column


def test_markup_is_printed_as_it_is():
    text = printed(Table("[red]t", ["[bold]x[/bold]"], [["[bold]y[/bold]"]], ["[red]z"]), 80)
    assert all(part in text for part in ("[red]t", "[bold]x[/bold]", "[bold]y[/bold]", "[red]z"))


def test_a_row_of_another_length_is_refused():
    with pytest.raises(SpecError, match=r"`t` has 2 columns, and the row \['a'\] has 1 cells"):
        Table("t", ["x", "y"], [["a"]])


def test_numbers_have_one_format():
    assert [number(x) for x in (1.2345, 0.5, -0.5, 0.0, 12.0, None, float("nan"))] == [
        "1.234",
        ".500",
        "-.500",
        ".000",
        "12.000",
        "-",
        "-",
    ]
    assert [number(x, sign=True) for x in (0.5, -0.5, 1.5)] == ["+.500", "-.500", "+1.500"]
    assert interval({"mean": 0.5, "low": -0.25, "high": 1}) == ".500 [-.250, 1.000]"
    assert interval({"mean": None, "low": None, "high": None}) == "- [-, -]"
    assert percent(-0.126) == "-13 %"
    assert [p_text(p) for p in (0.0001, 0.001, 0.5, None)] == ["< .001", ".001", ".500", "-"]
    assert span([5, 3, 4]) == "3 to 5" and span([3, 3]) == "3"


@given(st.lists(st.floats(0, 100), min_size=2, max_size=9))
def test_a_spread_is_mean_and_standard_error(values):
    mean, error = spread(values).split(" ± ")
    assert float(mean) == pytest.approx(np.mean(values), abs=6e-4)
    assert float(error) == pytest.approx(np.std(values, ddof=1) / np.sqrt(len(values)), abs=6e-4)


def test_a_spread_of_one_value_is_that_value():
    assert spread([0.25]) == ".250" and spread([]) == "-"
