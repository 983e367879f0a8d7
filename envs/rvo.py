"""ORCA for many scenes at once: the simulator behind the style-shift domain.

Optimal reciprocal collision avoidance of van den Berg, Guy, Lin and Manocha, "Reciprocal n-body collision
avoidance" (2011), in numpy over all scenes and agents of a batch. Agents that meet almost head on magnify any
difference, until they pass on another side. So the state is float32 and the arithmetic that of the RVO2 library,
operation by operation: on machines without fused multiply-add the two agree to the last bit.

The work follows the half-planes that bind: the half-planes of a pair are worked out once (those of its two agents are
mirror images), an agent whose preferred velocity they all allow takes it, and only the others sort their neighbours
and solve a linear program.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import SpecError

PARALLEL = np.float32(1e-5)
"""Lines whose unit directions span no more than this area count as parallel, as in RVO2."""
CHUNK = 4096
"""Pairs that are worked on together, so that their arrays stay in the cache."""


@dataclass(frozen=True, eq=False)
class Simulation:
    """What happened in S scenes of N agents.

    Attributes:
        positions: [S, F, N, 2] float32, metres; frame f is the state after ``first + f * every`` steps.
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
    for name, value in {
        "steps": steps,
        "every": every,
        "first": first,
        "max_neighbors": max_neighbors,
    }.items():
        if not isinstance(value, (int, np.integer)) or value < 1:
            raise SpecError(f"{name} is {value!r}; give a whole number of at least 1.")
    if first > steps:
        raise SpecError(
            f"the first frame is kept after {first} steps, but steps is {steps}; give more steps."
        )
    metres_and_seconds = {
        "time_step": time_step,
        "time_horizon": time_horizon,
        "neighbor_distance": neighbor_distance,
        "max_speed": max_speed,
    }
    for name, value in metres_and_seconds.items():
        if not 0 < value < np.inf:
            raise SpecError(f"{name} is {value!r}; give a finite number above 0.")
    radius = np.asarray(radius, float)
    if radius.shape not in ((), start.shape[:1]):
        raise SpecError(
            f"radius has shape {radius.shape}; give one number, or one for each of the {len(start)} scenes."
        )
    allowed = np.isfinite(radius) & (radius > 0)
    if not allowed.all():
        raise SpecError(f"radius is {radius[~allowed].flat[0]}; give finite numbers above 0, in metres.")
    radius = np.broadcast_to(radius, start.shape[:1])

    positions = np.empty((len(start), 1 + (steps - first) // every, *start.shape[1:]), np.float32)
    infeasible = np.full(start.shape[:2], -1)
    size = max(1, CHUNK // max(1, start.shape[1] * (start.shape[1] - 1) // 2))
    for begin in range(0, len(start), size):
        part = slice(begin, begin + size)
        _check_apart(start[part], radius[part], begin)
        crowd = _Crowd(
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
    return Simulation(positions, infeasible)


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


class _Crowd:
    """Scenes that are simulated together, in arrays (component, agent or pair or line, scene).

    With scenes last, an operation runs over long contiguous rows, and agents and pairs are picked by whole rows. A
    line is the border of a half-plane of allowed velocities: a point, and a unit direction that has them on its left.
    A line without direction (0, 0) allows everything.
    """

    def __init__(
        self,
        start,
        goal,
        velocity,
        radius,
        *,
        time_step,
        time_horizon,
        neighbor_distance,
        max_neighbors,
        max_speed,
    ):
        """Take arrays [S, N, 2] and ``radius`` [S]."""
        start, goal, velocity = (
            np.array(array.transpose(2, 1, 0), order="C") for array in (start, goal, velocity)
        )
        self.position, self.goal, self.velocity = start.astype(np.float32), goal, velocity.astype(np.float32)
        self.reach = radius.astype(np.float32) + radius.astype(np.float32)
        self.time_step, self.max_speed = np.float32(time_step), np.float32(max_speed)
        self.rate, self.touching_rate = 1 / np.float32(time_horizon), 1 / self.time_step
        self.range = np.float32(neighbor_distance) * np.float32(neighbor_distance)
        self.max_neighbors = max_neighbors

        agents = start.shape[1]
        self.one, self.other = np.triu_indices(agents, 1)
        pairs = len(self.one)
        # Pair p has two lines: p of its one agent and pairs + p of the other.
        self.owner = np.concatenate([self.one, self.other])
        line = np.zeros((agents, agents), np.intp)
        line[self.one, self.other] = np.arange(pairs)
        line[self.other, self.one] = np.arange(pairs) + pairs
        self.lines = line[~np.eye(agents, dtype=bool)].reshape(agents, max(agents - 1, 0))

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Move everyone by one time step; return agent and scene of every linear program that was infeasible."""
        wish = self.goal - self.position
        wish /= np.maximum(np.sqrt(_dot(wish, wish)) / float(self.max_speed), 1.0)
        wish = wish.astype(np.float32)
        velocity = wish.copy()
        square = _dot(wish, wish)
        fast = square > self.max_speed * self.max_speed
        velocity[:, fast] = wish[:, fast] * (1 / np.sqrt(square[fast])) * self.max_speed
        infeasible = self._avoid(wish, velocity)
        self.velocity = velocity
        self.position += velocity * self.time_step
        return infeasible

    def _avoid(self, wish: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Replace in ``velocity`` what the half-planes do not allow."""
        point, direction, square = self._half_planes()
        broken = _cross(direction, point - velocity[:, self.owner]) > 0
        agent, scene = np.nonzero(broken[self.lines].any(axis=1))
        if not len(agent):
            return agent, scene

        line = self.lines[agent]
        if line.shape[1] > 1:
            distance = square[line % len(square), scene[:, None]]
            order = np.argsort(distance, axis=1, kind="stable")[:, : self.max_neighbors]
            line = np.take_along_axis(line, order, axis=1)
        line = line.T
        point, direction = point[:, line, scene], direction[:, line, scene]
        direction[:, square[line % len(square), scene] >= self.range] = 0

        wish = wish[:, agent, scene]
        chosen, failed = _nearest(point, direction, velocity[:, agent, scene], wish, self.max_speed)
        bad = np.flatnonzero(failed < len(line))
        if len(bad):
            chosen[:, bad] = _least_violating(
                point[:, :, bad], direction[:, :, bad], chosen[:, bad], failed[bad], self.max_speed
            )
        velocity[:, agent, scene] = chosen
        return agent[bad], scene[bad]

    def _half_planes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Work out the lines of every pair (section 4 of the paper).

        Returns:
            Points and directions of the lines, [2, 2 P, S] each; squared distances of the pairs, [P, S].
        """
        one, other = self.velocity[:, self.one], self.velocity[:, self.other]
        between = self.position[:, self.other] - self.position[:, self.one]
        relative = one - other
        square, reach, reach_square = _dot(between, between), self.reach, self.reach * self.reach
        touching = square <= reach_square
        rate = np.where(touching, self.touching_rate, self.rate) if touching.any() else self.rate

        # w leads from the centre of the cut-off circle to the relative velocity.
        w = relative - rate * between
        w_square, along = _dot(w, w), _dot(w, between)
        circle = (along < 0) & (along * along > reach_square * w_square) | touching

        # The left leg if w turns left of the line between the agents, else, also when dead ahead, the right one.
        leg = np.sqrt(np.maximum(square - reach_square, 0))
        leg = np.where(_cross(between, w) > 0, leg, -leg)
        toward = np.stack([between[0] * leg - between[1] * reach, between[0] * reach + between[1] * leg])
        toward *= 1 / square
        change = _dot(relative, toward) * toward - relative

        w_length = np.sqrt(w_square)
        outward = w * (1 / w_length)
        np.copyto(toward[0], outward[1], where=circle)
        np.copyto(toward[1], -outward[0], where=circle)
        np.copyto(change, (reach * rate - w_length) * outward, where=circle)

        change *= np.float32(0.5)
        return np.hstack([one + change, other - change]), np.hstack([toward, -toward]), square


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product along the first axis."""
    return a[0] * b[0] + a[1] * b[1]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed area along the first axis."""
    return a[0] * b[1] - a[1] * b[0]


def _nearest(point, direction, velocity, target, speed, along=False):
    """Solve M linear programs in the plane, of L half-planes and a circle each.

    Incremental, as in section 5 of the paper: half-planes are added one by one; when one excludes the best velocity so
    far, the new best one lies on its border.

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocity inside the circle alone.
        target: [2, M] what to come close to; with ``along`` the unit vector to go far along.
        speed: Radius of the circle.
        along: What ``target`` is.

    Returns:
        Velocity [2, M], and [M] the first half-plane that could not be met (the velocity is then the best one before
        it), or L.
    """
    velocity, count = velocity.copy(), point.shape[1]
    failed = np.full(point.shape[2], count)
    for last in range(count):
        broken = _cross(direction[:, last], point[:, last] - velocity) > 0
        who = np.flatnonzero(broken & (failed == count))
        if not len(who):
            continue
        # The border is base + t * way; circle and earlier half-planes leave t in [left, right].
        base, way = point[:, last, who], direction[:, last, who]
        middle = _dot(base, way)
        room = middle * middle + speed * speed - _dot(base, base)
        half = np.sqrt(np.maximum(room, 0))
        left, right, possible = -middle - half, -middle + half, room >= 0
        if last:
            area = _cross(way[:, None], direction[:, :last, who])
            slack = _cross(direction[:, :last, who], base[:, None] - point[:, :last, who])
            parallel = np.abs(area) <= PARALLEL
            t = slack / np.where(parallel, 1, area)
            right = np.minimum(right, np.where(parallel | (area < 0), np.inf, t).min(axis=0))
            left = np.maximum(left, np.where(parallel | (area > 0), -np.inf, t).max(axis=0))
            possible &= (left <= right) & ~(parallel & (slack < 0)).any(axis=0)
        if along:
            t = np.where(_dot(target[:, who], way) > 0, right, left)
        else:
            t = np.minimum(np.maximum(_dot(way, target[:, who] - base), left), right)
        velocity[:, who[possible]] = (base + t * way)[:, possible]
        failed[who[~possible]] = last
    return velocity, failed


def _least_violating(point, direction, velocity, failed, speed):
    """Find the velocities that violate the half-planes of infeasible programs least (section 5.3 of the paper).

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocities before the half-plane that could not be met.
        failed: [M] that half-plane.
        speed: Radius of the circle.

    Returns:
        [2, M] velocities.
    """
    velocity, worst = velocity.copy(), np.zeros(point.shape[2], np.float32)
    for last in range(failed.min(), point.shape[1]):
        violation = _cross(direction[:, last], point[:, last] - velocity)
        who = np.flatnonzero((violation > worst) & (failed <= last))
        if not len(who):
            continue
        # Where an earlier half-plane is violated less than this one: again a half-plane, bounded by a bisector.
        base, way = point[:, None, last, who], direction[:, None, last, who]
        bases, ways = point[:, :last, who], direction[:, :last, who]
        area = _cross(way, ways)
        parallel = np.abs(area) <= PARALLEL
        meet = base + _cross(ways, base - bases) / np.where(parallel, 1, area) * way
        meet = np.where(parallel, np.float32(0.5) * (base + bases), meet)
        bisector = ways - way
        length = np.sqrt(_dot(bisector, bisector))
        same = parallel & (_dot(way, ways) > 0)
        bisector = np.where(same, 0, bisector * (1 / np.where(same, 1, length)))
        inward = np.stack([-way[1, 0], way[0, 0]])
        better, stopped = _nearest(meet, bisector, inward * speed, inward, speed, along=True)
        # This is feasible by definition; where rounding says otherwise the velocity stays.
        met = stopped == last
        velocity[:, who[met]] = better[:, met]
        worst[who] = _cross(way[:, 0], base[:, 0] - velocity[:, who])
    return velocity
