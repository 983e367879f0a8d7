"""The rules of the domain contract; each takes a DomainTrial and raises.

The library cuts all windows from the recordings, so that windows need no rule on where they come from.
"""

from __future__ import annotations

import copy
import dataclasses
import json
import math
import pickle as pickling
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.report import CheckError, NotChecked, Rule, broken_if
from motion_gym.contract import HISTORY, Card, DataError, MotionGymError, Recording, Truth
from motion_gym.data.overlap import shared_people
from motion_gym.data.recordings import check_recording
from motion_gym.data.windows import Tracks, check_truth, counts

SPLITS = ("train", "val", "test")
PROBED = 2000
"""Most agents that features are tried on."""
MOVED = (0.5, 1e-3)
"""Standard deviations, in the domain's unit, of the noise by which observed steps are moved."""


class DomainTrial:
    """A domain whose answers are kept, so that each rule can ask for them.

    Args:
        domain: The domain.
    """

    def __init__(self, domain: Any):
        self.domain = domain
        self._kept: dict[str, Sequence[Recording]] = {}

    @property
    def card(self) -> Card:
        """The card; NotChecked if there is none."""
        if not isinstance(self.domain.card, Card):
            raise NotChecked("the domain has no card")
        return self.domain.card

    def recordings(self, split: str) -> Sequence[Recording]:
        """Valid recordings of a split; NotChecked if they are not."""
        if split not in self._kept:
            try:
                self._kept[split] = checked_recordings(self.domain, split)
            except DataError:
                raise
            except Exception as error:
                raise NotChecked(f"recordings({split!r}) cannot be used: {error}") from error
        return self._kept[split]

    def windows(self, split: str) -> Truth:
        """Windows of a split; NotChecked if there are none to look at."""
        self.recordings(split)
        try:
            return check_truth(self.domain.windows(split), f"windows({split!r})")
        except Exception as error:
            raise NotChecked(f"windows({split!r}) cannot be cut: {error}") from error


def members(trial: DomainTrial) -> None:
    """The class is a RecordedDomain, with card and recordings(split)."""
    broken_if(
        not isinstance(trial.domain.card, Card),
        f"card is a {type(trial.domain.card).__name__}: leave it as RecordedDomain defines it.",
    )


def card(trial: DomainTrial) -> None:
    """The card is complete and agrees with what the domain gives."""
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
    if not isinstance(card.parameters, Mapping):
        faults.append(f"parameters are a {type(card.parameters).__name__}: give a dict of all of them")
    else:
        try:
            json.dumps(dict(card.parameters), allow_nan=False)
        except (TypeError, ValueError) as error:
            faults.append(f"parameters do not fit into a JSON result ({error}): use numbers, text, lists and None")
    if card.oracle is not None and card.oracle not in catalog.PREDICTORS and ":" not in str(card.oracle):
        faults.append(f"oracle is {card.oracle!r}, no predictor: give a name, `module:Class` or None")
    broken_if(faults, "; ".join(faults) + ".")
    for split in SPLITS:
        seen = counts(trial.windows(split))
        for key, value in trial.domain.card.counts.get(split, {}).items():
            broken_if(
                seen.get(key, value) != value,
                f"counts of {split} say {value} {key}, and there are {seen.get(key)}: leave out counts.",
            )


def splits(trial: DomainTrial) -> None:
    """Train, val, test and reference exist, test is not empty, and another split is refused."""
    for split in (*SPLITS, "reference"):
        try:
            trial.domain.recordings(split)
        except DataError:
            raise
        except Exception as error:
            raise CheckError(
                f"recordings({split!r}) raised {type(error).__name__}: {error}. A split may be empty, but must exist."
            ) from error
    try:
        trial.domain.recordings("no such split")
    except (KeyError, ValueError):
        pass
    except Exception as error:
        raise CheckError(f"recordings('no such split') raised {type(error).__name__}: {error}: {_REFUSE}") from error
    else:
        raise CheckError(f"recordings('no such split') was answered: {_REFUSE}")
    broken_if(not len(trial.windows("test").future), "windows('test') has no agent: there is nothing to score.")


_REFUSE = "call self.check_split(split) first, which raises motion_gym.contract.SpecError and names the splits."


def recordings(trial: DomainTrial) -> None:
    """Recordings are valid."""
    for split in (*SPLITS, "reference"):
        try:
            checked_recordings(trial.domain, split)
        except (CheckError, DataError):
            raise
        except Exception:
            continue  # rule `splits` says so


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
    for split in (*SPLITS, "reference"):
        trial.recordings(split)
        try:
            truth = check_truth(trial.domain.windows(split), f"windows({split!r})")
        except Exception as error:
            raise CheckError(
                f"windows({split!r}) cannot be used ({error}): features and side_channels must give finite numbers "
                f"[A, {HISTORY}, number of names]."
            ) from error
        columns, named = truth.observation.history.shape[2], len(trial.card.features)
        broken_if(
            columns != named,
            f"the history of windows({split!r}) has {columns} columns and the card names {named} features: give one "
            "name for each.",
        )


def features(trial: DomainTrial) -> None:
    """Features depend on the history that is given, and on nothing else."""
    problem = features_problem(trial.domain, trial.recordings("test"))
    broken_if(problem, problem)


def deterministic(trial: DomainTrial) -> None:
    """Recordings asked for twice are the same."""
    for split in SPLITS:
        first, again = trial.recordings(split), trial.domain.recordings(split)
        broken_if(
            len(first) != len(again) or not all(_same(a, b) for a, b in zip(first, again, strict=True)),
            f"recordings({split!r}), asked for twice, gave two answers: draw from a fixed seed.",
        )


def read_only(trial: DomainTrial) -> None:
    """Writing into what was returned changes nothing that is returned next."""
    for split in SPLITS:
        first, again = trial.recordings(split), trial.domain.recordings(split)
        if not all(_same(a, b) for a, b in zip(first, again, strict=False)):
            raise NotChecked("recordings asked for twice differ")
        for position, recording in enumerate(again):
            kept = copy.deepcopy(recording)
            for name in ("frame", "agent", "xy"):
                array = getattr(recording, name)
                if not array.flags.writeable or not array.size:
                    continue
                array += 1
                spoilt = not _same(kept, trial.domain.recordings(split)[position])
                array -= 1
                if name == "xy":
                    array[...] = kept.xy  # adding and subtracting rounds
                broken_if(
                    spoilt,
                    f"writing into {name} of recordings({split!r}) changed what is returned next: return copies, "
                    "or arrays with flags.writeable = False.",
                )


def reference(trial: DomainTrial) -> None:
    """No person of the reference scenes is among those of test at the same time."""
    people = shared_people(trial.recordings("reference"), trial.recordings("test"))
    broken_if(
        people, f"{people} people of recordings('reference') are in recordings('test') too: cut them from other frames."
    )


def parameters(trial: DomainTrial) -> None:
    """The card's parameters make the same domain again."""
    remedy = "list every argument of the constructor, with its value, in parameters"
    _same_elsewhere(trial, lambda: type(trial.domain)(**trial.card.parameters), remedy)


def pickle(trial: DomainTrial) -> None:
    """A pickled copy gives the same recordings."""
    remedy = "leave caches and open files out by __getstate__"
    _same_elsewhere(trial, lambda: pickling.loads(pickling.dumps(trial.domain)), remedy)


def checked_recordings(domain: Any, split: str) -> Sequence[Recording]:
    """The recordings of a split; CheckError if they are not valid."""
    listed = domain.recordings(split)
    broken_if(
        not isinstance(listed, Sequence) or not all(isinstance(r, Recording) for r in listed),
        f"recordings({split!r}) must be a list of motion_gym.contract.Recording.",
    )
    for recording in listed:
        try:
            if len(recording.frame):
                check_recording(recording)
        except MotionGymError as error:
            raise CheckError(f"recordings({split!r}): {error}") from error
    return listed  # type: ignore[no-any-return]


def features_problem(domain: Any, recordings: Sequence[Recording]) -> str:
    """Why ``features`` reads something else than the history that it is given; empty if nothing speaks for it.

    Called with the same steps in another order of agents, each agent must keep its feature; called with steps that are
    moved, by half a metre or by a millimetre, a feature with a value of its own for most agents must change.
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
            "Compute features from the history that is given, and from nothing else."
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
                "steps change: it reads something else than the history that is given, which may hold the future."
            )
    return ""


def _same_elsewhere(trial: DomainTrial, make: Any, remedy: str) -> None:
    test = trial.recordings("test")
    try:
        twin = make()
        others = twin.recordings("test")
        same = len(test) == len(others) and all(_same(a, b) for a, b in zip(test, others, strict=True))
        same = same and dict(twin.card.parameters) == dict(trial.card.parameters)
    except DataError:
        raise
    except Exception as error:
        raise CheckError(f"it raised {type(error).__name__}: {error}: {remedy}.") from error
    broken_if(not same, f"the recordings or parameters are other ones: {remedy}.")


def _same(a: Recording, b: Recording) -> bool:
    return all(
        np.array_equal(getattr(a, f.name), getattr(b, f.name), equal_nan=f.name == "xy")
        for f in dataclasses.fields(Recording)
    )


DOMAIN_RULES: Mapping[str, Rule] = MappingProxyType(
    {
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
)
