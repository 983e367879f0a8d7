"""The rules of the domain contract; ``motion_gym.checks.checker`` is the way in."""

from __future__ import annotations

import functools
import json
import math
import pickle
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.predictor_trials import Report, writable
from motion_gym.contract import FUTURE, HISTORY, Card, DataError, MotionGymError, Observation, Recording, Truth
from motion_gym.data.recordings import check_recording
from motion_gym.data.windows import Tracks, counts

DOMAIN_RULES = {
    "members": "there are card, recordings(split), windows(split) and reference()",
    "card": "the card is complete and agrees with what the domain gives",
    "splits": "train, val and test exist, test is not empty, and another split is refused",
    "types": "windows are Truth of the right shapes and types: float32, bool, int64",
    "scene": "scene counts the agents of each scene, of which there is at least one",
    "values": "history is finite, future is finite where known and zero where not",
    "agents": "no agent is twice in a scene",
    "dt": "card, windows and recordings have the same seconds per step",
    "deterministic": "windows asked for twice are the same",
    "read-only": "changing what was returned changes nothing that is returned next",
    "reference": "no reference scene is among those of test",
    "recordings": "recordings are valid",
    "tracks": "the windows of a split are cut from its recordings",
    "parameters": "the card's parameters make the same domain again",
    "pickle": "a pickled copy gives the same windows",
}
SPLITS = ("train", "val", "test")
NEAR = 1e-3
"""Metres between a window and the recording it is cut from: more than rounding to float32."""
SEARCHED = 100
"""Windows that do not occur bit by bit in a recording are searched for by distance, this many of them at most."""


def apply_domain_rules(domain: Any, report: Report) -> None:
    """Report every rule that a domain breaks.

    Raises:
        DataError: its data is missing or damaged.
    """
    methods = ("recordings", "windows", "reference")
    missing = [name for name in methods if not callable(getattr(domain, name, None))]
    if missing:
        report("members", f"{', '.join(missing)} cannot be called: make it a method, see motion_gym.contract.Domain.")
        return
    card = domain.card
    if not isinstance(card, Card):
        report("members", f"card is a {type(card).__name__}: make it a property that returns motion_gym.contract.Card.")
        return
    _card(card, report)
    truths: dict[str, Truth] = {}
    makers: dict[str, Callable[[], Any]] = {f"windows({s!r})": functools.partial(domain.windows, s) for s in SPLITS}
    makers["reference()"] = domain.reference
    for what, make in makers.items():
        truth = _called(what, make, report)
        if truth is not None and _truth(what, truth, card, report):
            truths[what] = truth
            _again(what, truth, make, report)
    _unknown_split(domain, report)
    test, reference = truths.get("windows('test')"), truths.get("reference()")
    if test is not None and not len(test.future):
        report("splits", "windows('test') has no agent: there is nothing to score.")
    if test is not None and reference is not None:
        _disjoint(reference, test, report)
    for split in SPLITS:
        recordings = _called(f"recordings({split!r})", functools.partial(domain.recordings, split), report)
        truth = truths.get(f"windows({split!r})")
        if recordings is not None and _recordings(split, recordings, card, report) and truth is not None:
            _cut_from(split, truth, recordings, report)
        if truth is not None:
            _counted(split, truth, card, report)
    if test is not None:
        _same_elsewhere(domain, card, test, report)


def _card(card: Card, report: Report) -> None:
    faults = []
    if not isinstance(card.name, str) or not card.name:
        faults.append(f"name is {card.name!r}: give the name of the domain")
    if isinstance(card.dt, bool) or not isinstance(card.dt, (int, float)) or not 0 < card.dt < math.inf:
        faults.append(f"dt is {card.dt!r}: give seconds per step, above 0")
    features = tuple(card.features)
    if features[:2] != ("x", "y") or len(set(features)) < len(features):
        faults.append(f"features are {features}: begin with x and y, and name each once")
    strangers = [name for name in card.side_channels if name not in features]
    if strangers:
        faults.append(f"side_channels {strangers} are no features: name what the history has")
    if not isinstance(card.parameters, Mapping):
        faults.append(f"parameters are a {type(card.parameters).__name__}: give a dict of all of them")
    else:
        try:
            json.dumps(dict(card.parameters), allow_nan=False)
        except (TypeError, ValueError) as error:
            faults.append(f"parameters do not fit into a JSON result ({error}): use numbers, text, lists and None")
    if card.oracle is not None and card.oracle not in catalog.PREDICTORS and ":" not in str(card.oracle):
        faults.append(f"oracle is {card.oracle!r}, no predictor: give a name, `module:Class` or None")
    if faults:
        report("card", "; ".join(faults) + ".")


def _called(what: str, make: Callable[[], Any], report: Report) -> Any:
    try:
        return make()
    except DataError:
        raise
    except Exception as error:
        report("splits", f"{what} raised {type(error).__name__}: {error}. It may be empty, but must be there.")
        return None


def _truth(what: str, truth: Any, card: Card, report: Report) -> bool:
    """Whether a truth is sound enough to look further into."""
    if not isinstance(truth, Truth) or not isinstance(truth.observation, Observation):
        report(
            "types",
            f"{what} is of type {type(truth).__name__}: return a motion_gym.contract.Truth with its Observation.",
        )
        return False
    observation, agents, features = truth.observation, len(truth.future), len(card.features)
    expected: tuple[tuple[str, Any, type, tuple[int | None, ...]], ...] = (
        ("future", truth.future, np.float32, (agents, FUTURE, 2)),
        ("known", truth.known, np.bool_, (agents, FUTURE)),
        ("observation.history", observation.history, np.float32, (agents, HISTORY, features)),
        ("observation.scene", observation.scene, np.int64, (None,)),
        ("observation.agent", observation.agent, np.int64, (agents,)),
    )
    for name, array, kind, shape in expected:
        fits = isinstance(array, np.ndarray) and array.dtype == kind and len(array.shape) == len(shape)
        if not fits or any(wanted not in (None, got) for wanted, got in zip(shape, array.shape, strict=True)):
            seen = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            wanted = str(shape).replace("None", "S + 1")
            why = f", with the {features} features of the card" if name.endswith("history") else ""
            report("types", f"{name} of {what} is {seen}: make it {np.dtype(kind)} {wanted}{why}.")
            return False
    scene = observation.scene
    if not len(scene) or scene[0] != 0 or scene[-1] != agents or (np.diff(scene) < 1).any():
        report(
            "scene",
            f"scene of {what} must begin with 0, grow with every scene, and end with {agents}, the number of agents: "
            "leave out scenes without agents.",
        )
        return False
    for name, values, remedy in (
        ("history", observation.history, "leave such agents out"),
        ("known future", truth.future[truth.known], "make known False there"),
    ):
        if not np.isfinite(values).all():
            report("values", f"the {name} of {what} has NaN or infinite values: {remedy}.")
            return False
    if (truth.future[~truth.known] != 0).any():
        report("values", f"the future of {what} is not zero where it is not known: set it to zero.")
    pairs = np.stack([observation.scene_index, observation.agent], axis=1)
    if len(np.unique(pairs, axis=0)) < agents:
        report("agents", f"an agent is twice in one scene of {what}: give each agent an id of its own.")
    if observation.dt != card.dt:
        report("dt", f"{what} has dt={observation.dt} and the card {card.dt}: make them the same.")
    return True


def _again(what: str, truth: Truth, make: Callable[[], Truth], report: Report) -> None:
    """The same when asked for again, also after somebody wrote into what was returned."""
    kept = writable(truth)
    if not _same(kept, make()):
        report(
            "deterministic", f"{what}, asked for twice, gave two answers: draw from a fixed seed, or keep the first."
        )
        return
    for name, array in _arrays(truth).items():
        if not array.flags.writeable or not array.size:
            continue
        array[...] = ~array if array.dtype == bool else array + 1
        spoilt = not _same(kept, make())
        array[...] = _arrays(kept)[name]
        if spoilt:
            text = f"writing into {name} of {what} changed what it returns next: return data.domains.freeze(truth)."
            report("read-only", text)
            return


def _unknown_split(domain: Any, report: Report) -> None:
    try:
        domain.windows("no such split")
    except (KeyError, ValueError):
        return
    except Exception as error:
        seen = f"raised {type(error).__name__}: {error}"
    else:
        seen = "was answered"
    report("splits", f"windows('no such split') {seen}: raise motion_gym.contract.SpecError that names the splits.")


def _disjoint(reference: Truth, test: Truth, report: Report) -> None:
    def rows(truth: Truth) -> tuple[list[bytes], list[bytes]]:
        ids = truth.observation.agent
        own = [a.tobytes() + h for a, h in zip(ids, _rows(truth.observation.history), strict=True)]
        # Whatever its id, nobody moves along the same 20 positions twice; standing still proves nothing.
        path = np.concatenate([truth.observation.xy, truth.future], axis=1)
        moves = np.ptp(truth.observation.xy, axis=1).max(axis=1, initial=0) > 0
        return own, [p if m else o for p, m, o in zip(_rows(path), moves, own, strict=True)]

    scored = {row for column in rows(test) for row in column}
    common = sum(own in scored or path in scored for own, path in zip(*rows(reference), strict=True))
    if common:
        report("reference", f"{common} windows of reference() are in windows('test') too: cut them from other frames.")


def _recordings(split: str, recordings: Any, card: Card, report: Report) -> bool:
    if not isinstance(recordings, Sequence) or not all(isinstance(r, Recording) for r in recordings):
        report("recordings", f"recordings({split!r}) must be a list of motion_gym.contract.Recording.")
        return False
    for recording in recordings:
        try:
            check_recording(recording)
        except MotionGymError as error:
            report("recordings", f"recordings({split!r}): {error}")
            return False
        if recording.dt != card.dt:
            report(
                "dt", f"recording {recording.name} has dt={recording.dt} and the card {card.dt}: make them the same."
            )
    return True


def _cut_from(split: str, truth: Truth, recordings: Sequence[Recording], report: Report) -> None:
    """Every window must occur in the recordings, bit by bit or nearly."""
    if not recordings or not len(truth.future):
        return
    parts = []
    for recording in recordings:
        tracks = Tracks.of(recording)
        parts.append(tracks.around(np.flatnonzero(tracks.age >= HISTORY - 1)))
    places = np.concatenate([positions for positions, _ in parts]).astype(np.float32)
    there = np.concatenate([known for _, known in parts])
    paths = np.concatenate([truth.observation.xy, truth.future], axis=1)
    known = np.concatenate([np.ones((len(paths), HISTORY), bool), truth.known], axis=1)
    whole, recorded = known.all(axis=1), set(_rows(places[there.all(axis=1)]))
    exact = np.fromiter((row in recorded for row in _rows(paths)), bool, len(paths)) & whole
    for row in np.flatnonzero(~exact)[:SEARCHED]:
        steps = known[row]
        near = np.abs(places[:, HISTORY - 1] - paths[row, HISTORY - 1]).max(axis=1) < NEAR
        off = np.abs(places[near][:, steps] - paths[row, steps]).max(axis=(1, 2))
        if not ((off < NEAR) & there[near][:, steps].all(axis=1)).any():
            agent = truth.observation.agent[row]
            report(
                "tracks",
                f"window row {row} of {split} (agent {agent}) is on no track of recordings({split!r}): both clocks "
                "must show the same people; cut windows with motion_gym.data.windows.windows_of.",
            )
            return


def _counted(split: str, truth: Truth, card: Card, report: Report) -> None:
    seen = counts(truth)
    for key, value in card.counts.get(split, {}).items():
        if key in seen and seen[key] != value:
            report("card", f"counts of {split} say {value} {key}, and there are {seen[key]}: count what windows gives.")


def _same_elsewhere(domain: Any, card: Card, test: Truth, report: Report) -> None:
    """A copy by pickle, and a domain made anew from its parameters, give the same test windows."""

    def anew() -> Any:
        return type(domain)(**card.parameters)

    makers: tuple[tuple[str, Callable[[], Any], str], ...] = (
        ("parameters", anew, "list every argument of the constructor, with its value, in card.parameters"),
        ("pickle", lambda: pickle.loads(pickle.dumps(domain)), "leave caches and open files out by __getstate__"),
    )
    for rule, make, remedy in makers:
        try:
            twin = make()
            same = _same(test, twin.windows("test")) and dict(twin.card.parameters) == dict(card.parameters)
        except DataError:
            raise
        except Exception as error:
            report(rule, f"it raised {type(error).__name__}: {error}: {remedy}.")
            continue
        if not same:
            report(rule, f"the windows or parameters are other ones: {remedy}.")


def _arrays(truth: Truth) -> dict[str, np.ndarray]:
    observation = truth.observation
    return {
        "future": truth.future,
        "known": truth.known,
        "observation.history": observation.history,
        "observation.scene": observation.scene,
        "observation.agent": observation.agent,
    }


def _same(a: Truth, b: Any) -> bool:
    if not isinstance(b, Truth):
        return False
    others = _arrays(b)
    return all(
        np.array_equal(array, others[name]) or _both_nan(array, others[name]) for name, array in _arrays(a).items()
    )


def _both_nan(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype.kind == "f" and b.dtype.kind == "f" and np.array_equal(a, b, equal_nan=True)


def _rows(array: np.ndarray) -> list[bytes]:
    """Each row as bytes; minus zero as zero."""
    return [row.tobytes() for row in np.ascontiguousarray(array + np.float32(0))]
