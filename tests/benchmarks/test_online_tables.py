"""Gain, recovery and forgetting as the tables of online adaptation give them, and the oracle beside them."""

import numpy as np
import pytest

import motion_gym
from motion_gym.benchmarks.reports import online_scores, online_tables
from motion_gym.benchmarks.reports import table as table_module
from motion_gym.contract import PredictorError, SpecError
from motion_gym.online.scores import BLOCK, EVERY, TRAIL
from motion_gym.predictors.linear import Linear

pytest.importorskip("torch")
from motion_gym.online.target_oracle import TargetOracle


def result(*segments, after=None, blocks=None, first=1):
    """A result of segments (domain, ADE, matured forecasts); ``after`` are trailing means after the first shift."""
    parts = [{"domain": d, "ade": {"mean": ade, "agent_windows": n}} for d, ade, n in segments]
    rows = [[TRAIL + EVERY * i, float(i), ade] for i, ade in enumerate(after or [])]
    shift = {"segment": first, "before": segments[first - 1][1], "after": rows}
    shift |= {} if blocks is None else {"blocks": [[BLOCK * n, 400.0 * n, ade] for n, ade in enumerate(blocks, 1)]}
    return {"stream": "a stream", "segments": parts, "shifts": [shift] if after or blocks else []}


def test_gain_is_of_means_over_seeds_after_the_first_segment():
    none = [result(("a", 9.0, 60), ("b", 0.5, 60)), result(("a", 9.0, 60), ("b", 0.3, 60))]
    mine = [result(("a", 1.0, 60), ("b", 0.3, 60)), result(("a", 1.0, 60), ("b", 0.3, 60))]
    oracle = [result(("a", 0.0, 60), ("b", 0.2, 60)), result(("a", 0.0, 60), ("b", 0.2, 60))]
    assert online_scores.gain_of(mine, none, oracle) == pytest.approx((0.4 - 0.3) / (0.4 - 0.2))
    assert online_scores.gain_of(mine, none, None) is None
    assert online_scores.gain_of(mine, oracle, none) is None  # an oracle that is worse is none


def phase(*blocks):
    return result(("a", 0.1, 60), ("b", 0.3, 100 * len(blocks)), blocks=blocks)


ORACLE_PHASE = phase(*[0.2] * 6)


def test_recovery_is_the_median_with_censored_runs_as_never():
    early, late, never = phase(*[0.2] * 6), phase(0.9, 0.9, *[0.2] * 4), phase(*[0.2] * 5, 0.9)
    assert online_scores.recovered([early, late, late], [ORACLE_PHASE] * 3) == "200 (800 s; 3 of 3)"
    assert online_scores.recovered([early, late, never], [ORACLE_PHASE] * 3) == "200 (800 s; 2 of 3)"
    assert online_scores.recovered([early, never, never], [ORACLE_PHASE] * 3) == "censored (1 of 3)"


def test_a_first_passage_is_no_recovery():
    """The error reaches the oracle's once and then stays a quarter above it."""
    passing = phase(0.2, *[0.25] * 5)
    assert online_scores.recovered([passing], [ORACLE_PHASE]) == "censored (0 of 1)"


def test_recovery_is_not_read_from_trailing_means_nor_from_short_phases():
    reached = result(("a", 0.1, 60), ("b", 0.3, 70), after=[0.1, 0.1], blocks=[])
    assert online_scores.recovered([reached], [reached]) == "censored (phase below 600)"
    short = phase(*[0.2] * 5)
    assert online_scores.recovered([short], [short]) == "censored (phase below 600)"
    assert online_scores.recovered([ORACLE_PHASE], None) == "-"


def test_only_the_first_change_of_domain_is_recovered_from():
    """What comes after a segment of few forecasts, or is not the first change, tells nothing of it."""
    few = result(("a", 0.1, TRAIL - 1), ("b", 0.3, 700), blocks=[0.1] * 7)
    later = result(("a", 0.1, 60), ("b", 0.3, 2), ("a", 0.1, 60), blocks=[0.1] * 7, first=2)
    assert online_scores.recovered([few], [few]) == online_scores.recovered([later], [later]) == "-"


def test_forgetting_is_growth_beyond_that_of_the_source_model():
    """Frames that are harder on return are no forgetting, and the second visit of what is adapted to is none either."""
    none = result(("a", 0.2, 60), ("b", 1.0, 60), ("a", 0.4, 60), ("b", 1.0, 60))
    mine = result(("a", 0.2, 60), ("b", 0.9, 60), ("a", 0.5, 60), ("b", 0.3, 60))
    assert online_scores.growth_on_return([mine], [none]) == [pytest.approx(0.25)]
    assert online_scores.growth_on_return([none], [none]) == [0.0]
    still = result(("a", 0.0, 60), ("b", 0.9, 60), ("a", 0.5, 60), ("b", 0.3, 60))
    assert online_scores.growth_on_return([still], [none]) == []
    other = {**none, "stream": "another seed"}
    assert online_scores.growth_on_return([mine], [other, none]) == [pytest.approx(0.25)]
    assert online_scores.growth_on_return([mine], [other]) == []


@pytest.fixture(scope="module")
def rows():
    """Results of real runs on a short stream of crowds."""
    stream = motion_gym.stream(["orca:d=0.3,scenes=150", "orca:d=0.6,scenes=150"], frames=1400, seed=0)
    runs = {"kalman": motion_gym.adapter("kalman", SOURCE), "none": motion_gym.adapter("none", SOURCE)}
    runs |= {"constant_velocity": motion_gym.predictor("constant_velocity")}
    identity = {"scoring_version": 1}
    cards = {row: motion_gym.evaluate_online(p, stream).as_dict() for row, p in runs.items()}
    return {row: [{"row": row, "identity": identity, **card}] for row, card in cards.items()}


SOURCE = "modular_invariant:weights=style,seed=0"


def test_the_table_of_a_stream_says_what_the_cards_say(rows):
    table = online_tables.stream_table("a stream", rows)
    assert [row[0] for row in table.rows] == ["none", "constant_velocity", "kalman"]
    cells = dict(zip(table.columns, table.rows[2], strict=True))
    (card,) = rows["kalman"]
    ade = card["ade"]
    assert cells["ADE [95 %]"] == table_module.interval(ade)
    assert cells["ADE on orca:d=0.6,scenes=150"] == table_module.number(card["segments"][1]["ade"]["mean"])
    assert cells["updates"] == str(card["updates"]) and "recovered after" not in cells  # without an oracle
    text = "; ".join(table.notes)
    assert "unit m, dt 0.4 s, horizon 4.8 s, scoring version 1" in text
    assert f"{ade['agent_windows']} matured forecasts of {ade['agents']} agents" in text
    assert "no oracle was named" in text and "10000 replicates" in text


def test_cards_hold_blocks_of_100_matured_forecasts(rows):
    (card,) = rows["none"]
    (shift,) = card["shifts"]
    matured = card["segments"][1]["ade"]["agent_windows"]
    assert [n for n, _, _ in shift["blocks"]] == list(range(BLOCK, matured + 1, BLOCK)) != []


def test_a_panel_of_a_shift_has_a_column_for_each_kind(rows):
    panel = online_tables.shift_panel("style", "Crowds", {"sudden": rows})
    (card,) = rows["kalman"]
    assert panel.errors["kalman", "sudden"] == [card["segments"][1]["ade"]["mean"]]
    after = {n: ade for n, _, ade in card["shifts"][0]["after"]}
    assert panel.errors["kalman", "last 50 at 100"] == [after[100]]
    assert panel.errors["kalman", "from 90 on"] == [np.mean([after[n] for n in range(140, max(after) + 1, 50)])]


def test_the_oracle_takes_the_predictor_of_the_domain_and_reads_its_style():
    oracle = TargetOracle({"orca:d=0.3": "constant_velocity", "orca:d=0.6": "modular_invariant:weights=style"})
    near, far = (motion_gym.domain(f"orca:d={d}", scenes=80) for d in (0.3, 0.6))
    seen = near.windows("test").observation
    with pytest.raises(SpecError, match=r"no oracle for orca:d=0\.3,scenes=80"):
        oracle.know(near)
    alone = TargetOracle("modular_invariant:weights=style")
    alone.know(far)
    read = alone.predict(seen).positions
    alone.know(near)
    assert not np.array_equal(read, alone.predict(seen).positions)
    assert "orca:d=0.1" in alone.trained_on and "validation windows" in alone.selection
    assert oracle.name == "oracle(constant_velocity, modular_invariant:weights=style)"


def test_who_is_not_trained_is_no_oracle():
    with pytest.raises(PredictorError, match="not trained"):
        TargetOracle("invariant:penalty=0.125")


def test_an_oracle_without_weights_is_fitted_to_the_scored_people():
    oracle, domain = TargetOracle("linear"), motion_gym.domain("orca:d=0.6,scenes=80")
    oracle.know(domain)
    truth = domain.windows("test")
    expected = Linear().fit([truth]).predict(truth.observation).positions
    np.testing.assert_array_equal(oracle.predict(truth.observation).positions, expected)
    assert oracle.selection == "fitted to the scored windows of each domain" and not oracle.trained_on


def test_the_regret_table_counts_the_seeds_within_two_percent():
    def run(mine, **experts):
        return {"ade": {"mean": mine}, "experts": experts}

    runs = [run(1.01, a=1.0, b=2.0), run(1.9, a=3.0, b=2.0), run(1.2, a=1.0, b=1.1)]
    table = online_tables.regret_table({"crowds": "Crowds"}, {("crowds", "sudden", "hedge"): runs})
    ((stream, row, _, _, *cells),) = table.rows
    assert (stream, row) == ("Crowds: sudden", "hedge")
    # +1 %, -5 % and +20 %.
    assert cells == ["+5.3 %", "+20.0 %", "2 of 3", "a (2), b (1)"]


def test_transfer_is_shown_beside_forgetting(rows):
    (none,), (mine,) = rows["none"], rows["kalman"]
    table = online_tables.stream_table("a stream", rows)
    cells = dict(zip(table.columns, table.rows[2], strict=True))
    first = [result["shifts"][0]["after"][0][2] for result in (mine, none)]
    assert cells["FWT"] == f"{100 * (1 - first[0] / first[1]):+.1f} %"
    assert "BWT" not in cells  # no domain comes back
