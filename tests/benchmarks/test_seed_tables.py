"""Tables over seeds, and those beside published numbers."""

import dataclasses

import numpy as np
import pytest

from motion_gym.benchmarks.objects import Part
from motion_gym.benchmarks.reports import published_tables, seed_tables
from motion_gym.contract import DataError
from tests.scored_runs import scored

PART = Part(
    "A small part",
    {"1": "eth:alpha=1", "8": "eth:alpha=8", "64": "eth:alpha=64"},
    ("constant_velocity",),
    ("erm",),
    "spurious",
    pooled={"both": ("1", "8")},
)


@pytest.fixture(scope="module")
def results(eth_ucy):
    """Scores of two rows on three domains; the first row is trained, so that its order must change."""
    runs = sorted(PART.runs(), key=lambda run: run[0] == "constant_velocity")
    return [scored(predictor, PART.domains[column], k=20) for predictor, column in runs]


def test_tables_hold_means_and_standard_errors(results):
    by_agent, *others = seed_tables.part_tables(PART, results)
    values = seed_tables.over_seeds(PART, results)["erm", "8"]
    assert len(values) == 5
    error = values.std(ddof=1) / np.sqrt(5)
    assert list(by_agent.columns) == ["method", "both", "1", "8", "64", "seeds"]
    assert [row[0] for row in by_agent.rows] == ["constant_velocity", "erm"]
    assert by_agent.rows[0][2:] == [".995 / 2.234"] * 3 + ["-"]
    assert by_agent.rows[1][3].startswith(f"{values.mean():.3f} ± {error:.3f} / ".replace("0.", "."))
    assert by_agent.rows[1][-1] == "5"
    assert [table.title.split(": ")[-1] for table in others] == [
        "k = 20, best sample of each agent",
        "k = 20, best sample of each scene",
    ]
    text = "; ".join(by_agent.notes)
    assert "oracle side channel: sigma reads the future" in text
    assert "unit m, dt 0.4 s, horizon 4.8 s, scoring version 1" in text
    assert "181 agent-windows of 36 agents in 70 scenes" in text
    assert "lowest ADE on the validation windows of the sources" in text


def test_pooled_columns_are_means_of_each_seed(results):
    values = seed_tables.over_seeds(PART, results, "FDE")
    np.testing.assert_allclose(values["erm", "both"], (values["erm", "1"] + values["erm", "8"]) / 2)


def test_a_short_table_has_the_ade_alone(results):
    table = seed_tables.short_table(PART, results)
    values = seed_tables.over_seeds(PART, results)["erm", "64"]
    assert table.rows[1][4].startswith(f"{values.mean():.3f} ± ") and "/" not in table.rows[1][4]


def test_a_row_that_was_not_run_everywhere_leaves_cells_empty(results):
    some = [r for r in results if r["predictor"] == "constant_velocity" or PART.column_of(r) == "64"]
    table = seed_tables.short_table(PART, some)
    assert table.rows[1][1:4] == ["-", "-", "-"] and table.rows[1][4] != "-"


def test_versions_are_not_mixed(results):
    later = {**results[0], "identity": {**results[0]["identity"], "scoring_version": 2}}
    with pytest.raises(DataError, match=r"scoring versions 1 \(as .*\) and 2 \(as"):
        seed_tables.part_tables(PART, [later, *results[1:]])


def test_published_numbers_stand_in_columns_of_their_own(results):
    again = dataclasses.replace(PART, weights="paper/eth")
    table = published_tables.spurious([(PART, results), (again, results)])
    (row,) = [row for row in table.rows if row[:3] == ["erm", "64", "20"]]
    assert row[5:] == ["2.770", "2.666 / 4.441"]
    ours = seed_tables.over_seeds(PART, results, "JADE_20")["erm", "64"].mean()
    assert row[4] == f"{row[3]} ({100 * (ours / 2.77 - 1):+.0f} %)"
    assert ["gcrl", "8", "1", "-", "-", "-", ".988 / 1.872"] in list(map(list, table.rows))
    alone = published_tables.spurious([(PART, results)])
    assert [row[4] for row in alone.rows if row[:3] == ["erm", "64", "20"]] == ["-"]


def test_published_numbers_are_rows_of_a_panel_for_claims(results):
    panel = published_tables.spurious_panel([(PART, results)])
    assert panel.errors["the paper: erm", "64"] == [2.77] and panel.columns[-1] == "64"
    ours = [r["metrics"]["JADE_20"]["mean"] for r in results if PART.column_of(r) == "64" and "erm" in r["predictor"]]
    assert panel.errors["erm", "64"].tolist() == ours
