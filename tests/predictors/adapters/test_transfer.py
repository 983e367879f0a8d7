"""Low-shot transfer of the modular predictor."""

import dataclasses

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.contract import PredictorError, SpecError, Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import score
from motion_gym.predictors.adapters import transfer
from motion_gym.predictors.adapters.refine import Refine
from motion_gym.predictors.adapters.transfer import Transfer
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.training.transfer_training import PARTS

SOURCES = [f"orca:d={d},scenes=200" for d in (0.1, 0.3, 0.5)]


@pytest.fixture(scope="module")
def source():
    data = training_set(mg.domain("orca", scenes=200))
    return Modular().fit(*data, [0, 1], names=SOURCES, epochs=(8, 2, 2, 4), scenes=16)


@pytest.fixture(scope="module")
def target():
    return mg.domain("orca:d=0.7,scenes=200")


def few(target, batches):
    return pick_scenes(target.windows("train"), slice(0, batches * 64))


def changed(predictor, source):
    return {name for name, value in predictor.inner.stacked.items() if not torch.equal(value, source.stacked[name])}


@pytest.mark.parametrize("parts", PARTS)
def test_only_the_chosen_parts_are_tuned(source, target, parts):
    before = {name: value.clone() for name, value in source.stacked.items()}
    predictor = Transfer(source, parts=parts, epochs=2)
    assert not changed(predictor, source)
    predictor.tune(few(target, 1))
    expected = {name for name in before if name in PARTS[parts] or name.split(".")[0] in PARTS[parts]}
    assert changed(predictor, source) - {"prior.code"} == expected
    assert all(torch.equal(before[name], value) for name, value in source.stacked.items())
    assert predictor.selection.endswith(
        "then tuned on scenes of the domain: as long and as fast as is said, the last epoch"
    )
    assert predictor.name.endswith(f",parts={parts},epochs=2" if parts != "modulator" else ",epochs=2")


def test_tuning_starts_from_the_trained_weights_each_time(source, target):
    once, twice = Transfer(source, epochs=2), Transfer(source, epochs=2)
    twice.tune(few(target, 2))
    other = {name: value.clone() for name, value in twice.inner.stacked.items()}
    for predictor in (once, twice):
        predictor.tune(few(target, 1))
    assert all(torch.equal(value, twice.inner.stacked[name]) for name, value in once.inner.stacked.items())
    assert any(not torch.equal(value, twice.inner.stacked[name]) for name, value in other.items())


def test_tuning_lowers_the_error_on_the_new_style(source, target):
    errors = []
    for predictor in (source, Transfer(source, parts="style", epochs=60, rate=1e-3)):
        card = mg.evaluate(predictor, target, shots=128, references=0)
        assert card.shots == 128 and card.reference_scenes == 0
        errors.append(card.metrics["ADE"].mean)
    source.reset()
    assert errors[1] < 0.9 * errors[0]


def test_tuned_predictors_can_be_refined(source, target):
    predictor = Refine(Transfer(source, epochs=2), steps=2)
    tuned = mg.evaluate(predictor, target, shots=64, references=0)
    assert "then tuned on scenes of the domain" in tuned.selection
    assert tuned.metrics["ADE"].mean != mg.evaluate(predictor.inner, target, shots=64, references=0).metrics["ADE"].mean


def test_the_paper_protocol_selects_on_the_target(source, target):
    predictor = Transfer(source, epochs=3)
    card = mg.evaluate(predictor, target, shots=64, protocol="paper")
    assert card.selection.endswith("the best epoch on validation scenes of the domain itself")
    assert any("tuned as long as is best on validation scenes" in leak for leak in card.leaks)
    with pytest.raises(SpecError, match="is shown scenes of split `val`"):
        mg.evaluate(predictor, target, shots=64, protocol="paper", split="val")


def test_validation_scenes_select_the_epoch(source, target):
    validation, errors = target.windows("val"), []
    for shown in (validation, None):
        predictor = Transfer(source, parts="all", epochs=30, rate=1e-2)
        predictor.tune(few(target, 1), shown)
        predictor.observe(few(target, 1))
        errors.append(score(predictor.predict(validation.observation), validation)["ADE"].mean())
    assert errors[0] < errors[1]


def test_evaluation_leaves_a_predictor_untuned(source, target):
    predictor = Transfer(source, parts="all", epochs=3, rate=1e-2)
    before = mg.evaluate(predictor, target, references=0).metrics["ADE"].mean
    assert mg.evaluate(predictor, target, references=0, shots=64).metrics["ADE"].mean != before
    assert mg.evaluate(predictor, target, references=0).metrics["ADE"].mean == before


def test_the_paper_protocol_counts_shots_only_for_tuned_predictors(source, target):
    assert mg.evaluate(source, target, shots=64, protocol="paper").shots == 0
    assert mg.evaluate(Refine(source), target, shots=64, protocol="paper").shots == 0
    assert mg.evaluate(Refine(Transfer(source, epochs=1)), target, shots=64, protocol="paper").shots == 64


def test_training_scenes_that_overlap_the_scored_ones_are_refused(eth_ucy):
    with pytest.raises(SpecError, match="cut from the scored recording"):
        mg.evaluate("ego_modular", "zara1", shots=64)


def test_predictors_without_tune_get_no_shots(target):
    assert mg.evaluate("constant_velocity", target, shots=64).shots == 0


def test_unsuitable_scenes_settings_and_predictors_are_refused(source, target):
    predictor = Transfer(source, epochs=1)
    with pytest.raises(PredictorError, match="batches of 64 scenes, and was given 100 scenes: give 64"):
        predictor.tune(pick_scenes(target.windows("train"), slice(0, 100)))
    with pytest.raises(SpecError, match=r"`shots=640`: orca has \d+ training scenes. Ask for at most"):
        mg.evaluate(predictor, target, shots=640)
    with pytest.raises(SpecError, match="is shown scenes of split `train`"):
        mg.evaluate(predictor, target, shots=64, split="train")
    with pytest.raises(SpecError, match=r"`parts=modulater` .*Did you mean `modulator`"):
        Transfer(source, parts="modulater")
    slow = target.windows("train")
    slow = Truth(slow.future, slow.known, dataclasses.replace(slow.observation, dt=0.1))
    with pytest.raises(PredictorError, match=r"trained on time steps of 0.4 s, and the observation has steps of 0.1 s"):
        predictor.tune(pick_scenes(slow, slice(0, 64)))
    with pytest.raises(SpecError, match="`weights` and `seed` go with the name"):
        Transfer(source, seed=1)
    for option in ({"rate": 0}, {"rate": True}, {"epochs": 0}, {"style_weight": -1}):
        with pytest.raises(SpecError, match=next(iter(option))):
            Transfer(source, **option)
    with pytest.raises(PredictorError, match="ConstantVelocity cannot be tuned to a style"):
        Transfer("constant_velocity")
    three = mg.domain("orca:agents=3,scenes=100").windows("train")
    with pytest.raises(PredictorError, match="exactly 2 agents"):
        predictor.tune(pick_scenes(three, np.arange(64)))
    unnamed = Transfer(source, parts="style", epochs=1)
    unnamed.inner.card = {**source.card, "trained_on": []}
    without = Transfer(unnamed.inner, epochs=1)
    without.tune(few(target, 1))
    assert torch.equal(without.inner.stacked["prior.code"], source.stacked["prior.code"])
    with pytest.raises(PredictorError, match="do not name the domains that they were trained on: set style_weight=0"):
        unnamed.tune(few(target, 1))


def test_all_seeds_of_a_row_are_tuned_together(target, monkeypatch):
    tuned = []
    train = transfer.training.train
    monkeypatch.setattr(transfer.training, "train", lambda *a, **options: tuned.append(a) or train(*a, **options))
    for seed in (3, 4):
        mg.evaluate(f"transfer:parts=last_layer,epochs=1,style_weight=0,seed={seed}", target, shots=64, references=0)
    assert len(tuned) == 1
