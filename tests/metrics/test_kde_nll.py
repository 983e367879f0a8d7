"""The negative log density of a kernel estimate."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from scipy.stats import gaussian_kde

from motion_gym.contract import Forecast, PredictorError
from motion_gym.metrics import errors as metrics
from tests.metric_cases import cases, fast, make

pytestmark = pytest.mark.filterwarnings("error")


@pytest.mark.parametrize("weighted", [False, True])
def test_kde_nll_is_scipys(weighted):
    forecast, truth = make([3, 4], samples=20, seed=1, weighted=weighted)
    expected = []
    for a in range(7):
        losses = []
        for t in np.flatnonzero(truth.known[a]):
            weights = forecast.weights[a] if weighted else None
            kernels = gaussian_kde(forecast.positions[a, :, t].T.astype(float), weights=weights)
            losses.append(min(20.0, -kernels.logpdf(truth.future[a, t].astype(float))[0]))
        expected.append(np.mean(losses) if losses else np.nan)
    np.testing.assert_allclose(metrics.kde_nll(forecast, truth, 20), expected, rtol=1e-6)
    assert np.isfinite(expected).sum() >= 5


def test_kde_nll_uses_the_first_k_samples():
    forecast, truth = make([4], samples=9, all_known=True)
    first = Forecast(forecast.positions[:, :5])
    np.testing.assert_array_equal(metrics.kde_nll(forecast, truth, 5), metrics.kde_nll(first, truth, 5))
    assert (metrics.kde_nll(forecast, truth, 5) != metrics.kde_nll(forecast, truth, 9)).all()


def test_kde_nll_of_samples_on_a_line_or_in_one_point_is_finite():
    forecast, truth = make([2], samples=6, all_known=True)
    forecast.positions[0, ..., 1] = truth.future[0, None, :, 1]
    forecast.positions[1] = forecast.positions[1, :1]
    line, point = metrics.kde_nll(forecast, truth, 6)
    assert -10 < line < 20
    error = ((forecast.positions[1, 0].astype(float) - truth.future[1]) ** 2).sum(axis=-1)
    expected = np.minimum(error / 2e-4 + math.log(2 * math.pi * 1e-4), 20).mean()
    assert point == pytest.approx(expected)


def test_kde_nll_kernels_are_never_narrower_than_a_centimetre():
    forecast, truth = make([1], samples=20, all_known=True, spread=0)
    forecast.positions[0, :, 0] += np.linspace(-1e-4, 1e-4, 20, dtype=np.float32)[:, None]
    np.testing.assert_allclose(metrics.kde_nll(forecast, truth, 20), math.log(2 * math.pi * 1e-4), atol=1e-3)


def test_kde_nll_of_a_lost_agent_is_20():
    forecast, truth = make([2], samples=6, all_known=True)
    forecast.positions[:] += 1e6
    np.testing.assert_array_equal(metrics.kde_nll(forecast, truth, 6), [20, 20])


@pytest.mark.parametrize("weights", [[0, 0, 0, 0, 1], [0, 0, 0, 1, 1], [1, 0, 0, 0, 0]])
def test_kde_nll_counts_agents_whose_weight_lies_on_few_samples(weights):
    forecast, truth = make([2], all_known=True)
    weighted = Forecast(forecast.positions, np.array([weights, [1, 1, 1, 0, 0]], np.float32))
    only = Forecast(forecast.positions[:, np.flatnonzero(weights)].repeat(3, axis=1))
    values = metrics.kde_nll(weighted, truth, 5)
    assert np.isfinite(values).all() and values.max() <= 20
    if sum(weights) == 1:  # the kernels of three equal samples are as wide as that of one
        apart = metrics.kde_nll(Forecast(np.concatenate([only.positions[:1], forecast.positions[1:, :3]])), truth, 3)
        assert values[0] == pytest.approx(apart[0])


def test_kde_nll_is_nan_for_what_is_no_density():
    forecast, truth = make([2], all_known=True)
    assert np.isnan(metrics.kde_nll(forecast, truth, 2)).all()
    assert np.isnan(metrics.kde_nll(Forecast(forecast.positions[:, :1].repeat(5, axis=1)), truth, 5)).all()


def test_weights_that_are_all_zero_are_refused():
    forecast, truth = make([2], all_known=True)
    with pytest.raises(PredictorError, match="weights of row 1 are 0 for the first 5 samples"):
        metrics.score(Forecast(forecast.positions, np.array([[1] * 5, [0] * 5], np.float32)), truth, 5)


@fast
@given(cases(weighted=True, all_known=True))
def test_the_scale_of_weights_does_not_matter(case):
    forecast, truth = case
    assume(len(forecast.positions))
    k = forecast.positions.shape[1]
    scaled = metrics.score(Forecast(forecast.positions, forecast.weights * 8), truth, k)
    for name, values in metrics.score(forecast, truth, k).items():
        np.testing.assert_allclose(scaled[name], values, rtol=1e-9, err_msg=name)
