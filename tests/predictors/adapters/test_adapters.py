"""All adapters: state, reset, styles, and the identity of scenes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.contract import Forecast, PredictorError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ready
from motion_gym.stepping.snapshot import shared_arrays, snapshot
from tests.predictors.adapters.adapting_scenes import PAIR, STGAT, learn, scenes_of
from tests.taped import fitted_linear


@pytest.fixture(scope="module")
def crowd():
    return mg.domain("orca:d=0.6,scenes=40").windows("test")


@pytest.mark.parametrize("name", catalog.ADAPTERS)
def test_the_source_is_unchanged_and_reset_restores_the_initial_state(crowd, name):
    source = mg.predictor(PAIR)
    source.predict(crowd.observation)
    source_before = snapshot(source)
    adapter, scenes = mg.adapter(name, source), scenes_of(crowd, range(6))
    adapter.predict(scenes[0].observation)
    initial, first = snapshot(adapter), learn(adapter, scenes)
    learned = snapshot(adapter)
    adapter.reset()
    adapter.predict(scenes[0].observation)
    assert snapshot(adapter) == initial and (learned != initial or name == "none")
    np.testing.assert_array_equal(learn(adapter, scenes), first)
    assert snapshot(adapter) == learned and snapshot(source) == source_before and not shared_arrays(source, adapter)


@pytest.mark.parametrize("name", ["finetune", "finetune:optimiser=sgd,rate=0.01", "kalman", "ekf", "ema_anchor"])
def test_reset_clears_updates_and_learned_weights(crowd, name):
    adapter = mg.adapter(name, PAIR)
    learn(adapter, scenes_of(crowd, range(4)))
    assert adapter.updates == 4
    adapter.reset()
    assert (adapter.updates, adapter.rolled_back) == (0, 0)
    plain = mg.adapter("kalman" if name == "kalman" else "none", PAIR)
    np.testing.assert_array_equal(
        adapter.predict(crowd.observation).positions, plain.predict(crowd.observation).positions
    )


@pytest.mark.parametrize("of", [PAIR, STGAT, "constant_velocity"])
def test_unadapted_equals_the_predictor(crowd, of):
    adapter, plain = mg.adapter("none", of), mg.predictor(of)
    before = snapshot(adapter)
    adapter.observe(crowd)
    assert snapshot(adapter) == before
    for samples in (1, 3):
        answers = [predictor.predict(crowd.observation, samples, 5).positions for predictor in (adapter, plain)]
        np.testing.assert_array_equal(*answers)


@pytest.mark.parametrize("name", ["style", "finetune:rate=1e-30", "refine:memory=5,steps=0"])
def test_the_style_is_read_from_the_last_whole_scenes(crowd, name):
    adapter = mg.adapter(name if name.startswith("refine") else f"{name}{',' if ':' in name else ':'}memory=5", PAIR)
    revealed = scenes_of(crowd, range(12))
    revealed[9] = dataclasses.replace(revealed[9], known=revealed[9].known & (np.arange(12) < 7))
    for scene in revealed:
        adapter.observe(scene)
    plain = mg.predictor(PAIR)
    plain.observe(pick_scenes(crowd, [6, 7, 8, 10, 11]))
    answers = [predictor.predict(crowd.observation).positions for predictor in (adapter, plain, mg.predictor(PAIR))]
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-5)
    assert np.abs(answers[0] - answers[2]).max() > 1e-3
    assert name != "style" or adapter.updates == 11


def timed(scene, time):
    """The scene with another time."""
    return dataclasses.replace(scene, observation=dataclasses.replace(scene.observation, time=np.array([time])))


@pytest.mark.parametrize("name", ["kalman", "hedge", "finetune", "ekf"])
def test_scenes_are_identified_by_time_and_agents(crowd, name):
    scene = scenes_of(crowd, [0])[0]
    adapter = mg.adapter(name, PAIR)
    for time in (8, 9, 10, 10):
        adapter.observe(timed(scene, time))
    # The scene at time 10 is revealed twice, but learned from once.
    assert adapter.updates == 3
    once = mg.adapter(name, PAIR)
    once.observe(timed(scene, 8))
    assert once.updates == 1


def test_identical_histories_at_different_times_are_different_scenes():
    """People predictor stand look alike at every time; before, all but the first scene were taken for the same one."""
    still = mg.adapter("kalman", fitted_linear(), memory=0)
    jittered = mg.adapter("kalman", fitted_linear(), memory=0)
    rng = np.random.default_rng(0)
    for time in range(40):
        history = np.zeros((2, 8, 2), np.float32) + np.array([[[3, 1]], [[5, 2]]], np.float32)
        here = mg.Observation(history, np.array([0, 2]), np.arange(2), 0.4, np.array([time]))
        future = history[:, -1:] + np.zeros((2, 12, 2), np.float32)
        moved = dataclasses.replace(here, history=history + rng.normal(0, 1e-4, history.shape).astype(np.float32))
        still.observe(mg.Truth(future, np.ones((2, 12), bool), here))
        jittered.observe(mg.Truth(future, np.ones((2, 12), bool), moved))
    assert still.updates == jittered.updates == 40
    adapter = (fitted_linear(), still, jittered)
    trained, *adapted = (np.abs(one.predict(here).positions[:, 0] - future).max() for one in adapter)
    # The remaining share of the prior's bias is 10 / (10 + 65): 80 rows with forgetting 0.99 and a ridge of 10.
    assert max(adapted) < 0.2 * trained


@pytest.mark.parametrize("name", catalog.ADAPTERS)
def test_partial_scenes_and_standing_crowds_are_accepted(crowd, name):
    adapter, scene = mg.adapter(name, PAIR), scenes_of(crowd, [0])[0]
    adapter.predict(scene.observation)  # loads the weights
    before = snapshot(adapter)
    part = dataclasses.replace(
        scene,
        future=scene.future[:1],
        known=scene.known[:1],
        observation=dataclasses.replace(
            scene.observation,
            history=scene.observation.history[:1],
            scene=np.array([0, 1]),
            agent=scene.observation.agent[:1],
        ),
    )
    adapter.observe(part)
    assert snapshot(adapter) == before  # the network takes pairs only
    last = np.repeat(scene.observation.xy[:, -1:], 12, axis=1)
    for _ in range(3):
        adapter.observe(
            dataclasses.replace(
                scene,
                future=last.copy(),
                observation=dataclasses.replace(scene.observation, history=last[:, :8].copy()),
            )
        )
    assert np.isfinite(adapter.predict(crowd.observation).positions).all()


class Plain:
    """A predictor that returns an array, as the contract allows: all agents stand still."""

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)


@pytest.mark.parametrize("name", ["none", "hedge"])
def test_predictors_that_return_arrays_can_be_adapted(crowd, name):
    adapter = mg.adapter(name, Plain())
    for scene in scenes_of(crowd, range(3)):
        assert isinstance(adapter.predict(scene.observation), Forecast)
        adapter.observe(scene)
    assert adapter.predict(crowd.observation).positions.shape == (len(crowd.future), 1, 12, 2)


@pytest.mark.parametrize("name", ["none", "kalman", "hedge"])
def test_the_predictor_inside_an_adapter_is_fitted_to_the_sources_of_the_domain(name):
    domain = mg.domain("orca:d=0.6,scenes=12")
    linear = ready("linear", domain)
    by_name = mg.evaluate_online(f"{name}:of=linear", domain)
    by_object = mg.evaluate_online(mg.adapter(name, linear), domain)
    assert by_name.ade.mean == by_object.ade.mean and by_name.leaks == by_object.leaks
    assert ready(f"{name}:of=linear", domain).trained_on == linear.trained_on


def test_a_wrapped_predictor_that_needs_no_training_is_not_trained():
    adapter = mg.predictor("none:of=constant_velocity")
    assert adapter.fitted
    with pytest.raises(PredictorError, match="ConstantVelocity has no `fit`"):
        adapter.fit([], [])


@pytest.mark.parametrize("name", ["none", "kalman", "hedge", "finetune:parts=last_layer"])
def test_an_adapter_lets_its_predictor_choose_weights_that_have_not_seen_the_scored_place(name):
    adapter = mg.adapter(name, "kalman_residual")
    adapter.choose_weights([mg.domain("zara1")])
    adapter.reset()
    assert "zara1" not in adapter.trained_on and "hotel" in adapter.trained_on
    named = mg.adapter(name, "kalman_residual:weights=original/all")
    named.choose_weights([mg.domain("zara1")])
    assert "zara1" in named.trained_on
