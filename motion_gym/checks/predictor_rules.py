"""The rules of the predictor contract; ``motion_gym.checks.checker`` is the way in."""

from __future__ import annotations

import copy
import inspect
import pickle
import tempfile
import warnings
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.predictor_trials import Report, Subject, Trial, domain_trial, swapped, synthetic_trial, writable
from motion_gym.contract import Forecast, MotionGymError, PredictorError
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import guarded
from motion_gym.stepping.snapshot import changed, global_randomness, shared_arrays, snapshot

PREDICTOR_RULES = {
    "predict": "predict(observation, samples=1, seed=0) exists and answers for every observation",
    "forecast": "the answer is a Forecast or array [A, K, 12, 2], K = samples or 1, of finite floats",
    "pure": "the same state, input and seed give the bit-identical answer, whatever was asked in between",
    "state": "predict changes nothing that the predictor holds; a cache may grow while the answers stay the same",
    "input": "what a predictor is given stays as it was",
    "buffer": "an answer that was given does not change later",
    "randomness": "the global generators of random, numpy and torch are left alone by predict",
    "seed": "where samples differ, another seed gives other ones; fixed modes come with weights",
    "scenes": "the forecasts of a scene do not depend on the other scenes of the observation",
    "observe": "observe(truth) takes partly known truth",
    "reset": "whoever observes can reset, and then forecasts as if fresh",
    "fit": "fit(train, validation, seed) returns self or None, and the same seed gives the same forecasts",
    "unfitted": "whoever must be fitted first says so by a PredictorError",
    "save": "save(path) and load(path) come together and bring back the same forecasts",
    "pickle": "a pickled copy gives the same forecasts and is independent",
    "copy": "a deep copy gives the same forecasts and is independent",
    "attributes": "fitted is a bool; name and selection are text",
}
METHODS: dict[str, tuple[str, tuple[str, ...]]] = {
    "observe": ("observe", ("truth",)),
    "reset": ("reset", ()),
    "fit": ("fit", ("train", "validation", "seed")),
    "save": ("save", ("path",)),
    "load": ("save", ("path",)),
    "know": ("predict", ("domain",)),
}
"""Optional methods: the rule they come under, and the positional arguments they are called with."""
TOLERANCE = 1e-4
"""Metres between the forecasts of a scene alone and in a batch, beyond the rounding of float32."""
COPIERS: tuple[tuple[str, Callable[[Any], Any]], ...] = (
    ("copy", copy.deepcopy),
    ("pickle", lambda thing: pickle.loads(pickle.dumps(thing))),
)


def apply_predictor_rules(predictor: Any, domain: Any, report: Report, broken: Collection[str]) -> None:
    """Report every rule that a predictor breaks.

    Args:
        predictor: A name, spec, class or instance with ``predict``.
        domain: Domain to take the scenes from, or None for synthetic ones.
        report: Called with the name of a rule and what is wrong.
        broken: Names of the rules reported so far.
    """
    fresh = _factory(predictor, report)
    if fresh is None:
        return
    original = fresh()
    _attributes(original, report)
    if not _signatures(original, report):
        return
    if domain is None and hasattr(original, "know"):
        _copies(Subject(original, synthetic_trial(), report), forecasts=False)
        return  # an oracle can forecast nothing before it knows a domain

    def known() -> Any:
        made = fresh()
        if hasattr(made, "know"):
            guarded(made, "know", domain)
        return made

    trials = (
        [domain_trial(domain)]
        if domain is not None
        else [synthetic_trial(features, pairs) for pairs in (False, True) for features in (2, 3)]
    )
    trainable = hasattr(original, "fit") and getattr(original, "fitted", False) is not True
    if trainable:
        _unfitted(Subject(known(), trials[0], report))
    subject = _ready(known, trials, trainable, report)
    if subject is None:
        _copies(Subject(original, trials[0], report), forecasts=False)
        return
    _purity(subject)
    if {"pure", "buffer", "predict", "forecast"} & set(broken):
        _copies(subject, forecasts=False)
        return  # nothing can be compared
    if "randomness" not in broken:
        _seeds(subject)
    if "input" not in broken:
        _scenes(subject)
    _observing(subject)
    _saving(subject, known)
    _copies(subject)
    if trainable:
        _refit(subject, known)


def _factory(predictor: Any, report: Report) -> Callable[[], Any] | None:
    """Makes the predictor anew; of an instance, copies of what it was."""
    if isinstance(predictor, (str, type)):
        return lambda: catalog.predictor(predictor)  # type: ignore[arg-type]
    try:
        copy.deepcopy(predictor)
    except Exception as error:
        report("copy", f"copy.deepcopy raised {_what(error)}; give its class to have the other rules checked.")
        return None
    return lambda: copy.deepcopy(predictor)


def _signatures(predictor: Any, report: Report) -> bool:
    """Whether every method can be called as the harness does."""
    fits = _takes(predictor.predict, (None,)) and _takes(predictor.predict, (None,), samples=1, seed=0)
    if not fits:
        report(
            "predict", f"predict{_signature(predictor.predict)} must be predict(self, observation, samples=1, seed=0)."
        )
    for method, (rule, arguments) in METHODS.items():
        bound = getattr(predictor, method, None)
        if bound is not None and not _takes(bound, arguments):
            report(rule, f"{method}{_signature(bound)} must be {method}({', '.join(('self', *arguments))}).")
            fits = False
    if hasattr(predictor, "observe") and not hasattr(predictor, "reset"):
        report("reset", "there is observe but no reset: define reset(self), which forgets all that was observed.")
    for one, other in (("save", "load"), ("load", "save")):
        if hasattr(predictor, one) and not hasattr(predictor, other):
            report("save", f"there is {one} but no {other}: define {other}(self, path).")
    return fits


def _attributes(predictor: Any, report: Report) -> None:
    for attribute, kind in (("fitted", bool), ("name", str), ("selection", str)):
        value = getattr(predictor, attribute, None)
        if value is not None and not isinstance(value, kind):
            report("attributes", f"{attribute} is {value!r}: make it of type {kind.__name__}.")


def _unfitted(subject: Subject) -> None:
    """An unfitted predictor must say so itself: what numpy says of None helps nobody."""
    remedy = "raise motion_gym.contract.PredictorError that says: not fitted, call fit(train, validation, seed)"
    try:
        with global_randomness():
            subject.predictor.predict(writable(subject.trial.truth.observation))
    except PredictorError:
        return
    except Exception as error:
        subject.report("unfitted", f"predict before fit raised {_what(error)}: {remedy}.")
    else:
        subject.report("unfitted", f"predict before fit gave a forecast: {remedy}, or let fitted be True.")


def _ready(fresh: Callable[[], Any], trials: list[Trial], trainable: bool, report: Report) -> Subject | None:
    """The predictor, fitted if it can be, with the first scenes that it does not refuse."""
    first: tuple[str, str] | None = None
    crashed = False
    for trial in trials:
        stage = "predict"
        try:
            subject = Subject(fresh(), trial, report)
            if trainable:
                stage = "fit"
                subject.fit()
                stage = "predict"
            subject.answer(trial.truth.observation)
            return subject
        except MotionGymError as error:
            first = first or (stage, str(error))
            crashed = error.__cause__ is not None
            if crashed:
                break  # another kind of scenes is for those that refuse these
    assert first is not None
    scenes = "synthetic scenes of 1, 2 and 5 agents" if trials[0].synthetic else "the windows of the domain"
    hint = (
        "" if crashed or not trials[0].synthetic else " If it is made for particular ones, give a domain that has them."
    )
    report(first[0], f"{first[0]} failed on {scenes}: {first[1].rstrip('.')}.{hint}")
    return None


def _purity(subject: Subject) -> None:
    """Asked again, and after something else, it answers the same; and nothing it holds has changed."""
    for samples in (1, 5):
        subject.ask(samples=samples)
    before = snapshot(subject.predictor)
    first = subject.ask()
    if first is None:
        return
    kept = Forecast(first.positions.copy(), first.weights)
    again = subject.ask()
    subject.ask(subject.trial.other.observation, seed=4)
    spoilt = not np.array_equal(first.positions, kept.positions)
    _ask_nobody(subject)
    later = subject.ask()
    touched = ", ".join(changed(before, snapshot(subject.predictor))[:3])
    if spoilt:
        subject.report("buffer", "predict wrote into an array that it had returned before: return a new one each time.")
        return
    for answer, when in ((again, "asked twice"), (later, "asked again after a forecast of other scenes")):
        if not _equal(kept, answer):
            cause = f" ({touched} changed)" if touched else ""
            subject.report(
                "pure",
                f"{when}, with the same input and seed, predict answered {_gap(kept, answer)} away{cause}: draw from "
                "numpy.random.default_rng(seed) alone, and learn in observe or fit alone.",
            )
            return
    if touched:
        subject.report("state", f"predict changed {touched}: leave it as it is, or change it in observe.")


def _ask_nobody(subject: Subject) -> None:
    """No agents: may be refused, as the harness never asks, but must do no harm."""
    nobody = pick_scenes(subject.trial.truth, slice(0, 0)).observation
    try:
        with global_randomness(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            subject.predictor.predict(nobody)
    except Exception:
        return


def _seeds(subject: Subject) -> None:
    """Samples that differ must come from the seed."""
    first, other = subject.ask(), subject.ask(seed=5)
    if _drawn(first) and _equal(first, other):
        subject.report(
            "seed",
            "samples differ, but seeds 3 and 5 give the same ones: draw from numpy.random.default_rng(seed), or, if "
            "they are fixed modes, return a Forecast with weights.",
        )


def _scenes(subject: Subject) -> None:
    """What other scenes hold, or whether they are there, must not matter."""
    trial, here = subject.trial, subject.trial.truth.observation
    whole = subject.ask()
    deterministic = not _drawn(whole) and _equal(whole, subject.ask(seed=5))
    remedy = "normalise, pool and attend within each scene (observation.scene, observation.scene_index)."
    limit = TOLERANCE + 4 * np.finfo(np.float32).eps * np.abs(here.xy).max(axis=(1, 2))
    for parity in (0, 1) if trial.synthetic else ():
        same = here.scene_index % 2 == parity
        answer = subject.ask(swapped(here, trial.other.observation, ~same))
        off = _distance(whole, answer)[same]
        if (off > limit[same]).any():
            subject.report(
                "scenes", f"other positions in some scenes moved forecasts of others by {off.max():.2g} m: {remedy}"
            )
            return
    for scene in range(here.scenes) if deterministic else ():  # one seed draws other noise for another batch
        rows = slice(here.scene[scene], here.scene[scene + 1])
        alone = subject.ask(pick_scenes(trial.truth, [scene]).observation)
        batch = None if whole is None else Forecast(whole.positions[rows])
        off = _distance(batch, alone)
        if (off > limit[rows]).any():
            text = f"alone, a scene is forecast {off.max():.2g} m from where it is among {here.scenes}: {remedy}"
            subject.report("scenes", text)
            return


def _observing(subject: Subject) -> None:
    """Truth is seen without being changed, and forgotten by reset."""
    if not subject.has("observe"):
        return
    twin = subject.copied()
    if twin.has("reset") and not twin.call("reset", "reset"):
        return
    before = twin.ask()
    if not twin.observe():
        return
    if not _equal(twin.ask(), twin.ask()):
        twin.report("pure", "after observe, predict asked twice gave two answers: learn in observe alone.")
    if not twin.has("reset") or not twin.call("reset", "reset"):
        return
    after = twin.ask()
    if not _equal(before, after):
        twin.report(
            "reset",
            f"after observe and reset the forecasts are {_gap(before, after)} from those before: bring back all that "
            "observe changes.",
        )


def _refit(subject: Subject, fresh: Callable[[], Any]) -> None:
    """The same seed and data give the same forecasts, whatever was fitted before."""
    first = subject.ask()
    for again, who in ((subject.of(fresh()), "another one"), (subject, "the same one again")):
        try:
            again.fit(world=1)
        except MotionGymError as error:
            subject.report("fit", f"{who} could not be fitted to the same data: {error}")
            return
        answer = again.ask()
        if not _equal(first, answer):
            subject.report(
                "fit",
                f"{who}, fitted to the same data with the same seed, forecasts {_gap(first, answer)} away: begin "
                "anew in fit, and draw from its seed alone.",
            )
            return


def _saving(subject: Subject, fresh: Callable[[], Any]) -> None:
    """What was saved forecasts the same when it is loaded."""
    if not (subject.has("save") and subject.has("load")):
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "weights"
        if not subject.call("save", "save", path):
            return
        made = fresh()
        try:
            with global_randomness(2):
                loaded = guarded(made, "load", path)
            subject.of(made if loaded is None else loaded).answer(subject.trial.truth.observation)
        except MotionGymError as error:
            subject.report("save", f"what save wrote could not be loaded and asked: {error}")
            return
    first, answer = subject.ask(), subject.of(made if loaded is None else loaded).ask()
    if not _equal(first, answer):
        subject.report("save", f"after save and load the forecasts are {_gap(first, answer)} away: save all they need.")


def _copies(subject: Subject, forecasts: bool = True) -> None:
    """Copies and pickles forecast the same, and share nothing that can be written to."""
    for rule, make in COPIERS:
        try:
            twin = subject.of(make(subject.predictor))
        except Exception as error:
            remedy = "keep lambdas, open files and classes defined in functions out of it, or define __getstate__"
            subject.report(rule, f"it raised {_what(error)}: {remedy}.")
            continue
        common = shared_arrays(subject.predictor, twin.predictor)
        if common:
            subject.report(rule, f"the copy shares the memory of {', '.join(common[:3])}: copy arrays too.")
        if not forecasts:
            continue
        first, answer = subject.ask(), twin.ask()
        if not _equal(first, answer):
            subject.report(rule, f"the copy forecasts {_gap(first, answer)} away: carry all state over.")
        elif twin.has("observe") and twin.observe() and not _equal(first, subject.ask()):
            subject.report(rule, "what the copy observed changed the forecasts of the original: share nothing.")


def _takes(method: Any, arguments: tuple[Any, ...], **keywords: Any) -> bool:
    try:
        inspect.signature(method).bind(*arguments, **keywords)
    except TypeError:
        return False
    except ValueError:
        return callable(method)  # a builtin that has no signature
    return True


def _signature(method: Any) -> str:
    return str(inspect.signature(method)) if callable(method) else f", a {type(method).__name__},"


def _equal(a: Forecast | None, b: Forecast | None) -> bool:
    """Bit-identical; what could not be asked has been reported already, and counts as equal."""
    if a is None or b is None:
        return True
    weights = a.weights is b.weights if a.weights is None or b.weights is None else np.array_equal(a.weights, b.weights)
    return weights and np.array_equal(a.positions, b.positions)


def _drawn(a: Forecast | None) -> bool:
    """Whether samples differ and are not modes with weights."""
    return a is not None and a.weights is None and not (a.positions == a.positions[:, :1]).all()


def _distance(a: Forecast | None, b: Forecast | None) -> np.ndarray:
    """[A] largest distance of any sample and step, or zeros if it cannot be told."""
    if a is None or b is None or a.positions.shape != b.positions.shape:
        return np.zeros(len((a or b or Forecast(np.zeros(1))).positions))
    return np.abs(a.positions.astype(np.float64) - b.positions).max(axis=(1, 2, 3))


def _gap(a: Forecast | None, b: Forecast | None) -> str:
    return f"up to {_distance(a, b).max(initial=0):.2g} m"


def _what(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"
