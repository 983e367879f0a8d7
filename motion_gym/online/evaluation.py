"""Evaluation on a stream: what is forecast is stored, scored when its truth is known, and only then learned from."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle
import time
from collections.abc import Callable
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import FUTURE, DataError, Domain, Predictor, PredictorError, SpecError, Truth
from motion_gym.data.storage import check_writable, write_atomic
from motion_gym.data.windows import stack
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.online.per_agent import PerAgent
from motion_gym.online.scores import OnlineCard, SegmentScore, curve_of, returns_of, shifts_of, summary_of
from motion_gym.online.streams import Stream, stream
from motion_gym.scoring.cards import declared_leaks, peak_memory
from motion_gym.stepping.harness import ask, guarded, name_of, ready, selection_of, tell
from motion_gym.stepping.outstanding import Outstanding
from motion_gym.stepping.snapshot import changed, snapshot

LABELS = {
    "matured": "the truth of a scene is told once, when all that will be known of it is known",
    "stepwise": "at each step, the truth of all scenes that wait is told as far as it has happened",
}
SCOPES = {
    "stream": "what was learned is kept until the stream ends",
    "place": "what was learned is forgotten where another segment begins",
    "agent": "each agent has a copy of its own, which learns from the scenes that the agent is in",
}
SAVED_EVERY = 60.0
"""Seconds from one checkpoint to the next."""
Report = Callable[[int, int, str], None]


@dataclasses.dataclass
class _Run:
    """Where an evaluation stands; all of it goes into a checkpoint.

    Attributes:
        predictor: Who forecasts.
        learner: A copy that is learning while the stream goes on, and when it will be done, in seconds.
        waiting: Forecasts that wait for their truth.
        futures: By when each was made: that truth, which nobody but the harness sees; when all that will be known of it
            is known, in listed frames; and whom it is about.
        at: Number of observations that were forecast.
        columns: [N] values of each forecast: ADE, FDE (NaN if it was censored), listed frames at which it was made
            and at which it was settled, and whom it is about.
        settled: Number of forecasts settled.
        ticks: [T, 2] seconds of the update and of the forecasts at each observation; NaN where nothing was told.
        updates: [segments] updates.
        rolled_back: Updates that were taken back.
        skipped: Updates that were skipped.
    """

    predictor: Any
    learner: tuple[Any, float] | None
    waiting: Outstanding
    futures: dict[int, tuple[Truth, int, np.ndarray]]
    at: int
    columns: dict[str, np.ndarray]
    settled: int
    ticks: np.ndarray
    updates: np.ndarray
    rolled_back: int
    skipped: int


def evaluate_online(
    predictor: str | Predictor,
    on: str | Domain | Stream,
    *,
    labels: str = "matured",
    scope: str = "stream",
    realtime: bool = False,
    cost: float | None = None,
    seed: int = 0,
    checkpoint: Path | None = None,
    report: Report = lambda done, of, what: None,
) -> OnlineCard:
    """Let a predictor run over a stream, and learn from it if it can.

    At each step: tell the truth that is due, score the forecasts that were stored, let the predictor observe, ask for
    new forecasts and store them.

    Args:
        predictor: A name, a spec, ``"module:Class"`` or a predictor; a copy of it runs. Adapters are predictors.
        on: A stream, or a domain, whose test split is played whole.
        labels: When truth is told, see ``LABELS``.
        scope: What is forgotten when, see ``SCOPES``.
        realtime: The stream waits for nobody: an update that takes ``c`` seconds is of use from the first step that
            begins ``c`` seconds later, and truth that comes while it is under way is lost to the predictor.
        cost: Seconds that each update is declared to take, so that the result repeats exactly; None to measure them.
        seed: Of a stochastic predictor's samples.
        checkpoint: File to go on from if the run is stopped, written each minute and deleted at the end. It is read by
            pickle: use no file of others.
        report: Called now and then with the number of steps done, of all, and what is played.

    Returns:
        OnlineCard.

    Raises:
        SpecError: a name or option is not known or not allowed, or the checkpoint is of another run.
        PredictorError: the predictor broke its contract: it learned when it was asked, for example.
        DataError: data is missing or damaged.
    """
    cost = check_options(labels, scope, realtime, cost)
    checkpoint = None if checkpoint is None else Path(checkpoint)
    if checkpoint is not None:
        check_writable(checkpoint.parent)
    seed = catalog.whole_number("seed", seed, 0, 2**63 - 1)
    played = on if isinstance(on, Stream) else stream(on)
    # A copy first, since what was given would be reset.
    given = predictor if isinstance(predictor, (str, type)) else _copied(predictor)
    made = ready(given, played.domains[0], seed)
    name = predictor if isinstance(predictor, str) else name_of(made)
    if scope == "place" and hasattr(made, "observe") and not hasattr(made, "reset"):
        raise PredictorError(f"{name} learns (`observe`) and cannot forget: `scope=place` needs a method `reset`.")
    identity = json.dumps(
        [
            name,
            getattr(made, "fingerprint", None),
            repr(played),
            played.split,
            [[label, part.start, part.stop] for label, part in zip(played.labels, played.segments, strict=True)],
            labels,
            scope,
            realtime,
            cost,
            seed,
        ]
    )
    alone = scope == "agent" and hasattr(made, "observe")
    run = _resumed(checkpoint, identity) or _begun(PerAgent(made) if alone else made, played)
    saved = time.perf_counter()
    total = len(played.clock.times)
    while run.at < total:
        if run.at % 50 == 0:
            segment = int(played.segment_at(played.clock.times[run.at]))
            report(run.at, total, f"{name} on {played.labels[segment]}")
        if checkpoint is not None and time.perf_counter() - saved > SAVED_EVERY:
            write_atomic(checkpoint, _saved(identity, run))
            saved = time.perf_counter()
        _step(run, played, labels, scope, realtime, cost, seed)
    _settle(run, played.clock.tracks.ticks)
    if checkpoint is not None:
        checkpoint.unlink(missing_ok=True)
    return _card(run, played, name, labels, scope, realtime, cost, seed)


def check_options(labels: str, scope: str, realtime: bool, cost: float | None) -> float | None:
    """The cost as a float; SpecError if an option of ``evaluate_online`` is not known or not allowed."""
    for name, value, allowed in (("labels", labels, LABELS), ("scope", scope, SCOPES)):
        if not isinstance(value, str) or value not in allowed:
            raise SpecError(f"`{name}={value}` is not known.{catalog.suggest(str(value), allowed)}")
    if not isinstance(realtime, bool):
        raise SpecError(f"`realtime={realtime}` must be True or False.")
    if cost is None:
        return None
    if isinstance(cost, bool) or not isinstance(cost, Real) or not 0 <= cost < np.inf:
        raise SpecError(f"`cost={cost}` must be a number of seconds, 0 or more.")
    if not realtime:
        raise SpecError(f"`cost={cost}` is of use where the stream waits for nobody: add realtime, or drop it.")
    return float(cost)


def _copied(predictor: Any) -> Any:
    try:
        return copy.deepcopy(predictor)
    except Exception as error:
        raise PredictorError(_uncopied(predictor, error)) from error


def _saved(identity: str, run: _Run) -> bytes:
    try:
        return pickle.dumps((identity, run))
    except Exception as error:
        raise PredictorError(_uncopied(run.predictor, error)) from error


def _uncopied(predictor: Any, error: Exception) -> str:
    return (
        f"{name_of(predictor)} cannot be copied and kept ({error}): let it hold nothing that cannot be pickled, as "
        "locks, open files and lambdas."
    )


def _begun(predictor: Any, played: Stream) -> _Run:
    clock = played.clock
    size = sum(len(clock.persons_at(at)) for at in range(len(clock.times)))
    # Filled, so that all memory is taken at the start.
    columns = {key: np.full(size, np.nan) for key in ("ade", "fde")}
    columns |= {key: np.full(size, -1, np.int32) for key in ("made", "settled", "person")}
    ticks = np.full((len(clock.times), 2), np.nan, np.float32)
    return _Run(predictor, None, Outstanding(), {}, 0, columns, 0, ticks, np.zeros(len(played.ends), np.int64), 0, 0)


def _resumed(checkpoint: Path | None, identity: str) -> _Run | None:
    if checkpoint is None or not checkpoint.exists():
        return None
    if not checkpoint.is_file():
        raise SpecError(f"The checkpoint {checkpoint} is a folder: name a file.")
    try:
        saved, run = pickle.loads(checkpoint.read_bytes())
    except Exception as error:
        raise SpecError(f"{checkpoint} is no checkpoint of an online run ({error}): delete it.") from None
    if saved != identity:
        raise SpecError(f"{checkpoint} is the checkpoint of another run: delete it, or choose another file.")
    return run  # type: ignore[no-any-return]


def _step(run: _Run, played: Stream, labels: str, scope: str, realtime: bool, cost: float | None, seed: int) -> None:
    clock, now = played.clock, int(played.clock.times[run.at])
    segment, seconds = int(played.segment_at(now)), now * played.dt
    truth = _settle(run, now)
    if labels == "stepwise":
        parts = [run.waiting.so_far(s.made, *_happened(run, s.made, now)) for s in run.waiting]
        parts = [part for part in ([] if truth is None else [truth]) + parts if part.known.any()]
        truth = stack(parts) if parts else None
    begins = run.at == 0 or segment != int(played.segment_at(clock.times[run.at - 1]))
    if begins:
        if scope == "place" and run.at and hasattr(run.predictor, "reset"):
            run.learner, truth = None, None  # which is of the place before
            guarded(run.predictor, "reset")
        if hasattr(run.predictor, "know"):
            guarded(run.predictor, "know", played.segments[segment].domain)
    if run.learner is not None and seconds >= run.learner[1] - 1e-9:  # 0.4 s after 12 x 0.4 s is at 13 x 0.4 s
        run.predictor, run.learner = run.learner[0], None
    measured = realtime and cost is None
    if not measured:
        _learn(run, truth, segment, seconds if realtime else None, cost)
    future = clock.truth_at(run.at)
    observation = future.observation
    # At powers of two: as often as is cheap, and never at the same times as whoever knows how long a stream is.
    looked_at = run.at & (run.at - 1) == 0 and hasattr(run.predictor, "observe")
    held = snapshot(run.predictor) if looked_at else {}
    began = time.perf_counter()
    forecast = ask(run.predictor, observation, 1, seed)
    run.ticks[run.at, 1] = time.perf_counter() - began
    if looked_at:
        touched = changed(held, snapshot(run.predictor))
        again = ask(run.predictor, observation, 1, seed).positions
        if not touched and not np.allclose(again, forecast.positions, rtol=0, atol=1e-4):
            touched = ["what it answers to the same question"]
        if touched:
            raise PredictorError(
                f"{name_of(run.predictor)} learns when it is asked: predict changed {', '.join(touched[:3])}. Learn in "
                "observe(truth) alone, after the forecast was scored."
            )
    run.waiting.store(now, observation, forecast)
    if measured:  # meanwhile: it is of use from the next step on, at the earliest
        _learn(run, truth, segment, seconds)
    # Nobody is known to have left before the step at which they are missed.
    due = now + min(int(future.known.sum(axis=1).max()) + 1, FUTURE)
    run.futures[now] = future, min(due, clock.tracks.ticks), clock.persons_at(run.at)
    run.at += 1


def _learn(run: _Run, truth: Truth | None, segment: int, now: float | None = None, cost: float | None = None) -> None:
    """Let the predictor learn; given the time now, a copy of it, that takes the cost, or as long as it takes."""
    if truth is None or not hasattr(run.predictor, "observe"):
        return
    if run.learner is not None:
        run.skipped += 1
        return
    before, undone = _count(run.predictor), _count(run.predictor, "rolled_back") or 0
    learner = run.predictor if now is None else _copied(run.predictor)
    began = time.perf_counter()
    tell(learner, truth)
    spent = time.perf_counter() - began
    run.ticks[run.at, 0] = spent
    after = _count(learner)
    learned = 1 if after is None or before is None else max(after - before, 0)
    run.updates[segment] += learned
    run.rolled_back += (_count(learner, "rolled_back") or 0) - undone
    if now is None or (cost is not None and not cost * learned):
        run.predictor = learner
    else:
        run.learner = learner, now + (spent if cost is None else cost)


def _count(predictor: Any, what: str = "updates") -> int | None:
    """How often a predictor says that it has learned, or has taken that back."""
    count = getattr(predictor, what, None)
    return count if isinstance(count, int) and not isinstance(count, bool) else None


def _happened(run: _Run, made: int, now: int) -> tuple[np.ndarray, np.ndarray]:
    """Future and known of a scene as far as they have happened by now."""
    truth = run.futures[made][0]
    return truth.future, truth.known & (np.arange(1, FUTURE + 1) <= now - made)


def _settle(run: _Run, now: int) -> Truth | None:
    """Score the scenes about which all is known by now; their truth, if there are some."""
    parts = []
    for made in [made for made, (_, due, _) in run.futures.items() if due <= now]:
        forecast, truth = run.waiting.settle(made, *_happened(run, made, now))
        _, due, person = run.futures.pop(made)
        parts.append(truth)
        error = distance(forecast.most_likely().astype(np.float64) - truth.future)
        matured = np.asarray(truth.known.all(axis=1))
        rows = slice(run.settled, run.settled + len(matured))
        run.columns["ade"][rows] = np.where(matured, mean_over_known(error, truth.known), np.nan)
        run.columns["fde"][rows] = np.where(matured, error[:, -1], np.nan)
        run.columns["made"][rows], run.columns["settled"][rows], run.columns["person"][rows] = made, due, person
        run.settled = rows.stop
    return stack(parts) if parts else None


def _card(
    run: _Run, played: Stream, name: str, labels: str, scope: str, realtime: bool, cost: float | None, seed: int
) -> OnlineCard:
    order = np.argsort(run.columns["made"], kind="stable")
    columns = {key: column[order] for key, column in run.columns.items()}
    matured = np.isfinite(columns["ade"])
    if not matured.any():
        raise DataError(f"No forecast matured on {played.name}: give a stream on which people stay for 20 steps.")
    ade, fde, made, settled, person = (columns[key][matured] for key in ("ade", "fde", "made", "settled", "person"))
    segment, starts = played.segment_at(made), np.concatenate([[0], played.ends[:-1]]) * played.dt
    lost = np.bincount(played.segment_at(columns["made"][~matured]), minlength=len(played.ends))
    segments = []
    for number, label in enumerate(played.labels):
        own = segment == number
        segments.append(
            SegmentScore(
                domain=label,
                start=float(starts[number]),
                stop=float(played.ends[number] * played.dt),
                ade=summary_of(ade[own], person[own], made[own]),
                fde=summary_of(fde[own], person[own], made[own]),
                censored=int(lost[number]),
                updates=int(run.updates[number]),
            )
        )
    cards = {label: s.domain.card for label, s in zip(played.labels, played.segments, strict=True)}  # type: ignore[union-attr]
    leaks = [declared_leaks(d, run.predictor, played.split) for d in played.domains]
    if hasattr(run.predictor, "know"):
        leaks.append((f"{name} is told which domain is played, and could know what is to come",))
    return OnlineCard(
        predictor=name,
        stream=played.name,
        domains={
            label: {
                "parameters": dict(card.parameters),
                "files": dict(card.files),
                "unit": card.unit,
                "dt": card.dt,
            }
            for label, card in cards.items()
        },
        labels=labels,
        scope=scope,
        realtime=realtime,
        cost=cost,
        protocol="honest",
        k=1,
        seed=seed,
        ade=summary_of(ade, person, made),
        fde=summary_of(fde, person, made),
        censored=int((~matured).sum()),
        segments=segments,
        curve=curve_of(ade, made * played.dt),
        shifts=shifts_of(ade, segment, settled * played.dt, played.labels, starts),
        returns=returns_of([(s.domain, s.ade.mean, s.ade.agent_windows) for s in segments]),
        updates=int(run.updates.sum()),
        rolled_back=run.rolled_back,
        skipped=run.skipped,
        update_seconds=_quantiles(run.ticks[:, 0]),
        tick_seconds=_quantiles(np.nansum(run.ticks, axis=1)),
        peak_memory=peak_memory(),
        oracle=hasattr(run.predictor, "know"),
        leaks=tuple(dict.fromkeys(sentence for found in leaks for sentence in found)),
        selection=selection_of(run.predictor),
        values=ade,
        made=made,
    )


def _quantiles(values: np.ndarray) -> tuple[float, float]:
    """Median and 95th percentile; zeros where there is nothing."""
    finite = values[np.isfinite(values)]
    return (float(np.median(finite)), float(np.percentile(finite, 95))) if len(finite) else (0.0, 0.0)
