"""Adapters that update weights: learning, waiting, buffers and rolled-back updates."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.snapshot import snapshot
from tests.predictors.adapters.adapting_scenes import PAIR, TUNED, error, learn, scenes_of

WRONG = {
    "finetune:rate=1e30": 3,
    "finetune:rate=1e30,optimiser=sgd": 3,
    "ema_anchor:rate=1e30": 3,
    "kalman:ridge=1e-300": 3,
    "ekf:spread=1e30": 3,
}
"""Number of rolled-back updates for settings that make updates unusable."""


@pytest.fixture(scope="module")
def crowd():
    return mg.domain("orca:d=0.6,scenes=40").windows("test")


def test_memory_zero_disables_the_style(crowd):
    adapter = mg.adapter("finetune:rate=1e-30,memory=0", PAIR)
    adapter.observe(crowd)
    np.testing.assert_array_equal(adapter.inner.observed, np.zeros(8))


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("style", 0.7),
        ("finetune:rate=3e-5", 0.8),
        ("finetune:rate=3e-5,memory=0,steps=3", 0.95),
        ("ema_anchor:rate=3e-5,memory=0,steps=3", 0.95),
    ],
)
def test_adapters_learn_a_new_crowd(crowd, name, least):
    adapter, plain, later = mg.adapter(name, PAIR), mg.predictor(PAIR), pick_scenes(crowd, slice(25, None))
    learn(adapter, scenes_of(crowd, range(25)))
    assert error(adapter, later) < least * error(plain, later)


@pytest.mark.parametrize("wrong", WRONG)
def test_unusable_updates_are_rolled_back_and_counted(crowd, wrong):
    adapter, scenes = mg.adapter(wrong, PAIR, memory=0), scenes_of(crowd, range(3))
    before = adapter.predict(crowd.observation).positions
    with np.errstate(all="ignore"):
        learn(adapter, scenes)
    assert (adapter.updates, adapter.rolled_back) == (3, WRONG[wrong])
    np.testing.assert_array_equal(adapter.predict(crowd.observation).positions, before)


def test_a_rolled_back_update_keeps_earlier_updates(crowd):
    adapter, scenes = mg.adapter("finetune", PAIR, memory=0), scenes_of(crowd, range(4))
    learn(adapter, scenes[:2])
    weights, state = snapshot(adapter.inner.tensors), snapshot(adapter.state)
    far = dataclasses.replace(scenes[2], future=np.full_like(scenes[2].future, 3e38))
    adapter.observe(far)
    assert (adapter.updates, adapter.rolled_back) == (3, 1)
    assert snapshot(adapter.inner.tensors) == weights and snapshot(adapter.state) == state
    assert np.isfinite(adapter.predict(crowd.observation).positions).all()


def test_the_buffer_is_bounded(crowd):
    adapter = mg.adapter("finetune:buffer=4,memory=3,rate=1e-6", PAIR)
    adapter.observe(pick_scenes(crowd, slice(0, 10)))
    for scene in scenes_of(crowd, range(10, 16)):
        adapter.observe(scene)
        assert len(adapter.recent) == 4 and len(adapter.styles) == 3
    last = [truth.future.tobytes() for truth in adapter.recent.values()]
    assert last == [scene.future.tobytes() for scene in scenes_of(crowd, range(12, 16))]


def test_a_repeated_scene_replaces_the_remembered_one(crowd):
    adapter, scene = mg.adapter("finetune:least=1,rate=1e-6", PAIR, memory=0), scenes_of(crowd, [0])[0]
    for steps in (0, 1, 5, 12):
        adapter.observe(dataclasses.replace(scene, known=scene.known & (np.arange(12) < steps)))
    (kept,) = adapter.recent.values()
    assert kept.known.all() and adapter.updates == 1


@pytest.mark.parametrize(("every", "updates"), [(1, [1, 2, 3, 4, 5, 6, 7]), (3, [0, 0, 1, 1, 1, 2, 2])])
@pytest.mark.parametrize("name", TUNED)
def test_updates_wait_for_enough_scenes(crowd, name, every, updates):
    adapter, initial = mg.adapter(name, PAIR, every=every, memory=0), 0
    for scene, count in zip(scenes_of(crowd, range(7)), updates, strict=True):
        before = snapshot(adapter.inner.tensors)
        adapter.observe(scene)
        assert adapter.updates == count
        assert (snapshot(adapter.inner.tensors) != before) == (count > initial)
        initial = count


@pytest.mark.parametrize("name", TUNED)
@pytest.mark.parametrize("least", [8, 12])
def test_least_sets_the_known_steps_of_agents_who_left(crowd, name, least):
    adapter, scene = mg.adapter(name, PAIR, least=least), scenes_of(crowd, [0])[0]
    for steps, expected in ((7, 0), (8, 1), (11, 1)):
        adapter.reset()
        adapter.observe(dataclasses.replace(scene, known=scene.known & (np.arange(12) < steps)))
        assert adapter.updates == (expected if least == 8 else 0)


@pytest.mark.parametrize("of", [PAIR, "modular_stgat"])
@pytest.mark.parametrize("name", ["finetune", "ekf"])
def test_only_the_chosen_parts_are_tuned(name, of):
    truth = synthetic((2,) * 4, 2, 4)
    for part in ("all", "style", "modulator", "last_layer") if name == "finetune" else ("last_layer",):
        adapter = mg.adapter(name, of, parts=part, **({"gate": 1e6} if name == "ekf" else {}))
        initial = {key: value.clone() for key, value in adapter.inner.tensors.items()}
        adapter.observe(truth)
        moved = {key for key, value in adapter.inner.tensors.items() if not torch.equal(value, initial[key])}
        named = {key for key in initial if key.startswith(adapter.inner.parts[part])}
        assert moved <= named and {key.split(".")[0] for key in moved} == {key.split(".")[0] for key in named}


def test_an_anchor_pulls_towards_the_trained_weights(crowd):
    def drift(name, **parameters):
        adapter = mg.adapter(name, PAIR, memory=0, rate=1e-3, **parameters)
        learn(adapter, scenes_of(crowd, range(8)))
        initial = adapter.source.tensors
        return sum(float((adapter.inner.tensors[key] - value).norm() ** 2) for key, value in initial.items()) ** 0.5

    free, weak, strong = drift("finetune"), drift("ema_anchor", anchor=0.05), drift("ema_anchor", anchor=0.5)
    assert drift("finetune", anchor=1.0) == 0 < strong < weak < free
    assert drift("finetune", anchor=0.05) == weak


def test_a_gradient_step_minimises_the_mean_distance(crowd):
    """Compares plain gradient descent on one partly known scene with finite differences."""
    adapter, scene = (
        mg.adapter("finetune:optimiser=sgd,rate=0.01,parts=last_layer", PAIR, memory=0),
        scenes_of(crowd, [3])[0],
    )
    known = np.arange(12) < np.array([[12], [5]])
    scene = dataclasses.replace(scene, known=known)
    bias, step = "decoder.bias4", 1e-3
    initial, slopes = adapter.inner.tensors, np.zeros(48)
    for index in range(48):
        for sign in (1, -1):
            shifted = initial[bias].clone()
            shifted[0, index] += sign * step
            adapter.inner.tensors = {**initial, bias: shifted}
            slopes[index] += sign * error(adapter, scene) / (2 * step)
    adapter.inner.tensors = initial
    adapter.observe(scene)
    moved = (adapter.inner.tensors[bias] - initial[bias])[0].numpy()
    np.testing.assert_allclose(moved, -0.01 * slopes, atol=2e-5)
    assert np.abs(moved).max() > 1e-4
