"""Evaluation on a stream: each forecast is stored, scored when its ground truth is known, and then learned from."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.contract import FUTURE, DataError, Domain, Predictor, PredictorError, SpecError
from motion_gym.online.checkpoints import Checkpoint, identity_of
from motion_gym.online.class_memory import no_class_memory
from motion_gym.online.run import Run
from motion_gym.online.scores import OnlineCard, SegmentScore, curve_of, returns_of, shifts_of, summary_of
from motion_gym.online.streams import Stream, stream
from motion_gym.scoring.cards import declared_leaks, peak_memory
from motion_gym.specs import number, one_of
from motion_gym.stepping.harness import copied, name_of, ready, selection_of

LABELS = {
    "matured": "each scene's ground truth is revealed once, after its last forecast step or when its last agent left",
    "stepwise": "at each step, the ground truth of all scenes that wait is revealed as far as it has happened",
}
SCOPES = {
    "stream": "what was learned is kept until the stream ends",
    "place": "what was learned is forgotten where another segment begins",
    "agent": "each agent has a copy of its own, which learns from the scenes that the agent is in",
}
SAVED_EVERY = 60.0
"""Seconds from one checkpoint to the next."""
REPORTED_EVERY = 50
"""Steps from one call of ``report`` to the next."""
Report = Callable[[int, int, str], None]


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
    """Run a predictor over a stream, and let it learn if it has ``observe``.

    Each step reveals the ground truth that is due, scores the stored forecasts, lets the predictor observe, asks for
    new forecasts and stores them. With the defaults, the scores equal those of this loop:

    >>> import motion_gym
    >>> from motion_gym.metrics.errors import ade
    >>> source = motion_gym.predictor("modular_invariant:weights=style")
    >>> stream = motion_gym.stream("orca:d=0.6,scenes=6")
    >>> predictor, step = motion_gym.adapter("kalman", source), stream.clock.reset()
    >>> while len(step.observation):
    ...     step = stream.clock.step(predictor.predict(step.observation))
    ...     if step.settled is not None:
    ...         predictor.observe(step.settled.truth)
    >>> errors = ade(*stream.clock.ledger.matured_only())
    >>> card = motion_gym.evaluate_online(motion_gym.adapter("kalman", source), stream)
    >>> bool(abs(errors.mean() - card.ade.mean) < 1e-6)
    True

    Args:
        predictor: A name, a spec, ``"module:Class"`` or a predictor; a copy of it runs. Adapters are predictors.
        on: A stream, or a domain, whose whole test split is played.
        labels: When ground truth is revealed, see ``LABELS``.
        scope: When learned state is forgotten, see ``SCOPES``.
        realtime: The stream does not wait: an update that takes ``c`` seconds takes effect at the first step that
            begins ``c`` seconds later, and the predictor misses ground truth that is revealed during the update.
        cost: Declared seconds of each update, so that the result repeats exactly; None to measure the seconds.
        seed: Seed of a stochastic predictor's samples.
        checkpoint: File from which a stopped run continues, written each minute and deleted at the end. The file
            continues the same run with the same predictor only, and must be written by the same user.
        report: Called every 50 steps with the number of steps done, the number of all steps, and a description.

    Returns:
        OnlineCard.

    Raises:
        SpecError: A name or option is not known or not allowed, or the checkpoint is of another run or user.
        PredictorError: The predictor broke its contract: for example, predict learned, or the class stores learned
            state.
        DataError: Data is missing or damaged.
    """
    cost = check_options(labels, scope, realtime, cost)
    seed = catalog.whole_number("seed", seed, 0, 2**63 - 1)
    options: dict[str, Any] = dict(labels=labels, scope=scope, realtime=realtime, cost=cost, seed=seed)
    played = on if isinstance(on, Stream) else stream(on)
    runner = ready(copied(predictor), played.domains[0], seed, played.domains[1:])
    name = predictor if isinstance(predictor, str) else name_of(runner)
    if scope == "place" and hasattr(runner, "observe") and not hasattr(runner, "reset"):
        raise PredictorError(f"{name} learns (`observe`) and cannot forget: `scope=place` needs a method `reset`.")
    kept = None
    if checkpoint is not None:
        identity = identity_of(runner, played, options, name)
        kept = Checkpoint(Path(checkpoint), identity)
    with no_class_memory(runner, name):
        run = Run(runner, played, **options)
        if kept is not None and (before := kept.load()) is not None:
            run.go_on(before)
        _play(run, name, kept, report)
    if kept is not None:
        kept.remove()
    return _card(run, name)


def _play(run: Run, name: str, checkpoint: Checkpoint | None, report: Report) -> None:
    """Advance a run to the end of its stream, with reports and checkpoints."""
    saved, total = time.perf_counter(), len(run.clock.times)
    while not run.over:
        if run.at % REPORTED_EVERY == 0:
            report(run.at, total, f"{name} on {run.stream.labels[run.segment]}")
        if checkpoint is not None and time.perf_counter() - saved > SAVED_EVERY:
            checkpoint.save(run)
            saved = time.perf_counter()
        run.advance()


def check_options(labels: str, scope: str, realtime: bool, cost: float | None) -> float | None:
    """The cost as a float; SpecError if an option of ``evaluate_online`` is not known or not allowed."""
    one_of("labels", labels, LABELS)
    one_of("scope", scope, SCOPES)
    if not isinstance(realtime, bool):
        raise SpecError(f"`realtime={realtime}` must be True or False.")
    if cost is None:
        return None
    cost = number("cost", cost)
    if not realtime:
        raise SpecError(f"`cost={cost}` needs realtime: add realtime, or leave cost out.")
    return cost


def _card(run: Run, name: str) -> OnlineCard:
    """The scores of a run that is over."""
    played, dt = run.stream, run.stream.dt
    matured = np.isfinite(run.columns["ade"])
    if not matured.any():
        raise DataError(f"No forecast matured on {played.name}: give a stream on which people stay for 20 steps.")
    ade, fde, made, person = (run.columns[key][matured] for key in ("ade", "fde", "made", "person"))
    segment, starts = played.segment_at(made), np.concatenate([[0], played.ends[:-1]]) * dt
    lost = np.bincount(played.segment_at(run.columns["made"][~matured]), minlength=len(played.ends))
    segments = [
        SegmentScore(
            domain=label,
            start=float(starts[number]),
            stop=float(played.ends[number] * dt),
            ade=summary_of(ade[segment == number], person[segment == number], made[segment == number]),
            fde=summary_of(fde[segment == number], person[segment == number], made[segment == number]),
            censored=int(lost[number]),
            updates=int(run.updates[number]),
        )
        for number, label in enumerate(played.labels)
    ]
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
        labels=run.labels,
        scope=run.scope,
        realtime=run.realtime,
        cost=run.cost,
        protocol="honest",
        k=1,
        seed=run.seed,
        ade=summary_of(ade, person, made),
        fde=summary_of(fde, person, made),
        censored=int((~matured).sum()),
        segments=segments,
        curve=curve_of(ade, made * dt),
        shifts=shifts_of(ade, segment, (made + FUTURE) * dt, played.labels, starts),
        returns=returns_of([(s.domain, s.ade.mean, s.ade.agent_windows) for s in segments]),
        experts=dict(zip(run.expert_names, run.experts[matured].mean(axis=0).tolist(), strict=True)),
        updates=int(run.updates.sum()),
        rolled_back=run.rolled_back,
        skipped=run.skipped,
        update_seconds=_quantiles(run.seconds[:, 0]),
        tick_seconds=_quantiles(np.nansum(run.seconds, axis=1)),
        peak_memory=peak_memory(),
        oracle=hasattr(run.predictor, "know"),
        leaks=tuple(dict.fromkeys(sentence for sentences in leaks for sentence in sentences)),
        selection=selection_of(run.predictor),
        values=ade,
        made=made,
        person=person,
    )


def _quantiles(values: np.ndarray) -> tuple[float, float]:
    """Median and 95th percentile; zeros where there is nothing."""
    finite = values[np.isfinite(values)]
    return (float(np.median(finite)), float(np.percentile(finite, 95))) if len(finite) else (0.0, 0.0)
