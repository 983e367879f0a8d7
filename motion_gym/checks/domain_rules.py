"""The rules of the domain contract; each takes a DomainTrial and raises.

The library cuts all windows from the recordings, so no rule checks how windows are cut.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import pickle as pickling
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.report import CheckError, NotChecked, Rules, broken_if
from motion_gym.contract import HISTORY, Card, DataError, MotionGymError, Recording, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.overlap import shared_people
from motion_gym.data.recordings import check_recording
from motion_gym.data.windows import Tracks, check_truth, counts

SPLITS = ("train", "val", "test")
PROBED = 2000
"""Most agents that features are computed for."""
MOVED = (0.5, 1e-3)
"""Standard deviations, in the domain's unit, of the noise that is added to observed steps."""


class DomainTrial:
    """A domain with its valid recordings, which are read once.

    Args:
        domain: The domain.
    """

    def __init__(self, domain: Any):
        self.domain = domain
        self._recordings: dict[str, Sequence[Recording]] = {}

    @property
    def card(self) -> Card:
        """The card; NotChecked if there is none."""
        if not isinstance(self.domain.card, Card):
            raise NotChecked("the domain has no card")
        return self.domain.card

    def recordings(self, split: str) -> Sequence[Recording]:
        """The recordings of a split; NotChecked if they are not valid."""
        if split not in self._recordings:
            try:
                self._recordings[split] = checked_recordings(self.domain, split)
            except DataError:
                raise
            except Exception as error:
                raise NotChecked("recordings cannot be used") from error
        return self._recordings[split]

    def windows(self, split: str) -> Truth:
        """The windows of a split; NotChecked if they are not valid."""
        self.recordings(split)
        try:
            return check_truth(self.domain.windows(split), f"windows({split!r})")
        except Exception as error:
            raise NotChecked("windows cannot be used") from error


def members(trial: DomainTrial) -> None:
    """The class is a RecordedDomain, with card and recordings(split)."""
    broken_if(
        not isinstance(trial.domain.card, Card),
        f"card is a {type(trial.domain.card).__name__}: leave it as RecordedDomain defines it.",
    )
    for method, names in (("features", "feature_names"), ("side_channels", "side_channel_names")):
        defined = getattr(type(trial.domain), method) is not getattr(RecordedDomain, method)
        broken_if(
            defined and not getattr(trial.domain, names) and names not in vars(trial.domain),
            f"`{method}` is defined, and `{names}` is empty, so that it is not used: name what it gives.",
        )


def card(trial: DomainTrial) -> None:
    """The card is complete and agrees with the windows."""
    card, faults = trial.card, []
    if not isinstance(card.name, str) or not card.name:
        faults.append(f"name is {card.name!r}: give the name of the domain")
    if isinstance(card.dt, bool) or not isinstance(card.dt, (int, float)) or not 0 < card.dt < math.inf:
        faults.append(f"dt is {card.dt!r}: give seconds per step, above 0")
    features = tuple(card.features)
    if features[:2] != ("x", "y") or len(set(features)) < len(features):
        faults.append(f"features are {features}: begin with x and y, and name each once")
    unknown = [name for name in card.side_channels if name not in features]
    if unknown:
        faults.append(f"side_channels {unknown} are no features: name columns of the history")
    try:
        json.dumps(dict(card.parameters), allow_nan=False)
    except (TypeError, ValueError) as error:
        faults.append(f"parameters are no dict that fits into JSON ({error}): use numbers, text, lists and None")
    if card.oracle is not None and card.oracle not in catalog.PREDICTORS and ":" not in str(card.oracle):
        faults.append(f"oracle is {card.oracle!r}, no predictor: give a name, `module:Class` or None")
    broken_if(faults, "; ".join(faults) + ".")
    for split in SPLITS:
        counted = counts(trial.windows(split))
        for key, value in trial.domain.card.counts.get(split, {}).items():
            broken_if(
                counted.get(key, value) != value,
                f"counts of {split} give {value} {key}, but there are {counted.get(key)}: leave out counts.",
            )


def splits(trial: DomainTrial) -> None:
    """Train, val, test and reference exist, test is not empty, and an unknown split is refused."""
    for split in (*SPLITS, "reference"):
        try:
            trial.domain.recordings(split)
        except DataError:
            raise
        except Exception as error:
            raise CheckError(
                f"recordings({split!r}) raised {type(error).__name__}: {error}. A split may be empty, but must exist."
            ) from error
    remedy = "call self.check_split(split) first, which raises motion_gym.contract.SpecError and names the splits."
    try:
        trial.domain.recordings("no such split")
    except (KeyError, ValueError):
        pass
    except Exception as error:
        raise CheckError(f"recordings('no such split') raised {type(error).__name__}: {error}: {remedy}") from error
    else:
        raise CheckError(f"recordings('no such split') gave an answer: {remedy}")
    broken_if(not len(trial.windows("test").future), "windows('test') has no agent: there is nothing to score.")


def recordings(trial: DomainTrial) -> None:
    """Recordings are valid."""
    for split in (*SPLITS, "reference"):
        try:
            checked_recordings(trial.domain, split)
        except (CheckError, DataError):
            raise
        except Exception:
            continue  # reported by rule `splits`


def dt(trial: DomainTrial) -> None:
    """Card and recordings have the same seconds per step."""
    for split in SPLITS:
        for recording in trial.recordings(split):
            broken_if(
                recording.dt != trial.card.dt,
                f"recording {recording.name} has dt={recording.dt}, the card {trial.card.dt}: make them the same.",
            )


def windows(trial: DomainTrial) -> None:
    """Windows are finite arrays of the right shapes and types, with the features of the card."""
    named = len(trial.card.features)
    for split in (*SPLITS, "reference"):
        if any(recording.dt != trial.card.dt for recording in trial.recordings(split)):
            raise NotChecked("recordings and card have different steps (rule `dt`)")
        try:
            columns = trial.windows(split).observation.history.shape[2]
        except NotChecked as reason:
            raise CheckError(
                f"windows({split!r}) cannot be used: {reason.__cause__}. "
                f"Features and side_channels must give finite numbers [A, {HISTORY}, number of names]."
            ) from reason
        broken_if(
            columns != named,
            f"the history of windows({split!r}) has {columns} columns and the card names {named} features: give one "
            "name for each.",
        )


def features(trial: DomainTrial) -> None:
    """Features depend on their argument history alone."""
    problem = features_problem(trial.domain, trial.recordings("test"))
    broken_if(problem, problem)


def deterministic(trial: DomainTrial) -> None:
    """A second call of recordings gives the same recordings."""
    for split in SPLITS:
        broken_if(
            not _same(trial.recordings(split), trial.domain.recordings(split)),
            f"two calls of recordings({split!r}) gave two answers: draw from a fixed seed.",
        )


def read_only(trial: DomainTrial) -> None:
    """Writing into returned arrays does not change later answers."""
    for split in SPLITS:
        before, returned = copy.deepcopy(trial.recordings(split)), trial.domain.recordings(split)
        if not _same(before, returned):
            raise NotChecked("two calls of recordings gave two answers")
        for name in ("frame", "agent", "xy"):
            arrays = [getattr(recording, name) for recording in returned]
            arrays = [array for array in arrays if array.flags.writeable and array.size]
            values = [array.copy() for array in arrays]
            for array in arrays:
                array += 1
            spoilt = not _same(before, trial.domain.recordings(split))
            for array, value in zip(arrays, values, strict=True):
                array[...] = value
            broken_if(
                spoilt,
                f"writing into {name} of recordings({split!r}) changed the next answer: return copies, or arrays with "
                "flags.writeable = False.",
            )


def reference(trial: DomainTrial) -> None:
    """No person of the reference scenes is in the test split at the same time."""
    people = shared_people(trial.recordings("reference"), trial.recordings("test"))
    broken_if(
        people, f"{people} people of recordings('reference') are in recordings('test') too: cut them from other frames."
    )


def parameters(trial: DomainTrial) -> None:
    """The parameters of the card make an equal domain."""
    card = trial.card
    remedy = "list every argument of the constructor, with its value, in parameters"
    _same_elsewhere(trial, lambda: type(trial.domain)(**card.parameters), remedy)


def pickle(trial: DomainTrial) -> None:
    """A pickled copy gives the same recordings."""
    remedy = "leave caches and open files out by __getstate__"
    _same_elsewhere(trial, lambda: pickling.loads(pickling.dumps(trial.domain)), remedy)


def checked_recordings(domain: Any, split: str) -> Sequence[Recording]:
    """The recordings of a split; CheckError if they are not valid."""
    recordings = domain.recordings(split)
    broken_if(
        not isinstance(recordings, Sequence) or not all(isinstance(r, Recording) for r in recordings),
        f"recordings({split!r}) must be a list of motion_gym.contract.Recording.",
    )
    for recording in recordings:
        try:
            if len(recording.frame):
                check_recording(recording)
        except MotionGymError as error:
            raise CheckError(f"recordings({split!r}): {error}") from error
    return recordings  # type: ignore[no-any-return]


def features_problem(domain: Any, recordings: Sequence[Recording]) -> str:
    """Evidence that ``features`` reads anything but its argument; empty if there is none.

    With the same agents in another order, each agent must keep its features. With the steps moved by half a metre or by
    a millimetre, a feature that differs between most agents must change.
    """
    if not domain.feature_names:
        return ""
    histories = [t.around(np.flatnonzero(t.age >= HISTORY - 1))[0][:, :HISTORY] for t in map(Tracks.of, recordings)]
    history = np.concatenate([np.zeros((0, HISTORY, 2)), *histories])
    rng = np.random.default_rng(0)
    history = history[rng.permutation(len(history))[:PROBED]]
    if len(history) < 2:
        return ""
    order = rng.permutation(len(history))
    try:
        values, shuffled, *moved = (
            np.asarray(domain.features(steps))
            for steps in (history.copy(), history[order], *(history + rng.normal(0, d, history.shape) for d in MOVED))
        )
        agree = np.allclose(values[order], shuffled, rtol=1e-9, atol=1e-9, equal_nan=True)
    except Exception as error:
        return (
            f"features(history) raised {type(error).__name__} for steps that are not in the recordings: {error}. "
            "Compute features from the argument history alone."
        )
    if not agree:
        return (
            "features(history) gives an agent another feature when the agents are in another order: compute each "
            "agent's features from its own observed steps."
        )
    for column, name in enumerate(domain.feature_names):
        own = len(np.unique(values[..., column], axis=0)) > len(values) / 2
        still = max(int((m[..., column] == values[..., column]).all(axis=1).sum()) for m in moved)
        if own and still > len(values) / 2:
            return (
                f"feature {name} of features(history) stays the same for {still} of {len(values)} agents when their "
                "steps change: it reads data other than its argument, which may hold the future."
            )
    return ""


def _same_elsewhere(trial: DomainTrial, make: Callable[[], Any], remedy: str) -> None:
    """Raise CheckError unless a newly made domain has the same test recordings and parameters."""
    test, card = trial.recordings("test"), trial.card
    try:
        twin = make()
        same = _same(test, twin.recordings("test")) and dict(twin.card.parameters) == dict(card.parameters)
    except DataError:
        raise
    except Exception as error:
        raise CheckError(f"making it raised {type(error).__name__}: {error}: {remedy}.") from error
    broken_if(not same, f"recordings or parameters differ: {remedy}.")


def _same(a: Sequence[Recording], b: Sequence[Recording]) -> bool:
    """Whether two lists of recordings are bit-identical."""
    return len(a) == len(b) and all(
        np.array_equal(getattr(one, field.name), getattr(other, field.name), equal_nan=field.name == "xy")
        for one, other in zip(a, b, strict=True)
        for field in dataclasses.fields(Recording)
    )


DOMAIN_RULES: Rules = {
    "members": members,
    "card": card,
    "splits": splits,
    "recordings": recordings,
    "dt": dt,
    "windows": windows,
    "features": features,
    "deterministic": deterministic,
    "read-only": read_only,
    "reference": reference,
    "parameters": parameters,
    "pickle": pickle,
}
