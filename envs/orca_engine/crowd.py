"""One step of ORCA for a batch of scenes: half-planes of allowed velocities, then velocities.

The half-planes of a pair are computed once, because those of its two agents are mirror images. An agent takes its
preferred velocity if all half-planes allow it. Only the other agents sort their neighbours and solve a linear program.
"""

from __future__ import annotations

import numpy as np

from motion_gym.envs.orca_engine.linear_program import least_violating, nearest
from motion_gym.envs.orca_engine.vectors import HALF, ONE, TINY, cross, dot, put, select


class Crowd:
    """A batch of scenes, in arrays (component, agent or pair or line, scene).

    Scenes are the last axis, so that operations run over long contiguous rows, and agents and pairs are whole rows. A
    line is the border of a half-plane of allowed velocities: a point, and a unit direction with the allowed velocities
    on its left. A line with direction (0, 0) allows all velocities.
    """

    def __init__(
        self,
        start,
        goal,
        radius,
        *,
        time_step,
        time_horizon,
        neighbor_distance,
        max_neighbors,
        max_speed,
    ):
        """Set the initial state from ``start`` and ``goal`` [S, N, 2] and ``radius`` [S]."""
        start, self.goal = (np.array(array.transpose(2, 1, 0), order="C") for array in (start, goal))
        self.position = start.astype(np.float32)
        self.velocity = np.zeros_like(self.position)
        self.reach = radius.astype(np.float32) + radius.astype(np.float32)
        self.time_step, self.max_speed, self.top_speed = np.float32(time_step), max_speed, np.float32(max_speed)
        self.rate, self.touching_rate = 1 / np.float32(time_horizon), 1 / self.time_step
        self.range = np.float32(neighbor_distance) * np.float32(neighbor_distance)
        self.max_neighbors = max_neighbors

        agents = start.shape[1]
        self.one, self.other = np.triu_indices(agents, 1)
        pairs = len(self.one)
        # Pair p has two lines: p of its first agent and pairs + p of the second.
        self.owner = np.concatenate([self.one, self.other])
        line = np.zeros((agents, agents), np.intp)
        line[self.one, self.other] = np.arange(pairs)
        line[self.other, self.one] = np.arange(pairs) + pairs
        self.lines = line[~np.eye(agents, dtype=bool)].reshape(agents, max(agents - 1, 0))

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Move all agents by one time step; return agent and scene of every infeasible linear program."""
        # Preferred velocities are an input of RVO2, which its caller computes in double precision.
        preferred = self.goal - self.position
        preferred /= np.maximum(np.sqrt(dot(preferred, preferred)) / self.max_speed, 1.0)
        preferred = preferred.astype(np.float32)
        square, limit = dot(preferred, preferred), self.top_speed * self.top_speed
        slowed = preferred * (ONE / np.sqrt(np.maximum(square, limit))) * self.top_speed
        velocity = select(square > limit, slowed, preferred)
        infeasible = self._avoid(preferred, velocity)
        self.velocity = velocity
        self.position += velocity * self.time_step
        return infeasible

    def _avoid(self, preferred: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Replace velocities that the half-planes do not allow, in place."""
        point, direction, square = self._half_planes()
        broken = cross(direction, point - velocity[:, self.owner]) > 0
        blocked = np.flatnonzero(broken[self.lines].any(axis=1))
        agent, scene = np.divmod(blocked, square.shape[1])
        if not len(blocked):
            return agent, scene

        place = self.lines[agent].T * square.shape[1] + scene
        if len(place) > 1:
            distance = square.ravel()[(place % square.size).T]
            order = np.argsort(distance, axis=1, kind="stable")[:, : self.max_neighbors]
            place = np.take_along_axis(place, order.T, axis=0)
        point, direction = (np.take(lines.reshape(2, -1), place, axis=1) for lines in (point, direction))
        direction *= np.take(square, place % square.size) < self.range

        velocity, preferred = velocity.reshape(2, -1), np.take(preferred.reshape(2, -1), blocked, axis=1)
        chosen, failed = nearest(point, direction, np.take(velocity, blocked, axis=1), preferred, self.top_speed)
        bad = np.flatnonzero(failed < len(place))
        if len(bad):
            point, direction = np.take(point, bad, axis=2), np.take(direction, bad, axis=2)
            put(chosen, bad, least_violating(point, direction, chosen[:, bad], failed[bad], self.top_speed))
        put(velocity, blocked, chosen)
        return agent[bad], scene[bad]

    def _half_planes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Compute the lines of every pair (section 4 of the paper).

        Returns:
            Points and directions of the lines, [2, 2 P, S] each; squared distances of the pairs, [P, S].
        """
        one, other = self.velocity[:, self.one], self.velocity[:, self.other]
        between = self.position[:, self.other] - self.position[:, self.one]
        relative = one - other
        square, reach, reach_square = dot(between, between), self.reach, self.reach * self.reach
        touching = square <= reach_square
        rate = select(touching, self.touching_rate, self.rate) if touching.any() else self.rate

        # w points from the centre of the cut-off circle to the relative velocity.
        w = relative - rate * between
        w_square, along = dot(w, w), dot(w, between)
        circle = (along < 0) & (along * along > reach_square * w_square) | touching

        # The left leg if w points left of the line between the agents; otherwise, also straight ahead, the right leg.
        leg = np.sqrt(np.maximum(square - reach_square, 0))
        leg = select(cross(between, w) > 0, leg, -leg)
        toward = np.stack([between[0] * leg - between[1] * reach, between[0] * reach + between[1] * leg])
        toward *= ONE / np.maximum(square, TINY)
        change = dot(relative, toward) * toward - relative

        length = np.sqrt(w_square)
        outward = w * (ONE / np.maximum(length, TINY))
        toward = select(circle, np.stack([outward[1], -outward[0]]), toward)
        change = select(circle, (reach * rate - length) * outward, change)
        change *= HALF
        return np.hstack([one + change, other - change]), np.hstack([toward, -toward]), square
