"""Kalman filters with a residual network."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_gym as mg
from motion_gym.contract import Observation
from motion_gym.data.domains import training_set
from motion_gym.metrics.errors import score
from motion_gym.predictors.kalman_residual import KalmanResidual
from motion_gym.predictors.kalman_velocity import KalmanVelocity
from motion_gym.predictors.networks.filter_features import NEAREST, inputs_of, mirrored, nearest_neighbours
from tests.walkers import crowd

QUICK = {"epochs": (4,), "agents": 2000, "batch": 128}


@pytest.fixture(scope="module")
def data():
    return training_set(mg.domain("orca", scenes=150))


@pytest.fixture(scope="module")
def trained(data):
    return KalmanResidual().fit(*data, [0, 1], **QUICK)


@settings(max_examples=25, deadline=None)
@given(
    angle=st.floats(-3, 3),
    shift=st.tuples(st.floats(-50, 50), st.floats(-50, 50)),
    mirror=st.booleans(),
    agents=st.integers(1, 12),
    seed=st.integers(0, 9),
)
def test_forecasts_are_equivariant_to_rotation_translation_and_mirroring(trained, angle, shift, mirror, agents, seed):
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    if mirror:
        turn = turn @ np.diag([1, -1])
    seen = crowd(agents, seed)
    moved = dataclasses.replace(seen, history=(seen.history @ turn + shift).astype(np.float32))
    expected = trained.predict(seen).positions @ turn + shift
    np.testing.assert_allclose(trained.predict(moved).positions, expected, atol=2e-3)


def test_mirrored_inputs_are_those_of_the_mirrored_scene():
    xy = crowd(9).xy.astype(np.float64)
    nearest = nearest_neighbours(xy[:, -1], np.array([0, 9]))
    one, other = mirrored(inputs_of(xy, 0.4, nearest)), inputs_of(xy * (1, -1), 0.4, nearest)
    for name in ("own", "others", "there"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=1e-5, err_msg=name)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.integers(0, 12), min_size=1, max_size=5), st.integers(0, 9))
def test_neighbours_are_the_nearest_of_the_scene(sizes, seed):
    last = np.random.default_rng(seed).normal(size=(sum(sizes), 2))
    scene = np.cumsum([0, *sizes])
    found = nearest_neighbours(last, scene)
    for first, end in itertools.pairwise(scene):
        for agent in range(first, end):
            others = [other for other in range(first, end) if other != agent]
            others.sort(key=lambda other: np.linalg.norm(last[other] - last[agent]))
            expected = others[:NEAREST] + [-1] * max(0, NEAREST - len(others))
            assert found[agent].tolist() == expected


def test_a_neighbour_beyond_the_reach_of_training_changes_nothing(trained):
    reach = trained.card["training"]["reach"]
    for distance in (reach - 0.1, reach + 0.1, 1000.0):
        pair = walkers(1.3, aside=(0.0, distance))
        alone = dataclasses.replace(pair, scene=np.array([0, 1, 2]), time=None)
        same = trained.predict(pair).positions == trained.predict(alone).positions
        assert same.all() == (distance > reach)


@pytest.mark.parametrize("plan", ["eth", "hotel", "univ", "zara1", "zara2", "all"])
@pytest.mark.parametrize("seed", range(5))
def test_people_who_walk_alone_far_apart_or_fast_go_on_as_they_walk(plan, seed):
    shipped = KalmanResidual(weights=f"original/{plan}", seed=seed)
    for speed, *aside in ((0.5,), (1.3,), (1.8,), (1.3, (0, 4)), (1.3, (-30, 40)), (3, (2, 2)), (5,), (8,)):
        seen = walkers(speed, aside[0] if aside else None)
        ahead = seen.xy[:, -1:] + (seen.xy[:, -1:] - seen.xy[:, -2:-1]) * np.arange(1, 13)[:, None]
        off = np.linalg.norm(shipped.predict(seen).positions[:, 0] - ahead, axis=-1).mean(axis=1)
        assert (off < 0.1 * speed * 4.8).all(), (speed, aside, off)


def walkers(speed, aside=None):
    """Someone who walks straight on at a speed, alone, or with another one aside."""
    way = np.array([0.6, 0.8])
    xy = np.array([0.0, 0.0] if aside is None else [[0.0, 0.0], aside]).reshape(-1, 1, 2)
    xy = xy + np.arange(8)[:, None] * 0.4 * speed * way
    return Observation(xy.astype(np.float32), np.array([0, len(xy)]), np.arange(len(xy)), 0.4)


def test_training_improves_on_the_filters(data, trained):
    _, validation = data
    errors = [
        np.concatenate([score(predictor.predict(t.observation), t)["ADE"] for t in validation]).mean()
        for predictor in (trained, KalmanVelocity())
    ]
    assert errors[0] < 0.9 * errors[1]
    assert trained.card["validation_ade"][0] == pytest.approx(errors[0], rel=0.1)


def test_an_untrained_network_forecasts_as_the_filters(data):
    untrained = KalmanResidual().fit(*data, 0, epochs=(1,), agents=1, batch=1)
    zero = {k: v * 0 if k.startswith("residual.") and k.endswith("3") else v for k, v in untrained.stacked.items()}
    untrained.use(zero, untrained.card)
    seen = crowd()
    np.testing.assert_allclose(untrained.predict(seen).positions, KalmanVelocity().predict(seen).positions, atol=1e-5)


def test_the_first_sample_is_the_forecast_and_the_others_spread_more_and_more(trained):
    seen = crowd(8)
    one, many = trained.predict(seen).positions, trained.predict(seen, samples=300, seed=3).positions
    np.testing.assert_allclose(many[:, :1], one, atol=1e-6)
    spread = many[:, 1:].std(axis=1).mean(axis=(0, 2))
    assert (spread[3:] > spread[:-3]).all()
    np.testing.assert_allclose(many[:, 1:].mean(axis=1), one[:, 0], atol=0.3 * spread[-1])


def test_the_weights_have_not_seen_the_place(eth_ucy):
    for place in ("eth", "eth6", "hotel", "univ", "zara1", "zara2"):
        predictor = KalmanResidual()
        predictor.choose_weights([mg.domain(place)])
        assert predictor.chosen == f"original/{place.removesuffix('6')}"
    simulated = {"orca": "style", "orca:d=0.6,agents=10": "style/crowd", "highway:style=aggressive": "vehicles"}
    for place, chosen in simulated.items():  # each split is simulated anew
        predictor.choose_weights([mg.domain(place)])
        assert predictor.chosen == chosen
    several = KalmanResidual()
    several.choose_weights([mg.domain("hotel"), mg.domain("zara1")])
    assert several.chosen == "original/all"  # every set has seen one of them, and the card declares it
    stated = KalmanResidual(weights="original/zara1")
    stated.choose_weights([mg.domain("zara1")])
    assert stated.trained_on == ("eth", "hotel", "univ", "zara2")


@pytest.mark.parametrize("place", ["eth", "eth6", "hotel", "univ", "zara1", "zara2"])
def test_the_forecaster_is_better_than_constant_velocity_at_every_place(eth_ucy, place):
    card, plain = (mg.evaluate(name, place) for name in ("kalman_residual", "constant_velocity"))
    assert card.ade.mean < plain.ade.mean and not card.leaks
