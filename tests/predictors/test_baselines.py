"""The baselines: reference numbers, geometry, and error messages."""

import copy
import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_gym
from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from tests.predictors.places import ade_fde, place

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


@pytest.mark.parametrize(("d", "most"), [(0.3, 0.005), (0.8, 0.02)])
def test_the_oracle_finds_the_starts_of_a_crowd_of_ten(d, most):
    card = motion_gym.evaluate("orca_oracle", f"orca:agents=10,d={d},scenes=100")
    assert card.ade.mean < most


def test_the_oracle_refuses_other_domains_and_partial_scenes(orca):
    oracle, truth = motion_gym.predictor("orca_oracle"), orca.windows("test")
    with pytest.raises(PredictorError, match="does not know the domain"):
        oracle.predict(truth.observation)
    with pytest.raises(PredictorError, match="knows ORCA only, not `eth`"):
        oracle.know(motion_gym.domain("eth"))
    oracle.know(orca)
    with pytest.raises(PredictorError, match="needs whole scenes of 2 agents"):
        oracle.predict(TRAINING[0].observation)
    with pytest.raises(PredictorError, match=r"cannot place \d+ of \d+ histories"):
        oracle.predict(trials.synthetic((2, 2), 2, seed=0).observation)
    oracle.know(orca.replace(d=0.1))
    with pytest.raises(PredictorError, match=r"cannot place \d+ of \d+ histories"):
        oracle.predict(truth.observation)
