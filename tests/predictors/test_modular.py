"""The paper's two-agent network, with and without a style."""

import dataclasses
import functools

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.checks.checker import check_predictor
from motion_gym.contract import PredictorError, SpecError
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.adapters.refine import Refine
from motion_gym.predictors.modular import Modular, StyleErm

SHORT = (2, 1, 1, 2)
OPTIONS = {"scenes": 16}
StyleInvariant = functools.partial(StyleErm, penalty=1)
ModularInvariant = functools.partial(Modular, penalty=1)


@pytest.fixture(scope="module")
def data():
    return training_set(mg.domain("orca", scenes=70))


@pytest.fixture(scope="module")
def modular(data):
    return Modular().fit(*data, [0, 1], epochs=SHORT, **OPTIONS)


@pytest.fixture(scope="module")
def reference():
    return mg.domain("orca:d=0.6,scenes=70").reference()


def test_training_lowers_the_error(data):
    for kind in (StyleErm, StyleInvariant):
        network = kind().fit(*data, [0, 1], epochs=(8,), **OPTIONS)
        scores = [np.mean(entry["score"]) for entry in network.card["curve"]]
        assert scores[-1] < 0.7 * scores[0]


def test_the_scene_encoder_is_frozen_after_the_first_stage(data, modular):
    longer = Modular().fit(*data, [0, 1], epochs=(2, 2, 2, 3), **OPTIONS)
    for name, value in longer.stacked.items():
        part = name.split(".")[0]
        assert torch.equal(value, modular.stacked[name]) == (part == "encoder" or name == "prior.dt")


def test_stages_train_their_own_parts_alone(data):
    early = Modular().fit(*data, 0, epochs=(1, 0, 0, 1), **OPTIONS).card
    assert [entry["stage"] for entry in early["curve"]] == ["forecast", "forecast in style"]
    assert "trained for 1/0/0/1 epochs" in early["selection"]


def test_a_killed_training_resumes_to_the_same_weights(data, modular, tmp_path):
    class Killed(Exception):
        pass

    def report(progress):
        if progress.epoch == 5:
            raise Killed

    path = tmp_path / "a.checkpoint"
    with pytest.raises(Killed):
        Modular().fit(*data, [0, 1], epochs=SHORT, checkpoint=path, every=2, report=report, **OPTIONS)
    resumed = Modular().fit(*data, [0, 1], epochs=SHORT, checkpoint=path, every=2, resume=True, **OPTIONS)
    assert all(torch.equal(value, modular.stacked[name]) for name, value in resumed.stacked.items())


def test_the_style_is_a_running_average_over_the_observed_scenes(modular, reference):
    network, other = Modular(), Modular()
    for each in (network, other):
        each.use(modular.stacked, modular.card)
    seen = mg.domain("orca:scenes=30").windows("test").observation
    fresh = network.predict(seen).positions
    network.observe(reference)
    for index in (range(20, reference.observation.scenes), range(20)):
        other.observe(pick_scenes(reference, list(index)))
    assert network.scenes == other.scenes == reference.observation.scenes
    np.testing.assert_allclose(network.predict(seen).positions, other.predict(seen).positions, atol=1e-5)
    assert np.abs(network.predict(seen).positions - fresh).max() > 1e-4
    network.reset()
    np.testing.assert_array_equal(network.predict(seen).positions, fresh)


def test_partly_known_scenes_have_no_style(modular, reference):
    network = Modular()
    network.use(modular.stacked, modular.card)
    known = reference.known.copy()
    known[::2, -1] = False
    network.observe(dataclasses.replace(reference, known=known))
    assert network.scenes == 0
    known[:4] = True
    network.observe(dataclasses.replace(reference, known=known))
    assert network.scenes == 2


def test_scenes_of_another_time_step_are_refused(modular, reference):
    other = dataclasses.replace(reference, observation=dataclasses.replace(reference.observation, dt=0.1))
    network = Modular()
    network.use(modular.stacked, modular.card)
    with pytest.raises(PredictorError, match=r"trained on time steps of 0.4 s, and the observation has steps of 0.1 s"):
        network.observe(other)


def test_scenes_of_another_number_of_agents_are_refused(modular):
    three = mg.domain("orca:agents=3,scenes=20")
    for call in (
        lambda: modular.predict(three.windows("test").observation),
        lambda: modular.observe(three.reference()),
    ):
        with pytest.raises(PredictorError, match="exactly 2 agents, but a scene has 3"):
            call()


@pytest.mark.parametrize(
    ("kind", "options", "error", "reason"),
    [
        (Modular, {"epochs": (1,)}, SpecError, "must be a list of 4 for modular, a number for each stage"),
        (StyleErm, {"epochs": (1, 1, 1, 1)}, SpecError, "must be a list of 1 for style_erm"),
        (StyleErm, {"epochs": 3}, SpecError, "must be a list of 1"),
        (StyleErm, {"epochs": (0,)}, SpecError, "at least one epoch in the last stage"),
        (StyleErm, {"epochs": (1,), "scenes": 100}, PredictorError, "a step takes 100 of each"),
    ],
)
def test_unsuitable_training_options_are_refused(data, kind, options, error, reason):
    with pytest.raises(error, match=reason):
        kind().fit(*data, 0, **options)


@pytest.mark.parametrize("kind", [Modular, ModularInvariant, StyleInvariant])
def test_trainings_that_compare_environments_refuse_one_environment(data, kind):
    one = [part[:1] for part in data]
    with pytest.raises(PredictorError, match="has one alone"):
        kind().fit(*one, 0, **OPTIONS)
    assert StyleErm().fit(*one, 0, epochs=(1,), **OPTIONS).card["validation_ade"][0] < 5


def test_weights_without_a_style_are_refused_by_the_modular_network(data, tmp_path):
    path = tmp_path / "erm.safetensors"
    StyleErm().fit(*data, 0, epochs=(1,), **OPTIONS).save(path)
    with pytest.raises(PredictorError, match="weights of style_erm, not of modular"):
        Modular(path)


def test_refinement_increases_the_likeness_to_the_reference_style(modular, reference):
    network = Modular()
    network.use(modular.stacked, modular.card)
    seen = mg.domain("orca:scenes=60").windows("test").observation
    refined = {steps: Refine(network, steps=steps, rate=0.02) for steps in (0, 3, 12)}
    untouched = network.predict(seen).positions
    likeness = {}
    for steps, predictor in refined.items():
        np.testing.assert_array_equal(predictor.predict(seen).positions, untouched)  # nothing observed yet
        predictor.observe(reference)
        with torch.no_grad():
            positions = predictor.predict(seen).positions[:, 0]
        path = np.concatenate([seen.xy[:, -1:], positions], axis=1)
        moves = torch.tensor(np.diff(path.astype(np.float64), axis=1)).reshape(1, seen.scenes, -1)
        embedded = network.embedded(seen, moves)[0].numpy()
        likeness[steps] = (embedded @ predictor.embeddings).mean() / predictor.scenes
    assert likeness[0] < likeness[3] < likeness[12]
    network.observe(reference)
    np.testing.assert_allclose(refined[0].predict(seen).positions, network.predict(seen).positions, atol=1e-6)
    refined[12].reset()
    np.testing.assert_array_equal(refined[12].predict(seen).positions, untouched)
    assert all(torch.equal(value, refined[12].inner.tensors[name]) for name, value in network.tensors.items())


def test_refine_satisfies_the_contract_of_a_predictor(modular):
    network = Modular()
    network.use(modular.stacked, modular.card)
    check_predictor(Refine(network), mg.domain("orca:scenes=40"))


def test_invalid_predictors_and_settings_of_refine_are_refused():
    with pytest.raises(PredictorError, match="style_erm has no style encoder"):
        Refine("style_erm")
    with pytest.raises(SpecError, match="rate"):
        Refine(Modular(), rate=0)
    with pytest.raises(SpecError, match="steps"):
        Refine(Modular(), steps=-1)
