"""Adapters: what they refuse, learn, remember, take back and forget."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym import catalog
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.contract import DataError, Forecast, PredictorError, SpecError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.snapshot import shared_arrays, snapshot
from tests.taped import fitted_linear

PAIR, STGAT = "modular_invariant", "erm_no_sigma:weights=original/zara2"
TUNED = ("finetune", "ema_anchor", "ekf")
WITH_STYLE = ("style", "refine")
WRONG = {
    "finetune:rate=1e38": 3,
    "finetune:rate=1e30,optimiser=sgd": 3,
    "ema_anchor:rate=1e38": 3,
    "kalman:ridge=1e-300": 3,
    "ekf:spread=1e30": 3,
}
"""Updates that cannot be used."""


@pytest.fixture(scope="module")
def crowd():
    return mg.domain("orca:d=0.6,scenes=40").windows("test")


def each(truth, scenes):
    return [pick_scenes(truth, [scene]) for scene in scenes]


def taught(made, scenes):
    """The forecast of each scene before it was told."""
    answers = []
    for scene in scenes:
        answers.append(made.predict(scene.observation).positions)
        made.observe(scene)
    return answers


def error(made, truth):
    off = made.predict(truth.observation).positions[:, 0].astype(float) - truth.future
    return np.linalg.norm(off, axis=-1)[truth.known].mean()


@pytest.mark.parametrize("name", catalog.ADAPTERS)
def test_what_was_given_stays_as_it_was_and_reset_brings_everything_back(crowd, name):
    source = mg.predictor(PAIR)
    source.predict(crowd.observation)
    given = snapshot(source)
    made, scenes = mg.adapter(name, source), each(crowd, range(6))
    made.predict(scenes[0].observation)
    begun, first = snapshot(made), taught(made, scenes)
    learned = snapshot(made)
    made.reset()
    made.predict(scenes[0].observation)
    assert snapshot(made) == begun and (learned != begun or name == "none")
    np.testing.assert_array_equal(taught(made, scenes), first)
    assert snapshot(made) == learned and snapshot(source) == given and not shared_arrays(source, made)


@pytest.mark.parametrize("name", ["finetune", "finetune:optimiser=sgd,rate=0.01", "kalman", "ekf", "ema_anchor"])
def test_what_it_has_learned_and_counts_is_gone_after_reset(crowd, name):
    made = mg.adapter(name, PAIR)
    taught(made, each(crowd, range(4)))
    assert made.updates == 4
    made.reset()
    assert (made.updates, made.rolled_back) == (0, 0)
    plain = mg.adapter("none", PAIR) if name != "kalman" else mg.adapter("kalman", PAIR)
    np.testing.assert_array_equal(made.predict(crowd.observation).positions, plain.predict(crowd.observation).positions)


@pytest.mark.parametrize("of", [PAIR, STGAT, "constant_velocity"])
def test_without_adaptation_it_is_the_predictor(crowd, of):
    made, plain = mg.adapter("none", of), mg.predictor(of)
    before = snapshot(made)
    made.observe(crowd)
    assert snapshot(made) == before
    for samples in (1, 3):
        answers = [who.predict(crowd.observation, samples, 5).positions for who in (made, plain)]
        np.testing.assert_array_equal(*answers)


@pytest.mark.parametrize("name", ["style", "finetune:rate=1e-30", "refine:memory=5,steps=0"])
def test_the_style_is_that_of_the_last_whole_scenes(crowd, name):
    made = mg.adapter(name if name.startswith("refine") else f"{name}{',' if ':' in name else ':'}memory=5", PAIR)
    told = each(crowd, range(12))
    told[9] = dataclasses.replace(told[9], known=told[9].known & (np.arange(12) < 7))
    for scene in told:
        made.observe(scene)
    plain = mg.predictor(PAIR)
    plain.observe(pick_scenes(crowd, [6, 7, 8, 10, 11]))
    answers = [who.predict(crowd.observation).positions for who in (made, plain, mg.predictor(PAIR))]
    np.testing.assert_allclose(answers[0], answers[1], atol=1e-5)
    assert np.abs(answers[0] - answers[2]).max() > 1e-3
    assert name != "style" or made.updates == 11


def test_a_style_can_be_left_alone(crowd):
    made = mg.adapter("finetune:rate=1e-30,memory=0", PAIR)
    made.observe(crowd)
    np.testing.assert_array_equal(made.inner.observed, np.zeros(8))


@pytest.mark.parametrize(
    ("name", "least"),
    [
        ("style", 0.7),
        ("finetune:rate=3e-5", 0.8),
        ("finetune:rate=3e-5,memory=0,steps=3", 0.95),
        ("ema_anchor:rate=3e-5,memory=0,steps=3", 0.95),
    ],
)
def test_adapters_learn_another_crowd(crowd, name, least):
    made, plain, later = mg.adapter(name, PAIR), mg.predictor(PAIR), pick_scenes(crowd, slice(25, None))
    taught(made, each(crowd, range(25)))
    assert error(made, later) < least * error(plain, later)


@pytest.mark.parametrize("wrong", WRONG)
def test_an_update_that_cannot_be_used_is_taken_back_and_counted(crowd, wrong):
    made, scenes = mg.adapter(wrong, PAIR, memory=0), each(crowd, range(3))
    before = made.predict(crowd.observation).positions
    with np.errstate(all="ignore"):
        taught(made, scenes)
    assert (made.updates, made.rolled_back) == (3, WRONG[wrong])
    np.testing.assert_array_equal(made.predict(crowd.observation).positions, before)


def test_an_update_that_is_taken_back_leaves_what_was_learned_before(crowd):
    made, scenes = mg.adapter("finetune", PAIR, memory=0), each(crowd, range(4))
    taught(made, scenes[:2])
    weights, state = snapshot(made.inner.tensors), snapshot(made.state)
    far = dataclasses.replace(scenes[2], future=np.full_like(scenes[2].future, 3e38))
    made.observe(far)
    assert (made.updates, made.rolled_back) == (3, 1)
    assert snapshot(made.inner.tensors) == weights and snapshot(made.state) == state
    assert np.isfinite(made.predict(crowd.observation).positions).all()


def test_what_it_remembers_is_bounded(crowd):
    made = mg.adapter("finetune:buffer=4,memory=3,rate=1e-6", PAIR)
    made.observe(pick_scenes(crowd, slice(0, 10)))
    for scene in each(crowd, range(10, 16)):
        made.observe(scene)
        assert len(made.recent) == 4 and len(made.shown) == 3
    last = [truth.future.tobytes() for truth in made.recent.values()]
    assert last == [scene.future.tobytes() for scene in each(crowd, range(12, 16))]


def test_a_scene_that_is_told_again_replaces_what_was_known_of_it(crowd):
    made, scene = mg.adapter("finetune:least=1,rate=1e-6", PAIR, memory=0), each(crowd, [0])[0]
    for upto in (0, 1, 5, 12):
        made.observe(dataclasses.replace(scene, known=scene.known & (np.arange(12) < upto)))
    (kept,) = made.recent.values()
    assert kept.known.all() and made.updates == 1


@pytest.mark.parametrize(("every", "updates"), [(1, [1, 2, 3, 4, 5, 6, 7]), (3, [0, 0, 1, 1, 1, 2, 2])])
@pytest.mark.parametrize("name", TUNED)
def test_it_waits_until_enough_scenes_have_come(crowd, name, every, updates):
    made, begun = mg.adapter(name, PAIR, every=every, memory=0), 0
    for scene, count in zip(each(crowd, range(7)), updates, strict=True):
        before = snapshot(made.inner.tensors)
        made.observe(scene)
        assert made.updates == count
        assert (snapshot(made.inner.tensors) != before) == (count > begun)
        begun = count


@pytest.mark.parametrize("name", TUNED)
@pytest.mark.parametrize("least", [8, 12])
def test_people_who_left_are_learned_from_as_far_as_is_asked_for(crowd, name, least):
    made, scene = mg.adapter(name, PAIR, least=least), each(crowd, [0])[0]
    for upto, expected in ((7, 0), (8, 1), (11, 1)):
        made.reset()
        made.observe(dataclasses.replace(scene, known=scene.known & (np.arange(12) < upto)))
        assert made.updates == (expected if least == 8 else 0)


@pytest.mark.parametrize("of", [PAIR, "modular_stgat"])
@pytest.mark.parametrize("name", ["finetune", "ekf"])
def test_only_the_parts_that_are_named_are_tuned(name, of):
    truth = synthetic((2,) * 4, 2, 4)
    for part in ("all", "style", "modulator", "last_layer") if name == "finetune" else ("last_layer",):
        made = mg.adapter(name, of, parts=part, **({"gate": 1e6} if name == "ekf" else {}))
        begun = {key: value.clone() for key, value in made.inner.tensors.items()}
        made.observe(truth)
        moved = {key for key, value in made.inner.tensors.items() if not torch.equal(value, begun[key])}
        named = {key for key in begun if key.startswith(made.inner.parts[part])}
        assert moved <= named and {key.split(".")[0] for key in moved} == {key.split(".")[0] for key in named}


def test_an_anchor_pulls_back_to_the_trained_weights(crowd):
    def way(name, **parameters):
        made = mg.adapter(name, PAIR, memory=0, rate=1e-3, **parameters)
        taught(made, each(crowd, range(8)))
        begun = made._begun.tensors
        return sum(float((made.inner.tensors[key] - value).norm() ** 2) for key, value in begun.items()) ** 0.5

    free, weak, strong = way("finetune"), way("ema_anchor", anchor=0.05), way("ema_anchor", anchor=0.5)
    assert way("finetune", anchor=1.0) == 0 < strong < weak < free
    assert way("finetune", anchor=0.05) == weak


def test_one_gradient_step_is_that_of_the_mean_distance(crowd):
    """Of plain gradient descent on one scene, some of whose steps are unknown, by finite differences."""
    made, scene = mg.adapter("finetune:optimiser=sgd,rate=0.01,parts=last_layer", PAIR, memory=0), each(crowd, [3])[0]
    known = np.arange(12) < np.array([[12], [5]])
    scene = dataclasses.replace(scene, known=known)
    bias, step = "decoder.bias4", 1e-3
    begun, slopes = made.inner.tensors, np.zeros(48)
    for index in range(48):
        for sign in (1, -1):
            shifted = begun[bias].clone()
            shifted[0, index] += sign * step
            made.inner.tensors = {**begun, bias: shifted}
            slopes[index] += sign * error(made, scene) / (2 * step)
    made.inner.tensors = begun
    made.observe(scene)
    moved = (made.inner.tensors[bias] - begun[bias])[0].numpy()
    np.testing.assert_allclose(moved, -0.01 * slopes, atol=2e-5)
    assert np.abs(moved).max() > 1e-4


@pytest.mark.parametrize(
    ("name", "of", "error", "message"),
    [
        ("style", "constant_velocity", PredictorError, "reads no style from scenes .*: use modular_invariant"),
        ("style", STGAT, PredictorError, "reads no style"),
        ("refine", STGAT, PredictorError, "no style encoder"),
        ("finetune", "constant_velocity", PredictorError, "no weights that gradients reach .*: use one of the STGAT"),
        ("ema_anchor", "linear", PredictorError, "`linear` is adapted by kalman"),
        ("ekf", "linear", PredictorError, "no weights that gradients reach"),
        ("kalman", "constant_velocity", PredictorError, "no linear last layer that can be replaced"),
        ("kalman", "linear", PredictorError, "not fitted: give it fitted"),
        (
            "finetune:parts=style",
            STGAT,
            PredictorError,
            "has no part `style`, as it reads no style: it has all, last_l",
        ),
        ("finetune:parts=modulater", PAIR, SpecError, "`parts=modulater` is not known. Did you mean `modulator`"),
        ("ekf:parts=all", PAIR, SpecError, r"are \d+ weights, and the covariance of more than 4096 is too large"),
        ("finetune:optimiser=adem", PAIR, SpecError, "`optimiser=adem` is not known. Did you mean `adam`"),
        ("finetune:rate=0", PAIR, SpecError, "`rate=0` must be a number above 0"),
        ("finetune:anchor=1.5", PAIR, SpecError, "`anchor=1.5` must be a number, 0 or more, and at most 1"),
        ("ema_anchor:anchor=-1", PAIR, SpecError, "`anchor=-1`"),
        ("finetune:every=0", PAIR, SpecError, "`every=0`"),
        ("finetune:steps=0", PAIR, SpecError, "`steps=0`"),
        ("finetune:batch=0", PAIR, SpecError, "`batch=0`"),
        ("finetune:buffer=0.5", PAIR, SpecError, "`buffer=0.5`"),
        ("finetune:least=13", PAIR, SpecError, "`least=13` must be a whole number, from 1 to 12"),
        ("finetune:memory=-1", PAIR, SpecError, "`memory=-1`"),
        ("style:memory=0", PAIR, SpecError, "`memory=0`"),
        ("kalman:ridge=0", PAIR, SpecError, "`ridge=0` must be a number above 0"),
        ("kalman:forgetting=0", PAIR, SpecError, "`forgetting=0` must be a number above 0, and at most 1"),
        ("kalman:forgetting=1.01", PAIR, SpecError, "`forgetting=1.01` must be a number above 0, and at most 1"),
        ("ekf:least=2", PAIR, SpecError, "`least=2` must be a whole number, from 3 to 12"),
        ("ekf:average=1", PAIR, SpecError, "`average=1` must be a number, 0 or more, and below 1"),
        ("ekf:noise=0", PAIR, SpecError, "`noise=0` must be a number above 0"),
        ("ekf:spread=true", PAIR, SpecError, "`spread=True` must be a number above 0"),
        ("ekf:drift=-1", PAIR, SpecError, "`drift=-1`"),
        ("ekf:gate=0", PAIR, SpecError, "`gate=0`"),
        ("kalman:weights=style", PAIR, SpecError, "`weights` and `seed` go with the name of a predictor"),
        ("kalmann", PAIR, SpecError, "no adapter `kalmann`. Did you mean `kalman`"),
        ("kalman:rigde=1", PAIR, SpecError, "no parameter `rigde`. Did you mean `ridge`"),
        (
            "motion_gym.predictors.linear:Linear",
            PAIR,
            SpecError,
            "is no adapter, as its constructor takes no predictor",
        ),
    ],
)
def test_what_cannot_be_adapted_is_refused(name, of, error, message):
    with pytest.raises(error, match=message):
        mg.adapter(name, of)


@pytest.mark.parametrize("name", ["none", *TUNED, "kalman", "style"])
def test_what_is_no_truth_is_refused(crowd, name):
    made, scene = mg.adapter(name, PAIR), each(crowd, [0])[0]
    before = snapshot(made)
    bad = scene.future.copy()
    bad[1, 3] = np.nan
    for truth in (
        scene.observation,
        dataclasses.replace(scene, future=bad),
        dataclasses.replace(scene, known=bad[..., 0]),
    ):
        with pytest.raises(DataError, match="The observed truth"):
            made.observe(truth)
    assert snapshot(made) == before


def test_names_say_what_is_done_to_whom():
    made = mg.adapter("finetune:rate=0.01,parts=style", PAIR, every=4)
    assert made.name == "finetune:parts=style,rate=0.01,every=4"
    assert mg.predictor(made.name).name == made.name
    assert mg.adapter("kalman", fitted_linear()).name == "kalman:of=Linear"
    assert mg.adapter("none", PAIR).name == "none:of=modular_invariant"
    assert made.selection == mg.predictor(PAIR).selection and made.trained_on == mg.predictor(PAIR).trained_on


def timed(scene, time):
    """The same scene at another time."""
    return dataclasses.replace(scene, observation=dataclasses.replace(scene.observation, time=np.array([time])))


@pytest.mark.parametrize("name", ["kalman", "hedge", "finetune", "ekf"])
def test_a_scene_is_known_by_when_it_was_and_not_by_what_it_shows(crowd, name):
    scene = each(crowd, [0])[0]
    made = mg.adapter(name, PAIR)
    for time in (8, 9, 10, 10):
        made.observe(timed(scene, time))
    # The scene at time 10 is told twice; fine-tuning and filters learn from it once.
    assert made.updates == 3
    once = mg.adapter(name, PAIR)
    once.observe(timed(scene, 8))
    assert once.updates == 1


def test_a_crowd_that_stands_still_is_learned_from_as_any_other():
    """People who stand look alike at every time; before, all but the first scene were taken for the same one."""
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
    made = (fitted_linear(), still, jittered)
    trained, *adapted = (np.abs(one.predict(here).positions[:, 0] - future).max() for one in made)
    # Of the prior's bias, 10 / (10 + 65) is left: 80 rows, forgotten by .99 a scene, against a ridge of 10.
    assert max(adapted) < 0.2 * trained


@pytest.mark.parametrize("name", catalog.ADAPTERS)
def test_parts_of_scenes_and_standing_crowds_do_not_stop_an_adapter(crowd, name):
    made, scene = mg.adapter(name, PAIR), each(crowd, [0])[0]
    made.predict(scene.observation)  # which loads the weights
    before = snapshot(made)
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
    made.observe(part)
    assert snapshot(made) == before  # the network takes pairs
    last = np.repeat(scene.observation.xy[:, -1:], 12, axis=1)
    for _ in range(3):
        made.observe(
            dataclasses.replace(
                scene,
                future=last.copy(),
                observation=dataclasses.replace(scene.observation, history=last[:, :8].copy()),
            )
        )
    assert np.isfinite(made.predict(crowd.observation).positions).all()


class Plain:
    """A predictor that gives an array, as the contract allows: everybody stays."""

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)


@pytest.mark.parametrize("name", ["none", "hedge"])
def test_a_predictor_that_gives_an_array_can_be_adapted(crowd, name):
    made = mg.adapter(name, Plain())
    for scene in each(crowd, range(3)):
        assert isinstance(made.predict(scene.observation), Forecast)
        made.observe(scene)
    assert made.predict(crowd.observation).positions.shape == (len(crowd.future), 1, 12, 2)


def test_names_of_aliases_stay_and_are_read_back():
    for name in ("erm_no_sigma", "counterfactual:sigma=false", "style_invariant", "modular_invariant", "vrex"):
        assert mg.predictor(name).name == name
    for name in ("ema_anchor", "ema_anchor:rate=0.001,anchor=0.001", "finetune"):
        made = mg.adapter(name, PAIR)
        assert mg.adapter(made.name, PAIR).name == made.name and made.name.startswith(name.partition(":")[0])
    assert mg.predictor("modular:penalty=1").name == "modular_invariant"
    assert mg.predictor("erm:counterfactual=true").name == "counterfactual"
