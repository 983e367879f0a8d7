"""The filters of velocity: reference numbers, the textbook filter, samples, and error messages."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import norm

import motion_gym
from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import SpecError
from motion_gym.predictors.kalman_velocity import ACCELERATION, MEASUREMENT, filtered
from tests.predictors.places import ade_fde, place

TRAINING = [trials.synthetic((1, 2, 5) * 8, 3, seed) for seed in (1, 2)]
PLACES = ("eth", "eth6", "hotel", "univ", "zara1", "zara2")
REFERENCE = {  # ADE by place, metres
    "constant_velocity": (0.995, 0.679, 0.323, 0.524, 0.431, 0.326),
    "constant_velocity:velocity=2": (0.960, 0.585, 0.271, 0.557, 0.457, 0.346),
    "constant_velocity:velocity=3": (0.958, 0.551, 0.248, 0.586, 0.480, 0.364),
    "constant_velocity:velocity=4": (0.956, 0.549, 0.239, 0.612, 0.501, 0.381),
    "constant_velocity:velocity=mean": (0.959, 0.570, 0.239, 0.676, 0.557, 0.422),
    "kalman_velocity": (0.956, 0.563, 0.258, 0.529, 0.440, 0.328),
}
FINAL = (2.234, 1.348, 0.617, 1.165, 0.960, 0.728)
"""FDE of constant velocity by place, metres."""


@pytest.mark.parametrize("spec", REFERENCE)
@pytest.mark.parametrize("number", range(len(PLACES)), ids=PLACES)
def test_training_free_filters_reproduce_the_reference(spec, number):
    ade, fde = ade_fde(motion_gym.predictor(spec), place(PLACES[number]).windows("test"))
    # The grid of the published mixture is not known exactly.
    assert ade == pytest.approx(REFERENCE[spec][number], abs=0.003 if spec == "kalman_velocity" else 0.001)
    if spec == "constant_velocity":
        assert fde == pytest.approx(FINAL[number], abs=0.001)


def filter_by_definition(xy, dt, q, r):
    """Last position and velocity of one axis of one agent, and the log-likelihood: the textbook filter in matrices."""
    model, noise = np.array([[1, dt], [0, 1]]), q * np.array([[dt**4 / 4, dt**3 / 2], [dt**3 / 2, dt**2]])
    # The prior is nearly flat, so the first two positions determine the first state.
    state, covariance, likelihood = np.zeros(2), np.diag([1e6, 1e6]), 0.0
    for step, seen in enumerate(xy):
        if step:
            state, covariance = model @ state, model @ covariance @ model.T + noise
        spread = covariance[0, 0] + r
        if step > 1:
            likelihood += norm.logpdf(seen, state[0], np.sqrt(spread))
        gain = covariance[:, 0] / spread
        state = state + gain * (seen - state[0])
        covariance = covariance - np.outer(gain, covariance[0])
    return state, likelihood


@pytest.mark.parametrize("dt", [0.1, 0.4])
def test_filters_equal_the_textbook_filter(dt):
    rng = np.random.default_rng(0)
    xy = np.cumsum(rng.normal(0.3, 0.1, (3, 8, 2)), axis=1)
    q, r = np.array([0.3, 0.01]), np.array([0.002, 0.05])
    bank = filtered(xy, dt, q, r)
    for number in range(2):
        for agent in range(3):
            axes = [filter_by_definition(xy[agent, :, axis], dt, q[number], r[number]) for axis in range(2)]
            # The flat prior of the textbook filter has a variance of 1e6 against less than 1 here.
            np.testing.assert_allclose(bank.position[number, agent], [state[0] for state, _ in axes], atol=1e-5)
            np.testing.assert_allclose(bank.velocity[number, agent], [state[1] for state, _ in axes], atol=1e-4)
            total = sum(value for _, value in axes) + 6 * np.log(2 * np.pi)
            assert bank.likelihood[number, agent] == pytest.approx(total, abs=1e-3)


@pytest.mark.parametrize(("q", "r"), [(0.3, 0.002), (0.001, 0.05)])
def test_samples_of_a_filter_have_its_predicted_mean_and_variance(q, r):
    here, dt = TRAINING[0].observation, TRAINING[0].observation.dt
    here = dataclasses.replace(here, history=here.history[:2], scene=np.array([0, 2]), agent=here.agent[:2])
    positions = motion_gym.predictor("kalman_velocity", q=q, r=r).predict(here, samples=4001, seed=1).positions
    bank = filtered(here.xy.astype(np.float64), dt, np.array([q]), np.array([r]))
    covariance, transition, effect = bank.covariance[0], np.array([[1, dt], [0, 1]]), np.array([dt**2 / 2, dt])
    for step in range(12):
        covariance = transition @ covariance @ transition.T + q * np.outer(effect, effect)
        drawn = positions[:, 1:, step]
        np.testing.assert_allclose(drawn.var(axis=1), covariance[0, 0], rtol=0.12)  # five standard errors
        atol = 5 * np.sqrt(covariance[0, 0] / 4000)
        np.testing.assert_allclose(drawn.mean(axis=1), positions[:, 0, step], atol=atol)


def test_samples_of_the_mixture_take_the_filters_by_their_weights():
    here = TRAINING[0].observation
    one = motion_gym.predictor("kalman_velocity")
    few, many = one.predict(here, samples=3, seed=2).positions, one.predict(here, samples=400, seed=2).positions
    np.testing.assert_array_equal(few, many[:, :3])
    np.testing.assert_array_equal(few[:, :1], one.predict(here).positions)
    spread = many[:, 1:].std(axis=1)[:, -1].mean(axis=-1)
    off = np.linalg.norm(many[:, 1:, -1].mean(axis=1) - few[:, 0, -1], axis=-1)
    assert (off < 0.4 * spread + 1e-3).all()


def test_the_mixture_weights_filters_by_the_likelihood_of_each_agent():
    here = TRAINING[0].observation
    forecasts, weights = [], []
    for q in ACCELERATION:
        for r in MEASUREMENT:
            one = motion_gym.predictor("kalman_velocity", q=float(q), r=float(r))
            forecasts.append(one.predict(here).positions[:, 0].astype(np.float64))
            weights.append(filtered(here.xy.astype(np.float64), here.dt, np.array([q]), np.array([r])).likelihood[0])
    weights = np.exp(np.array(weights) - np.max(weights, axis=0))
    expected = np.einsum("ga,gatc->atc", weights / weights.sum(axis=0), np.array(forecasts))
    # Forecasts of single filters are rounded to float32.
    np.testing.assert_allclose(
        motion_gym.predictor("kalman_velocity").predict(here).positions[:, 0], expected, atol=1e-4
    )
    best = np.array(forecasts)[weights.argmax(axis=0), np.arange(len(here))]
    likeliest = motion_gym.predictor("kalman_velocity:select=likeliest").predict(here).positions[:, 0]
    np.testing.assert_allclose(likeliest, best, atol=1e-5)


@pytest.mark.parametrize("shift", [0, 1e4, 1e6])
def test_a_straight_walker_is_forecast_exactly_at_any_time_step(shift):
    for dt in (0.04, 0.1, 0.4, 1.0):
        way = shift + 1.5 * dt * np.arange(20)
        xy = np.stack([way, np.zeros(20)], axis=-1)[None].astype(np.float32)
        here = motion_gym.Observation(xy[:, :8], np.array([0, 1]), np.array([0]), dt)
        ahead = motion_gym.predictor("kalman_velocity").predict(here).positions[0, 0]
        # Float32 holds a position of 1e6 m to 6 cm, which the velocity multiplies by the horizon.
        np.testing.assert_allclose(ahead[:, 0], way[8:], atol=1e-4 + shift * 2e-6)


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("kalman_velocity:q=0", "`q=0` must be a number above 0"),
        ("kalman_velocity:r=-1", "`r=-1` must be a number above 0"),
        ("kalman_velocity:select=mix", "Did you mean `mixture`"),
        ("constant_velocity:velocity=8", "`velocity=8` must be a whole number, from 1 to 7"),
        ("constant_velocity:velocity=2.5", "`velocity=2.5` must be a whole number"),
    ],
)
def test_invalid_settings_of_filters_are_refused(spec, message):
    with pytest.raises(SpecError, match=message):
        motion_gym.predictor(spec)
