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
def trained(crowd):
    return ModularStgat().fit(*training_set(crowd), [0, 1], epochs=SHORT, scenes=24)


def changed(truth, path, order):
    """The scenes with other paths [A, 20, 2] and another order of agents."""
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


def test_the_style_is_invariant_to_frame_and_order_of_agents(trained, crowd):
    truth = crowd.windows("test")
    path = whole_paths(truth).double().numpy()
    turn = np.array([[0.6, 0.8], [-0.8, 0.6]])
    order = np.arange(len(path)).reshape(-1, 3)[:, [2, 0, 1]].ravel()
    expected = trained.scene_codes(truth, trained.tensors)[0]
    codes = trained.scene_codes(changed(truth, path @ turn + [3.0, -2.0], order), trained.tensors)[0]
    torch.testing.assert_close(codes, expected, atol=1e-4, rtol=1e-4)
    assert expected.shape == (truth.observation.scenes, 8) and expected.std(dim=0).min() > 0


def test_agents_who_left_and_single_agents_have_no_style(trained, crowd):
    truth = pick_scenes(crowd.windows("test"), np.arange(4))
    known = truth.known.copy()
    known[:2, -1] = False  # one agent remains in the first scene, all agents in the others
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
    before = trained.predict(truth.observation).positions
    trained.observe(alone)
    assert trained.scenes == 0
    np.testing.assert_array_equal(trained.predict(truth.observation).positions, before)


def test_observed_scenes_change_forecasts_until_reset(trained, crowd):
    observation = crowd.windows("test").observation
    before = trained.predict(observation, 3).positions
    trained.observe(pick_scenes(crowd.reference(), np.arange(8)))
    assert trained.scenes == 8
    after = trained.predict(observation, 3).positions
    assert before.shape == after.shape == (len(observation), 3, 12, 2)
    assert not np.allclose(before, after, atol=1e-3)
    trained.reset()
    np.testing.assert_array_equal(trained.predict(observation, 3).positions, before)


def test_weights_are_saved_and_other_weights_are_refused(trained, crowd, tmp_path):
    trained.save(tmp_path / "w.safetensors")
    observation = pick_scenes(crowd.windows("test"), np.arange(5)).observation
    again = ModularStgat(tmp_path / "w.safetensors", seed=0)
    torch.testing.assert_close(
        torch.from_numpy(again.predict(observation).positions), torch.from_numpy(trained.predict(observation).positions)
    )
    with pytest.raises(PredictorError, match="weights of erm_no_sigma, not of modular_stgat"):
        plain = Erm(sigma=False).fit(*training_set(crowd), 0, epochs=(1, 1, 1), joint=True)
        plain.save(tmp_path / "plain.safetensors")
        ModularStgat(tmp_path / "plain.safetensors")
    with pytest.raises(PredictorError, match="weights of modular_stgat, not of modular_stgat:sigma=true"):
        ModularStgat(tmp_path / "w.safetensors", sigma=True)


def test_forecasts_are_refined_scene_by_scene(trained, crowd):
    truth = crowd.windows("test")
    refined = Refine(trained, steps=2, rate=0.01)
    plain = refined.predict(truth.observation).positions
    refined.observe(pick_scenes(crowd.reference(), np.arange(8)))
    whole = refined.predict(truth.observation).positions
    assert np.abs(whole - plain).max() > 1e-3
    few = pick_scenes(truth, np.arange(5)).observation
    np.testing.assert_allclose(refined.predict(few).positions, whole[:15], atol=1e-4)


def test_real_scenes_of_any_size_are_accepted(trained, eth_ucy):
    place = mg.domain("zara1:min_agents=1")
    truth = pick_scenes(place.windows("test"), np.arange(0, 700, 18))
    stretched = dataclasses.replace(truth.observation, dt=crowd_dt(trained))
    trained.observe(Truth(truth.future, truth.known, stretched))
    assert 0 < trained.scenes < truth.observation.scenes  # scenes of one agent have no style
    forecast = trained.predict(truth.observation, 2)
    assert forecast.positions.shape == (len(truth.observation), 2, 12, 2) and np.isfinite(forecast.positions).all()
    trained.reset()


def crowd_dt(trained):
    return float(trained.tensors["prior.dt"])


def test_unsuitable_training_sets_are_refused(crowd):
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
