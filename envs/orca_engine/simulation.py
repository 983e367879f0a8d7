"""``simulate``: scenes of agents that avoid each other by ORCA, from their starts to their paths."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import ORIGIN_GRID

ENGINE_VERSION = 1
"""Raise this number when results change, so that cached scenes of an older engine are not used."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """The result of a simulation of S scenes of N agents.

    Attributes:
        positions: [S, F, N, 2] float64, metres, exact sums of float32 states and the origin of the scene (0 within
            500 m of the zero point); frame f is the state after ``first + f * every`` steps.
        first_infeasible: [S, N] int64, the first step, from 0, in which no velocity satisfied all half-planes of the
            agent, so that it took the velocity that violates them least; -1 if there was no such step.
    """

    positions: np.ndarray
    first_infeasible: np.ndarray


def simulate(
    start: np.ndarray,
    goal: np.ndarray,
    *,
    radius: float | np.ndarray,
    steps: int = 400,
    every: int = 20,
    first: int | None = None,
    time_step: float = 0.02,
    time_horizon: float = 2.0,
    neighbor_distance: float = 10.0,
    max_neighbors: int = 10,
    max_speed: float = 1.0,
    lean: float = 0.0,
) -> Simulation:
    """Simulate S scenes of N agents that walk to their goals and avoid each other.

    Agents start at rest. The preferred velocity of an agent points straight to its goal, with ``max_speed``, and slower
    within a second of the goal. All agents choose their velocities from the same state, then all move. Scenes do not
    influence each other: a scene has bit-identical results alone and in any batch.

    Args:
        start: [S, N, 2] initial positions, metres.
        goal: [S, N, 2] goals, metres.
        radius: Radius of the agents, metres; one for all scenes, or [S].
        steps: Number of steps.
        every: Steps between frames.
        first: Steps before the first frame; ``every`` by default.
        time_step: Seconds per step.
        time_horizon: Seconds for which a chosen velocity must be free of collisions.
        neighbor_distance: Agents at this distance or further away are ignored, metres.
        max_neighbors: Number of nearest neighbours to avoid.
        max_speed: m/s.
        lean: Above 0 agents prefer to pass each other on the right, each moving to its right; below 0 on the left. See
            ``crowd.half_planes``.

    Returns:
        Simulation with ``1 + (steps - first) // every`` frames.
    """
    from motion_gym.envs.orca_engine.crowd import play  # numba takes half a second to import

    first = every if first is None else first
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    origin = np.round(start[:, :1] / ORIGIN_GRID) * ORIGIN_GRID
    start, goal = np.ascontiguousarray(start - origin), np.ascontiguousarray(goal - origin)
    radius = np.broadcast_to(radius, start.shape[:1])

    paths = np.empty((len(start), 1 + (steps - first) // every, *start.shape[1:]))
    infeasible = np.full(start.shape[:2], -1)
    single = np.float32
    rules = (
        single(time_step),
        single(1) / single(time_horizon),
        single(neighbor_distance) * single(neighbor_distance),
        single(max_speed),
        max_neighbors,
        single(lean),
    )
    play(start, goal, radius.astype(single), rules, float(max_speed), steps, first, every, paths, infeasible)
    return Simulation(paths + origin[:, None], infeasible)
