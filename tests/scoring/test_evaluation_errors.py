"""Errors of evaluate."""

from __future__ import annotations

import math

import numpy as np
import pytest

from motion_gym.contract import Forecast, PredictorError, SpecError
from motion_gym.scoring.evaluation import evaluate
from tests.predictors_to_score import PAIRS, Counts


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"protocol": "hones"}, "`protocol=hones` is not known. Did you mean `honest`"),
        ({"through": "array"}, "`through=array` is not known. Did you mean `arrays`"),
        ({"k": 0}, "`k=0` must be a whole number, 1 or more"),
        ({"k": -1}, "`k=-1`"),
        ({"k": 2.5}, "`k=2.5`"),
        ({"k": True}, "`k=True`"),
        ({"seed": -1}, "`seed=-1` must be a whole number, 0 or more"),
        ({"seed": 0.5}, "`seed=0.5`"),
        ({"split": "tset"}, "no split `tset`. Did you mean `test`"),
        ({"alpha": 3}, "already a domain"),
    ],
)
def test_bad_options(wrong, message):
    with pytest.raises(SpecError, match=message):
        evaluate("constant_velocity", PAIRS, **wrong)


@pytest.mark.parametrize(
    ("predictor", "domain", "message"),
    [
        ("constant_velocty", "orca", "no predictor `constant_velocty`. Did you mean `constant_velocity`"),
        ("constant_velocity", "ocra", "no domain `ocra`. Did you mean `orca`"),
        ("constant_velocity:velocity=lst", "orca:scenes=5", "Did you mean `last`"),
        ("constant_velocity", 3, "int cannot be used as domain"),
        (3, "orca:scenes=5", "int cannot be used as predictor"),
    ],
)
def test_bad_names(predictor, domain, message):
    with pytest.raises(SpecError, match=message):
        evaluate(predictor, domain)


def broken(answer):
    class Broken:
        def predict(self, observation, samples=1, seed=0):
            return answer(observation, samples)

    return Broken()


def change_input(observation, samples):
    observation.history[:] = 0
    return observation.xy[:, None, -1:]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda o, k: 1 / 0, "Broken.predict raised ZeroDivisionError: division by zero"),
        (lambda o, k: None, "returned NoneType; return a Forecast or a numpy array"),
        (lambda o, k: o.xy.tolist(), "returned list"),
        (lambda o, k: np.zeros((len(o), 12, 2), np.float32), r"use positions\[:, None\]"),
        (lambda o, k: np.zeros((1, k, 12, 2), np.float32), r"shape \(1, 2, 12, 2\) for \d+ agents, expected"),
        (lambda o, k: np.zeros((len(o), k, 11, 2), np.float32), "expected .* agents, samples, future steps, x and y"),
        (lambda o, k: np.zeros((len(o), 5, 12, 2), np.float32), "returned 5 samples and 2 were asked for"),
        (lambda o, k: np.zeros((len(o), k, 12, 2), int), "dtype int64: positions are float32"),
        (lambda o, k: np.full((len(o), k, 12, 2), math.nan, np.float32), "NaN or infinite .* row 0 .* must be finite"),
        (lambda o, k: np.full((len(o), k, 12, 2), math.inf, np.float32), "every position must be finite"),
        (lambda o, k: Forecast(np.zeros((len(o), k, 12, 2)), -np.ones((len(o), k))), "weights .* not negative"),
        (change_input, r"may not change its input: work on a copy, as observation.history.copy\(\)"),
    ],
)
def test_broken_predictor_is_named_with_a_remedy(answer, message):
    with pytest.raises(PredictorError, match=message):
        evaluate(broken(answer), PAIRS, k=2)


def test_wrong_signature_is_explained():
    class Old:
        def predict(self, observation):
            return observation.xy

    with pytest.raises(PredictorError, match=r"signature is predict\(self, observation, samples=1, seed=0\)"):
        evaluate(Old(), PAIRS)  # type: ignore[arg-type]


def test_failing_observe_and_fit_are_named():
    class Observes(Counts):
        def observe(self, truth):
            truth.future[:] = 0

    class Fits(Counts):
        def fit(self, train, validation, seed):
            raise RuntimeError("no convergence")

    with pytest.raises(PredictorError, match=r"Observes.observe raised .*work on a copy"):
        evaluate(Observes(), PAIRS)
    with pytest.raises(PredictorError, match=r"Fits.fit raised RuntimeError: no convergence"):
        evaluate(Fits, PAIRS)  # type: ignore[arg-type]


def test_evaluation_changes_nothing():
    before = PAIRS.windows("test").future.copy()
    evaluate("linear", PAIRS)
    assert np.array_equal(PAIRS.windows("test").future, before)
