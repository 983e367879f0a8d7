"""The ledger: forecasts that wait for their ground truth, and settled forecasts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, DataError, Forecast, Observation, PredictorError, SpecError, Truth
from motion_gym.data.validation import check_forecast
from motion_gym.data.windows import offsets, stack, stack_observations
from motion_gym.stepping.harness import frozen


@dataclass(frozen=True, eq=False)
class Stored:
    """A scene whose forecast waits for its ground truth.

    Attributes:
        made: Time of the forecast, in steps.
        observation: The observation that was forecast, one scene.
        forecast: The forecast of its agents.
    """

    made: int
    observation: Observation
    forecast: Forecast


class Outstanding:
    """Stores each forecast when it is made, and pairs the stored forecast with its ground truth later.

    A stored forecast cannot change. The clocks, the environments and ``evaluate_online`` use this ledger; other loops
    can use it, too.

    Args:
        keep: Keep the settled forecasts for ``read``; otherwise they are only counted, and memory stays bounded.

    Attributes:
        matured: Number of settled forecasts of one agent whose 12 steps all happened.
        censored: Number of settled forecasts of one agent that left before the last step.
    """

    def __init__(self, keep: bool = False) -> None:
        self.keep = keep
        self.matured = self.censored = 0
        self._stored: dict[int, Stored] = {}
        self._settled: list[tuple[Forecast, Truth, np.ndarray]] = []

    def __len__(self) -> int:
        """Number of scenes that wait."""
        return len(self._stored)

    def __iter__(self) -> Iterator[Stored]:
        """The scenes that wait, oldest first."""
        return iter(list(self._stored.values()))

    @property
    def settled(self) -> int:
        """Number of settled forecasts of one agent, matured or censored."""
        return self.matured + self.censored

    def store(self, made: int, observation: Observation, forecast: Forecast | np.ndarray) -> None:
        """Store a copy of the forecast of a scene.

        Args:
            made: Time of the forecast, in steps.
            observation: The scene, A agents.
            forecast: Its forecast, or positions [A, K, 12, 2] alone.

        Raises:
            PredictorError: A forecast of this time is already stored, or the forecast does not fit the agents.
        """
        if made in self._stored:
            raise PredictorError(f"A forecast made at {made} is stored already: a time is forecast once.")
        checked = check_forecast(forecast, observation, None, f"The predictor, asked at {made},")
        # Copied unless read-only, so that the caller cannot change it later.
        arrays = (observation.history, observation.scene, observation.agent, observation.time)
        read_only = all(a is None or (a.flags.owndata and not a.flags.writeable) for a in arrays)
        self._stored[made] = Stored(made, observation if read_only else frozen(observation), checked)

    def settle(
        self, made: int | Sequence[int], future: Any, known: Any, person: np.ndarray | None = None
    ) -> tuple[Forecast, Truth]:
        """Remove the forecast of a time, and return the forecast with its complete ground truth.

        Args:
            made: Time of the forecast; or several times, whose scenes are then stacked.
            future: [A, 12, 2] positions, metres, of the agents observed at that time, in their order.
            known: [A, 12], False at the steps after an agent left.
            person: [A] ids for ``matured_only``; by default the agents of the observation.

        Raises:
            DataError: No forecast of this time waits, or the ground truth has a wrong shape, or is not finite where
                it is known.
        """
        truth = self.so_far(made, future, known)
        times = [made] if isinstance(made, int) else made
        forecasts = [self._stored.pop(time).forecast for time in times]
        forecast = forecasts[0] if len(forecasts) == 1 else Forecast.join(forecasts)
        matured = int(np.count_nonzero(truth.known.all(axis=1)))
        self.matured += matured
        self.censored += len(truth.known) - matured
        if self.keep:
            self._settled.append((forecast, truth, truth.observation.agent if person is None else person))
        return forecast, truth

    def so_far(self, made: int | Sequence[int], future: Any, known: Any) -> Truth:
        """The ground truth known so far; arguments and errors as for ``settle``, but the scene goes on waiting."""
        times = [made] if isinstance(made, int) else made
        observation, name = self._observed(times), f"forecast made at {times[0] if len(times) == 1 else times}"
        agents = len(observation)
        with np.errstate(over="ignore"):  # values beyond float32 become infinite and are refused below
            try:
                future, known = np.array(future, np.float32), np.array(known, bool)
            except (TypeError, ValueError) as error:
                raise DataError(f"The truth of the {name} is no array of numbers: {error}.") from None
        if future.shape != (agents, FUTURE, 2) or known.shape != (agents, FUTURE):
            raise DataError(
                f"The truth of the {name} has shapes {future.shape} and {known.shape}, expected "
                f"{(agents, FUTURE, 2)} and {(agents, FUTURE)}: the {agents} agents observed then, {FUTURE} steps."
            )
        future[~known] = 0
        if not np.isfinite(future).all():
            row, step, _ = np.argwhere(~np.isfinite(future))[0]
            raise DataError(
                f"The truth of agent {observation.agent[row]}, forecast at {times[observation.scene_index[row]]}, is "
                f"not finite at step {step + 1}: make known False where a position is not known."
            )
        return Truth(future, known, observation)

    def _observed(self, times: Sequence[int]) -> Observation:
        """The observations stored at some times, stacked."""
        missing = [time for time in times if time not in self._stored]
        if missing:
            stored = f"{min(self._stored)} to {max(self._stored)}" if self._stored else "none"
            raise DataError(
                f"Truth was given for a forecast made at {missing[0]}, but none is stored of that time ({stored})."
            )
        return stack_observations([self._stored[time].observation for time in times])

    def read(self) -> tuple[Forecast, Truth]:
        """All settled forecasts with their ground truth, stacked.

        Raises:
            SpecError: Nothing is settled yet, or settled forecasts are not kept.
        """
        if not self.keep:
            raise SpecError("This ledger counts settled forecasts and does not keep them: make it with keep=True.")
        if not self._settled:
            raise SpecError("No forecast is settled yet, the ledger is empty: step further before you read it.")
        forecasts, truths, _ = zip(*self._settled, strict=True)
        return Forecast.join(forecasts), stack(truths)

    def matured_only(self) -> tuple[Forecast, Truth]:
        """The matured forecasts with their ground truth; agents are persons, as in ``domain.windows``.

        Raises:
            SpecError: As for ``read``.
        """
        forecast, truth = self.read()
        keep = np.flatnonzero(truth.known.all(axis=1))
        seen = truth.observation
        sizes = np.bincount(seen.scene_index[keep], minlength=seen.scenes)
        person = np.concatenate([person for *_, person in self._settled])[keep]
        time = None if seen.time is None else seen.time[sizes > 0]
        there = np.flatnonzero(sizes)
        images = None if seen.images is None else tuple(seen.images[number] for number in there.tolist())
        observation = Observation(seen.history[keep], offsets(sizes[there]), person, seen.dt, time, images)
        return forecast.take(keep), Truth(truth.future[keep], truth.known[keep], observation)
