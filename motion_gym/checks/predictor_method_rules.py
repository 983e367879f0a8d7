"""The rules of the predictor contract for optional methods and copies; each takes a PredictorTrial and raises."""

from __future__ import annotations

import copy as copying
import pickle as pickling
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from motion_gym.checks import predictor_rules as rules
from motion_gym.checks.predictor_rules import check_signature
from motion_gym.checks.predictor_trials import PredictorTrial, gap, partly_known, same
from motion_gym.checks.report import CheckError, Rules, broken_if
from motion_gym.contract import MotionGymError, PredictorError
from motion_gym.stepping.harness import guarded
from motion_gym.stepping.snapshot import global_randomness, shared_arrays


def pickled_copy(thing: Any) -> Any:
    """A copy by pickle."""
    return pickling.loads(pickling.dumps(thing))


def observe(trial: PredictorTrial) -> None:
    """Method observe takes partly known truth."""
    predictor = trial.make()
    check_signature(predictor, "observe")
    if hasattr(predictor, "observe"):
        predictor = trial.comparable()
        with global_randomness():
            guarded(predictor, "observe", copying.deepcopy(partly_known(trial.scenes.truth)))


def reset(trial: PredictorTrial) -> None:
    """A predictor with observe has reset, after which it forecasts like a new one."""
    predictor = trial.make()
    check_signature(predictor, "reset")
    observes, resets = hasattr(predictor, "observe"), hasattr(predictor, "reset")
    broken_if(
        observes and not resets,
        "there is observe but no reset: define reset(self), which forgets everything that was observed.",
    )
    if not resets:
        return
    predictor = trial.comparable()
    with global_randomness():
        guarded(predictor, "reset")
    if not observes:
        return
    before = trial.ask(predictor)
    trial.observe(predictor)
    with global_randomness():
        guarded(predictor, "reset")
    after = trial.ask(predictor)
    broken_if(
        not same(before, after),
        f"after observe and reset the forecasts are {gap(before, after)} from those before: restore everything that "
        "observe changes.",
    )


def fit(trial: PredictorTrial) -> None:
    """Method fit returns self or None, and the same seed gives the same forecasts."""
    check_signature(trial.make(), "fit")
    if not trial.trainable:
        return
    predictor = trial.fresh()
    with global_randomness():
        returned = guarded(predictor, "fit", *trial.scenes.training(), 0)
    broken_if(
        returned is not None and returned is not predictor,
        f"fit returned another object, a {type(returned).__name__}: return self.",
    )
    fitted = getattr(predictor, "fitted", True)
    broken_if(fitted is not True, f"after fit, fitted is {fitted!r}: make it True.")
    trial.comparable()
    first = trial.ask(predictor)
    for again, subject in ((trial.fresh(), "another predictor"), (predictor, "the same predictor again")):
        with global_randomness(1):
            guarded(again, "fit", *trial.scenes.training(), 0)
        answer = trial.ask(again)
        broken_if(
            not same(first, answer),
            f"{subject}, fitted to the same data with the same seed, forecasts {gap(first, answer)} away: begin "
            "anew in fit, and draw from its seed alone.",
        )


def unfitted(trial: PredictorTrial) -> None:
    """A predictor that must be fitted raises PredictorError before that."""
    if not trial.trainable:
        return
    remedy = "raise motion_gym.contract.PredictorError that says: not fitted, call fit(train, validation, seed)"
    predictor = trial.fresh()
    try:
        with global_randomness():
            predictor.predict(copying.deepcopy(trial.scenes.truth.observation))
    except PredictorError:
        return
    except Exception as error:
        raise CheckError(f"predict before fit raised {type(error).__name__}: {error}: {remedy}.") from error
    raise CheckError(f"predict before fit gave a forecast: {remedy}, or let fitted be True.")


def save(trial: PredictorTrial) -> None:
    """Methods save and load exist together and restore the same forecasts."""
    predictor = trial.make()
    for method, other in (("save", "load"), ("load", "save")):
        check_signature(predictor, method)
        broken_if(
            hasattr(predictor, method) and not hasattr(predictor, other),
            f"there is {method} but no {other}: define {other}(self, path).",
        )
    if not hasattr(predictor, "save"):
        return
    predictor = trial.comparable()
    with tempfile.TemporaryDirectory() as folder, global_randomness(2):
        path = Path(folder) / "weights"
        guarded(predictor, "save", path)
        try:
            revived = trial.fresh()
            loaded = guarded(revived, "load", path)
            answer = trial.ask(revived if loaded is None else loaded)
        except MotionGymError as error:
            raise CheckError(f"the saved predictor could not be loaded and asked: {error}") from error
    first = trial.ask(predictor)
    broken_if(
        not same(first, answer), f"after save and load the forecasts are {gap(first, answer)} away: save all they need."
    )


def copy(trial: PredictorTrial) -> None:
    """A deep copy gives the same forecasts and is independent."""
    _copies(trial, copying.deepcopy)


def pickle(trial: PredictorTrial) -> None:
    """A pickled copy gives the same forecasts and is independent."""
    _copies(trial, pickled_copy)


def _copies(trial: PredictorTrial, copier: Callable[[Any], Any]) -> None:
    try:
        trial.comparable()
        asks, predictor = True, trial.fitted(trial.scenes)
    except MotionGymError:
        asks, predictor = False, trial.make()
    try:
        twin = copier(predictor)
    except Exception as error:
        raise CheckError(
            f"copying raised {type(error).__name__}: {error}: hold no lambdas, open files or classes defined in "
            "functions, or define __getstate__."
        ) from error
    common = shared_arrays(predictor, twin)
    broken_if(common, f"the copy shares the memory of {', '.join(common[:3])}: copy arrays too.")
    if not asks:
        return
    first, answer = trial.ask(predictor), trial.ask(twin)
    broken_if(not same(first, answer), f"the copy forecasts {gap(first, answer)} away: copy the whole state.")
    if hasattr(twin, "observe"):
        trial.observe(twin)
        broken_if(
            not same(first, trial.ask(predictor)),
            "observing with the copy changed the forecasts of the original: share nothing.",
        )


PREDICTOR_RULES: Rules = {
    "attributes": rules.attributes,
    "unfitted": unfitted,
    "fit": fit,
    "predict": rules.predict,
    "forecast": rules.forecast,
    "pure": rules.pure,
    "state": rules.state,
    "input": rules.input_,
    "buffer": rules.buffer,
    "randomness": rules.randomness,
    "seed": rules.seed,
    "noise": rules.noise,
    "place": rules.place,
    "scenes": rules.scenes,
    "observe": observe,
    "reset": reset,
    "save": save,
    "pickle": pickle,
    "copy": copy,
}
