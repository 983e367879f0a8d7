"""A run of a predictor over a stream, step by step: settle, score, learn, forecast, store."""

from __future__ import annotations

import copy
import time
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


class Run:
    """The state of an evaluation between two steps; a checkpoint holds everything except the stream.

    Attributes:
        predictor: The predictor that forecasts.
        learner: In realtime, a copy that learns while the stream goes on, and the time, in seconds of the stream, at
            which its update is complete; None if there is no update.
        step: The last step of the clock: the current observation, and the scenes that the step settled.
        columns: [N] values of each settled forecast: ADE and FDE (NaN if censored), listed frame of the forecast, and
            person.
        expert_names: Names of the E experts of a predictor with ``advice``, such as ``hedge``; empty for others.
        experts: [N, E] ADE of each expert (NaN if censored).
        advice: Forecasts [E, A, 12, 2] of the experts that wait for their ground truth, by their listed frame.
        count: Number of forecasts settled so far.
        seconds: [T, 2] seconds of the update and of the forecasts at each step; NaN without an update.
        updates: [segments] number of updates.
        rolled_back: Number of updates that the predictor rolled back.
        skipped: Number of steps at which ground truth was revealed during an update.
    """

    def __init__(
        self, predictor: Any, stream: Stream, labels: str, scope: str, realtime: bool, cost: float | None, seed: int
    ):
        self.predictor = PerAgent(predictor) if scope == "agent" and _learns(predictor) else predictor
        self.stream, self.labels, self.scope = stream, labels, scope
        self.realtime, self.cost, self.seed = realtime, cost, seed
        # A copy, since other evaluations may play the same stream; the ledger keeps nothing that is settled.
        self.clock = copy.copy(stream.clock)
        self.clock.keep = self.clock.rewards = False
        self.step: Step = self.clock.reset()
        self.learner: tuple[Any, float] | None = None
        # Filled, so that all memory is allocated at the start.
        self.columns = {key: np.full(self.clock.count, np.nan) for key in ("ade", "fde")}
        self.columns |= {key: np.full(self.clock.count, -1, np.int32) for key in ("made", "person")}
        self.expert_names = tuple(predictor.names) if hasattr(type(self.predictor), "advice") else ()
        self.experts = np.full((self.clock.count, len(self.expert_names)), np.nan)
        self.advice: dict[int, np.ndarray] = {}
        self.count = self.rolled_back = self.skipped = 0
        self.seconds = np.full((len(self.clock.times), 2), np.nan, np.float32)
        self.updates = np.zeros(len(stream.ends), np.int64)

    def __getstate__(self) -> dict[str, Any]:
        state = {key: value for key, value in vars(self).items() if key not in ("stream", "clock")}
        return {**state, "at": self.clock.at, "ledger": self.clock.ledger}

    def go_on(self, saved: Run) -> None:
        """Restore the state of a saved run."""
        state = vars(saved).copy()
        self.clock.resume(state.pop("at"), state.pop("ledger"))
        vars(self).update(state)

    @property
    def at(self) -> int:
        """Number of the current step."""
        return self.clock.at

    @property
    def over(self) -> bool:
        """Whether the stream has ended."""
        return not len(self.step.observation)

    @property
    def segment(self) -> int:
        """Number of the current segment."""
        return int(self.stream.segment_at(self.clock.time))

    def advance(self) -> None:
        """Reveal the ground truth that is due, let the predictor learn, ask for forecasts, and step the clock."""
        segment = self.segment
        now = self.clock.time * self.stream.dt
        truth = self._due()
        if self.at == 0 or segment != int(self.stream.segment_at(self.clock.times[self.at - 1])):
            truth = self._begin_segment(segment, truth)
        if self.learner is not None and now >= self.learner[1] - 1e-9:  # rounding of sums of dt
            self.predictor, self.learner = self.learner[0], None
        measured = self.realtime and self.cost is None
        if not measured:
            self._learn(truth, now)
        # At a few steps, powers of two, which do not depend on the length of the stream.
        looked_at = self.at & (self.at - 1) == 0 and _learns(self.predictor)
        held = snapshot(self.predictor) if looked_at else {}
        began = time.perf_counter()
        forecast = ask(self.predictor, self.step.observation, 1, self.seed)
        self.seconds[self.at, 1] = time.perf_counter() - began
        if self.expert_names:
            self.advice[self.clock.time] = np.stack(list(self.predictor.advice(self.step.observation).values()))
        if looked_at:
            self._check_pure(held, forecast.positions)
        if measured:  # the update runs meanwhile, and takes effect at the next step at the earliest
            self._learn(truth, now)
        self.step = self.clock.step(forecast)
        if self.step.settled is not None:
            self._score(self.step.settled)

    def _due(self) -> Truth | None:
        """The ground truth to reveal now."""
        settled = None if self.step.settled is None else self.step.settled.truth
        if self.labels == "matured":
            return settled
        waiting = self.clock.so_far()
        parts = [truth for truth in (settled, waiting) if truth is not None]
        if not parts:
            return None
        truth = stack(parts)
        happened = np.unique(truth.observation.scene_index[truth.known.any(axis=1)])
        return pick_scenes(truth, happened) if len(happened) else None

    def _begin_segment(self, segment: int, truth: Truth | None) -> Truth | None:
        """Reset the predictor or show it the domain where the segment requires it; the truth still to reveal."""
        if self.scope == "place" and self.at and hasattr(self.predictor, "reset"):
            self.learner, truth = None, None  # the truth belongs to the previous place
            guarded(self.predictor, "reset")
        if hasattr(self.predictor, "know"):
            guarded(self.predictor, "know", self.stream.segments[segment].domain)
        return truth

    def _learn(self, truth: Truth | None, now: float) -> None:
        """Let the predictor learn; in realtime a copy learns, and later replaces the predictor."""
        if truth is None or not _learns(self.predictor):
            return
        if self.learner is not None:
            self.skipped += 1
            return
        before, undone = _count(self.predictor), _count(self.predictor, "rolled_back") or 0
        learner = copied(self.predictor) if self.realtime else self.predictor
        began = time.perf_counter()
        tell(learner, truth)
        spent = time.perf_counter() - began
        self.seconds[self.at, 0] = spent
        after = _count(learner)
        learned = 1 if after is None or before is None else max(after - before, 0)
        self.updates[self.segment] += learned
        self.rolled_back += (_count(learner, "rolled_back") or 0) - undone
        if not self.realtime or (self.cost is not None and not self.cost * learned):
            self.predictor = learner
        else:
            self.learner = learner, now + (spent if self.cost is None else self.cost)

    def _check_pure(self, held: dict[str, Any], positions: np.ndarray) -> None:
        """Raise PredictorError if predict changed the predictor."""
        touched = changed(held, snapshot(self.predictor))
        again = ask(self.predictor, self.step.observation, 1, self.seed).positions
        if not touched and not np.allclose(again, positions, rtol=0, atol=1e-4):
            touched = ["its answer to the same question"]
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
        if self.expert_names:
            times = settled.made[settled.truth.observation.scene[:-1]].tolist()
            advice = np.concatenate([self.advice.pop(time) for time in times], axis=1)
            error = distance(advice.astype(np.float64) - settled.truth.future)
            self.experts[rows] = np.where(matured, error.mean(axis=2), np.nan).T
        self.count = rows.stop


def _learns(predictor: Any) -> bool:
    return hasattr(predictor, "observe")


def _count(predictor: Any, name: str = "updates") -> int | None:
    """A count of updates that a predictor keeps; None if it keeps none."""
    count = getattr(predictor, name, None)
    return count if isinstance(count, int) and not isinstance(count, bool) else None
