"""The linear programs of ORCA: the allowed velocity nearest to the preferred one, for many agents at once."""

from __future__ import annotations

import numpy as np

from motion_gym.envs.orca_engine.vectors import HALF, ONE, TINY, cross, dot, put, select

PARALLEL = np.float32(1e-5)
"""Lines are parallel if their unit directions span at most this area, as in RVO2."""
FAR = np.float32(1e30)


def nearest(point, direction, velocity, target, speed, along=False):
    """Solve M linear programs in the plane, of L half-planes and a circle each.

    Incremental, as in section 5 of the paper: half-planes are added one by one. If a half-plane excludes the best
    velocity so far, the new best velocity lies on its border.

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocity inside the circle alone; modified in place.
        target: [2, M] the velocity to approach; with ``along`` a unit vector, the direction to maximise.
        speed: Radius of the circle.
        along: Whether ``target`` is a direction.

    Returns:
        Velocity [2, M], and [M] the first half-plane that could not be satisfied, or L. In the first case the velocity
        is the best one without this half-plane.
    """
    count = point.shape[1]
    failed = np.full(point.shape[2], count)
    for last in range(count):
        broken = cross(direction[:, last], point[:, last] - velocity) > 0
        active = np.flatnonzero(broken & (failed == count))
        if not len(active):
            continue
        # The border is base + t * way; the circle and the earlier half-planes restrict t to [left, right].
        base, way, goal = (np.take(a, active, axis=1) for a in (point[:, last], direction[:, last], target))
        middle = dot(base, way)
        room = middle * middle + speed * speed - dot(base, base)
        half = np.sqrt(np.maximum(room, 0))
        left, right, possible = -middle - half, half - middle, room >= 0
        if last:
            ways = np.take(direction[:, :last], active, axis=2)
            area = cross(way[:, None], ways)
            slack = cross(ways, base[:, None] - np.take(point[:, :last], active, axis=2))
            parallel = np.abs(area) <= PARALLEL
            t = slack / (area + parallel)
            right = np.minimum(right, (t + np.multiply(area <= PARALLEL, FAR, dtype=np.float32)).min(axis=0))
            left = np.maximum(left, (t - np.multiply(area >= -PARALLEL, FAR, dtype=np.float32)).max(axis=0))
            possible &= (left <= right) & ~(parallel & (slack < 0)).any(axis=0)
        if along:
            t = select(dot(goal, way) > 0, right, left)
        else:
            t = np.minimum(np.maximum(dot(way, goal - base), left), right)
        best = base + t * way
        if not possible.all():
            failed[active[~possible]] = last
            active, best = active[possible], np.compress(possible, best, axis=1)
        put(velocity, active, best)
    return velocity, failed


def least_violating(point, direction, velocity, failed, speed):
    """Find the velocities that violate the half-planes of infeasible programs least (section 5.3 of the paper).

    Args:
        point: [2, L, M] a point on each border.
        direction: [2, L, M] its direction.
        velocity: [2, M] the best velocities without the half-plane that could not be satisfied; modified in place.
        failed: [M] this half-plane.
        speed: Radius of the circle.

    Returns:
        [2, M] velocities.
    """
    worst = np.zeros(point.shape[2], np.float32)
    for last in range(failed.min(), point.shape[1]):
        violation = cross(direction[:, last], point[:, last] - velocity)
        active = np.flatnonzero((violation > worst) & (failed <= last))
        if not len(active):
            continue
        # The velocities that violate an earlier half-plane less than this one are a half-plane bounded by the bisector.
        base, way = (np.take(a[:, last : last + 1], active, axis=2) for a in (point, direction))
        bases, ways = (np.take(a[:, :last], active, axis=2) for a in (point, direction))
        area = cross(way, ways)
        parallel = np.abs(area) <= PARALLEL
        meet = base + cross(ways, base - bases) / (area + parallel) * way
        meet = select(parallel, HALF * (base + bases), meet)
        bisector = ways - way
        bisector *= ONE / np.maximum(np.sqrt(dot(bisector, bisector)), TINY)
        bisector *= ~(parallel & (dot(way, ways) > 0))
        inward = np.stack([-way[1, 0], way[0, 0]])
        better, stopped = nearest(meet, bisector, inward * speed, inward, speed, along=True)
        # Feasible by definition; where rounding makes it infeasible, the velocity is unchanged.
        met = stopped == last
        put(velocity, active[met], np.compress(met, better, axis=1))
        worst[active] = cross(way[:, 0], base[:, 0] - np.take(velocity, active, axis=1))
    return velocity
