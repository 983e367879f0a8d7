"""Whom the hedge trusts, and what it then forecasts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.checks.predictor_trials import partly_known
from motion_gym.contract import FUTURE, SpecError
from motion_gym.predictors.constant_velocity import ConstantVelocity
from tests.predictors.test_filters import SOURCES, STGAT, adapter, scenes
from tests.taped import fitted_linear

TRAINED, ADAPTED, STRAIGHT = range(3)


def experts(of, **parameters):
    """The trained predictor and the filter on their own, and constant velocity."""
    source = fitted_linear() if of == "linear" else of
    return mg.adapter("none", source), adapter("kalman", of, **parameters)


def advice(trained, adapted, seen):
    return np.stack([made.predict(seen).positions[:, 0] for made in (trained, adapted, ConstantVelocity())])


@pytest.mark.parametrize("of", SOURCES)
def test_trust_falls_with_the_error_and_the_forecast_is_the_mean_by_trust(of):
    made = adapter("hedge", of, ridge=1.0, forgetting=0.9, rate=2.0, share=0.1)
    trained, adapted = experts(of, ridge=1.0, forgetting=0.9)
    trust = np.full(3, 1 / 3)
    for number, truth in enumerate(scenes(6)):
        told = partly_known(truth) if number == 2 else truth
        given = advice(trained, adapted, truth.observation)
        expected = np.einsum("e,eaxy->axy", trust, given)
        np.testing.assert_allclose(made.predict(truth.observation).positions[:, 0], expected, atol=1e-4)
        whole = told.known.all(axis=1)
        if whole.any():
            off = np.linalg.norm(given - truth.future, axis=-1)[:, whole].mean(axis=(1, 2))
            trust = trust * np.exp(-2.0 * off / off.mean())
            trust = 0.9 * trust / trust.sum() + 0.1 / 3
        made.observe(told)
        adapted.observe(told)
        np.testing.assert_allclose(made.trust, trust, rtol=1e-4)


def test_who_was_wrong_for_long_is_soon_believed_again():
    made = adapter("hedge", STGAT, rate=3.0, share=0.03)
    trained, _ = experts(STGAT)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        made.observe(dataclasses.replace(truth, future=future))
    assert made.trust[STRAIGHT] > 0.9
    for truth in scenes(3, seed=5):
        made.observe(dataclasses.replace(truth, future=trained.predict(truth.observation).positions[:, 0]))
    assert made.trust[TRAINED] > 0.9
    made.reset()
    np.testing.assert_array_equal(made.trust, 1 / 3)


def test_what_is_told_step_by_step_is_judged_once():
    at_once, by_steps = (adapter("hedge", STGAT) for _ in range(2))
    (one,) = scenes(1)
    at_once.observe(one)
    for upto in range(1, FUTURE + 1):
        assert (by_steps.trust == 1 / 3).all()
        by_steps.observe(dataclasses.replace(one, known=one.known & (np.arange(FUTURE) < upto)))
    by_steps.observe(one)
    # By then the filter has learned from what came before the last step.
    assert by_steps.trust[ADAPTED] > at_once.trust[ADAPTED]
    assert by_steps.updates == FUTURE
    assert not np.allclose(by_steps.trust, 1 / 3)


def test_no_learned_style_reaches_the_trained_predictor():
    truth = mg.domain("orca:d=0.6,scenes=40").windows("train")
    made, trained = mg.adapter("hedge", "modular_invariant"), mg.adapter("none", "modular_invariant")
    made.observe(truth)
    assert made.inner.scenes
    layer = made._layer(truth.observation)
    np.testing.assert_allclose(
        made._advice(layer, truth.observation)[TRAINED], trained.predict(truth.observation).positions[:, 0], atol=1e-4
    )


@pytest.mark.parametrize(("setting", "value"), [("rate", 0), ("rate", float("nan")), ("share", 1.5), ("share", -0.1)])
def test_settings_that_cannot_be(setting, value):
    with pytest.raises(SpecError, match=f"`{setting}={value}`"):
        adapter("hedge", STGAT, **{setting: value})


def test_without_a_last_layer_the_predictor_and_constant_velocity_remain():
    made = mg.adapter("hedge", "stand_still", rate=3.0, share=0.03)
    (one,) = scenes(1)
    np.testing.assert_array_equal(made.trust, 0.5)
    both = [
        mg.predictor(name).predict(one.observation).positions[:, 0] for name in ("stand_still", "constant_velocity")
    ]
    np.testing.assert_allclose(made.predict(one.observation).positions[:, 0], np.mean(both, axis=0), atol=1e-5)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        made.observe(dataclasses.replace(truth, future=future))
    assert made.trust[1] > 0.9 and made.updates == 10 and made.rolled_back == 0
    drawn = made.predict(one.observation, 50, 1).positions
    assert drawn.shape == (2, 50, 12, 2) and drawn[:, 1:].std(axis=1).min() > 0
    made.reset()
    np.testing.assert_array_equal(made.trust, 0.5)
