"""A run of a predictor over a stream, step by step: settle, score, learn, forecast, store."""

from __future__ import annotations

import copy
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, PredictorError, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.metrics.errors import distance, mean_over_known
from motion_gym.online.per_agent import PerAgent
from motion_gym.online.streams import Stream
from motion_gym.stepping.clocks import Settled, Step
from motion_gym.stepping.harness import ask, copied, guarded, name_of, tell
from motion_gym.stepping.snapshot import changed, snapshot


@dataclass(frozen=True)
class Options:
    """The options of ``evaluate_online`` that change its scores."""

    labels: str
    scope: str
    realtime: bool
    cost: float | None
    seed: int


class Run:
    """The state of an evaluation between two steps; all of it but the stream goes into a checkpoint.

    Attributes:
        predictor: The predictor that forecasts.
        learner: In realtime, a copy that is learning while the stream goes on, and the time, in seconds of the stream,
            at which it is done; None if none is.
        step: The last step of the clock: what is observed now, and the scenes that it settled.
        columns: [N] values of each settled forecast: ADE and FDE (NaN if censored), listed frame at which it was made,
            and person.
        count: Number of forecasts settled so far.
        seconds: [T, 2] seconds of the update and of the forecasts at each step; NaN where there was no update.
        updates: [segments] updates.
        rolled_back: Updates that the predictor took back.
        skipped: Steps at which truth came while an update was under way.
    """

    def __init__(self, predictor: Any, played: Stream, options: Options):
        self.predictor = PerAgent(predictor) if options.scope == "agent" and _learns(predictor) else predictor
        self.options, self.stream = options, played
        # A copy, since other evaluations may play the same stream; the ledger keeps nothing that is settled.
        self.clock = copy.copy(played.clock)
        self.clock.keep = self.clock.rewards = False
        self.step: Step = self.clock.reset()
        self.learner: tuple[Any, float] | None = None
        # Filled, so that all memory is taken at the start.
        self.columns = {key: np.full(self.clock.count, np.nan) for key in ("ade", "fde")}
        self.columns |= {key: np.full(self.clock.count, -1, np.int32) for key in ("made", "person")}
        self.count = self.rolled_back = self.skipped = 0
        self.seconds = np.full((len(self.clock.times), 2), np.nan, np.float32)
        self.updates = np.zeros(len(played.ends), np.int64)

    def __getstate__(self) -> dict[str, Any]:
        state = {key: value for key, value in vars(self).items() if key not in ("options", "stream", "clock")}
        return {**state, "at": self.clock.at, "ledger": self.clock.ledger}

    def go_on(self, saved: Run) -> None:
        """Take the state of a run that was saved."""
        state = vars(saved).copy()
        self.clock.resume(state.pop("at"), state.pop("ledger"))
        vars(self).update(state)

    @property
    def at(self) -> int:
        """Number of the current step."""
        return self.clock.at

    @property
    def over(self) -> bool:
        """Whether the whole stream was played."""
        return not len(self.step.observation)

    @property
    def segment(self) -> int:
        """Number of the segment that is played."""
        return int(self.stream.segment_at(self.clock.time))

    def advance(self) -> None:
        """Tell the ground truth that is due, let the predictor learn, ask for forecasts, and step the clock."""
        options, segment = self.options, self.segment
        now = self.clock.time * self.stream.dt
        truth = self._due()
        if self.at == 0 or segment != int(self.stream.segment_at(self.clock.times[self.at - 1])):
            truth = self._begin_segment(segment, truth)
        if self.learner is not None and now >= self.learner[1] - 1e-9:  # rounding of sums of dt
            self.predictor, self.learner = self.learner[0], None
        measured = options.realtime and options.cost is None
        if not measured:
            self._learn(truth, now)
        # Asked as often as is cheap, at times that tell nothing about the length of the stream.
        looked_at = self.at & (self.at - 1) == 0 and _learns(self.predictor)
        held = snapshot(self.predictor) if looked_at else {}
        began = time.perf_counter()
        forecast = ask(self.predictor, self.step.observation, 1, options.seed)
        self.seconds[self.at, 1] = time.perf_counter() - began
        if looked_at:
            self._check_pure(held, forecast.positions)
        if measured:  # the update runs meanwhile: it is of use from the next step on, at the earliest
            self._learn(truth, now)
        self.step = self.clock.step(forecast)
        if self.step.settled is not None:
            self._score(self.step.settled)

    def _due(self) -> Truth | None:
        """The ground truth to be told now."""
        settled = None if self.step.settled is None else self.step.settled.truth
        if self.options.labels == "matured":
            return settled
        waiting = self.clock.so_far()
        parts = [truth for truth in (settled, waiting) if truth is not None]
        if not parts:
            return None
        truth = stack(parts)
        happened = np.unique(truth.observation.scene_index[truth.known.any(axis=1)])
        return pick_scenes(truth, happened) if len(happened) else None

    def _begin_segment(self, segment: int, truth: Truth | None) -> Truth | None:
        """Forget and know what the segment asks for; the truth that is still to be told."""
        if self.options.scope == "place" and self.at and hasattr(self.predictor, "reset"):
            self.learner, truth = None, None  # the truth is that of the place before
            guarded(self.predictor, "reset")
        if hasattr(self.predictor, "know"):
            guarded(self.predictor, "know", self.stream.segments[segment].domain)
        return truth

    def _learn(self, truth: Truth | None, now: float) -> None:
        """Let the predictor learn; in realtime a copy learns, and is of use when it is done."""
        if truth is None or not _learns(self.predictor):
            return
        if self.learner is not None:
            self.skipped += 1
            return
        realtime, cost = self.options.realtime, self.options.cost
        before, undone = _count(self.predictor), _count(self.predictor, "rolled_back") or 0
        learner = copied(self.predictor) if realtime else self.predictor
        began = time.perf_counter()
        tell(learner, truth)
        spent = time.perf_counter() - began
        self.seconds[self.at, 0] = spent
        after = _count(learner)
        learned = 1 if after is None or before is None else max(after - before, 0)
        self.updates[self.segment] += learned
        self.rolled_back += (_count(learner, "rolled_back") or 0) - undone
        if not realtime or (cost is not None and not cost * learned):
            self.predictor = learner
        else:
            self.learner = learner, now + (spent if cost is None else cost)

    def _check_pure(self, held: dict[str, Any], positions: np.ndarray) -> None:
        """Raise PredictorError if the predictor learned from being asked."""
        touched = changed(held, snapshot(self.predictor))
        again = ask(self.predictor, self.step.observation, 1, self.options.seed).positions
        if not touched and not np.allclose(again, positions, rtol=0, atol=1e-4):
            touched = ["what it answers to the same question"]
        if touched:
            raise PredictorError(
                f"{name_of(self.predictor)} learns when it is asked: predict changed {', '.join(touched[:3])}. Learn "
                "in observe(truth) alone, after the forecast was scored."
            )

    def _score(self, settled: Settled) -> None:
        """Write the errors of settled forecasts into the columns."""
        error = distance(settled.forecast.most_likely().astype(np.float64) - settled.truth.future)
        matured, rows = settled.matured, slice(self.count, self.count + len(settled.made))
        self.columns["ade"][rows] = np.where(matured, mean_over_known(error, settled.truth.known), np.nan)
        self.columns["fde"][rows] = np.where(matured, error[:, FUTURE - 1], np.nan)
        self.columns["made"][rows], self.columns["person"][rows] = settled.made, settled.person
        self.count = rows.stop


def _learns(predictor: Any) -> bool:
    return hasattr(predictor, "observe")


def _count(predictor: Any, name: str = "updates") -> int | None:
    """A count that a predictor keeps of its updates; None if it keeps none."""
    count = getattr(predictor, name, None)
    return count if isinstance(count, int) and not isinstance(count, bool) else None
