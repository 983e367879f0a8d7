"""The baselines: reference numbers, geometry, and error messages."""

import copy
import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import norm

import motion_gym
from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import DataError, PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics import errors as metrics
from motion_gym.predictors.kalman_velocity import ACCELERATION, MEASUREMENT, filtered

fast = settings(max_examples=30, deadline=None)
TRAINING = [trials.synthetic((1, 2, 5) * 8, 3, seed) for seed in (1, 2)]
LINEAR = motion_gym.predictor("linear").fit(TRAINING)
EQUIVARIANT = {
    "constant_velocity": motion_gym.predictor("constant_velocity"),
    "constant_velocity:velocity=mean": motion_gym.predictor("constant_velocity:velocity=mean"),
    "constant_velocity:velocity=3": motion_gym.predictor("constant_velocity:velocity=3"),
    "kalman_velocity": motion_gym.predictor("kalman_velocity"),
    "kalman_velocity:q=0.1,r=0.01": motion_gym.predictor("kalman_velocity:q=0.1,r=0.01"),
    "stand_still": motion_gym.predictor("stand_still"),
    "constant_acceleration": motion_gym.predictor("constant_acceleration"),
    "constant_turn": motion_gym.predictor("constant_turn"),
    "linear": LINEAR,
    "linear:sigma=true": motion_gym.predictor("linear:sigma=true").fit(TRAINING),
}
each = pytest.mark.parametrize("name", EQUIVARIANT)


@st.composite
def crowds(draw):
    """Truth of a few scenes with a third feature."""
    sizes = draw(st.lists(st.integers(1, 5), min_size=2, max_size=6))
    return trials.synthetic(sizes, 3, draw(st.integers(0, 2**32 - 1)))


def turned(xy, angle, shift):
    cos, sin = np.cos(angle), np.sin(angle)
    return xy @ np.array([[cos, sin], [-sin, cos]]) + shift


def place(name, **parameters):
    domain = motion_gym.domain(name, **parameters)
    try:
        domain.windows("test")
    except DataError as error:
        pytest.skip(f"no data: {error}")
    return domain


def ade_fde(predictor, truth):
    values = metrics.score(motion_gym.Forecast(predictor.predict(truth.observation).positions), truth)
    return values["ADE"].mean(), values["FDE"].mean()


@each
@fast
@given(crowds(), st.floats(-4, 4), st.floats(-50, 50), st.floats(-50, 50))
def test_forecasts_are_equivariant_to_rotation_and_translation(name, truth, angle, x, y):
    here = truth.observation
    # An agent that stands still has no heading; linear uses the x axis.
    moving = np.hypot(*(here.xy[:, -1] - here.xy[:, -2]).T) > 0.1
    history = here.history.astype(np.float64)
    history[..., :2] = turned(history[..., :2], angle, (x, y))
    there = dataclasses.replace(here, history=history.astype(np.float32))
    expected = turned(EQUIVARIANT[name].predict(here).positions.astype(np.float64), angle, (x, y))
    np.testing.assert_allclose(EQUIVARIANT[name].predict(there).positions[moving], expected[moving], atol=2e-3)


@each
@fast
@given(crowds(), st.randoms(use_true_random=False))
def test_a_forecast_does_not_depend_on_the_batch(name, truth, random):
    whole = EQUIVARIANT[name].predict(truth.observation).positions
    order = list(range(truth.observation.scenes))
    random.shuffle(order)
    index = np.concatenate([np.flatnonzero(truth.observation.scene_index == scene) for scene in order])
    shuffled = EQUIVARIANT[name].predict(pick_scenes(truth, order).observation).positions
    np.testing.assert_array_equal(shuffled, whole[index])
    alone = EQUIVARIANT[name].predict(pick_scenes(truth, order[:1]).observation).positions
    np.testing.assert_array_equal(alone, shuffled[: len(alone)])


@each
@pytest.mark.parametrize("samples", [1, 20])
def test_forecasts_have_float32_samples(name, samples):
    answer = EQUIVARIANT[name].predict(TRAINING[0].observation, samples, seed=3)
    drawn = samples if name.startswith("kalman_velocity") else 1  # the others are deterministic
    assert answer.positions.shape == (len(TRAINING[0].observation), drawn, 12, 2)
    assert answer.positions.dtype == np.float32


def test_constant_velocity_continues_at_the_last_or_mean_velocity():
    history = np.zeros((1, 8, 2), np.float32)
    history[0, :, 0] = [0, 1, 2, 3, 4, 5, 6, 13]
    here = motion_gym.Observation(history, np.array([0, 1]), np.array([0]), 0.4)
    for velocity, speed in (("last", 7), (1, 7), (2, 8 / 2), ("mean", 13 / 7), (7, 13 / 7)):
        ahead = motion_gym.predictor("constant_velocity", velocity=velocity).predict(here).positions[0, 0]
        np.testing.assert_allclose(ahead[:, 0], 13 + speed * np.arange(1, 13), rtol=1e-6)
        assert (ahead[:, 1] == 0).all()


def test_stand_still_stays():
    here = TRAINING[0].observation
    ahead = motion_gym.predictor("stand_still").predict(here).positions
    np.testing.assert_array_equal(ahead, np.broadcast_to(here.xy[:, None, -1:], ahead.shape))


@pytest.mark.parametrize(
    "spec",
    [
        "constant_velocity:velocity=first",
        "linear:ridge=-1",
        "linear:ridge=much",
        "linear:sigma=1",
    ],
)
def test_invalid_settings_are_refused(spec):
    with pytest.raises(SpecError, match=r"`(velocity=first|ridge=-1|ridge=much|sigma=1)`"):
        motion_gym.predictor(spec)


def test_linear_learns_a_linear_law():
    # All agents turn by 5 degrees per step: in the heading frame the future is linear in the last step.
    rng = np.random.default_rng(0)
    angle = rng.uniform(0, 6, (60, 1)) + np.deg2rad(5) * np.arange(20)
    steps = rng.uniform(0.2, 1, (60, 1, 1)) * np.stack([np.cos(angle), np.sin(angle)], -1)
    xy = np.cumsum(steps, axis=1).astype(np.float32)
    here = motion_gym.Observation(xy[:, :8], np.arange(61), np.arange(60), 0.4)
    truth = Truth(xy[:, 8:], np.ones((60, 12), bool), here)
    predictor = motion_gym.predictor("linear:ridge=1e-6").fit([truth])
    assert ade_fde(predictor, truth)[0] < 1e-3


def test_linear_learns_from_complete_agents_only():
    truth = TRAINING[0]
    known = truth.known.copy()
    known[::2, 5:] = False
    future = np.where(known[..., None], truth.future, np.float32(1e6))
    complete = pick_scenes(copy.deepcopy(truth), slice(None))
    rows = np.flatnonzero(known.all(axis=1))
    here = dataclasses.replace(
        truth.observation,
        history=truth.observation.history[rows],
        scene=np.arange(len(rows) + 1),
        agent=truth.observation.agent[rows],
    )
    complete = Truth(truth.future[rows], truth.known[rows], here)
    partly = motion_gym.predictor("linear").fit([dataclasses.replace(truth, known=known, future=future)])
    np.testing.assert_allclose(partly.weight, motion_gym.predictor("linear").fit([complete]).weight, rtol=1e-9)


def test_linear_without_sigma_ignores_the_third_feature():
    here = TRAINING[0].observation
    blind = dataclasses.replace(here, history=here.history[..., :2])
    np.testing.assert_array_equal(LINEAR.predict(here).positions, LINEAR.predict(blind).positions)


def test_unfitted_linear_is_refused():
    predictor = motion_gym.predictor("linear")
    assert not predictor.fitted
    with pytest.raises(PredictorError, match="linear is not fitted: call fit"):
        predictor.predict(TRAINING[0].observation)


def test_linear_with_sigma_needs_a_third_feature():
    here = TRAINING[0].observation
    with pytest.raises(PredictorError, match="needs a third feature"):
        EQUIVARIANT["linear:sigma=true"].predict(dataclasses.replace(here, history=here.history[..., :2]))


@pytest.mark.parametrize(
    "train", [[], [pick_scenes(TRAINING[0], [])], [trials.partly_known(pick_scenes(TRAINING[0], [0]))]]
)
def test_linear_needs_complete_training_agents(train):
    predictor = motion_gym.predictor("linear")
    with pytest.raises(PredictorError, match="cannot be fitted"):
        predictor.fit(train)
    assert not predictor.fitted


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
    np.testing.assert_allclose(EQUIVARIANT["kalman_velocity"].predict(here).positions[:, 0], expected, atol=1e-4)
    best = np.array(forecasts)[weights.argmax(axis=0), np.arange(len(here))]
    likeliest = motion_gym.predictor("kalman_velocity:select=likeliest").predict(here).positions[:, 0]
    np.testing.assert_allclose(likeliest, best, atol=1e-5)


@pytest.mark.parametrize("shift", [0, 1e4, 1e6])
def test_a_straight_walker_is_forecast_exactly_at_any_time_step(shift):
    for dt in (0.04, 0.1, 0.4, 1.0):
        way = shift + 1.5 * dt * np.arange(20)
        xy = np.stack([way, np.zeros(20)], axis=-1)[None].astype(np.float32)
        here = motion_gym.Observation(xy[:, :8], np.array([0, 1]), np.array([0]), dt)
        ahead = EQUIVARIANT["kalman_velocity"].predict(here).positions[0, 0]
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


@pytest.fixture(scope="module")
def ridge():
    """Linear without and with sigma, fitted once: alpha of the test place does not reach its sources."""
    train, validation = training_set(place("eth", alpha=8))
    return {s: motion_gym.predictor("linear", sigma=s).fit(train, validation) for s in (False, True)}


@pytest.mark.parametrize(
    ("sigma", "alpha", "expected"),
    [
        *((False, alpha, (0.967, 2.049)) for alpha in (1, 8, 16, 32, 64)),
        (True, 1, (0.965, 1.993)),
        (True, 8, (0.792, 1.663)),
        (True, 16, (0.974, 2.151)),
        (True, 32, (1.832, 4.147)),
        (True, 64, (3.955, 8.919)),
    ],
)
def test_linear_reproduces_the_reference(ridge, sigma, alpha, expected):
    truth = place("eth", alpha=alpha).windows("test")
    np.testing.assert_allclose(ade_fde(ridge[sigma], truth), expected, atol=0.002)


@pytest.fixture(scope="module")
def orca():
    return motion_gym.domain("orca", d=0.6, scenes=40)


def test_the_oracle_matches_the_ground_truth(orca):
    oracle = motion_gym.predictor("orca_oracle")
    oracle.know(orca)
    assert ade_fde(oracle, orca.windows("test"))[0] < 0.01


def test_the_oracle_does_not_use_the_future(orca):
    oracle, truth = motion_gym.predictor("orca_oracle"), orca.windows("test")
    oracle.know(orca.replace(seed=7))
    assert ade_fde(oracle, truth)[0] < 0.01


def test_the_oracle_refuses_other_domains_and_partial_scenes(orca):
    oracle, truth = motion_gym.predictor("orca_oracle"), orca.windows("test")
    with pytest.raises(PredictorError, match="does not know the domain"):
        oracle.predict(truth.observation)
    with pytest.raises(PredictorError, match="knows ORCA only, not `eth`"):
        oracle.know(motion_gym.domain("eth"))
    oracle.know(orca)
    with pytest.raises(PredictorError, match="needs whole scenes of 2 agents"):
        oracle.predict(TRAINING[0].observation)
    with pytest.raises(PredictorError, match="cannot place a history"):
        oracle.predict(trials.synthetic((2, 2), 2, seed=0).observation)
    oracle.know(orca.replace(d=0.1))
    with pytest.raises(PredictorError, match="cannot place a history"):
        oracle.predict(truth.observation)
