"""The clustered bootstrap against a plain loop, theory where there is one, and constant velocity on eth."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_gym.contract import Forecast, Observation, SpecError, Truth
from motion_gym.metrics import bootstrap
from motion_gym.metrics import errors as metrics
from motion_gym.metrics.bootstrap import clustered_interval, paired_difference, summarise

pytestmark = pytest.mark.filterwarnings("error")
fast = settings(max_examples=50, deadline=None)


@st.composite
def samples(draw):
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    agents = draw(st.integers(0, 40))
    values = rng.gamma(2.0, 1.0, agents)
    values[rng.random(agents) < draw(st.sampled_from([0, 0.3, 1]))] = np.nan
    return values, rng.integers(0, draw(st.integers(1, 12)), agents) * 7 - 20


def plain_interval(values, cluster, level, replicates, seed):
    """Resamples ids one replicate at a time and pools their values."""
    ids, rng = sorted(set(cluster.tolist())), np.random.default_rng(seed)
    groups = [values[(cluster == i) & np.isfinite(values)] for i in ids]
    everything = np.concatenate([np.empty(0), *groups])
    mean = everything.mean() if len(everything) else np.nan
    if sum(len(group) > 0 for group in groups) < 2:
        return mean, np.nan, np.nan
    means = []
    for _ in range(replicates):
        pooled = np.concatenate([groups[i] for i in rng.integers(len(ids), size=len(ids))])
        if len(pooled):
            means.append(pooled.mean())
    return mean, np.quantile(means, (1 - level) / 2), np.quantile(means, (1 + level) / 2)


@fast
@given(samples(), st.sampled_from([0.5, 0.95]), st.integers(1, 60), st.integers(0, 5))
def test_equal_to_a_plain_loop(sample, level, replicates, seed):
    result = clustered_interval(*sample, level=level, replicates=replicates, seed=seed)
    np.testing.assert_allclose(result, plain_interval(*sample, level, replicates, seed), rtol=1e-9)
    assert all(isinstance(part, float) for part in result)


@fast
@given(samples(), st.integers(0, 2**32 - 1))
def test_order_of_rows_does_not_matter(sample, seed):
    values, cluster = sample
    order = np.random.default_rng(seed).permutation(len(values))
    shuffled = clustered_interval(values[order], cluster[order], replicates=50)
    np.testing.assert_allclose(shuffled, clustered_interval(values, cluster, replicates=50), rtol=1e-12)


@fast
@given(samples(), st.integers(2, 5))
def test_repeating_the_windows_of_agents_adds_no_certainty(sample, times):
    values, cluster = sample
    repeated = clustered_interval(np.repeat(values, times), np.repeat(cluster, times), replicates=50)
    np.testing.assert_allclose(repeated, clustered_interval(values, cluster, replicates=50), rtol=1e-12)


def test_metrics_side_by_side_are_as_each_alone():
    rng = np.random.default_rng(0)
    values, cluster = rng.random((60, 3)), rng.integers(0, 9, 60)
    values[:, 1] = np.nan
    together = clustered_interval(values[None], cluster, replicates=200)
    assert together.mean.shape == (3,)
    for column in range(3):
        alone = clustered_interval(values[:, column], cluster, replicates=200)
        np.testing.assert_allclose([part[column] for part in together], alone, rtol=1e-12)


def test_blocks_do_not_change_the_draws(monkeypatch):
    rng = np.random.default_rng(1)
    values, cluster = rng.random(200), rng.integers(0, 50, 200)
    whole = clustered_interval(values, cluster, replicates=101)
    for draws in (1, 333):
        monkeypatch.setattr(bootstrap, "DRAWS_AT_ONCE", draws)
        np.testing.assert_allclose(clustered_interval(values, cluster, replicates=101), whole, rtol=1e-12)


def test_seed_decides():
    rng = np.random.default_rng(2)
    values, cluster = rng.random(100), rng.integers(0, 20, 100)
    assert clustered_interval(values, cluster, seed=3) == clustered_interval(values, cluster, seed=3)
    assert clustered_interval(values, cluster, seed=3) != clustered_interval(values, cluster, seed=4)


def test_width_is_that_of_the_normal_theory():
    values = np.random.default_rng(3).normal(5, 2, 2000)
    mean, low, high = clustered_interval(values, np.arange(2000), replicates=4000)
    half = 1.96 * values.std() / np.sqrt(2000)
    assert low == pytest.approx(mean - half, abs=half / 8)
    assert high == pytest.approx(mean + half, abs=half / 8)


@pytest.mark.parametrize(("values", "mean"), [([], np.nan), ([np.nan, np.nan], np.nan), ([1.0, 3.0], 2.0)])
def test_one_cluster_has_no_interval(values, mean):
    result = clustered_interval(np.array(values), np.zeros(len(values), int))
    np.testing.assert_array_equal(result, [mean, np.nan, np.nan])
    difference = paired_difference(np.array(values), np.zeros(len(values)), np.zeros(len(values), int))
    np.testing.assert_array_equal([difference.mean, difference.low, difference.p_value], [mean, np.nan, np.nan])


@fast
@given(samples(), st.integers(0, 9))
def test_swapping_a_and_b_mirrors_the_difference(sample, seed):
    a, cluster = sample
    b = a + np.random.default_rng(seed).normal(0.1, 1, len(a))
    one = paired_difference(a, b, cluster, replicates=99, seed=seed)
    two = paired_difference(b, a, cluster, replicates=99, seed=seed)
    left = [one.mean, one.low, one.high, one.p_value, one.n]
    np.testing.assert_allclose(left, [-two.mean, -two.high, -two.low, two.p_value, two.n], rtol=1e-9, atol=1e-12)


def test_the_difference_is_paired():
    rng = np.random.default_rng(4)
    a, cluster = rng.gamma(2, 3, 300), rng.integers(0, 40, 300)
    b = a + 0.05 + rng.normal(0, 0.01, 300)
    result = paired_difference(a, b, cluster)
    assert -0.06 < result.low < result.mean < result.high < -0.04
    assert result.p_value == pytest.approx(2 / 10_001)
    assert clustered_interval(a, cluster).high > clustered_interval(b, cluster).low


def test_only_pairs_are_compared():
    a, b = np.array([1, np.nan, 3, 5.0]), np.array([0, 0, np.nan, 2.0])
    result = paired_difference(a, b, np.arange(4))
    assert (result.mean, result.n) == (2.0, 2)


def test_p_values_are_uniform_when_nothing_differs():
    rng = np.random.default_rng(5)
    p = []
    for _ in range(300):
        cluster = rng.integers(0, 60, 200)
        difference = rng.normal(size=200) + rng.normal(size=60)[cluster]
        p.append(paired_difference(difference, np.zeros(200), cluster, replicates=199).p_value)
    assert 0.02 <= np.mean(np.array(p) <= 0.05) <= 0.1
    assert 0.4 < np.mean(p) < 0.6
    assert paired_difference(difference, difference, cluster).p_value == 1.0


@pytest.mark.parametrize(("agents", "replicates"), [(2, 10_000), (999, 10_000), (1000, 1000), (10_000, 1000)])
def test_small_samples_get_ten_thousand_replicates(agents, replicates):
    assert bootstrap.replicates_for(agents) == replicates
    rng = np.random.default_rng(0)
    a, cluster = rng.normal(1, 0.01, agents), np.arange(agents)
    # All replicates lie above 0, so that the p-value is the smallest that their number allows.
    assert paired_difference(a, np.zeros(agents), cluster).p_value == pytest.approx(2 / (replicates + 1))


@fast
@given(samples(), st.integers(1, 4))
def test_draws_that_agree_add_nothing(sample, draws):
    values, cluster = sample
    alone = clustered_interval(values, cluster, replicates=60)
    over = clustered_interval(np.tile(values, (draws, 1)), cluster, replicates=60)
    np.testing.assert_allclose(over, alone, rtol=1e-9)


def plain_interval_over_draws(values, cluster, replicates, seed):
    """Resamples draws and agents one replicate at a time and pools their values."""
    ids = np.unique(cluster)
    by_draw, by_agent = np.random.default_rng((seed, 1)), np.random.default_rng(seed)
    means = []
    for _ in range(replicates):
        agents = by_agent.integers(len(ids), size=len(ids))
        draws = by_draw.integers(len(values), size=len(values))
        rows = np.concatenate([np.flatnonzero(cluster == ids[agent]) for agent in agents])
        means.append(np.nanmean(values[draws][:, rows]))
    return np.nanmean(values), *np.quantile(means, [0.025, 0.975])


@fast
@given(st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_draws_and_agents_are_resampled_together(draws, seed):
    rng = np.random.default_rng(seed)
    values, cluster = rng.normal(size=(draws, 40)), np.arange(40) % 7
    values[:, 5] = np.nan
    interval = clustered_interval(values, cluster, replicates=50, seed=3)
    np.testing.assert_allclose(interval, plain_interval_over_draws(values, cluster, 50, 3), rtol=1e-9)
    metrics = clustered_interval(np.stack([values, values + 1], axis=2), cluster, replicates=50, seed=3)
    np.testing.assert_allclose([part[0] for part in metrics], interval, rtol=1e-9)


def test_an_interval_over_draws_has_the_width_of_both_sources():
    rng = np.random.default_rng(6)
    draws, agents = 200, 400
    values = rng.normal(0, 1, (draws, 1)) + rng.normal(0, 2, (1, agents))
    _, low, high = clustered_interval(values, np.arange(agents), replicates=4000)
    half = 1.96 * np.sqrt(values.mean(axis=1).var() / draws + values.mean(axis=0).var() / agents)
    assert (high - low) / 2 == pytest.approx(half, rel=0.08)
    difference = paired_difference(values, np.zeros(agents), np.arange(agents), replicates=4000)
    assert (difference.low, difference.high, difference.n) == (low, high, agents)


def test_a_summary_over_draws_counts_agent_windows_once():
    observation = Observation(np.zeros((3, 8, 2)), np.array([0, 3]), np.arange(3), 0.4)
    summary = summarise({"ADE": np.array([[1.0, 2, np.nan], [3.0, 4, np.nan]])}, observation)["ADE"]
    assert (summary.mean, summary.agent_windows, summary.agents) == (2.5, 2, 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"level": 95}, "level is 95"),
        ({"replicates": 0}, "replicates is 0"),
        ({"cluster": np.arange(4)}, r"cluster has shape \(4,\), expected \(3,\)"),
        ({"values": np.array([1, np.inf, 2])}, "infinite"),
        ({"values": np.zeros((1, 3, 1, 1))}, r"\(1, 3, 1, 1\), expected \[A\], \[D, A\] or \[D, A, M\]"),
    ],
)
def test_bad_arguments_are_named(change, message):
    with pytest.raises(SpecError, match=message):
        clustered_interval(**{"values": np.arange(3.0), "cluster": np.arange(3), **change})


def test_pairs_must_fit():
    with pytest.raises(SpecError, match=r"\(1, 3\) and \(1, 4\)"):
        paired_difference(np.zeros(3), np.zeros(4), np.arange(3))
    for a, b in (((1, 1, 3), (3,)), ((3,), (1, 1, 3)), ((2, 3), (3, 3))):
        with pytest.raises(SpecError, match="have shapes"):
            paired_difference(np.zeros(a), np.zeros(b), np.arange(3))
    for infinite in ((np.inf, 0.0), (0.0, np.inf)):
        with pytest.raises(SpecError, match="infinite"):
            paired_difference(*(np.full(2, value) for value in infinite), np.arange(2))
    with pytest.raises(SpecError, match="infinite"):
        paired_difference(np.array([np.inf, 1.0]), np.array([np.inf, 2.0]), np.arange(2))


def test_summary_counts_what_stands_behind_a_mean():
    observation = Observation(np.zeros((5, 8, 2)), np.array([0, 2, 2, 3, 5]), np.array([4, 9, 4, 9, 8]), 0.4)
    scores = {"ADE": np.arange(5.0), "FDE": np.array([1, np.nan, 3, np.nan, np.nan])}
    result = summarise(scores, observation)
    assert list(result) == ["ADE", "FDE"]
    whole, part = result["ADE"], result["FDE"]
    assert (whole.mean, whole.agent_windows, whole.scenes, whole.agents) == (2.0, 5, 3, 3)
    assert (part.mean, part.agent_windows, part.scenes, part.agents) == (2.0, 2, 2, 1)
    assert (whole.low, whole.high) == clustered_interval(scores["ADE"], observation.agent)[1:]
    assert np.isnan([part.low, part.high]).all()
    assert summarise({}, observation) == {}


def eth_windows():
    """Truth of every window of eth: 20 consecutive listed frames, at least 2 agents in all of them."""
    root = Path(__file__).parents[2]
    path = Path(os.environ.get("MOTION_GYM_SHARED", root.parent / "shared")) / "data/eth_ucy/biwi_eth.txt"
    if not path.exists():
        pytest.skip(f"needs {path}; set MOTION_GYM_SHARED to the folder that holds data/eth_ucy")
    rows = np.loadtxt(path)
    frames, ids = np.unique(rows[:, 0]), np.unique(rows[:, 1])
    grid = np.full((len(ids), len(frames), 2), np.nan)
    grid[np.searchsorted(ids, rows[:, 1]), np.searchsorted(frames, rows[:, 0])] = rows[:, 2:4]
    tracks, agents, scene = [], [], [0]
    for start in range(len(frames) - 19):
        window = grid[:, start : start + 20]
        complete = np.flatnonzero(np.isfinite(window).all(axis=(1, 2)))
        if len(complete) >= 2:
            tracks.append(window[complete])
            agents.append(complete)
            scene.append(scene[-1] + len(complete))
    track = np.concatenate(tracks).astype(np.float32)
    observation = Observation(track[:, :8], np.array(scene), np.concatenate(agents), 0.4)
    return Truth(track[:, 8:], np.ones((len(track), 12), bool), observation)


def test_constant_velocity_on_eth():
    truth = eth_windows()
    last, before = truth.observation.xy[:, -1], truth.observation.xy[:, -2]
    steps = np.arange(1, 13, dtype=np.float32)[:, None]
    forecast = Forecast((last[:, None] + (last - before)[:, None] * steps)[:, None])
    result = summarise(metrics.score(forecast, truth), truth.observation)
    one, final = result["ADE"], result["FDE"]
    assert (one.agent_windows, one.scenes, one.agents) == (181, 70, 36)
    assert one.mean == pytest.approx(0.995, abs=5e-4)
    assert final.mean == pytest.approx(2.234, abs=5e-4)
    # Over seeds the lower end moves by 0.01 m, the upper one by 0.02 m; with 1,000 replicates by 0.05 m.
    for seed in range(3):
        one = summarise(metrics.score(forecast, truth), truth.observation, seed=seed)["ADE"]
        assert (one.low, one.high) == (pytest.approx(0.666, abs=0.01), pytest.approx(1.415, abs=0.02))


def test_a_summary_has_the_interval_of_its_options():
    rng = np.random.default_rng(5)
    observation = Observation(np.zeros((9, 8, 2), np.float32), np.array([0, 4, 9]), np.arange(9) % 5, 0.4)
    values = rng.normal(size=9)
    for level, replicates, seed in ((0.5, 30, 3), (0.9, 77, 1)):
        result = summarise({"ADE": values}, observation, level, replicates, seed)["ADE"]
        expected = clustered_interval(values, observation.agent, level, replicates, seed)
        assert (result.mean, result.low, result.high) == expected and result.replicates == replicates
    assert summarise({"ADE": values}, observation)["ADE"].replicates == bootstrap.replicates_for(5)
