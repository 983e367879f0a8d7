"""How the library calls a predictor: make it ready, ask it for forecasts, and check every answer."""

from __future__ import annotations

import contextlib
import copy
import functools
import inspect
from collections.abc import Mapping, Sequence
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
    """The signature of a class; cached, since reading it takes as long as forecasting some agents."""
    return inspect.signature(kind)


def name_of(predictor: Any) -> str:
    """Name of a predictor for tables and messages: its ``name``, or its class with its settings.

    Settings are arguments of the constructor that are attributes of the same name and differ from their defaults.
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
    """How the weights of a predictor were selected, from its attribute ``selection``."""
    return str(getattr(predictor, "selection", "does not say how its weights were selected (attribute `selection`)"))


def ready(predictor: str | Predictor, domain: Domain, seed: int = 0, later: Sequence[Domain] = ()) -> Predictor:
    """Make a predictor ready for a domain.

    A predictor that is named is constructed, and fitted to the domain's sources if ``is_fitted_here`` says so.
    A predictor with several sets of weights chooses one that has seen neither the domain nor the later ones. An oracle
    is shown the domain. Then the predictor is reset.

    Raises:
        SpecError: The name is not known, or the domain names no sources to fit to.
    """
    instance = catalog.predictor(predictor)
    if is_fitted_here(predictor, instance):
        train, validation = training_set(domain)
        if not getattr(instance, "trained_on", ()):
            with contextlib.suppress(AttributeError):  # its class may have slots
                instance.trained_on = tuple(spec_of(source) for source in domain.sources())  # type: ignore[attr-defined]
        guarded(instance, "fit", train, validation, seed)
    if hasattr(instance, "choose_weights"):
        guarded(instance, "choose_weights", [domain, *later])
    if hasattr(instance, "know"):
        guarded(instance, "know", domain)
    if hasattr(instance, "reset"):
        guarded(instance, "reset")
    return instance


def is_fitted_here(predictor: str | Predictor, instance: Predictor) -> bool:
    """Whether a predictor must be fitted before it is scored; an object is scored as it is.

    Args:
        predictor: A name, a spec or a class; or a predictor.
        instance: The predictor that it stands for.
    """
    named = isinstance(predictor, (str, type))
    unfitted = hasattr(instance, "fit") and not getattr(instance, "fitted", False)
    return named and unfitted and bool(getattr(instance, "fit_on_demand", True))


def copied(predictor: Any) -> Any:
    """A copy of a predictor; a name or a class is returned as it is.

    Raises:
        PredictorError: The predictor cannot be copied.
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
        DataError: The method raised, or its windows cannot be scored.
    """
    name = type(domain).__name__
    try:
        truth = domain.windows(split)
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        raise DataError(
            f"{name}.windows({split!r}) raised {type(error).__name__}: {error}{raised_at(error)}."
        ) from error
    return check_truth(truth, f"{name}.windows({split!r})")


def ask(predictor: Predictor, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
    """Ask for a forecast, and check the answer.

    The predictor gets a read-only copy of the observation.

    Returns:
        Forecast of float32 positions [A, K, 12, 2] with K = ``samples``, or 1 if the predictor is deterministic.

    Raises:
        PredictorError: The predictor raised, tried to change its input, or returned no valid forecast.
    """
    if not len(observation):
        return Forecast(np.zeros((0, samples, FUTURE, 2), np.float32))
    answer = guarded(predictor, "predict", frozen(observation), samples=samples, seed=seed)
    return check_forecast(answer, observation, samples, f"{name_of(predictor)}.predict")


def tell(predictor: Predictor, truth: Truth) -> None:
    """Let a predictor that has ``observe`` observe revealed truth or reference scenes."""
    if hasattr(predictor, "observe") and len(truth.future):
        guarded(predictor, "observe", _locked_truth(truth))


def tune(predictor: Predictor, scenes: Truth, validation: Truth | None) -> None:
    """Let a predictor that has ``tune`` learn from scenes, and select by validation scenes if there are any."""
    guarded(predictor, "tune", _locked_truth(scenes), None if validation is None else _locked_truth(validation))


def _locked_truth(truth: Truth) -> Truth:
    return Truth(_locked(truth.future), _locked(truth.known), frozen(truth.observation))


def frozen(observation: Observation) -> Observation:
    """A copy of an observation with read-only arrays."""
    history, scene, agent = (_locked(a) for a in (observation.history, observation.scene, observation.agent))
    time = None if observation.time is None else _locked(observation.time)
    return Observation(history, scene, agent, float(observation.dt), time, observation.images)


SIGNATURES: Mapping[str, tuple[tuple[str, ...], Mapping[str, Any]]] = {
    "predict": (("observation",), {"samples": 1, "seed": 0}),
    "observe": (("truth",), {}),
    "reset": ((), {}),
    "tune": (("scenes", "validation"), {}),
    "fit": (("train", "validation", "seed"), {}),
    "know": (("domain",), {}),
    "save": (("path",), {}),
    "load": (("path",), {}),
}
"""Arguments and keywords with their defaults, by method of a predictor; see ``contract.Predictor``."""


def signature_of(method: str) -> str:
    """How a predictor defines a method, as ``observe(self, truth)``."""
    arguments, keywords = SIGNATURES[method]
    return f"{method}({', '.join(('self', *arguments, *(f'{key}={value}' for key, value in keywords.items())))})"


def guarded(predictor: Any, method: str, *arguments: Any, **keywords: Any) -> Any:
    """Call a method of a predictor; an exception becomes a PredictorError that names the method."""
    try:
        return getattr(predictor, method)(*arguments, **keywords)
    except MotionGymError:
        raise
    except (Exception, SystemExit) as error:
        remedy = ""
        if "read-only" in str(error) or "not writeable" in str(error):
            remedy = " A predictor may not change its input: work on a copy, as observation.history.copy()."
        elif isinstance(error, TypeError) and "argument" in str(error) and method in SIGNATURES:
            remedy = f" The signature is {signature_of(method)}."
        elif isinstance(error, TypeError) and "'Forecast'" in str(error):
            remedy = " The positions of a Forecast are its array `positions` [A, K, 12, 2]."
        said = f": {str(error).rstrip('.')}" if str(error) else ""
        message = f"{name_of(predictor)}.{method} raised {type(error).__name__}{said}{raised_at(error)}.{remedy}"
        raise PredictorError(message) from error


def _locked(array: np.ndarray) -> np.ndarray:
    copy = np.array(array)  # a plain array also for subclasses
    copy.flags.writeable = False
    return copy


class CheckedPredictor:
    """Wraps a predictor so that ``predict`` returns a checked Forecast; every other attribute is the predictor's own.

    A user's adapter gets this instead of the predictor, whose ``predict`` may return an array.

    Args:
        inner: The predictor.
    """

    def __init__(self, inner: Any):
        vars(self)["inner"] = inner

    @property
    def name(self) -> str:
        """The name of the predictor."""
        return name_of(self.inner)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """The checked forecast of the predictor."""
        return ask(self.inner, observation, samples, seed)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.inner, name, value)
