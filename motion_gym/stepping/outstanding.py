"""Forecasts that were made and wait for their truth."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, DataError, Forecast, Observation, PredictorError, Truth
from motion_gym.stepping.harness import frozen


@dataclass(frozen=True, eq=False)
class Stored:
    """A scene that was forecast.

    Attributes:
        made: When, in steps.
        observation: What was seen: one scene.
        forecast: What was said.
    """

    made: int
    observation: Observation
    forecast: Forecast


class Outstanding:
    """Keeps each forecast as it was made until its truth is told, so that nothing can be scored that was made later.

    ``evaluate_online`` uses it; so can a loop of one's own.
    """

    def __init__(self) -> None:
        self._stored: dict[int, Stored] = {}

    def __len__(self) -> int:
        """Number of scenes that wait."""
        return len(self._stored)

    def __iter__(self) -> Iterator[Stored]:
        """The scenes that wait, oldest first."""
        return iter(list(self._stored.values()))

    def store(self, made: int, observation: Observation, forecast: Forecast | np.ndarray) -> None:
        """Keep a copy of the forecast of a scene, or of its positions [A, K, 12, 2] alone.

        Raises:
            PredictorError: one was stored for this time already, or it is not of the agents observed.
        """
        if made in self._stored:
            raise PredictorError(f"A forecast made at {made} is stored already: a time is forecast once.")
        said = forecast if isinstance(forecast, Forecast) else Forecast(forecast)
        shape: tuple[int, ...] = tuple(getattr(said.positions, "shape", ()))
        if len(shape) != 4 or shape[2:] != (FUTURE, 2):
            raise PredictorError(
                f"The forecast made at {made} is a {type(said.positions).__name__} of shape {shape}: positions are an "
                f"array [A, K, {FUTURE}, 2]."
            )
        if shape[0] != len(observation):
            raise PredictorError(
                f"The forecast made at {made} is of {shape[0]} agents, and {len(observation)} are observed: forecast "
                "each of them."
            )
        if not np.isfinite(said.positions).all():
            raise PredictorError(f"The forecast made at {made} has NaN or infinite positions: all must be finite.")
        # Copies, so that whoever made them can change nothing later.
        self._stored[made] = Stored(made, frozen(observation), copy.deepcopy(said))

    def settle(self, made: int, future: Any, known: Any) -> tuple[Forecast, Truth]:
        """The stored forecast of a time and its truth, when all that will be known of it is known; it waits no more.

        Args:
            made: When it was made.
            future: [A, 12, 2] positions, metres, of the agents that were observed then, in their order.
            known: [A, 12], False where an agent had left.

        Raises:
            DataError: no forecast was made then, or the truth has another shape, or is not finite where it is known.
        """
        truth = self.so_far(made, future, known)
        return self._stored.pop(made).forecast, truth

    def so_far(self, made: int, future: Any, known: Any) -> Truth:
        """The truth as far as it is known, as for ``settle``; the forecast goes on waiting."""
        if made not in self._stored:
            there = f"{min(self._stored)} to {max(self._stored)}" if self._stored else "none"
            raise DataError(f"Truth was told of a forecast made at {made}, and none is stored of that time ({there}).")
        stored = self._stored[made]
        agents = len(stored.observation)
        with np.errstate(over="ignore"):  # which is not finite, and said below
            try:
                future, known = np.array(future, np.float32), np.array(known, bool)
            except (TypeError, ValueError) as error:
                said = f"The truth of the forecast made at {made} is no array of numbers: {error}."
                raise DataError(said) from None
        if future.shape != (agents, FUTURE, 2) or known.shape != (agents, FUTURE):
            raise DataError(
                f"The truth of the forecast made at {made} has shapes {future.shape} and {known.shape}, expected "
                f"{(agents, FUTURE, 2)} and {(agents, FUTURE)}: the {agents} agents observed then, {FUTURE} steps."
            )
        bad = np.argwhere(known & ~np.isfinite(future).all(axis=-1))
        if len(bad):
            raise DataError(
                f"The truth of agent {stored.observation.agent[bad[0][0]]}, forecast at {made}, is not finite at step "
                f"{bad[0][1] + 1}: make known False where a position is not known."
            )
        future[~known] = 0
        return Truth(future, known, stored.observation)
