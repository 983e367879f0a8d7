"""The linear programs of ORCA: the allowed velocity that is nearest to the preferred one, many at a time."""

from __future__ import annotations

import numpy as np

from motion_gym.envs.orca_engine.vectors import HALF, ONE, TINY, cross, dot, put, select

PARALLEL = np.float32(1e-5)
"""Lines whose unit directions span no more than this area count as parallel, as in RVO2."""
FAR = np.float32(1e30)


def nearest(point, direction, velocity, target, speed, along=False):
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
        broken = cross(direction[:, last], point[:, last] - velocity) > 0
        who = np.flatnonzero(broken & (failed == count))
        if not len(who):
            continue
        # The border is base + t * way; circle and earlier half-planes leave t in [left, right].
        base, way, goal = (np.take(a, who, axis=1) for a in (point[:, last], direction[:, last], target))
        middle = dot(base, way)
        room = middle * middle + speed * speed - dot(base, base)
        half = np.sqrt(np.maximum(room, 0))
        left, right, possible = -middle - half, half - middle, room >= 0
        if last:
            ways = np.take(direction[:, :last], who, axis=2)
            area = cross(way[:, None], ways)
            slack = cross(ways, base[:, None] - np.take(point[:, :last], who, axis=2))
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
            failed[who[~possible]] = last
            who, best = who[possible], np.compress(possible, best, axis=1)
        put(velocity, who, best)
    return velocity, failed


def least_violating(point, direction, velocity, failed, speed):
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
        violation = cross(direction[:, last], point[:, last] - velocity)
        who = np.flatnonzero((violation > worst) & (failed <= last))
        if not len(who):
            continue
        # Where an earlier half-plane is violated less than this one: a half-plane again, bounded by the bisector.
        base, way = (np.take(a[:, last : last + 1], who, axis=2) for a in (point, direction))
        bases, ways = (np.take(a[:, :last], who, axis=2) for a in (point, direction))
        area = cross(way, ways)
        parallel = np.abs(area) <= PARALLEL
        meet = base + cross(ways, base - bases) / (area + parallel) * way
        meet = select(parallel, HALF * (base + bases), meet)
        bisector = ways - way
        bisector *= ONE / np.maximum(np.sqrt(dot(bisector, bisector)), TINY)
        bisector *= ~(parallel & (dot(way, ways) > 0))
        inward = np.stack([-way[1, 0], way[0, 0]])
        better, stopped = nearest(meet, bisector, inward * speed, inward, speed, along=True)
        # Feasible by definition: where rounding says otherwise the velocity stays.
        met = stopped == last
        put(velocity, who[met], np.compress(met, better, axis=1))
        worst[who] = cross(way[:, 0], base[:, 0] - np.take(velocity, who, axis=1))
    return velocity
