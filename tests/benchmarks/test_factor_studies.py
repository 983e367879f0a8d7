"""The studies of style factors, their tables and their claims."""

import json

import numpy as np
import pytest

from motion_gym.benchmarks.claims.factor_sentences import FACTOR_CLAIMS
from motion_gym.benchmarks.claims.panels import HOLDS, compare, verdict
from motion_gym.benchmarks.claims.sentences import CLAIMS
from motion_gym.benchmarks.reports import factor_tables
from motion_gym.benchmarks.studies.factor_studies import BOTH, OWN, WRONG_D, WRONG_SIDE, passing_sides, swaps

TARGETS = {
    "right 0.3": {
        "scored": "orca:d=0.3,side=right,scenes=200",
        "side": "orca:d=0.1,side=right,scenes=200",
        "d": "orca:d=0.3,scenes=200",
        "wrong side": "orca:d=0.1,side=left,scenes=200",
        "wrong d": "orca:d=0.1,scenes=200",
    }
}


@pytest.fixture(scope="module")
def study():
    pytest.importorskip("torch")
    return json.loads(json.dumps(swaps("Swaps", ["modular", "modular_factors"], "factors", TARGETS, [0, 1], 32)))


def test_a_swap_of_a_factor_changes_this_factor_of_the_forecasts(study):
    values = study["rows"]["modular_factors"]["right 0.3"]["values"]
    mean = {case: {name: np.mean(by_seed) for name, by_seed in by.items()} for case, by in values.items()}
    assert {len(by_seed) for by in values.values() for by_seed in by.values()} == {2}
    assert mean[BOTH]["ADE"] < min(mean[WRONG_SIDE]["ADE"], mean[WRONG_D]["ADE"])
    assert mean[BOTH]["right"] > mean[WRONG_SIDE]["right"]
    assert mean[BOTH]["distance"] > mean[WRONG_D]["distance"] + 0.1
    assert mean[BOTH]["ADE"] < 1.5 * mean[OWN]["ADE"]


def test_changes_are_differences_of_the_values(study):
    for stored in (by_target["right 0.3"] for by_target in study["rows"].values()):
        for factor, wrong in (("side", WRONG_SIDE), ("d", WRONG_D)):
            for measure, (mean, low, high) in stored["changes"][factor].items():
                first, second = (np.mean(stored["values"][case][measure]) for case in (BOTH, wrong))
                assert mean == pytest.approx(first - second, abs=1e-9) and low <= mean <= high


def test_one_code_is_read_from_the_scenes_of_both_factors(study):
    values = study["rows"]["modular"]["right 0.3"]["values"]
    assert values[OWN]["ADE"] != values[BOTH]["ADE"] != values[WRONG_D]["ADE"]


def test_the_table_and_the_panel_show_the_study(study):
    table = factor_tables.swaps(study)
    assert [row[2] for row in table.rows[:4]] == [OWN, BOTH, WRONG_SIDE, WRONG_D] and len(table.rows) == 20
    panel = factor_tables.swap_panel("swaps", study)
    stored = study["rows"]["modular_factors"]["right 0.3"]["values"][BOTH]["ADE"]
    assert panel.errors["modular_factors, both right", "right 0.3, ADE"].tolist() == stored
    sentence = next(s for s in FACTOR_CLAIMS if "when the code of d is swapped" in s)
    claim = next(one for one in CLAIMS["factors"] if one.sentence == sentence)
    assert verdict(claim, compare([claim], [panel])) == HOLDS


def test_the_sides_of_simulated_crowds_are_counted():
    domains = {side: f"orca:d=0.3,side={side},scenes=60" for side in ("left", "right")}
    study = json.loads(json.dumps(passing_sides(domains)))
    assert study["places"]["left"]["right"] == [0, 0, 0] and study["places"]["right"]["right"] == [1, 1, 1]
    assert study["places"]["right"]["people"] == 2 * study["places"]["right"]["encounters"] > 100
    assert factor_tables.passing_sides(study).rows[0][-1] == ".000 [.000, .000]"
