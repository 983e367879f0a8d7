"""An oracle for the ORCA domain: knows the style, and simulates."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Forecast, Observation, PredictorError
from motion_gym.predictors.simulating import Simulating

TOLERANCE = 0.05
"""Largest distance between the observed and the simulated history, metres."""
CORRECTIONS = 6


class OrcaOracle(Simulating):
    """Simulates each scene again, from a start that is computed from the first observed positions.

    *Oracle*: ``know(domain)`` gives it d and all other parameters of the simulation, which no forecaster can know. The
    oracle does not use the future; its remaining error comes from the inexact start. It needs whole scenes, observed
    from their first frame, as on the windows clock. Deterministic.

    Until the first frame p an agent walks straight to its goal, opposite the start, so start = p + 0.38 p / |p| at
    speed 1. With many agents this does not hold, and the start is corrected until the simulation matches p.
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
        first = history[:, 0].astype(np.float64)
        distance = np.linalg.norm(first, axis=-1, keepdims=True)
        start = first * (1 + domain.first_frame * domain.speed / np.maximum(distance, 1e-9))
        frames = domain.simulate(start).positions
        for _ in range(CORRECTIONS):
            off = np.abs(frames[:, 0] - first).max(axis=(1, 2)) > 1e-4
            if not off.any():
                break
            start[off] += first[off] - frames[off, 0]
            frames[off] = domain.simulate(start[off]).positions
        error = np.abs(frames[:, :HISTORY] - history).max(initial=0)
        if error > TOLERANCE:
            raise PredictorError(
                f"orca_oracle cannot place a history ({error:.2f} m from the simulated one): use scenes that start at "
                "their first frame, as on the windows clock, and the parameters of the domain."
            )
        future = frames[:, HISTORY : HISTORY + FUTURE].transpose(0, 2, 1, 3)
        return Forecast(np.ascontiguousarray(future.reshape(-1, 1, FUTURE, 2)))
