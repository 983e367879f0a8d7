"""The trust of the hedge in its experts, its experts, and its forecasts."""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.checks.predictor_trials import partly_known
from motion_gym.contract import FUTURE, PredictorError, SpecError
from motion_gym.predictors.constant_velocity import ConstantVelocity
from tests.predictors.adapters.test_filters import PAIR, SOURCES, STGAT, adapter, scenes
from tests.taped import fitted_linear

UNTRAINED = ("constant_velocity", "constant_velocity:velocity=4", "kalman_velocity")
STYLED = ("style", "style:memory=16", "kalman", "kalman:memory=16")
STRAIGHT, TRAINED, ADAPTED = 0, 3, 4
START = (0.2 / 3,) * 3 + (0.4,) * 2
"""Trust before the first truth: 0.8 in the experts that contain the trained predictor."""


def timed(truth, time):
    """The scene, observed at a time in steps."""
    return dataclasses.replace(truth, observation=dataclasses.replace(truth.observation, time=np.array([time])))


def alone(of, **parameters):
    """The experts, each on its own."""
    source = fitted_linear() if of == "linear" else of
    own = [mg.predictor(name) for name in UNTRAINED]
    return [*own, mg.adapter("none", source), adapter("kalman", of, **parameters)]


def advice(experts, seen):
    return np.stack([expert.predict(seen).positions[:, 0] for expert in experts])


def adahedge(trust, gap, losses):
    """One step of AdaHedge (de Rooij et al. 2014, figure 1) on the trust of the step before."""
    relative = (losses - losses.min()) / losses.mean()
    rate = np.log(len(losses)) / max(gap, 1e-12)
    mix = -np.log((trust * np.exp(-rate * relative)).sum()) / rate
    gap += (trust * relative).sum() - mix
    rate, before = np.log(len(losses)) / max(gap, 1e-12), rate
    trust = trust ** (rate / before) * np.exp(-rate * relative)
    return trust / trust.sum(), gap


@pytest.mark.parametrize("of", SOURCES)
def test_trust_follows_the_errors_and_weights_the_mean_forecast(of):
    hedge = adapter("hedge", of, ridge=1.0, forgetting=0.9, share=0.1, recall=0.7)
    experts = alone(of, ridge=1.0, forgetting=0.9)
    trust, gap = np.array(START), 0.0
    mean = trust
    for number, truth in enumerate(scenes(6)):
        revealed = partly_known(truth) if number == 2 else truth
        forecasts = advice(experts, truth.observation)
        expected = np.einsum("e,eaxy->axy", trust, forecasts)
        np.testing.assert_allclose(hedge.predict(truth.observation).positions[:, 0], expected, atol=1e-4)
        whole = revealed.known.all(axis=1)
        if whole.any():
            losses = np.linalg.norm(forecasts - truth.future, axis=-1)[:, whole].mean(axis=(1, 2))
            trust, gap = adahedge(trust, gap, losses)
            mean = 0.95 * mean + 0.05 * trust
            trust = 0.9 * trust + 0.1 * (0.7 * mean + 0.3 / 5)
        hedge.observe(revealed)
        experts[ADAPTED].observe(revealed)
        np.testing.assert_allclose(hedge.trust, trust, rtol=1e-3, atol=1e-6)


def test_an_expert_with_long_errors_regains_trust_quickly():
    hedge, trained = adapter("hedge", STGAT), mg.adapter("none", STGAT)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        hedge.observe(dataclasses.replace(truth, future=future))
    assert hedge.trust[STRAIGHT] > 0.7
    for truth in scenes(8, seed=5):
        hedge.observe(dataclasses.replace(truth, future=trained.predict(truth.observation).positions[:, 0]))
    assert hedge.trust[TRAINED] > 0.8
    hedge.reset()
    np.testing.assert_allclose(hedge.trust, START)


def test_an_expert_that_was_trusted_before_regains_trust_sooner():
    """The learning rates are the same until the second change."""
    hedges = [adapter("hedge", STGAT, recall=recall) for recall in (0.9, 0.0)]
    trained = mg.adapter("none", STGAT)
    for seed, expert in ((0, ConstantVelocity()), (5, trained), (7, ConstantVelocity())):
        for truth in scenes(3 if seed == 7 else 30, seed=seed):
            future = expert.predict(truth.observation).positions[:, 0]
            for hedge in hedges:
                hedge.observe(dataclasses.replace(truth, future=future))
    assert hedges[0].trust[STRAIGHT] > hedges[1].trust[STRAIGHT]
    assert (hedges[0].trust[[1, 2]] < hedges[1].trust[[1, 2]]).all()


@pytest.mark.parametrize("scale", [0.01, 100])
def test_the_trust_does_not_depend_on_the_unit_of_length(scale):
    """A learning rate that is tuned to errors in metres fails on pixels."""
    hedges = [mg.adapter("hedge", "stand_still", experts="constant_velocity") for _ in range(2)]
    for truth in scenes(8):
        other = dataclasses.replace(truth.observation, history=truth.observation.history * np.float32(scale))
        hedges[0].observe(truth)
        hedges[1].observe(dataclasses.replace(truth, future=truth.future * np.float32(scale), observation=other))
    np.testing.assert_allclose(hedges[0].trust, hedges[1].trust, rtol=1e-3)
    assert not np.allclose(hedges[0].trust, [0.2, 0.8])


def test_step_by_step_labels_change_the_trust_once_and_as_at_once():
    at_once, by_steps = (adapter("hedge", STGAT) for _ in range(2))
    one = timed(scenes(1)[0], 20)
    at_once.observe(one)
    for steps in range(1, FUTURE + 1):
        np.testing.assert_allclose(by_steps.trust, START)
        by_steps.observe(dataclasses.replace(one, known=one.known & (np.arange(FUTURE) < steps)))
    by_steps.observe(one)
    # The filter has learned from the earlier steps, which it did not know when it made its forecast.
    np.testing.assert_allclose(by_steps.trust, at_once.trust, rtol=1e-6)
    assert by_steps.updates == FUTURE
    assert not np.allclose(by_steps.trust, START)


def test_an_expert_is_judged_by_the_forecast_that_it_made_then():
    """The truth of one scene shows most of the truth of the next one, whose forecast was made before."""
    hedge = adapter("hedge", STGAT, share=0.0)
    first, second = (timed(truth, time) for truth, time in zip(scenes(2), (20, 21), strict=True))
    then = hedge.advice(second.observation)
    hedge.observe(first)
    now = hedge.advice(second.observation)
    assert np.abs(now["kalman"] - then["kalman"]).max() > 1e-3
    trust, gap = hedge.trust, hedge.gap
    hedge.observe(second)
    losses = np.array([np.linalg.norm(f - second.future, axis=-1).mean() for f in then.values()])
    np.testing.assert_allclose(hedge.trust, adahedge(trust, gap, losses)[0], rtol=1e-3, atol=1e-9)


def test_experts_of_a_predictor_with_a_style():
    truth = mg.domain("orca:d=0.6,scenes=40").windows("train")
    hedge = mg.adapter("hedge", PAIR, memory=20, recent=4)
    alone = {"none": mg.predictor(PAIR)}
    alone |= {name: mg.adapter(name, PAIR, memory=20) for name in ("style", "kalman")}
    alone |= {f"{name}:memory=4": mg.adapter(name, PAIR, memory=4) for name in ("style", "kalman")}
    for predictor in (hedge, *list(alone.values())[1:]):
        predictor.observe(truth)
    given = hedge.advice(truth.observation)
    assert list(given) == [*UNTRAINED, "none", *(name.replace("16", "4") for name in STYLED)]
    for name, predictor in alone.items():
        np.testing.assert_allclose(given[name], predictor.predict(truth.observation).positions[:, 0], atol=1e-4)
    forecasts = [given[name] for name in alone]
    for one, other in itertools.combinations(forecasts, 2):
        assert np.abs(one - other).max() > 1e-3


@pytest.mark.parametrize(
    ("setting", "value", "message"),
    [
        ("share", 1.5, "`share=1.5`"),
        ("share", -0.1, "`share=-0.1`"),
        ("prior", 1.5, "`prior=1.5`"),
        ("recall", -0.1, "`recall=-0.1`"),
        ("experts", "linear", "linear is not one: name constant_velocity, kalman_velocity"),
        ("experts", "constant_velocity kalman", "kalman is not one"),
        ("experts", "constant_velocty", "Did you mean `constant_velocity`"),
        ("experts", "orca_oracle", "orca_oracle is not one"),
    ],
)
def test_invalid_settings_are_refused(setting, value, message):
    with pytest.raises(SpecError, match=message):
        adapter("hedge", STGAT, **{setting: value})


def test_a_predictor_that_is_not_fitted_is_refused():
    with pytest.raises(PredictorError, match="linear is not fitted: call fit"):
        mg.adapter("hedge", "linear").predict(scenes(1)[0].observation)


def test_without_a_last_layer_the_predictor_and_the_training_free_ones_remain():
    hedge = mg.adapter("hedge", "stand_still", experts="constant_velocity")
    (one,) = scenes(1)
    np.testing.assert_allclose(hedge.trust, [0.2, 0.8])
    both = [
        mg.predictor(name).predict(one.observation).positions[:, 0] for name in ("stand_still", "constant_velocity")
    ]
    np.testing.assert_allclose(hedge.predict(one.observation).positions[:, 0], 0.8 * both[0] + 0.2 * both[1], atol=1e-5)
    for truth in scenes(10):
        future = ConstantVelocity().predict(truth.observation).positions[:, 0]
        hedge.observe(dataclasses.replace(truth, future=future))
    assert hedge.trust[0] > 0.9 and hedge.updates == 10 and hedge.rolled_back == 0
    drawn = hedge.predict(one.observation, 50, 1).positions
    assert drawn.shape == (2, 50, 12, 2) and drawn[:, 1:].std(axis=1).min() > 0
    hedge.reset()
    np.testing.assert_allclose(hedge.trust, [0.2, 0.8])


def test_trust_stays_a_share_at_the_ends_of_the_settings():
    """One expert alone; and a prior of 0 or 1, without a share that could give trust to the others."""
    alone = mg.adapter("hedge", "stand_still", experts="", prior=0.0)
    sure = [mg.adapter("hedge", "stand_still", experts="constant_velocity", prior=p, share=0.0) for p in (0.0, 1.0)]
    for truth in scenes(3):
        for hedge in (alone, *sure):
            hedge.observe(truth)
    assert alone.trust == 1 and sure[0].trust.tolist() == [1, 0] and sure[1].trust.tolist() == [0, 1]


def test_the_name_of_a_hedge_makes_it_again():
    hedge = mg.adapter("hedge:experts=constant_velocity stand_still,share=0.1", "kalman_velocity")
    again = mg.predictor(mg.adapter("hedge:experts=constant_velocity stand_still,share=0.1", PAIR).name)
    assert again.names == ("constant_velocity", "stand_still", "none", *STYLED)
    assert hedge.names == ("constant_velocity", "stand_still", "none")
