"""The linear programs of ORCA: the allowed velocity of an agent that is nearest to its preferred one."""

from __future__ import annotations

import math

import numpy as np

from motion_gym.envs.orca_engine.vectors import HALF, ONE, ZERO, cross, dot, loop

PARALLEL = np.float32(1e-5)
"""Lines are parallel if their unit directions span at most this area, as in RVO2."""


@loop
def nearest(point, direction, count, velocity, target, speed, along):
    """Solve a linear program in the plane, of some half-planes and a circle.

    Incremental, as in section 5 of the paper: half-planes are added one by one. If a half-plane excludes the best
    velocity so far, the new best velocity lies on its border.

    Args:
        point: [L, 2] float32, a point on the border of each half-plane.
        direction: [L, 2] its unit direction, with the allowed velocities on its left.
        count: Number of half-planes, at most L.
        velocity: [2] the best velocity inside the circle alone; modified in place.
        target: [2] the velocity to approach; with ``along`` a unit vector, the direction to maximise.
        speed: Radius of the circle.
        along: Whether ``target`` is a direction.

    Returns:
        The first half-plane that could not be satisfied, or ``count``. In the first case the velocity is the best one
        without this half-plane.
    """
    for last in range(count):
        base_x, base_y = point[last, 0], point[last, 1]
        way_x, way_y = direction[last, 0], direction[last, 1]
        if cross(way_x, way_y, base_x - velocity[0], base_y - velocity[1]) <= ZERO:
            continue
        # The border is base + t * way; the circle and the earlier half-planes restrict t to [left, right].
        middle = dot(base_x, base_y, way_x, way_y)
        room = middle * middle + speed * speed - dot(base_x, base_y, base_x, base_y)
        if room < ZERO:
            return last
        half = np.float32(math.sqrt(room))
        left, right = -middle - half, half - middle
        for earlier in range(last):
            area = cross(way_x, way_y, direction[earlier, 0], direction[earlier, 1])
            slack = cross(
                direction[earlier, 0], direction[earlier, 1], base_x - point[earlier, 0], base_y - point[earlier, 1]
            )
            if abs(area) <= PARALLEL:
                if slack < ZERO:
                    return last
            elif area >= ZERO:
                right = min(right, slack / area)
            else:
                left = max(left, slack / area)
            if left > right:
                return last
        if along:
            t = right if dot(target[0], target[1], way_x, way_y) > ZERO else left
        else:
            t = min(max(dot(way_x, way_y, target[0] - base_x, target[1] - base_y), left), right)
        velocity[0], velocity[1] = base_x + t * way_x, base_y + t * way_y
    return count


@loop
def least_violating(point, direction, count, velocity, failed, speed, work):
    """Find the velocity that violates the half-planes of an infeasible program least (section 5.3 of the paper).

    Args:
        point: See ``nearest``.
        direction: See ``nearest``.
        count: See ``nearest``.
        velocity: [2] the best velocity without the half-plane that could not be satisfied; modified in place.
        failed: This half-plane.
        speed: Radius of the circle.
        work: [2, L, 2] float32, memory for half-planes.
    """
    meets, bisectors = work[0], work[1]
    better, inward = np.empty(2, np.float32), np.empty(2, np.float32)
    worst = ZERO
    for last in range(failed, count):
        base_x, base_y = point[last, 0], point[last, 1]
        way_x, way_y = direction[last, 0], direction[last, 1]
        if cross(way_x, way_y, base_x - velocity[0], base_y - velocity[1]) <= worst:
            continue
        # The velocities that violate an earlier half-plane less than this one are a half-plane bounded by the bisector.
        used = 0
        for earlier in range(last):
            x, y = point[earlier, 0], point[earlier, 1]
            other_x, other_y = direction[earlier, 0], direction[earlier, 1]
            area = cross(way_x, way_y, other_x, other_y)
            if abs(area) <= PARALLEL:
                if dot(way_x, way_y, other_x, other_y) > ZERO:
                    continue
                meets[used, 0], meets[used, 1] = HALF * (base_x + x), HALF * (base_y + y)
            else:
                t = cross(other_x, other_y, base_x - x, base_y - y) / area
                meets[used, 0], meets[used, 1] = base_x + t * way_x, base_y + t * way_y
            turn_x, turn_y = other_x - way_x, other_y - way_y
            rate = ONE / np.float32(math.sqrt(dot(turn_x, turn_y, turn_x, turn_y)))
            bisectors[used, 0], bisectors[used, 1] = turn_x * rate, turn_y * rate
            used += 1
        inward[0], inward[1] = -way_y, way_x
        better[0], better[1] = inward[0] * speed, inward[1] * speed
        # Feasible by definition; where rounding makes it infeasible, the velocity is unchanged.
        if nearest(meets, bisectors, used, better, inward, speed, True) == used:
            velocity[0], velocity[1] = better[0], better[1]
        worst = cross(way_x, way_y, base_x - velocity[0], base_y - velocity[1])
