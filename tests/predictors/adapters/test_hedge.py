"""The trust of the hedge in its experts, and its forecasts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.checks.predictor_trials import partly_known
from motion_gym.contract import FUTURE, SpecError
from motion_gym.predictors.constant_velocity import ConstantVelocity
from tests.predictors.adapters.test_filters import SOURCES, STGAT, adapter, scenes
from tests.taped import fitted_linear

TRAINED, ADAPTED, STRAIGHT = range(3)


def experts(of, **parameters):
    """The trained predictor and the filter on their own, and constant velocity."""
    source = fitted_linear() if of == "linear" else of
    return mg.adapter("none", source), adapter("kalman", of, **parameters)


def advice(trained, adapted, seen):
    return np.stack([hedge.predict(seen).positions[:, 0] for hedge in (trained, adapted, ConstantVelocity())])


@pytest.mark.parametrize("of", SOURCES)
def test_trust_follows_the_errors_and_weights_the_mean_forecast(of):
    hedge = adapter("hedge", of, ridge=1.0, forgetting=0.9, rate=2.0, share=0.1)
    trained, adapted = experts(of, ridge=1.0, forgetting=0.9)
    trust = np.full(3, 1 / 3)
    for number, truth in enumerate(scenes(6)):
        revealed = partly_known(truth) if number == 2 else truth
        forecasts = advice(trained, adapted, truth.observation)
        expected = np.einsum("e,eaxy->axy", trust, forecasts)
        np.testing.assert_allclose(hedge.predict(truth.observation).positions[:, 0], expected, atol=1e-4)
        whole = revealed.known.all(axis=1)
        if whole.any():
            errors = np.linalg.norm(forecasts - truth.future, axis=-1)[:, whole].mean(axis=(1, 2))
            trust = trust * np.exp(-2.0 * errors / errors.mean())
            trust = 0.9 * trust / trust.sum() + 0.1 / 3
        hedge.observe(revealed)
        adapted.observe(revealed)
        np.testing.assert_allclose(hedge.trust, trust, rtol=1e-4)


def test_an_expert_with_long_errors_regains_trust_quickly():
    hedge = adapter("hedge", STGAT, rate=3.0, share=0.03)
    trained, _ = experts(STGAT)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        hedge.observe(dataclasses.replace(truth, future=future))
    assert hedge.trust[STRAIGHT] > 0.9
    for truth in scenes(3, seed=5):
        hedge.observe(dataclasses.replace(truth, future=trained.predict(truth.observation).positions[:, 0]))
    assert hedge.trust[TRAINED] > 0.9
    hedge.reset()
    np.testing.assert_array_equal(hedge.trust, 1 / 3)


def test_step_by_step_labels_change_the_trust_once():
    at_once, by_steps = (adapter("hedge", STGAT) for _ in range(2))
    (one,) = scenes(1)
    at_once.observe(one)
    for steps in range(1, FUTURE + 1):
        assert (by_steps.trust == 1 / 3).all()
        by_steps.observe(dataclasses.replace(one, known=one.known & (np.arange(FUTURE) < steps)))
    by_steps.observe(one)
    # The filter has already learned from the earlier steps.
    assert by_steps.trust[ADAPTED] > at_once.trust[ADAPTED]
    assert by_steps.updates == FUTURE
    assert not np.allclose(by_steps.trust, 1 / 3)


def test_the_trained_expert_has_no_style():
    truth = mg.domain("orca:d=0.6,scenes=40").windows("train")
    hedge, trained = mg.adapter("hedge", "modular_invariant"), mg.adapter("none", "modular_invariant")
    hedge.observe(truth)
    assert hedge.inner.scenes
    layer = hedge._layer(truth.observation)
    np.testing.assert_allclose(
        hedge._experts(layer, truth.observation)[TRAINED], trained.predict(truth.observation).positions[:, 0], atol=1e-4
    )


@pytest.mark.parametrize(("setting", "value"), [("rate", 0), ("rate", float("nan")), ("share", 1.5), ("share", -0.1)])
def test_invalid_settings_are_refused(setting, value):
    with pytest.raises(SpecError, match=f"`{setting}={value}`"):
        adapter("hedge", STGAT, **{setting: value})


def test_without_a_last_layer_the_predictor_and_constant_velocity_remain():
    hedge = mg.adapter("hedge", "stand_still", rate=3.0, share=0.03)
    (one,) = scenes(1)
    np.testing.assert_array_equal(hedge.trust, 0.5)
    both = [
        mg.predictor(name).predict(one.observation).positions[:, 0] for name in ("stand_still", "constant_velocity")
    ]
    np.testing.assert_allclose(hedge.predict(one.observation).positions[:, 0], np.mean(both, axis=0), atol=1e-5)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        hedge.observe(dataclasses.replace(truth, future=future))
    assert hedge.trust[1] > 0.9 and hedge.updates == 10 and hedge.rolled_back == 0
    drawn = hedge.predict(one.observation, 50, 1).positions
    assert drawn.shape == (2, 50, 12, 2) and drawn[:, 1:].std(axis=1).min() > 0
    hedge.reset()
    np.testing.assert_array_equal(hedge.trust, 0.5)
