"""Adapters: refused settings, predictors and truths, and names."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.contract import DataError, PredictorError, SpecError
from motion_gym.stepping.snapshot import snapshot
from tests.predictors.adapters.adapting_scenes import PAIR, STGAT, TUNED, scenes_of
from tests.taped import fitted_linear


@pytest.fixture(scope="module")
def crowd():
    return mg.domain("orca:d=0.6,scenes=40").windows("test")


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
        ("finetune:rate=1e38", PAIR, SpecError, "`rate=1e\\+38` must be a number above 0, and at most 1e\\+30"),
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
def test_invalid_settings_and_predictors_are_refused(name, of, error, message):
    with pytest.raises(error, match=message):
        mg.adapter(name, of)


@pytest.mark.parametrize("name", ["none", *TUNED, "kalman", "style"])
def test_invalid_truths_are_refused(crowd, name):
    adapter, scene = mg.adapter(name, PAIR), scenes_of(crowd, [0])[0]
    before = snapshot(adapter)
    invalid = scene.future.copy()
    invalid[1, 3] = np.nan
    for truth in (
        scene.observation,
        dataclasses.replace(scene, future=invalid),
        dataclasses.replace(scene, known=invalid[..., 0]),
    ):
        with pytest.raises(DataError, match="The observed truth"):
            adapter.observe(truth)
    assert snapshot(adapter) == before


def test_names_hold_the_settings_and_the_predictor():
    adapter = mg.adapter("finetune:rate=0.01,parts=style", PAIR, every=4)
    assert adapter.name == "finetune:parts=style,rate=0.01,every=4"
    assert mg.predictor(adapter.name).name == adapter.name
    assert mg.adapter("kalman", fitted_linear()).name == "kalman:of=Linear"
    assert mg.adapter("none", PAIR).name == "none:of=modular_invariant"
    assert adapter.selection == mg.predictor(PAIR).selection and adapter.trained_on == mg.predictor(PAIR).trained_on


def test_names_of_aliases_are_read_back():
    for name in ("erm_no_sigma", "counterfactual:sigma=false", "style_invariant", "modular_invariant", "vrex"):
        assert mg.predictor(name).name == name
    for name in ("ema_anchor", "ema_anchor:rate=0.001,anchor=0.001", "finetune"):
        adapter = mg.adapter(name, PAIR)
        assert mg.adapter(adapter.name, PAIR).name == adapter.name and adapter.name.startswith(name.partition(":")[0])
    assert mg.predictor("modular:penalty=1").name == "modular_invariant"
    assert mg.predictor("erm:counterfactual=true").name == "counterfactual"
