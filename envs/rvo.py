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

CHUNK = 65536
"""Pairs of agents that are worked on together: many, since each numpy call costs, but arrays stay in the cache."""
ENGINE_VERSION = 1
"""To be raised whenever results change, so that cached scenes of an older engine are not used."""
PARALLEL = np.float32(1e-5)
"""Lines whose unit directions span no more than this area count as parallel, as in RVO2."""
ONE, HALF, TINY, FAR = np.float32(1), np.float32(0.5), np.float32(1e-30), np.float32(1e30)


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
        raise SpecError(f"the first frame is kept after {first} steps, but steps is {steps}; give more steps.")
    metres_and_seconds = {
        "time_step": time_step,
        "time_horizon": time_horizon,
        "neighbor_distance": neighbor_distance,
        "max_speed": max_speed,
    }
    for name, number in metres_and_seconds.items():
        if not 0 < number < np.inf:
            raise SpecError(f"{name} is {number!r}; give a finite number above 0.")
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
        start, goal, velocity = (np.array(array.transpose(2, 1, 0), order="C") for array in (start, goal, velocity))
        self.position, self.goal, self.velocity = start.astype(np.float32), goal, velocity.astype(np.float32)
        self.reach = radius.astype(np.float32) + radius.astype(np.float32)
        self.time_step, self.max_speed, self.top_speed = np.float32(time_step), max_speed, np.float32(max_speed)
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
        """Move everyone by one time step; return agent and scene of every infeasible linear program."""
        # RVO2 takes preferred velocities from its caller, who works them out in double precision.
        wish = self.goal - self.position
        wish /= np.maximum(np.sqrt(_dot(wish, wish)) / self.max_speed, 1.0)
        wish = wish.astype(np.float32)
        square, limit = _dot(wish, wish), self.top_speed * self.top_speed
        slowed = wish * (ONE / np.sqrt(np.maximum(square, limit))) * self.top_speed
        velocity = _select(square > limit, slowed, wish)
        infeasible = self._avoid(wish, velocity)
        self.velocity = velocity
        self.position += velocity * self.time_step
        return infeasible

    def _avoid(self, wish: np.ndarray, velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Replace in ``velocity`` what the half-planes do not allow."""
        point, direction, square = self._half_planes()
        broken = _cross(direction, point - velocity[:, self.owner]) > 0
        who = np.flatnonzero(broken[self.lines].any(axis=1))
        agent, scene = np.divmod(who, square.shape[1])
        if not len(who):
            return agent, scene

        place = self.lines[agent].T * square.shape[1] + scene
        if len(place) > 1:
            distance = square.ravel()[(place % square.size).T]
            order = np.argsort(distance, axis=1, kind="stable")[:, : self.max_neighbors]
            place = np.take_along_axis(place, order.T, axis=0)
        point, direction = (np.take(lines.reshape(2, -1), place, axis=1) for lines in (point, direction))
        direction *= np.take(square, place % square.size) < self.range

        velocity, wish = velocity.reshape(2, -1), np.take(wish.reshape(2, -1), who, axis=1)
        chosen, failed = _nearest(point, direction, np.take(velocity, who, axis=1), wish, self.top_speed)
        bad = np.flatnonzero(failed < len(place))
        if len(bad):
            point, direction = np.take(point, bad, axis=2), np.take(direction, bad, axis=2)
            _put(chosen, bad, _least_violating(point, direction, chosen[:, bad], failed[bad], self.top_speed))
        _put(velocity, who, chosen)
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
        rate = _select(touching, self.touching_rate, self.rate) if touching.any() else self.rate

        # w leads from the centre of the cut-off circle to the relative velocity.
        w = relative - rate * between
        w_square, along = _dot(w, w), _dot(w, between)
        circle = (along < 0) & (along * along > reach_square * w_square) | touching

        # The left leg if w turns left of the line between the agents, else, also when dead ahead, the right one.
        leg = np.sqrt(np.maximum(square - reach_square, 0))
        leg = _select(_cross(between, w) > 0, leg, -leg)
        toward = np.stack([between[0] * leg - between[1] * reach, between[0] * reach + between[1] * leg])
        toward *= ONE / np.maximum(square, TINY)
        change = _dot(relative, toward) * toward - relative

        length = np.sqrt(w_square)
        outward = w * (ONE / np.maximum(length, TINY))
        toward = _select(circle, np.stack([outward[1], -outward[0]]), toward)
        change = _select(circle, (reach * rate - length) * outward, change)
        change *= HALF
        return np.hstack([one + change, other - change]), np.hstack([toward, -toward]), square


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Scalar product along the first axis."""
    return a[0] * b[0] + a[1] * b[1]


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Signed area along the first axis."""
    return a[0] * b[1] - a[1] * b[0]


def _select(mask: np.ndarray, yes: np.ndarray, no: np.ndarray) -> np.ndarray:
    """Do what ``numpy.where`` does for finite numbers, without its branches: several times faster."""
    mask = mask.astype(np.float32)
    return yes * mask + no * (ONE - mask)


def _put(array: np.ndarray, place: np.ndarray, value: np.ndarray) -> None:
    """Do ``array[:, place] = value`` row by row, which is several times faster."""
    array[0][place], array[1][place] = value


def _nearest(point, direction, velocity, target, speed, along=False):
    """Solve M linear programs in the plane, of L half-planes and a circle each.

    Incremental, as in section 5 of the paper: half-planes are added one by one; when one excludes the best velocity so
    far, the new best one lies on its border.

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocity inside the circle alone; changed in place.
        target: [2, M] what to come close to; with ``along`` the unit vector to go far along.
        speed: Radius of the circle.
        along: What ``target`` is.

    Returns:
        Velocity [2, M], and [M] the first half-plane that could not be met (the velocity is then the best one before
        it), or L.
    """
    count = point.shape[1]
    failed = np.full(point.shape[2], count)
    for last in range(count):
        broken = _cross(direction[:, last], point[:, last] - velocity) > 0
        who = np.flatnonzero(broken & (failed == count))
        if not len(who):
            continue
        # The border is base + t * way; circle and earlier half-planes leave t in [left, right].
        base, way, goal = (np.take(a, who, axis=1) for a in (point[:, last], direction[:, last], target))
        middle = _dot(base, way)
        room = middle * middle + speed * speed - _dot(base, base)
        half = np.sqrt(np.maximum(room, 0))
        left, right, possible = -middle - half, half - middle, room >= 0
        if last:
            ways = np.take(direction[:, :last], who, axis=2)
            area = _cross(way[:, None], ways)
            slack = _cross(ways, base[:, None] - np.take(point[:, :last], who, axis=2))
            parallel = np.abs(area) <= PARALLEL
            t = slack / (area + parallel)
            right = np.minimum(right, (t + np.multiply(area <= PARALLEL, FAR, dtype=np.float32)).min(axis=0))
            left = np.maximum(left, (t - np.multiply(area >= -PARALLEL, FAR, dtype=np.float32)).max(axis=0))
            possible &= (left <= right) & ~(parallel & (slack < 0)).any(axis=0)
        if along:
            t = _select(_dot(goal, way) > 0, right, left)
        else:
            t = np.minimum(np.maximum(_dot(way, goal - base), left), right)
        best = base + t * way
        if not possible.all():
            failed[who[~possible]] = last
            who, best = who[possible], np.compress(possible, best, axis=1)
        _put(velocity, who, best)
    return velocity, failed


def _least_violating(point, direction, velocity, failed, speed):
    """Find the velocities that violate the half-planes of infeasible programs least (section 5.3 of the paper).

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocities before the half-plane that could not be met; changed in place.
        failed: [M] that half-plane.
        speed: Radius of the circle.

    Returns:
        [2, M] velocities.
    """
    worst = np.zeros(point.shape[2], np.float32)
    for last in range(failed.min(), point.shape[1]):
        violation = _cross(direction[:, last], point[:, last] - velocity)
        who = np.flatnonzero((violation > worst) & (failed <= last))
        if not len(who):
            continue
        # Where an earlier half-plane is violated less than this one: a half-plane again, bounded by the bisector.
        base, way = (np.take(a[:, last : last + 1], who, axis=2) for a in (point, direction))
        bases, ways = (np.take(a[:, :last], who, axis=2) for a in (point, direction))
        area = _cross(way, ways)
        parallel = np.abs(area) <= PARALLEL
        meet = base + _cross(ways, base - bases) / (area + parallel) * way
        meet = _select(parallel, HALF * (base + bases), meet)
        bisector = ways - way
        bisector *= ONE / np.maximum(np.sqrt(_dot(bisector, bisector)), TINY)
        bisector *= ~(parallel & (_dot(way, ways) > 0))
        inward = np.stack([-way[1, 0], way[0, 0]])
        better, stopped = _nearest(meet, bisector, inward * speed, inward, speed, along=True)
        # Feasible by definition: where rounding says otherwise the velocity stays.
        met = stopped == last
        _put(velocity, who[met], np.compress(met, better, axis=1))
        worst[who] = _cross(way[:, 0], base[:, 0] - np.take(velocity, who, axis=1))
    return velocity
