"""Between arrays and the dicts of PettingZoo: observations and truth in, forecasts out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import HISTORY, Forecast, Observation, Truth


def observation_from_dict(
    observations: Mapping[str, np.ndarray], dt: float, agents: Sequence[str], time: int | None = None
) -> Observation:
    """One scene from the observations of a PettingZoo environment.

    Args:
        observations: What ``reset`` or ``step`` gave.
        dt: Seconds per step (``env.domain.card.dt``).
        agents: ``env.agents``; those that have left are in the dict too, but need no forecast.
        time: ``env.clock.time``, so that an adapter can tell scenes apart that look alike; None where not known.
    """
    if not agents:
        return Observation(np.zeros((0, HISTORY, 2), np.float32), np.zeros(1, np.int64), np.zeros(0, np.int64), dt)
    history = np.stack([observations[name] for name in agents])
    when = None if time is None else np.array([time])
    return Observation(history, np.array([0, len(agents)]), np.array([_number(n) for n in agents]), dt, when)


def forecast_to_dict(forecast: Forecast, agents: Sequence[str]) -> dict[str, np.ndarray]:
    """Actions of a PettingZoo environment from a forecast of ``env.agents``."""
    return dict(zip(agents, forecast.positions, strict=True))


def truth_from_infos(infos: Mapping[str, Mapping[str, Any]], dt: float) -> Truth | None:
    """The truth that has just been revealed, one scene per time at which forecasts were made; None if nothing was."""
    settled = [(name, info) for name, info in infos.items() if "future" in info]
    if not settled:
        return None
    history, future, known, made = (
        np.concatenate([info[key] for _, info in settled]) for key in ("history", "future", "known", "made")
    )
    agent = np.concatenate([np.full(len(info["made"]), _number(name)) for name, info in settled])
    order = np.lexsort((agent, made))
    scene = np.append(np.flatnonzero(np.diff(made[order], prepend=-1)), len(made))
    observation = Observation(history[order], scene, agent[order], dt, made[order][scene[:-1]])
    return Truth(future[order], known[order], observation)


def _number(name: str) -> int:
    return int(name.rsplit("_", 1)[1])
