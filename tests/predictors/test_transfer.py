"""Low-shot transfer of the modular predictor."""

import numpy as np
import pytest
import torch

import motion_gym as mg
from motion_gym.contract import PredictorError, SpecError
from motion_gym.domains import training_set
from motion_gym.metrics import score
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.transfer import PARTS, transfer
from motion_gym.windows import pick_scenes


@pytest.fixture(scope="module")
def data():
    return training_set(mg.domain("orca", scenes=200))


@pytest.fixture(scope="module")
def source(data):
    return Modular().fit(*data, [0, 1], epochs=(8, 2, 2, 4), scenes=16)


@pytest.fixture(scope="module")
def target():
    return mg.domain("orca:d=0.7,scenes=200")


def tuned(made, source):
    return {name for name, value in made.stacked.items() if not torch.equal(value, source.stacked[name])}


@pytest.mark.parametrize("parts", PARTS)
def test_only_what_is_named_is_tuned(data, source, target, parts):
    before = {name: value.clone() for name, value in source.stacked.items()}
    made = transfer(source, target.windows("train"), data[0], 1, parts, epochs=2)
    expected = {name for name in before if name in PARTS[parts] or name.split(".")[0] in PARTS[parts]}
    assert tuned(made, source) - {"prior.code"} == expected
    assert all(torch.equal(before[name], value) for name, value in source.stacked.items())
    assert f"{parts} tuned on 64 scenes, 2 epochs at rate 0.001, the last epoch" in made.selection


def test_tuning_lowers_the_error_on_the_new_style(data, source, target):
    made = transfer(source, target.windows("train"), data[0], 2, "style", epochs=60)
    errors = []
    for predictor in (source, made):
        predictor.reset()
        predictor.observe(target.reference())
        truth = target.windows("test")
        errors.append(score(predictor.predict(truth.observation), truth)["ADE"].mean())
    source.reset()
    assert errors[1] < 0.9 * errors[0]


def test_nothing_shown_is_nothing_tuned(data, source, target):
    made = transfer(source, target.windows("train"), data[0], 0)
    assert not tuned(made, source) and made.selection.endswith("then untouched")


def test_selecting_on_the_target_is_said(data, source, target):
    made = transfer(source, target.windows("train"), data[0], 1, epochs=3, target=target.windows("val"))
    assert made.selection.endswith("the best epoch on validation scenes of the target")


def test_what_cannot_be_tuned_is_refused(data, source, target):
    scenes = target.windows("train")
    with pytest.raises(PredictorError, match=r"10 batches of 64 scenes.*there are \d+ scenes.*at most \d batches"):
        transfer(source, scenes, data[0], 10)
    with pytest.raises(SpecError, match=r"no `parts=modulater`.*Did you mean `modulator`"):
        transfer(source, scenes, data[0], 1, "modulater")
    with pytest.raises(SpecError, match="rate"):
        transfer(source, scenes, data[0], 1, rate=0)
    with pytest.raises(PredictorError, match="compares the new style with others"):
        transfer(source, scenes, [], 1)
    three = mg.domain("orca:agents=3,scenes=100").windows("train")
    with pytest.raises(PredictorError, match="exactly 2 agents"):
        transfer(source, pick_scenes(three, np.arange(64)), data[0], 1)
