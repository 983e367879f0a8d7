"""Coverage of regions that samples span."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_gym.contract import Forecast, Observation, SpecError, Truth
from motion_gym.metrics.calibration import inside


def forecast_of(samples, truth):
    """A forecast and a truth whose positions are the same at all steps."""
    agents = len(truth)
    history = np.zeros((agents, 8, 2), np.float32)
    observation = Observation(history, np.arange(agents + 1), np.arange(agents), 0.4)
    future = np.repeat(truth[:, None], 12, axis=1).astype(np.float32)
    positions = np.repeat(samples[:, :, None], 12, axis=2).astype(np.float32)
    return Forecast(positions), Truth(future, np.ones((agents, 12), bool), observation)


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.5, 0.9]), st.floats(0.1, 3), st.floats(-1, 1))
def test_truths_of_the_same_distribution_are_covered_as_often_as_stated(seed, share, spread, skew):
    rng = np.random.default_rng(seed)
    turn = np.array([[spread, skew], [0, 1]])
    samples, truth = rng.normal(size=(800, 200, 2)) @ turn, rng.normal(size=(800, 2)) @ turn
    covered = inside(*forecast_of(samples, truth), 12, share)
    # Four standard errors of a share of 800 agents.
    assert abs(covered.mean() - share) < 4 * np.sqrt(share * (1 - share) / 800) + 0.01


@pytest.mark.parametrize("share", [0.3, 0.9])
def test_coverage_is_that_of_the_definition(share):
    rng = np.random.default_rng(4)
    positions = (rng.normal(size=(40, 20, 12, 2)) * rng.uniform(0.2, 2, (40, 1, 12, 2))).astype(np.float32)
    future = rng.normal(size=(40, 12, 2)).astype(np.float32)
    _, truth = forecast_of(positions[:, :, 0], future[:, 0])
    forecast, truth = Forecast(positions), Truth(future, truth.known, truth.observation)
    for step in (1, 6, 12):
        expected = []
        for samples, place in zip(positions[:, :, step - 1].astype(float), future[:, step - 1], strict=True):
            precision = np.linalg.inv(np.cov(samples.T, bias=True))
            far = [(each - samples.mean(axis=0)) @ precision @ (each - samples.mean(axis=0)) for each in samples]
            off = place - samples.mean(axis=0)
            expected.append(float(off @ precision @ off <= np.quantile(far, share)))
        assert inside(forecast, truth, step, share).tolist() == expected


def test_samples_on_a_line_cover_nothing_beside_it():
    line = np.linspace(0, 1, 20)[:, None] * [1.0, 2.0]
    samples = np.repeat(line[None], 2, axis=0)
    assert inside(*forecast_of(samples, np.array([[0.5, 1.0], [1.5, 0.5]])), 3, 0.9).tolist() == [1, 0]


def test_samples_that_spread_too_little_cover_less():
    rng = np.random.default_rng(0)
    samples, truth = rng.normal(size=(400, 100, 2)), 2 * rng.normal(size=(400, 2))
    assert inside(*forecast_of(samples, truth), 4, 0.5).mean() < 0.25


def test_far_from_the_origin_nothing_changes():
    rng = np.random.default_rng(1)
    samples, truth = rng.normal(size=(50, 60, 2)), rng.normal(size=(50, 2))
    near, far = (inside(*forecast_of(samples + shift, truth + shift), 12, 0.9) for shift in (0, 1000))
    assert (near == far).mean() > 0.97  # float32 holds 1000 m to 0.1 mm


def test_unknown_truth_is_not_counted_and_few_samples_are_refused():
    rng = np.random.default_rng(2)
    forecast, truth = forecast_of(rng.normal(size=(3, 40, 2)), rng.normal(size=(3, 2)))
    known = truth.known.copy()
    known[1, 11] = False
    part = Truth(truth.future, known, truth.observation)
    assert np.isnan(inside(forecast, part, 12, 0.5)).tolist() == [False, True, False]
    with pytest.raises(SpecError, match="at least 20"):
        inside(Forecast(forecast.positions[:, :5]), truth, 12, 0.5)
    for share in (0.0, 1.0):
        with pytest.raises(SpecError, match="between 0 and 1"):
            inside(forecast, truth, 12, share)
