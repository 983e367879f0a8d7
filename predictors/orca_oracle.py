"""An oracle for the ORCA domain: knows the style, and simulates."""

from __future__ import annotations

from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError
from motion_gym.predictors.simulating import Simulating

TOLERANCE = 0.05
"""Largest distance between a history and the simulated one, metres."""
LOST = 0.05
"""Share of the histories that may be further away, since crowds are chaotic."""
EXACT, CORRECTIONS = 2e-6, 40
"""Distance at which the first frame is met, metres, and the number of simulations to meet it."""


class OrcaOracle(Simulating):
    """Simulates each scene again, from a start that is computed from the first observed positions.

    *Oracle*: ``know(domain)`` gives it d and all other parameters of the simulation, which no forecaster can know. The
    oracle does not use the future; its remaining error comes from the inexact start. It needs whole scenes, observed
    from their first frame, as on the windows clock. Deterministic.

    Until the first frame p an agent walks straight to its goal, opposite the start, so start = p + 0.38 p / |p| at
    speed 1. With many agents this does not hold: the start is moved by what the simulation misses p by, and by half as
    much where that made it worse, until p is met to 2e-6 m. Crowds amplify the rest: at d = 0.6 ten agents have an
    error of about 0.0004 m, at d = 0.8 of 0.005 m, where one scene in a hundred cannot be placed.
    """

    selection = "no weights; knows every parameter of the simulation"
    kind = "orca_oracle"
    knows = ("orca", "ORCA", "an orca domain")

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: ``know`` was not called, or an observation is not the beginning of a whole scene.
        """
        domain = self.known()
        agents = domain.agents
        if (np.diff(observation.scene) != agents).any():
            raise PredictorError(f"orca_oracle needs whole scenes of {agents} agents, but a scene has another number.")
        history = observation.xy.reshape(observation.scenes, agents, HISTORY, 2).transpose(0, 2, 1, 3)
        frames = domain.simulate(self._start(domain, history[:, 0].astype(np.float64))).positions
        error = np.abs(frames[:, :HISTORY] - history).max(axis=(1, 2, 3))
        lost = error > TOLERANCE
        if lost.sum() > LOST * len(lost):
            raise PredictorError(
                f"orca_oracle cannot place {lost.sum()} of {len(lost)} histories (up to {error.max():.2f} m from the "
                "simulated ones): use scenes that start at their first frame, as on the windows clock, and the "
                "parameters of the domain."
            )
        future = frames[:, HISTORY : HISTORY + FUTURE].transpose(0, 2, 1, 3)
        return Forecast(np.ascontiguousarray(future.reshape(-1, 1, FUTURE, 2)))

    @staticmethod
    def _start(domain: Any, first: np.ndarray) -> np.ndarray:
        """Starts [S, N, 2] from which the simulation meets the first frames [S, N, 2]."""
        distance = np.linalg.norm(first, axis=-1, keepdims=True)
        best = first * (1 + domain.first_frame * domain.speed / np.maximum(distance, 1e-9))
        miss, error, rate = np.zeros_like(best), np.full(len(best), np.inf), np.ones(len(best))
        for _ in range(CORRECTIONS):
            left = np.flatnonzero(error > EXACT)
            start = best[left] + rate[left, None, None] * miss[left]
            off = first[left] - domain.simulate(start, frames=1).positions[:, 0]
            largest = np.abs(off).max(axis=(1, 2))
            better = largest < error[left]
            scene = left[better]
            best[scene], miss[scene], error[scene], rate[scene] = start[better], off[better], largest[better], 1
            rate[left[~better]] /= 2
        return best
