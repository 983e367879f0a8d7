"""STGAT with a style: any number of agents, in any order."""

import dataclasses

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.contract import Observation, PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.adapters.refine import Refine
from motion_gym.predictors.modular_stgat import ModularStgat
from motion_gym.predictors.networks.neighbour_pairs import NEAREST, NeighbourPairs, whole_paths
from motion_gym.predictors.stgat import Erm

SHORT = (2, 2, 3, 10, 3, 4)


@pytest.fixture(scope="module")
def crowd():
    return mg.domain("orca:agents=3,d=0.6,scenes=80")


@pytest.fixture(scope="module")
def made(crowd):
    return ModularStgat().fit(*training_set(crowd), [0, 1], epochs=SHORT, scenes=24)


def changed(truth, path, order):
    """The same scenes on other paths [A, 20, 2], agents in another order within each."""
    observation = dataclasses.replace(
        truth.observation,
        history=path[order, :8].astype(np.float32),
        agent=truth.observation.agent[order],
    )
    return Truth(path[order, 8:].astype(np.float32), truth.known[order], observation)


def test_pairs_are_the_nearest_neighbours_from_both_sides(eth_ucy):
    truth = pick_scenes(mg.domain("univ").windows("test"), np.arange(3))
    pairs = NeighbourPairs.of(truth)
    path = whole_paths(truth).double().numpy()
    scene = truth.observation.scene_index
    for agent in range(len(path)):
        others = [b for b in np.flatnonzero(scene == scene[agent]) if b != agent]
        nearest = {b: np.linalg.norm(path[b] - path[agent], axis=-1).min() for b in others}
        expected = sorted(others, key=lambda b: nearest[b])[:NEAREST]
        assert pairs.other[pairs.agent == agent].tolist() == expected
    assert np.array_equal(pairs.scene, scene[pairs.agent])


def test_the_style_depends_neither_on_the_frame_nor_on_the_order_of_agents(made, crowd):
    truth = crowd.windows("test")
    path = whole_paths(truth).double().numpy()
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    order = np.arange(len(path)).reshape(-1, 3)[:, [2, 0, 1]].ravel()
    expected = made.scene_codes(truth, made.tensors)[0]
    found = made.scene_codes(changed(truth, path @ turn + [3.0, -2.0], order), made.tensors)[0]
    torch.testing.assert_close(found, expected, atol=1e-4, rtol=1e-4)
    assert expected.shape == (truth.observation.scenes, 8) and expected.std(dim=0).min() > 0


def test_agents_who_left_and_agents_alone_show_no_style(made, crowd):
    truth = pick_scenes(crowd.windows("test"), np.arange(4))
    known = truth.known.copy()
    known[:2, -1] = False  # of the first scene one agent is left, of the others all
    pairs = NeighbourPairs.of(Truth(truth.future, known, truth.observation))
    assert set(pairs.scene) == {1, 2, 3} and len(pairs.agent) == 3 * 3 * 2
    alone = Truth(
        truth.future[:1],
        truth.known[:1],
        Observation(
            history=truth.observation.history[:1],
            scene=np.array([0, 1]),
            agent=truth.observation.agent[:1],
            dt=truth.observation.dt,
        ),
    )
    before = made.predict(truth.observation).positions
    made.observe(alone)
    assert made.scenes == 0
    np.testing.assert_array_equal(made.predict(truth.observation).positions, before)


def test_what_is_observed_changes_forecasts_until_reset(made, crowd):
    observation = crowd.windows("test").observation
    before = made.predict(observation, 3).positions
    made.observe(pick_scenes(crowd.reference(), np.arange(8)))
    assert made.scenes == 8
    after = made.predict(observation, 3).positions
    assert before.shape == after.shape == (len(observation), 3, 12, 2)
    assert not np.allclose(before, after, atol=1e-3)
    made.reset()
    np.testing.assert_array_equal(made.predict(observation, 3).positions, before)


def test_weights_are_kept_and_others_are_refused(made, crowd, tmp_path):
    made.save(tmp_path / "w.safetensors")
    observation = pick_scenes(crowd.windows("test"), np.arange(5)).observation
    again = ModularStgat(tmp_path / "w.safetensors", seed=0)
    torch.testing.assert_close(
        torch.from_numpy(again.predict(observation).positions), torch.from_numpy(made.predict(observation).positions)
    )
    with pytest.raises(PredictorError, match="it lacks"):
        plain = Erm(sigma=False).fit(*training_set(crowd), 0, epochs=(1, 1, 1), joint=True)
        plain.save(tmp_path / "plain.safetensors")
        ModularStgat(tmp_path / "plain.safetensors")
    with pytest.raises(PredictorError, match="trained without sigma"):
        ModularStgat(tmp_path / "w.safetensors", sigma=True)


def test_forecasts_are_refined_scene_by_scene(made, crowd):
    truth = crowd.windows("test")
    refined = Refine(made, steps=2, rate=0.01)
    plain = refined.predict(truth.observation).positions
    refined.observe(pick_scenes(crowd.reference(), np.arange(8)))
    whole = refined.predict(truth.observation).positions
    assert np.abs(whole - plain).max() > 1e-3
    few = pick_scenes(truth, np.arange(5)).observation
    np.testing.assert_allclose(refined.predict(few).positions, whole[:15], atol=1e-4)


def test_real_scenes_of_any_size(made, eth_ucy):
    place = mg.domain("zara1:min_agents=1")
    truth = pick_scenes(place.windows("test"), np.arange(0, 700, 18))
    stretched = dataclasses.replace(truth.observation, dt=crowd_dt(made))
    made.observe(Truth(truth.future, truth.known, stretched))
    assert 0 < made.scenes < truth.observation.scenes  # those of one agent show no style
    forecast = made.predict(truth.observation, 2)
    assert forecast.positions.shape == (len(truth.observation), 2, 12, 2) and np.isfinite(forecast.positions).all()
    made.reset()


def crowd_dt(made):
    return float(made.tensors["prior.dt"])


def test_what_cannot_be_trained_on_is_refused(crowd):
    train, validation = training_set(crowd)
    with pytest.raises(SpecError, match="must be a list of 6"):
        ModularStgat().fit(train, validation, epochs=(1, 1, 1))
    with pytest.raises(PredictorError, match="give at least two"):
        ModularStgat().fit(train[:1], validation[:1], epochs=SHORT)
    known = train[1].known.copy()
    known[:, -1] = False
    alone = Truth(train[1].future, known, train[1].observation)
    with pytest.raises(PredictorError, match="Environment 1 of the training set has no scenes of two agents"):
        ModularStgat().fit([train[0], alone], validation[:2], epochs=SHORT)
