"""``simulate``: scenes of agents that avoid each other by ORCA, from their starts to their paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import ORIGIN_GRID, SpecError
from motion_gym.envs.orca_engine.crowd import Crowd
from motion_gym.specs import number, whole_number

CHUNK = 65536
"""Pairs of agents that are worked on together: many, since each numpy call costs, but arrays stay in the cache."""
ENGINE_VERSION = 1
"""To be raised whenever results change, so that cached scenes of an older engine are not used."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """What happened in S scenes of N agents.

    Attributes:
        positions: [S, F, N, 2] float64, metres, exact sums of float32 states and the origin of the scene (0 within
            500 m of the zero point); frame f is the state after ``first + f * every`` steps.
        first_infeasible: [S, N] int64, the first step, counted from 0, in which no velocity satisfied all half-planes
            of the agent, so that it took the one that violates them least; -1 where that never happened.
    """

    positions: np.ndarray
    first_infeasible: np.ndarray


def simulate(
    start: np.ndarray,
    goal: np.ndarray,
    *,
    radius: float | np.ndarray,
    velocity: np.ndarray | None = None,
    steps: int = 400,
    every: int = 20,
    first: int | None = None,
    time_step: float = 0.02,
    time_horizon: float = 2.0,
    neighbor_distance: float = 10.0,
    max_neighbors: int = 10,
    max_speed: float = 1.0,
) -> Simulation:
    """Simulate S scenes of N agents that walk to their goals and avoid each other.

    An agent prefers to walk straight to its goal at ``max_speed``, and slower within a second of it. All agents choose
    their velocities from the same state, then all move. Scenes do not influence each other: a scene gives the same
    bits alone and in any batch.

    Args:
        start: [S, N, 2] positions, metres.
        goal: [S, N, 2] goals, metres.
        radius: Radius of the agents, metres; one for all, or [S], one for each scene.
        velocity: [S, N, 2] velocities at the start, m/s; at rest by default, as in a fresh RVO2 simulator.
        steps: Steps to simulate.
        every: Steps from one kept frame to the next.
        first: Steps up to the first kept frame; ``every`` by default.
        time_step: Seconds per step.
        time_horizon: Seconds for which a chosen velocity must be free of collisions.
        neighbor_distance: Agents at this distance or further away are ignored, metres.
        max_neighbors: Only so many nearest neighbours are avoided.
        max_speed: m/s.

    Returns:
        Simulation with ``1 + (steps - first) // every`` frames.

    Raises:
        SpecError: A shape, a number or the start of a scene is not what it should be.
    """
    start = _points("start", start)
    goal = _points("goal", goal, start.shape)
    velocity = np.zeros_like(start) if velocity is None else _points("velocity", velocity, start.shape)
    first = every if first is None else first
    counts = {"steps": steps, "every": every, "first": first, "max_neighbors": max_neighbors}
    for name, count in counts.items():
        whole_number(name, count, 1, 10**9)
    if first > steps:
        raise SpecError(f"the first frame is kept after {first} steps, but steps is {steps}; give more steps.")
    metres_and_seconds = {
        "time_step": time_step,
        "time_horizon": time_horizon,
        "neighbor_distance": neighbor_distance,
        "max_speed": max_speed,
    }
    for name, value in metres_and_seconds.items():
        number(name, value, above=True)
    radius = np.asarray(radius, float)
    if radius.shape not in ((), start.shape[:1]):
        raise SpecError(
            f"radius has shape {radius.shape}; give one number, or one for each of the {len(start)} scenes."
        )
    allowed = np.isfinite(radius) & (radius > 0)
    if not allowed.all():
        raise SpecError(f"radius is {radius[~allowed].flat[0]}; give finite numbers above 0, in metres.")
    radius = np.broadcast_to(radius, start.shape[:1])
    origin = np.round(start[:, :1] / ORIGIN_GRID) * ORIGIN_GRID
    start, goal = start - origin, goal - origin

    positions = np.empty((len(start), 1 + (steps - first) // every, *start.shape[1:]))
    infeasible = np.full(start.shape[:2], -1)
    size = max(1, CHUNK // max(1, start.shape[1] * (start.shape[1] - 1) // 2))
    for begin in range(0, len(start), size):
        part = slice(begin, begin + size)
        _check_apart(start[part], radius[part], begin)
        crowd = Crowd(
            *(array[part] for array in (start, goal, velocity, radius)),
            time_step=time_step,
            time_horizon=time_horizon,
            neighbor_distance=neighbor_distance,
            max_neighbors=max_neighbors,
            max_speed=max_speed,
        )
        for step in range(steps):
            agent, scene = crowd.step()
            new = infeasible[begin + scene, agent] < 0
            infeasible[begin + scene[new], agent[new]] = step
            frame, between = divmod(step + 1 - first, every)
            if frame >= 0 and not between:
                positions[part, frame] = crowd.position.transpose(2, 1, 0)
    return Simulation(positions + origin[:, None], infeasible)


def _points(name: str, value: np.ndarray, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """Give ``value`` as float64 [S, N, 2], or say what is wrong with it."""
    value = np.asarray(value, float)
    if value.ndim != 3 or value.shape[-1] != 2:
        raise SpecError(f"{name} has shape {value.shape}; give (scenes, agents, 2).")
    if shape is not None and value.shape != shape:
        raise SpecError(f"{name} has shape {value.shape} but start has {shape}; give both the same shape.")
    if not np.isfinite(value).all():
        scene, agent, _ = np.argwhere(~np.isfinite(value))[0]
        raise SpecError(
            f"{name} of agent {agent} in scene {scene} is {value[scene, agent]}; give finite numbers, in metres."
        )
    return value


def _check_apart(start: np.ndarray, radius: np.ndarray, begin: int) -> None:
    """Raise SpecError if agents overlap; ``begin`` is the number of the first of these scenes."""
    one, other = np.triu_indices(start.shape[1], 1)
    distance = np.linalg.norm(start[:, one] - start[:, other], axis=-1)
    overlap = np.argwhere(distance < 2 * radius[:, None])
    if len(overlap):
        scene, pair = overlap[0]
        raise SpecError(
            f"agents {one[pair]} and {other[pair]} of scene {begin + scene} overlap at the start: they are "
            f"{distance[scene, pair]:.6g} m apart and need 2 * radius = {2 * radius[scene]:.6g} m; "
            "move them apart or give a smaller radius."
        )
