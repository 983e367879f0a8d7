"""The leak probe: whether observations, rewards, ground truth or forecasts depend on data of later times."""

from __future__ import annotations

import copy
import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.checks.changed_future import Stage
from motion_gym.checks.domain_rules import features_problem
from motion_gym.contract import FUTURE, Domain, Forecast, Observation, Predictor, SpecError, Truth
from motion_gym.data.domains import spec_of
from motion_gym.specs import one_of
from motion_gym.stepping.dicts import forecast_to_dict, observation_from_dict, truth_from_infos
from motion_gym.stepping.harness import ask, name_of, ready, tell
from motion_gym.stepping.pettingzoo_env import CLOCKS, ForecastEnv
from motion_gym.stepping.snapshot import changed, global_randomness, leaves

SAMPLES = 2
"""Samples asked for, so that a stochastic predictor has to draw."""
ASKED_TWICE = 3
"""Number of observations that the first play forecasts twice."""
START = -1
"""Time of the predictor's state before its first forecast."""


@dataclass(frozen=True)
class LeakReport:
    """Result of the leak probe.

    Attributes:
        domain: Name of the domain with its parameters.
        predictor: Name of the predictor.
        clock: ``stream`` or ``windows``.
        split: Split that was played.
        changed: The method whose return value was changed; code that runs before it, as reading a file, is not probed.
        cuts: Times after which all data was changed: listed frames since the first, over all recordings.
        checked: Number of values compared by kind: agent-times, or states.
        side_channels: Declared oracle side channels that read the future, with the largest change of a value.
        selections: Declared ways in which the future determines who is observed.
        oracles: Oracles, and whether their forecasts read the future, as oracles may.
        unprobed: Parts that could not be probed, and why.
        leaks: Undeclared dependencies on the future: one sentence per kind.
    """

    domain: str
    predictor: str
    clock: str
    split: str
    changed: str
    cuts: tuple[int, ...]
    checked: Mapping[str, int]
    side_channels: Mapping[str, float]
    selections: tuple[str, ...]
    oracles: tuple[str, ...]
    unprobed: tuple[str, ...]
    leaks: tuple[str, ...]

    @property
    def ok(self) -> bool:
        """Whether there is no undeclared leak."""
        return not self.leaks

    def __str__(self) -> str:
        lines = [
            f"{self.predictor} on {self.domain}, {self.clock} clock, split {self.split}: "
            + ("no leak found." if self.ok else f"{len(self.leaks)} found to LEAK."),
            f"data changed after times {', '.join(map(str, self.cuts))}, in the result of {self.changed}",
            "compared: " + ", ".join(f"{n} {kind}" for kind, n in self.checked.items()),
        ]
        lines += [f"LEAK: {leak}" for leak in self.leaks]
        lines += [
            f"side channel: {name} reads the future, as declared (changed by up to {by:.3g})"
            for name, by in self.side_channels.items()
        ]
        for label in ("selections", "oracles", "unprobed"):
            lines += [f"{label.removesuffix('s')}: {sentence}" for sentence in getattr(self, label)]
        return "\n- ".join(lines)


@dataclass
class _Tape:
    """All values handed out in one play, by time and kind, and the predictor's observations and truths."""

    rows: dict[tuple[int, str], tuple[list[str], np.ndarray]] = field(default_factory=dict)
    states: dict[int, dict[str, int]] = field(default_factory=dict)
    shown: dict[int, Observation] = field(default_factory=dict)
    told: dict[int, Truth | None] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)


def leak_probe(
    predictor: str | Predictor,
    domain: str | Domain | None = None,
    *,
    clock: str = "stream",
    split: str = "test",
    cuts: int = 3,
    seed: int = 0,
    **parameters: Any,
) -> LeakReport:
    """Change all data after time t, play again, and compare, bit for bit, everything that was handed out up to t.

    The first play uses the original data, the second play uses changed data. The changed data moves positions by
    metres. On the stream clock people also leave, are lost for a while or enter, and frames disappear or are added. The
    probe changes the return value of the domain's ``recordings``; the library cuts windows and steps ``ForecastEnv`` as
    usual. The probe compares who is observed, histories, images of the ground, rewards and ends, revealed truth,
    forecasts and the predictor's state. In the second play the predictor is shown the observations of the first play,
    and the environment gets the same forecasts, so each leak is reported where it arises. On the stream clock the
    predictor observes revealed truth in whole scenes; on the windows clock, as in ``evaluate``, it observes the
    reference scenes alone. The probe also calls ``features`` with other observed steps, since data that a domain stores
    itself does not change with the recordings.

    The probe cannot find leaks inside ``recordings``, and it cannot find a predictor that holds the data of the split,
    because it was trained on the split or reads a file. ``possible_agents``, which PettingZoo requires, lists agents
    that have not appeared yet.

    Args:
        predictor: A name, a spec, ``"module:Class"`` or a predictor; a copy of it plays. If the predictor holds the
            domain, the copy holds the changed domain.
        domain: A name, a spec, ``"module:Class"`` or a domain; it is not changed.
        clock: ``stream`` or ``windows``.
        split: Which split.
        cuts: Number of times t, one in each of as many equal parts of the episode, or of its first 2000 steps.
        seed: Seed of the changes, the times, and the predictor's samples.
        **parameters: Parameters of the domain.

    Raises:
        SpecError: A name or option is not known, or the split has no agent to observe.
        PredictorError: The predictor broke its contract.
        DataError: Data is missing or damaged.
    """
    predictor, domain = _in_order(predictor, domain)
    one_of("clock", clock, CLOCKS)
    cuts = catalog.whole_number("cuts", cuts, 1, 10**9)
    place = catalog.domain(domain, **parameters)
    stage = Stage(place, clock, split, seed)
    player, unprobed = predictor, stage.unprobed
    if not isinstance(predictor, (str, type)):
        try:
            player = copy.deepcopy(predictor, {id(place): stage.domain})
        except Exception as error:
            unprobed.append(f"{name_of(predictor)} cannot be copied ({error}): the probe misses reads of the domain.")
    player = ready(player, stage.domain, seed)
    times = stage.cuts(cuts)
    first = _play(stage, player, max(times), seed, None)
    leaks = {fault: fault for fault in first.faults}
    if problem := features_problem(place, place.recordings(split)):
        leaks["features"] = problem
    checked: Counter[str] = Counter()
    side_channels: dict[str, float] = {}
    for cut in times:
        stage.change(cut)
        second = _play(stage, player, cut, seed, first)
        for kind, sentence in _compare(first, second, cut, stage.domain.card, checked, side_channels).items():
            leaks.setdefault(kind, sentence)
    oracles: list[str] = []
    name = name_of(player)
    if hasattr(player, "know"):
        read = [leaks.pop(kind) for kind in ("forecasts", "weights", "states") if kind in leaks]
        oracles = [f"{name} is told what no forecaster can know", *read]
    return LeakReport(
        domain=spec_of(place),
        predictor=predictor if isinstance(predictor, str) else name,
        clock=clock,
        split=split,
        changed=f"{type(place).__name__}.recordings",
        cuts=tuple(times),
        checked=dict(checked),
        side_channels=side_channels,
        selections=_selections(place, clock),
        oracles=tuple(oracles),
        unprobed=tuple(unprobed),
        leaks=tuple(leaks.values()),
    )


def _in_order(predictor: Any, domain: Any) -> tuple[Any, Any]:
    """Predictor and domain, also where they are given in the order of earlier versions: domain, predictor."""
    named = isinstance(predictor, str) and catalog.parse_spec(predictor)[0] in catalog.DOMAINS
    if not named and not hasattr(predictor, "recordings"):
        if domain is None:
            raise SpecError("leak_probe needs a domain: leak_probe(predictor, domain).")
        return predictor, domain
    warnings.warn(
        "leak_probe(domain, predictor) is the order of earlier versions: write leak_probe(predictor, domain).",
        DeprecationWarning,
        stacklevel=3,
    )
    return ("constant_velocity" if domain is None else domain), predictor


def _play(stage: Stage, predictor: Any, stop: int, seed: int, first: _Tape | None) -> _Tape:
    """Play an episode up to a time; the second play repeats the observations and forecasts of the first one."""
    tape = _Tape()
    dt, streams = stage.domain.card.dt, stage.clock == "stream"
    if first is None:
        stage.change(None)
    ready(predictor, stage.domain, seed)
    if hasattr(predictor, "observe") and not streams:
        tell(predictor, stage.domain.reference())
    # Another seed in the second play, which changes the forecasts of a predictor that draws from a global generator.
    with global_randomness(seed + (first is not None)):
        try:
            env = ForecastEnv(stage.domain, clock=stage.clock, split=stage.split)
        except SpecError:
            if first is None:
                raise
            return tape  # no agent is left in the changed data, which the comparison reports
        observations, _ = env.reset()
        tape.states[START] = _state(predictor, stage.domain)
        while env.agents and (now := stage.time(env)) <= stop:
            names = list(env.agents)
            seen = observation_from_dict(observations, dt, names, images=env.images)
            tape.rows[now, "histories"] = names, seen.history
            if seen.images is not None:
                tape.rows[now, "images of the ground"] = names, np.array([[seen.images[0].digest]] * len(names))
            if first is not None and (now not in first.shown or first.rows[now, "histories"][0] != names):
                break
            shown = tape.shown[now] = seen if first is None else first.shown[now]
            before = _state(predictor, stage.domain) if first is None else {}
            forecast = ask(predictor, shown, SAMPLES, seed)
            if first is None and not tape.faults:
                after, twice = _state(predictor, stage.domain), len(tape.shown) <= ASKED_TWICE
                again = ask(predictor, shown, SAMPLES, seed) if twice else forecast
                tape.faults = _faults(predictor, before, after, forecast, again, now)
            tape.rows[now, "forecasts"] = names, forecast.positions
            weights = np.zeros(len(names)) if forecast.weights is None else forecast.weights
            tape.rows[now, "weights"] = names, weights
            acted = forecast.positions if first is None else first.rows[now, "forecasts"][1]
            actions = forecast_to_dict(Forecast(acted[:, :1]), names)
            observations, rewards, ends, _, infos = env.step(actions)
            then = stage.time(env) if streams else now + FUTURE
            tape.rows[then, "rewards"] = names, np.array([[rewards[n], ends[n]] for n in names])
            truth = truth_from_infos(infos, dt)
            if truth is not None:
                settled = [f"agent_{n}" for n in truth.observation.agent]
                told = np.concatenate([truth.future, truth.known[..., None]], axis=-1)
                tape.rows[then, "revealed histories"] = settled, truth.observation.history
                tape.rows[then, "revealed truths"] = settled, told
            if streams and then <= stop:
                tape.told[then] = truth if first is None else first.told.get(then)
                if (told_now := tape.told[then]) is not None:
                    tell(predictor, told_now)
                tape.states[then] = _state(predictor, stage.domain)
    return tape


def _faults(predictor: Any, before: dict, after: dict, forecast: Forecast, again: Forecast, now: int) -> list[str]:
    """Faults of a predictor that do not depend on data: predict changes its state, or its answers do not repeat."""
    name, faults = name_of(predictor), []
    touched = changed(before, after)
    if touched:
        faults.append(f"{name}.predict at time {now} changed what it holds: {', '.join(touched[:3])}")
    if again.positions.tobytes() != forecast.positions.tobytes():
        faults.append(f"{name}.predict, asked twice at time {now}, gave two answers")
    return faults


def _compare(
    first: _Tape, second: _Tape, stop: int, card: Any, checked: Counter[str], side_channels: dict[str, float]
) -> dict[str, str]:
    """One sentence per kind about differences up to a time; updates ``checked`` and ``side_channels``."""
    differences: dict[str, str] = {}
    declared = [i for i, feature in enumerate(card.features) if feature in card.side_channels]
    for time, kind in sorted({*first.rows, *second.rows}, key=lambda k: (k[0], k[1] != "histories", k[1])):
        if time > stop:
            break
        (names, a), (others, b) = (t.rows.get((time, kind), ([], np.zeros(0))) for t in (first, second))
        if names != others:
            agent = next((n for n in (*names, *others) if (n in names) != (n in others)), "the order")
            differences.setdefault(
                "who", f"who is observed at time {time} ({agent}) changes with data after time {stop}"
            )
            break
        checked[kind] += len(names)
        features = list(card.features) if kind.endswith("histories") else []
        if features and a.shape == b.shape:
            for i in declared:
                gap = float(np.abs(a[..., i] - b[..., i]).max(initial=0))
                if gap > 0:
                    side_channels[features[i]] = max(side_channels.get(features[i], 0.0), gap)
            a, b = np.delete(a, declared, axis=-1), np.delete(b, declared, axis=-1)
            features = [f for i, f in enumerate(features) if i not in declared]
        if a.shape != b.shape or a.tobytes() != b.tobytes():
            differences.setdefault(kind, _sentence(kind, names, a, b, time, stop, features))
    for time in sorted(t for t in first.states if t <= stop and t in second.states):
        checked["states"] += 1
        touched = changed(first.states[time], second.states[time])
        if touched and "states" not in differences:
            state = f"what the predictor holds ({', '.join(touched[:3])})"
            differences["states"] = (
                f"{state} differs in a second episode: reset() does not forget it, or it reads the domain"
                if time == START
                else f"{state} at time {time} changes with data after time {stop}, which it was not shown"
            )
    return differences


def _sentence(
    kind: str, names: list[str], a: np.ndarray, b: np.ndarray, time: int, stop: int, features: list[str]
) -> str:
    if a.shape != b.shape:
        return f"the shape of {kind} at time {time} changes with data after time {stop}"
    where = np.argwhere(a != b)
    row, column = (int(where[0][0]), int(where[0][-1])) if len(where) else (0, 0)
    feature = f", feature {features[column]}," if column < len(features) else ""
    more = len(np.unique(where[:, 0])) - 1
    also = f" and {more} more" if more > 0 else ""
    cause = ""
    if kind in ("forecasts", "weights"):
        cause = ", for the same observation: the predictor reads other data, or draws from more than its seed"
    return f"{kind} of {names[row]}{also} at time {time}{feature} change with data after time {stop}{cause}"


def _selections(domain: Domain, clock: str) -> tuple[str, ...]:
    if clock == "stream":
        return ()
    least = domain.card.parameters.get("min_agents", 1)
    return (
        f"the windows clock shows agents that are complete over all 20 steps, in windows of at least {least}: "
        "this is known only afterwards, so the probe moved people but did not change who is present",
    )


def _state(predictor: Any, domain: Any) -> dict[str, int]:
    """Hash of each leaf of a predictor by path; the domain is walked first, which leaves it out."""
    state = {}
    for path, leaf in leaves((domain, predictor)):
        if path.startswith("[1]") and leaf is not None:
            content = (leaf.shape, leaf.tobytes()) if isinstance(leaf, np.ndarray) else repr(leaf)
            state[path.removeprefix("[1].")] = hash(content)
    return state
