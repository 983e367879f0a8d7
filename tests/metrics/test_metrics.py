"""Metrics against slow references in plain Python, symmetries of the plane, and errors."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_gym.contract import DataError, Forecast, Observation, PredictorError, SpecError, Truth
from motion_gym.metrics import errors as metrics
from tests.metric_cases import cases, fast, make

pytestmark = pytest.mark.filterwarnings("error")


def plain_ade(track, truth, agent):
    errors = [math.dist(track[t], truth.future[agent, t]) for t in range(12) if truth.known[agent, t]]
    return sum(errors) / len(errors) if errors else math.nan


def plain_fde(track, truth, agent):
    return math.dist(track[11], truth.future[agent, 11]) if truth.known[agent, 11] else math.nan


def plain_scores(forecast, truth, k):
    """Every metric but KDE-NLL, one agent and one sample after the other."""
    positions, scene, agents = (
        forecast.positions.astype(float),
        truth.observation.scene,
        len(forecast.positions),
    )
    weights = forecast.weights if forecast.weights is not None else np.ones(positions.shape[:2])
    best = [max(range(len(w)), key=lambda i: (w[i], -i)) for w in weights]
    likely = [positions[a, best[a]] for a in range(agents)]
    number = min(k, positions.shape[1])
    out = {name: [math.nan] * agents for name in (f"JADE_{k}", f"JFDE_{k}")}
    out["ADE"] = [plain_ade(likely[a], truth, a) for a in range(agents)]
    out["FDE"] = [plain_fde(likely[a], truth, a) for a in range(agents)]
    out["MR_2m"] = [math.nan if math.isnan(e) else float(e > 2) for e in out["FDE"]]
    for name, error in (("ADE", plain_ade), ("FDE", plain_fde)):
        table = [[error(positions[a, i], truth, a) for i in range(number)] for a in range(agents)]
        out[f"min{name}_{k}"] = [min(row) for row in table]
        for first, last in pairwise(scene):
            there = [a for a in range(first, last) if not math.isnan(table[a][0])]
            total = [sum(table[a][i] for a in there) for i in range(number)]
            for a in there:
                out[f"J{name}_{k}"][a] = table[a][total.index(min(total))]
    out[f"MR_2m_{k}"] = [math.nan if math.isnan(e) else float(e > 2) for e in out[f"minFDE_{k}"]]
    hit = [0.0] * agents
    for first, last in pairwise(scene):
        for a in range(first, last):
            for b in range(first, last):
                if a != b and any(math.dist(likely[a][t], likely[b][t]) < 0.2 for t in range(12)):
                    hit[a] = 1.0
    out["collision_0.2m"] = hit
    return out


@fast
@given(cases(), st.integers(2, 6))
def test_equal_to_plain_python(case, k):
    forecast, truth = case
    k = min(k, forecast.positions.shape[1]) if forecast.positions.shape[1] > 1 else k
    scores = metrics.score(forecast, truth, k)
    expected = plain_scores(forecast, truth, k)
    assert set(scores) == {*expected, f"KDE_NLL_{k}"}
    for name, values in expected.items():
        np.testing.assert_allclose(scores[name], values, rtol=1e-9, atol=1e-12, err_msg=name)
        assert scores[name].dtype == np.float64


@pytest.mark.parametrize("k", [1, 5])
def test_metrics_that_hold_a_length_in_metres_are_left_out_of_other_units(k):
    forecast, truth = make([3, 2], all_known=True)
    metres, pixels = metrics.score(forecast, truth, k), metrics.score(forecast, truth, k, unit="px")
    assert not {name for name in pixels if name.startswith(("MR", "collision", "KDE"))}
    assert set(metres) - set(pixels) == {n for n in metres if n.startswith(("MR", "collision", "KDE"))}
    assert {row.unit for row in metrics.metric_rows(k, "px")} == {"px"}
    assert {row.unit for row in metrics.metric_rows(k) if row.name.startswith(("MR", "collision"))} == {"1"}
    for name, values in pixels.items():
        np.testing.assert_array_equal(values, metres[name])


@fast
@given(cases(weighted=False), st.data())
def test_order_of_the_metrics(case, data):
    forecast, truth = case
    k = data.draw(st.integers(1, forecast.positions.shape[1]))
    for one, least, joint in (
        (metrics.ade, metrics.min_ade, metrics.joint_ade),
        (metrics.fde, metrics.min_fde, metrics.joint_fde),
    ):
        there = ~np.isnan(one(forecast, truth))
        single, best, scene = (
            values[there] for values in (one(forecast, truth), least(forecast, truth, k), joint(forecast, truth, k))
        )
        assert (best <= single).all()
        assert (best <= scene).all()
        index = truth.observation.scene_index[there]
        sums = [np.bincount(index, values) for values in (scene, single)]
        assert (sums[0] <= sums[1] + 1e-9).all()
        if k > 1:
            assert (best <= least(forecast, truth, k - 1)[there]).all()
            before = np.bincount(index, joint(forecast, truth, k - 1)[there])
            assert (sums[0] <= before + 1e-9).all()
        np.testing.assert_array_equal(joint(forecast, truth, 1), one(forecast, truth))


@fast
@given(cases(), st.floats(-math.pi, math.pi), st.tuples(st.floats(-50, 50), st.floats(-50, 50)))
def test_invariant_under_rotation_and_translation(case, angle, shift):
    forecast, truth = case
    k = forecast.positions.shape[1]
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    moved_forecast = Forecast((forecast.positions @ turn.T + shift).astype(np.float32), forecast.weights)
    moved_truth = Truth((truth.future @ turn.T + shift).astype(np.float32), truth.known, truth.observation)
    before, after = metrics.score(forecast, truth, k), metrics.score(moved_forecast, moved_truth, k)
    for name in before:
        # Float32 resolves 4e-6 m at 50 m; a kernel of 1 cm turns that into 5e-3 of log density at 12 widths.
        tolerance = 5e-3 if name.startswith("KDE") else 2e-5
        np.testing.assert_allclose(after[name], before[name], rtol=1e-5, atol=tolerance, err_msg=name)


@fast
@given(cases(), st.integers(0, 2**32 - 1))
def test_scenes_and_their_agents_may_come_in_any_order(case, seed):
    forecast, truth = case
    k, scene, rng = forecast.positions.shape[1], truth.observation.scene, np.random.default_rng(seed)
    scenes = [rng.permutation(np.arange(a, b)) for a, b in pairwise(scene)]
    scenes = [scenes[i] for i in rng.permutation(len(scenes))]
    order = np.concatenate([np.empty(0, int), *scenes])
    observation = Observation(
        truth.observation.history[order],
        np.concatenate([[0], np.cumsum([len(s) for s in scenes])]).astype(np.int64),
        truth.observation.agent[order],
        0.4,
    )
    weights = None if forecast.weights is None else forecast.weights[order]
    shuffled = Forecast(forecast.positions[order], weights)
    before = metrics.score(forecast, truth, k)
    after = metrics.score(shuffled, Truth(truth.future[order], truth.known[order], observation), k)
    for name in before:
        np.testing.assert_allclose(after[name], before[name][order], rtol=1e-12, err_msg=name)


@fast
@given(cases())
def test_what_is_not_known_is_never_read(case):
    forecast, truth = case
    k = forecast.positions.shape[1]
    for junk in (-3, 1e6):
        future = np.where(truth.known[..., None], truth.future, np.float32(junk))
        other = metrics.score(forecast, Truth(future, truth.known, truth.observation), k)
        for name, values in metrics.score(forecast, truth, k).items():
            np.testing.assert_array_equal(other[name], values, err_msg=name)


def test_nan_exactly_where_nothing_can_be_measured():
    forecast, truth = make([3], all_known=True)
    truth.known[0] = False
    truth.known[1, 11] = False
    scores = metrics.score(forecast, truth, 5)
    for name, values in scores.items():
        forecasts_alone = name == "collision_0.2m"
        expected = [not forecasts_alone, not forecasts_alone and ("FDE" in name or "MR" in name), False]
        assert np.isnan(values).tolist() == expected, name


def test_the_most_likely_sample_is_scored():
    forecast, truth = make([2], samples=3, all_known=True)
    forecast.positions[0, 2], forecast.positions[1, 1] = truth.future[0], truth.future[1]
    weighted = Forecast(forecast.positions, np.array([[1, 2, 9], [1, 2, 1]], np.float32))
    assert (metrics.ade(weighted, truth) == 0).all()
    assert (metrics.ade(forecast, truth) > 0).all()


def test_joint_sample_is_shared_by_a_scene_and_only_by_it():
    _, truth = make([2, 1], all_known=True)
    offset = np.array([[0, 3], [2, 0], [5, 1]], np.float32)
    positions = truth.future[:, None] + offset[:, :, None, None] * np.array([1, 0], np.float32)
    assert metrics.joint_ade(Forecast(positions), truth, 2) == pytest.approx([0, 2, 1], abs=1e-5)
    assert metrics.min_ade(Forecast(positions), truth, 2) == pytest.approx([0, 0, 1], abs=1e-5)


def test_ade_and_fde_choose_their_joint_sample_apart():
    _, truth = make([1], samples=2, all_known=True)
    positions = np.repeat(truth.future[:, None], 2, axis=1)
    positions[0, 0, :11, 0] += 2
    positions[0, 1, 11, 0] += 3
    forecast = Forecast(positions)
    assert metrics.joint_ade(forecast, truth, 2) == pytest.approx([0.25], abs=1e-5)
    assert metrics.joint_fde(forecast, truth, 2) == pytest.approx([0], abs=1e-5)


@pytest.mark.parametrize(("gap", "expected"), [(0.19, 1), (0.21, 0)])
def test_collision_is_closer_than_20_centimetres_in_the_same_scene(gap, expected):
    _, truth = make([2, 1, 1], all_known=True)
    positions = np.zeros((4, 1, 12, 2), np.float32)
    positions[:2, 0, :, 0] = [[0], [9]]
    positions[1, 0, 7, 0] = gap
    positions[2:] = 100
    assert metrics.collision_rate(Forecast(positions), truth).tolist() == [expected, expected, 0, 0]


def test_collision_does_not_depend_on_how_many_pairs_fit_in_memory(monkeypatch):
    forecast, truth = make([9, 30, 1, 17], seed=3)
    whole = metrics.collision_rate(forecast, truth)
    monkeypatch.setattr(metrics, "PAIRS_AT_ONCE", 7)
    np.testing.assert_array_equal(metrics.collision_rate(forecast, truth), whole)
    assert 0 < whole.sum() < len(whole)


def test_error_by_horizon_averages_to_ade_and_ends_with_fde():
    forecast, truth = make([4, 3], seed=2, all_known=True)
    errors = metrics.error_by_horizon(forecast, truth)
    assert errors.shape == (7, 12)
    np.testing.assert_allclose(errors.mean(axis=1), metrics.ade(forecast, truth))
    truth.known[2, 5] = False
    assert np.argwhere(np.isnan(metrics.error_by_horizon(forecast, truth))).tolist() == [[2, 5]]


def test_no_agents():
    forecast, truth = make([], samples=4)
    for k in (1, 4):
        assert all(values.shape == (0,) for values in metrics.score(forecast, truth, k).values())
    assert metrics.error_by_horizon(forecast, truth).shape == (0, 12)


def test_one_sample_stands_for_any_k():
    forecast, truth = make([3, 2], samples=1)
    scores = metrics.score(forecast, truth, 20)
    for name in ("minADE_20", "JADE_20"):
        np.testing.assert_array_equal(scores[name], scores["ADE"])
    np.testing.assert_array_equal(scores["MR_2m_20"], scores["MR_2m"])
    assert np.isnan(scores["KDE_NLL_20"]).all()


def test_rows_of_the_table():
    assert [m.name for m in metrics.metric_rows(1)] == ["ADE", "FDE", "MR_2m", "collision_0.2m"]
    names = [m.name for m in metrics.metric_rows(20)]
    assert names[4:] == ["minADE_20", "minFDE_20", "JADE_20", "JFDE_20", "MR_2m_20", "KDE_NLL_20"]
    assert not any("{" in m.name + m.description for m in metrics.metric_rows(20))


def damaged(change):
    forecast, truth = make([2, 3], all_known=True)
    forecast.positions[3, 1, 4, 0] = np.nan
    good = make([2, 3], all_known=True)[0].positions
    return {
        "flat": Forecast(good[:, 0]),
        "steps": Forecast(good[:, :, :11]),
        "agents": Forecast(good[:4]),
        "none": Forecast(good[:, :0]),
        "text": Forecast(good.astype(object)),
        "nan": forecast,
        "list": Forecast(good.tolist()),
        "weights": Forecast(good, np.ones((5, 3))),
        "log weights": Forecast(good, -np.ones((5, 5))),
    }[change], truth


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("flat", r"shape \(5, 12, 2\) for 5 agents, expected \(5, K, 12, 2\).*positions\[:, None\]"),
        ("steps", r"shape \(5, 5, 11, 2\) for 5 agents, expected \(5, K, 12, 2\)"),
        ("agents", r"shape \(4, 5, 12, 2\) for 5 agents, expected \(5, K, 12, 2\)"),
        ("none", r"The predictor returned 0 samples"),
        ("text", "object"),
        ("nan", r"NaN or infinite positions for 1 of 5 agents, the first in row 3"),
        ("list", r"returned list; return a Forecast or a numpy array"),
        ("weights", r"weights of shape \(5, 3\): expected \(5, 5\)"),
        ("log weights", "not negative"),
    ],
)
def test_a_bad_forecast_is_told_what_is_wrong(change, message):
    forecast, truth = damaged(change)
    for k in (1, 2):
        with pytest.raises(PredictorError, match=message):
            metrics.score(forecast, truth, k)


def test_too_few_samples_for_k():
    forecast, truth = make([2], samples=5)
    with pytest.raises(PredictorError, match=r"has 5 samples, but k = 20.*samples=20"):
        metrics.score(forecast, truth, 20)
    with pytest.raises(SpecError, match="k is 0"):
        metrics.score(forecast, truth, 0)


def test_a_truth_that_contradicts_itself():
    forecast, truth = make([2, 3], all_known=True)
    observation = Observation(truth.observation.history, np.array([0, 2, 4]), truth.observation.agent, 0.4)
    with pytest.raises(DataError, match="rise from 0 to the 5 agents"):
        metrics.ade(forecast, Truth(truth.future, truth.known, observation))
    with pytest.raises(DataError, match="known"):
        metrics.ade(forecast, Truth(truth.future, truth.known[:, :3], truth.observation))
    with pytest.raises(DataError, match="must be finite, and 0 where they are not known"):
        metrics.ade(forecast, Truth(np.full_like(truth.future, np.nan), truth.known, truth.observation))
