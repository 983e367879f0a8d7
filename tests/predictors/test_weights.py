"""Trained weights: their time step, and messages for missing weights."""

import dataclasses
import json
import warnings
from pathlib import Path

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.contract import PredictorError
from motion_gym.training.weight_files import SHIPPED

PAIRS = synthetic((2,) * 4, 3, 0)
TRAINED = [
    "erm",
    "erm_no_sigma:weights=original/eth",
    "style_erm",
    "modular",
    "modular_factors",
    "modular_stgat",
    "ego_erm",
    "ego_modular",
]
IN_SECONDS = ["constant_velocity", "constant_velocity:velocity=4", "kalman_velocity", "stand_still"]


def at(dt):
    """The observation with another time step."""
    return dataclasses.replace(PAIRS.observation, dt=dt)


@pytest.mark.parametrize("spec", TRAINED)
def test_weights_of_another_time_step_are_refused(spec):
    predictor = mg.predictor(spec)
    assert np.isfinite(predictor.predict(at(0.4)).positions).all()
    # Frame rates may be slightly inexact.
    assert np.isfinite(predictor.predict(at(0.40001)).positions).all()
    for dt in (0.1, 0.48):
        with pytest.raises(PredictorError, match=rf"trained on time steps of 0.4 s, .* steps of {dt} s: resample"):
            predictor.predict(at(dt))


@pytest.mark.parametrize("spec", ["erm_no_sigma:weights=original/eth", "modular_invariant"])
@pytest.mark.parametrize("name", ["none", "finetune", "kalman", "hedge", "ekf"])
def test_adapters_refuse_another_time_step_too(name, spec):
    predictor = mg.adapter(name, spec)
    with pytest.raises(PredictorError, match=r"trained on time steps of 0.4 s"):
        predictor.predict(at(0.1))


@pytest.mark.parametrize("dt", [0.1, 0.4])
def test_linear_refuses_another_time_step_than_that_of_the_training_data(dt):
    slow = dataclasses.replace(PAIRS, observation=at(dt))
    predictor = mg.predictor("linear").fit([slow])
    predictor.predict(at(dt))
    with pytest.raises(PredictorError, match=rf"fitted to time steps of {dt} s, .* steps of 0.2 s"):
        predictor.predict(at(0.2))
    with pytest.raises(PredictorError, match=r"time steps of \[0.2, 0.4\] s at once"):
        mg.predictor("linear").fit([PAIRS, dataclasses.replace(PAIRS, observation=at(0.2))])


@pytest.mark.parametrize("spec", IN_SECONDS)
@pytest.mark.parametrize("dt", [0.04, 0.1, 1.0])
def test_predictors_without_training_work_at_any_time_step(spec, dt):
    assert np.isfinite(mg.predictor(spec).predict(at(dt)).positions).all()


def test_cards_hold_the_time_step_of_the_training_data(tmp_path):
    fast = [dataclasses.replace(PAIRS, observation=at(0.1))]
    predictor = mg.predictor("style_erm").fit(fast, fast, 0, epochs=(1,), scenes=4)
    assert predictor.card["dt"] == 0.1
    predictor.save(tmp_path / "fast.safetensors")
    again = mg.predictor("style_erm", weights=tmp_path / "fast.safetensors")
    again.predict(at(0.1))
    with pytest.raises(PredictorError, match=r"trained on time steps of 0.1 s"):
        again.predict(at(0.4))


@pytest.mark.parametrize("path", sorted(SHIPPED.rglob("*.json")), ids=lambda path: str(path.relative_to(SHIPPED)))
def test_shipped_cards_hold_their_time_step(path: Path):
    assert json.loads(path.read_text())["dt"] == 0.4


def test_predictors_without_weights_are_not_fitted_by_an_evaluation():
    assert mg.predictor("invariant").fitted and not mg.predictor("invariant:penalty=0.125").fitted
    with pytest.raises(PredictorError, match=r"Train it: motion-gym train invariant:penalty=0\.125"):
        mg.evaluate("invariant:penalty=0.125", "orca:scenes=20")


@pytest.mark.parametrize("spec", ["ego_erm", "ego_modular", "modular", "style_erm", "modular_stgat"])
def test_weights_of_another_simulation_are_not_used_without_a_warning(spec):
    predictor = mg.predictor(spec)
    with pytest.warns(UserWarning, match=rf"{spec} was not trained on data like `walkers`.*orca:.*motion-gym train"):
        predictor.choose_weights([mg.domain("walkers")])


def test_an_earlier_choice_is_forgotten():
    predictor = mg.predictor("ego_erm")
    for place, chosen in (("highway", "vehicles"), ("walkers", "style"), ("orca:agents=10", "style/crowd")):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            predictor.choose_weights([mg.domain(place)])
        assert predictor.chosen == chosen


@pytest.mark.parametrize(
    ("spec", "place"),
    [
        ("ego_erm", "orca:d=0.8"),
        ("ego_erm:weights=style", "walkers"),  # as the user says
        ("kalman_residual", "walkers"),
        ("kalman_residual", "highway"),
        ("erm_no_sigma", "walkers"),
    ],
)
def test_other_weights_are_chosen_silently(spec, place, recwarn):
    mg.predictor(spec).choose_weights([mg.domain(place)])
    assert not recwarn.list
