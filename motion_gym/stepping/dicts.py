"""Between arrays and the dicts of PettingZoo: observations, forecasts and ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import HISTORY, Forecast, Observation, Truth
from motion_gym.data.scene_images import SceneImage
from motion_gym.stepping.clocks import Settled


def observation_from_dict(
    observations: Mapping[str, np.ndarray],
    dt: float,
    agents: Sequence[str],
    time: int | None = None,
    images: tuple[SceneImage, ...] | None = None,
) -> Observation:
    """One scene from the observations of a PettingZoo environment.

    Args:
        observations: What ``reset`` or ``step`` gave.
        dt: Seconds per step (``env.domain.card.dt``).
        agents: ``env.agents``; agents that have left are in the dict too, but need no forecast.
        time: ``env.clock.time``, by which an adapter can distinguish scenes that look alike; None if not known.
        images: ``env.images``, for predictors that see the ground.
    """
    if not agents:
        return Observation(np.zeros((0, HISTORY, 2), np.float32), np.zeros(1, np.int64), np.zeros(0, np.int64), dt)
    history = np.stack([observations[name] for name in agents])
    when = None if time is None else np.array([time])
    numbers = np.array([int(name.rsplit("_", 1)[1]) for name in agents])
    return Observation(history, np.array([0, len(agents)]), numbers, dt, when, images)


def forecast_to_dict(forecast: Forecast, agents: Sequence[str]) -> dict[str, np.ndarray]:
    """Actions of a PettingZoo environment from a forecast of ``env.agents``."""
    return dict(zip(agents, forecast.positions, strict=True))


def truth_from_infos(infos: Mapping[str, Mapping[str, Any]], dt: float) -> Truth | None:
    """The ground truth that the last step revealed, in whole scenes; None if it revealed nothing.

    The times of the scenes are those of the environment's clock.
    """
    settled = [info for info in infos.values() if "future" in info]
    if not settled:
        return None
    agent, row, history, future, known, made = (
        np.concatenate([info[key] for info in settled])
        for key in ("agent", "row", "history", "future", "known", "made")
    )
    order = np.lexsort((row, made))
    scene = np.append(np.flatnonzero(np.diff(made[order], prepend=-1)), len(made))
    images = None
    if all("image" in info for info in settled):
        images = tuple(np.concatenate([info["image"] for info in settled])[order][scene[:-1]].tolist())
    observation = Observation(history[order], scene, agent[order], dt, made[order][scene[:-1]], images)
    return Truth(future[order], known[order], observation)


def infos_of(settled: Settled, names: Mapping[int, str]) -> dict[str, dict[str, np.ndarray]]:
    """The infos that report settled scenes.

    Every agent reports its own forecasts. An agent of the same scene reports the forecasts of an agent that left in an
    earlier step: the last agents of a scene are present in the step that settles it.

    Args:
        settled: Whole scenes.
        names: Name by the clock's id, of the agents in the dicts of this step.
    """
    seen, reporter = settled.truth.observation, settled.identity
    scene = seen.scene_index
    gone = np.array([identity not in names for identity in reporter.tolist()])
    if gone.any():
        rows = np.flatnonzero(~gone)
        reporter = reporter.copy()
        reporter[gone] = reporter[rows[np.searchsorted(scene[rows], scene[gone])]]
    order = np.argsort(reporter, kind="stable")
    columns = {
        "agent": seen.agent,
        "row": np.arange(len(scene)) - seen.scene[scene],
        "history": seen.history,
        "future": settled.truth.future,
        "known": settled.truth.known,
        "forecast": settled.forecast.positions,
        "made": settled.made,
    }
    if seen.images is not None:
        columns["image"] = np.array(seen.images, object)[scene]
    columns = {key: column.take(order, axis=0) for key, column in columns.items()}
    reporter = reporter[order]
    start = np.flatnonzero(np.diff(reporter, prepend=-1))
    parts = zip(reporter[start].tolist(), start.tolist(), [*start[1:].tolist(), len(order)], strict=True)
    return {names[i]: {key: column[a:b] for key, column in columns.items()} for i, a, b in parts}
