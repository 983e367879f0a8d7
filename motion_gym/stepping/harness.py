"""How the library calls a predictor: it makes it ready, asks it for forecasts, and checks every answer."""

from __future__ import annotations

import contextlib
import copy
import functools
import inspect
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import (
    FUTURE,
    DataError,
    Domain,
    Forecast,
    MotionGymError,
    Observation,
    Predictor,
    PredictorError,
    Truth,
    raised_at,
)
from motion_gym.data.domains import spec_of, training_set
from motion_gym.data.validation import check_forecast
from motion_gym.data.windows import check_truth


@functools.lru_cache
def _signature(kind: type) -> inspect.Signature:
    """The signature of a class, kept, since reading it takes as long as a forecast of some agents."""
    return inspect.signature(kind)


def name_of(predictor: Any) -> str:
    """Name of a predictor for tables and messages: its own ``name``, or its class with settings.

    Settings are those arguments of the constructor that are attributes of the same name and not at their defaults.
    """
    own = getattr(predictor, "name", None)
    if isinstance(own, str):
        return own
    try:
        arguments = _signature(type(predictor)).parameters.values()  # type: ignore[arg-type]
    except (TypeError, ValueError):
        return type(predictor).__name__
    values = [(a, getattr(predictor, a.name, a.default)) for a in arguments]
    plain = (int, float, str, type(None))
    settings = [f"{a.name}={v!r}" for a, v in values if isinstance(v, plain) and v != a.default]
    return type(predictor).__name__ + (f"({', '.join(settings)})" if settings else "")


def selection_of(predictor: Any) -> str:
    """How the weights of a predictor were selected, as it says itself."""
    return str(getattr(predictor, "selection", "does not say how its weights were selected (attribute `selection`)"))


def ready(predictor: str | Predictor, domain: Domain, seed: int = 0) -> Predictor:
    """Make a predictor ready for a domain.

    A predictor given by name or spec is made, and fitted to the domain's sources if it can be and is not yet. An
    oracle is shown the domain. Then it is reset.

    Raises:
        SpecError: the name is not known, or the domain names no sources to fit to.
    """
    instance = catalog.predictor(predictor)
    unfitted = (
        isinstance(predictor, (str, type)) and hasattr(instance, "fit") and not getattr(instance, "fitted", False)
    )
    if unfitted and getattr(instance, "fit_on_demand", True):
        train, validation = training_set(domain)
        guarded(instance, "fit", train, validation, seed)
        if not hasattr(instance, "trained_on"):
            with contextlib.suppress(AttributeError):  # it may not take further attributes
                instance.trained_on = tuple(spec_of(source) for source in domain.sources())  # type: ignore[attr-defined]
    if hasattr(instance, "know"):
        guarded(instance, "know", domain)
    if hasattr(instance, "reset"):
        guarded(instance, "reset")
    return instance


def copied(predictor: Any) -> Any:
    """A copy of a predictor, so that what the caller gave stays as it is; a name or a class is returned as it is.

    Raises:
        PredictorError: the predictor cannot be copied.
    """
    try:
        return copy.deepcopy(predictor)
    except Exception as error:
        raise not_copied(predictor, error) from error


def not_copied(predictor: Any, error: Exception) -> PredictorError:
    """The error for a predictor that cannot be copied or pickled."""
    return PredictorError(
        f"{name_of(predictor)} cannot be copied ({type(error).__name__}: {error}): let it hold nothing that cannot be "
        "pickled, as locks, open files and lambdas, or give its class."
    )


def windows_of_domain(domain: Domain, split: str) -> Truth:
    """``domain.windows(split)``, checked.

    Raises:
        DataError: it raised, or gave something that cannot be scored.
    """
    name = type(domain).__name__
    try:
        truth = domain.windows(split)
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        raise DataError(
            f"{name}.windows({split!r}) raised {type(error).__name__}: {error} ({raised_at(error)})."
        ) from error
    return check_truth(truth, f"{name}.windows({split!r})")


def ask(predictor: Predictor, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
    """Ask for a forecast, and check the answer.

    The predictor is given a copy that cannot be written to, so that it cannot change what others see.

    Returns:
        Forecast of float32 positions [A, K, 12, 2] with K = ``samples``, or 1 where the predictor is deterministic.

    Raises:
        PredictorError: it raised, tried to change its input, or answered with something that is not a forecast.
    """
    if not len(observation):
        return Forecast(np.zeros((0, samples, FUTURE, 2), np.float32))
    answer = guarded(predictor, "predict", frozen(observation), samples=samples, seed=seed)
    return check_forecast(answer, observation, samples, f"{name_of(predictor)}.predict")


def tell(predictor: Predictor, truth: Truth) -> None:
    """Let a predictor that has ``observe`` see revealed truth, or reference scenes."""
    if hasattr(predictor, "observe") and len(truth.future):
        guarded(predictor, "observe", _locked_truth(truth))


def tune(predictor: Predictor, scenes: Truth, validation: Truth | None) -> None:
    """Let a predictor that has ``tune`` learn from scenes, and select by others if there are some."""
    guarded(predictor, "tune", _locked_truth(scenes), None if validation is None else _locked_truth(validation))


def _locked_truth(truth: Truth) -> Truth:
    return Truth(_locked(truth.future), _locked(truth.known), frozen(truth.observation))


def frozen(observation: Observation) -> Observation:
    """A copy of an observation whose arrays cannot be written to; nothing but its fields goes along."""
    history, scene, agent = (_locked(a) for a in (observation.history, observation.scene, observation.agent))
    time = None if observation.time is None else _locked(observation.time)
    return Observation(history, scene, agent, float(observation.dt), time)


def guarded(predictor: Any, method: str, *arguments: Any, **keywords: Any) -> Any:
    """Call a method of a predictor; whatever it raises becomes a PredictorError that names it."""
    try:
        return getattr(predictor, method)(*arguments, **keywords)
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        remedy = ""
        if "read-only" in str(error) or "not writeable" in str(error):
            remedy = " A predictor may not change its input: work on a copy, as observation.history.copy()."
        elif isinstance(error, TypeError) and "argument" in str(error):
            remedy = " The signature is predict(self, observation, samples=1, seed=0)." if method == "predict" else ""
        said = f": {str(error).rstrip('.')}" if str(error) else ""
        message = f"{name_of(predictor)}.{method} raised {type(error).__name__}{said} ({raised_at(error)}).{remedy}"
        raise PredictorError(message) from error


def _locked(array: np.ndarray) -> np.ndarray:
    copy = np.array(array)  # of the plain class, whatever the array was
    copy.flags.writeable = False
    return copy
