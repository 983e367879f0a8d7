"""Predictors in each agent's own frame."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_gym as mg
from motion_gym.contract import Observation, PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.predictors.ego import EgoErm, EgoModular
from motion_gym.predictors.networks.ego_features import kept_distances
from motion_gym.predictors.training.ego_training import distance_and_trust
from tests.walkers import crowd

SOURCES = mg.domain("orca", scenes=400)


@pytest.fixture(scope="module")
def data():
    return training_set(SOURCES)


@pytest.fixture(scope="module")
def trained(data):
    return EgoModular().fit(*data, [0, 1], epochs=(20,), agents=64)


def fresh(trained):
    copy = EgoModular()
    copy.use(trained.stacked, trained.card)
    return copy


@settings(max_examples=25, deadline=None)
@given(
    angle=st.floats(-3, 3),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    mirror=st.booleans(),
    seed=st.integers(0, 9),
)
def test_forecasts_are_equivariant_to_rotation_translation_and_mirroring(trained, angle, shift, mirror, seed):
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    if mirror:
        turn = turn @ np.diag([1, -1])
    seen, predictor = crowd(seed=seed), fresh(trained)
    predictor.observed = np.array([2.0, 1.2])
    moved = dataclasses.replace(seen, history=(seen.history @ turn + shift).astype(np.float32))
    expected = predictor.predict(seen).positions @ turn + shift
    off = np.abs(predictor.predict(moved).positions - expected)
    if mirror:
        # The gain on an agent's own deviation is not mirror symmetric.
        assert np.median(off) < 0.1
    else:
        assert off.max() < 5e-3


def test_forecasts_do_not_depend_on_the_order_of_agents(trained):
    seen, order = crowd(7), np.array([3, 0, 6, 1, 5, 2, 4])
    other = dataclasses.replace(seen, history=seen.history[order], agent=seen.agent[order])
    expected = trained.predict(seen).positions[order]
    np.testing.assert_allclose(trained.predict(other).positions, expected, atol=1e-5)


@pytest.mark.parametrize("agents", [1, 2, 40])
def test_any_number_of_agents_is_accepted(trained, agents):
    positions = trained.predict(crowd(agents)).positions
    assert positions.shape == (agents, 1, 12, 2) and np.isfinite(positions).all()


def test_a_single_agent_walks_at_about_constant_velocity(trained):
    seen = crowd(1)
    off = np.linalg.norm(trained.predict(seen).positions - ConstantVelocity().predict(seen).positions, axis=-1)
    assert off.max() < 0.5


def meeting(gap, kept):
    """Two agents who would pass at distance ``gap``, but step aside and pass at distance ``kept``."""
    x = np.linspace(-4, 4, 20)
    aside = np.where(np.arange(20) < 5, 0, (kept - gap) / 2 * np.clip((np.arange(20) - 4) / 4, 0, 1))
    first, second = np.stack([x, gap / 2 + aside], axis=-1), np.stack([-x, -gap / 2 - aside], axis=-1)
    path = np.stack([first, second]).astype(np.float32)
    seen = Observation(path[:, :8], np.array([0, 2]), np.arange(2), 0.4)
    return Truth(path[:, 8:], np.ones((2, 12), bool), seen)


@given(gap=st.floats(0, 0.3), kept=st.floats(0.4, 2))
def test_the_kept_distance_is_read_from_agents_who_step_aside(gap, kept):
    ((weight, sums),) = kept_distances(meeting(gap, kept))
    assert weight > 0 and sums / weight == pytest.approx(kept, abs=1e-4)


def test_agents_who_do_not_step_aside_have_no_weight():
    assert kept_distances(meeting(1.0, 1.0)).sum() == pytest.approx(0, abs=1e-9)
    partly = meeting(0.1, 1.0)
    known = partly.known.copy()
    known[0, -1] = False
    assert kept_distances(dataclasses.replace(partly, known=known)).sum() == 0


def test_without_observed_scenes_there_is_no_style():
    distance, trust = distance_and_trust(np.zeros(2))
    assert distance == 0 and trust == 0
    assert distance_and_trust(np.array([3.0, 1.5])) == pytest.approx((0.5, 3 / 3.05))


def test_the_style_lowers_the_error_outside_the_training_styles(trained):
    place = SOURCES.replace(d=0.7)
    truth, predictor = place.windows("test"), fresh(trained)
    without = score(predictor.predict(truth.observation), truth)["ADE"].mean()
    predictor.observe(place.reference())
    assert score(predictor.predict(truth.observation), truth)["ADE"].mean() < 0.8 * without
    predictor.reset()
    assert score(predictor.predict(truth.observation), truth)["ADE"].mean() == without


@pytest.mark.parametrize(("weights", "gap"), [("style", 200), ("style", 2), ("vehicles", 200)])
def test_people_far_apart_are_no_style_to_keep_such_a_distance(weights, gap):
    predictor = EgoModular(weights=weights)
    predictor.observe(mg.domain("walkers:people=2,gap=200,noise=2").reference())
    distance, trust = distance_and_trust(predictor.observed)
    assert distance > 190 and trust > 0.5  # by the noise of the annotation
    truth = mg.domain("walkers:people=2", gap=gap).windows("test")
    errors = [score(p.predict(truth.observation), truth)["ADE"].mean() for p in (predictor, ConstantVelocity())]
    assert errors[0] < 2 * errors[1]


def test_partly_known_training_windows_are_refused(data):
    known = data[0][0].known.copy()
    known[0, -1] = False
    partly = [dataclasses.replace(data[0][0], known=known), *data[0][1:]]
    with pytest.raises(PredictorError, match="give complete windows"):
        EgoErm().fit(partly, data[1], 0)
    with pytest.raises(SpecError, match="must be a list of 1 for ego_erm"):
        EgoErm().fit(*data, 0, epochs=(1, 1))
    with pytest.raises(PredictorError, match="0 environments"):
        EgoErm().fit([], [], 0)


def test_environments_without_a_style_are_refused(data):
    apart = [mg.domain("orca:radius=60,d=0.1,scenes=20").windows("train")] * 2
    with pytest.raises(PredictorError, match="no agents keep a distance"):
        EgoModular().fit(apart, apart, 0)


def test_scenes_observed_before_the_weights_are_loaded_are_kept():
    place = mg.domain("orca:d=0.6,scenes=100")
    truth, references = place.windows("test"), pick_scenes(place.reference(), slice(0, 16))
    lazy, named, unobserved = (mg.predictor(f"ego_modular{weights}") for weights in ("", ":weights=style", ""))
    for predictor in (lazy, named):
        predictor.observe(references)
    errors = [score(p.predict(truth.observation), truth)["ADE"].mean() for p in (lazy, named, unobserved)]
    assert errors[0] == errors[1] < 0.6 * errors[2]
