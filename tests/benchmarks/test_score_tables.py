"""Tables of single runs: what they say is what the cards say."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

import motion_gym
from motion_gym.benchmarks.reports import score_tables
from motion_gym.benchmarks.reports.conditions import in_order
from motion_gym.contract import DataError
from tests.scored_runs import scored

CROWD = motion_gym.domain("orca", d=0.6, scenes=30)


@pytest.fixture(scope="module")
def results():
    """k = 1: two predictors and the oracle."""
    return [scored(name, CROWD) for name in ("orca_oracle", "stand_still", "constant_velocity")]


@pytest.fixture(scope="module")
def best_of_20():
    return [scored(name, CROWD, protocol="paper") for name in ("constant_velocity", "linear")]


def number(value):
    return f"{value:.3f}".replace("0.", ".", 1) if abs(value) < 1 else f"{value:.3f}"


def printed(table, width):
    out = io.StringIO()
    Console(file=out, width=width).print(table)
    return out.getvalue()


def test_rows_say_what_the_results_say(results):
    table = score_tables.domain_table(results)
    metrics = results[2]["metrics"]
    ade, fde = metrics["ADE"], metrics["FDE"]
    assert list(table.columns) == ["predictor", "ADE [95 %], m", "FDE [95 %], m", "ADE vs. const. velocity, m"]
    assert table.rows[0] == [
        "constant_velocity",
        f"{number(ade['mean'])} [{number(ade['low'])}, {number(ade['high'])}]",
        f"{number(fde['mean'])} [{number(fde['low'])}, {number(fde['high'])}]",
        "-",
    ]
    difference = results[1]["metrics"]["ADE"]["mean"] - ade["mean"]
    assert table.rows[1][3].startswith(f"+{number(difference)} [+")
    assert table.rows[2][0] == "orca_oracle (oracle)"
    assert table.rows[2][3].startswith(f"-{number(ade['mean'])} [-")
    assert table.notes[0] == "data: simulated by motion-gym"
    assert table.notes[1].startswith(
        f"means over {ade['agent_windows']} agent-windows of {ade['agents']} agents in {ade['scenes']} scenes"
    )


def test_rows_are_in_the_order_of_what_they_know(results):
    fitted = scored("linear", CROWD)
    trained = {**results[1], "predictor": "erm:weights=spurious,seed=0", "selection": "the last epoch"}
    filtered = {**results[1], "predictor": "constant_velocity:velocity=4"}
    ordered = in_order([results[0], trained, fitted, filtered, results[2]])
    assert [r["predictor"].split(":weights")[0] for r in ordered] == [
        "constant_velocity",
        "constant_velocity:velocity=4",
        "linear",
        "erm",
        "orca_oracle",
    ]


@pytest.mark.parametrize("width", [80, 120])
def test_every_line_fits(results, best_of_20, width):
    for rows in (results, best_of_20):
        assert max(map(len, printed(score_tables.domain_table(rows), width).splitlines())) <= width


def test_every_number_of_20_samples_has_its_name(best_of_20):
    table = score_tables.domain_table(best_of_20)
    cells = dict(zip(table.columns, table.rows[1], strict=True))
    metrics = best_of_20[1]["metrics"]
    for column, names in (("minADE/FDE_20", ("minADE_20", "minFDE_20")), ("JADE/JFDE_20", ("JADE_20", "JFDE_20"))):
        assert cells[column] == " / ".join(number(metrics[name]["mean"]) for name in names)
    assert "KDE_NLL_20, nat" in cells


def test_agents_without_a_density_are_counted(best_of_20):
    result = best_of_20[1]
    (name,) = [name for name in result["metrics"] if name.startswith("KDE_NLL")]
    total = result["metrics"]["ADE"]["agent_windows"]
    short = {**result["metrics"], name: {**result["metrics"]["ADE"], "agent_windows": total - 7}}
    notes = score_tables.domain_table([{**result, "metrics": short}]).notes
    assert f"{name} (k = 20) could not be computed for 7 agent-windows" in notes


def test_conditions_name_unit_step_horizon_version_and_replicates(results):
    text = "; ".join(score_tables.conditions(results))
    for part in ("protocol honest, k = 1", "unit m, dt 0.4 s, horizon 4.8 s, scoring version 1", "no weights"):
        assert part in text
    assert "10000 replicates" in text  # of 60 agents
    quick = [{**r, "domain": {**r["domain"], "unit": "px", "dt": 0.1}} for r in results]
    assert "unit px, dt 0.1 s, horizon 1.2 s" in "; ".join(score_tables.conditions(quick))
    assert "ADE [95 %], px" in score_tables.domain_table(quick).columns


def test_units_and_scoring_versions_are_not_mixed(results):
    pixels = {**results[1], "domain": {**results[1]["domain"], "unit": "px"}}
    with pytest.raises(DataError, match="cannot mix results in m and px"):
        score_tables.domain_table([results[0], pixels])
    later = {**results[1], "identity": {**results[1]["identity"], "scoring_version": 2}}
    with pytest.raises(DataError, match=r"1 \(as .*\) and 2 \(as stand_still\).*Make the results of one version again"):
        score_tables.conditions([results[0], later])


def test_seed_is_shown_where_it_is_not_0(results):
    assert score_tables.label({**results[1], "seed": 7}) == "stand_still, seed 7"
    assert score_tables.label({**results[0], "seed": 7}) == "orca_oracle, seed 7 (oracle)"


def test_leaks_stand_under_the_table(results):
    row = {**results[1], "leaks": ["oracle side channel: sigma reads the future"]}
    assert "sigma reads the future" in score_tables.domain_table([row]).notes[-1]
