"""A scene of ORCA, step by step: half-planes of allowed velocities, then velocities, then positions."""

from __future__ import annotations

import math

import numpy as np

from motion_gym.envs.orca_engine.linear_program import least_violating, nearest
from motion_gym.envs.orca_engine.vectors import HALF, ONE, TINY, ZERO, cross, dot, loop


@loop
def play(start, goal, radius, rules, max_speed, steps, first, every, paths, infeasible):  # type: ignore[no-untyped-def]
    """Simulate scenes one after another.

    Args:
        start: [S, N, 2] float64, metres.
        goal: [S, N, 2] float64, metres.
        radius: [S] float32, metres.
        rules: (seconds per step, 1 / time horizon, square of the distance at which neighbours begin to count, maximum
            speed), each float32, the largest number of neighbours, and the lean (float32): above 0 agents prefer to
            pass on the right, below 0 on the left.
        max_speed: The maximum speed in double precision.
        steps: Number of steps.
        first: Steps before the first frame.
        every: Steps between frames.
        paths: [S, F, N, 2] float64, filled with the positions at the frames.
        infeasible: [S, N] int64, -1; set to the first step in which no velocity satisfied all half-planes of an agent.
    """
    agents = start.shape[1]
    position, velocity = np.empty((agents, 2), np.float32), np.empty((agents, 2), np.float32)
    chosen, preferred = np.empty((agents, 2), np.float32), np.empty(2, np.float32)
    point, direction = np.empty((agents, agents, 2), np.float32), np.empty((agents, agents, 2), np.float32)
    square = np.empty((agents, agents), np.float32)
    near, distance = np.empty(agents, np.int64), np.empty(agents, np.float32)
    work = np.empty((4, agents, 2), np.float32)
    for scene in range(len(start)):
        for agent in range(agents):
            for axis in range(2):
                position[agent, axis], velocity[agent, axis] = np.float32(start[scene, agent, axis]), ZERO
        for step in range(steps):
            half_planes(position, velocity, radius[scene], rules, point, direction, square)
            for agent in range(agents):
                prefer(goal[scene, agent], position[agent], max_speed, rules[3], preferred, chosen[agent])
                count = nearest_neighbors(agent, square, rules, near, distance)
                allowed = avoid(agent, point, direction, near, count, preferred, chosen[agent], rules[3], work)
                if not allowed and infeasible[scene, agent] < 0:
                    infeasible[scene, agent] = step
            kept = step + 1 >= first and (step + 1 - first) % every == 0
            for agent in range(agents):
                for axis in range(2):
                    velocity[agent, axis] = chosen[agent, axis]
                    position[agent, axis] += chosen[agent, axis] * rules[0]
                    if kept:
                        paths[scene, (step + 1 - first) // every, agent, axis] = position[agent, axis]


@loop
def prefer(goal, position, max_speed, top_speed, preferred, chosen):  # type: ignore[no-untyped-def]
    """Fill in the preferred velocity [2], straight to the goal and slower near it, and a copy with a limited speed."""
    # An input of RVO2, which its caller computes in double precision.
    x, y = goal[0] - position[0], goal[1] - position[1]
    slower = max(math.sqrt(x * x + y * y) / max_speed, 1.0)
    preferred[0], preferred[1] = np.float32(x / slower), np.float32(y / slower)
    square = dot(preferred[0], preferred[1], preferred[0], preferred[1])
    chosen[0], chosen[1] = preferred[0], preferred[1]
    if square > top_speed * top_speed:
        rate = ONE / np.float32(math.sqrt(square))
        chosen[0], chosen[1] = preferred[0] * rate * top_speed, preferred[1] * rate * top_speed


@loop
def half_planes(position, velocity, radius, rules, point, direction, square):  # type: ignore[no-untyped-def]
    """Fill in the half-planes of every pair (section 4 of the paper); those of its two agents are mirror images.

    With a lean, the border touches the velocity obstacle not where the relative velocity is nearest to it, but further
    to one side: at the place that w + lean |w| r has in the paper, where w points from the centre of the cut-off circle
    to the relative velocity, and r is the unit vector to the right of the line to the other agent. The obstacle is
    convex, so that every such half-plane excludes all of it, and no collision is allowed. Both agents of a pair choose
    the same border.

    Args:
        position: [N, 2] metres.
        velocity: [N, 2] m/s.
        radius: Radius of the agents, metres.
        rules: See ``play``.
        point: [N, N, 2] a point on the border of the half-plane of an agent (first index) because of another.
        direction: [N, N, 2] the unit direction of the border, with the allowed velocities on its left.
        square: [N, N] squared distances.
    """
    reach = radius + radius
    reach_square = reach * reach
    for one in range(len(position)):
        for other in range(one + 1, len(position)):
            x, y = position[other, 0] - position[one, 0], position[other, 1] - position[one, 1]
            fast_x, fast_y = velocity[one, 0] - velocity[other, 0], velocity[one, 1] - velocity[other, 1]
            apart = dot(x, y, x, y)
            touching = apart <= reach_square
            rate = ONE / rules[0] if touching else rules[1]

            # w points from the centre of the cut-off circle to the relative velocity.
            w_x, w_y = fast_x - rate * x, fast_y - rate * y
            bent_x, bent_y = w_x, w_y
            if rules[5] != ZERO:
                bend = rules[5] * np.float32(math.sqrt(dot(w_x, w_y, w_x, w_y) / max(apart, TINY)))
                bent_x, bent_y = w_x + bend * y, w_y - bend * x
            w_square, along = dot(bent_x, bent_y, bent_x, bent_y), dot(bent_x, bent_y, x, y)
            if touching or (along < ZERO and along * along > reach_square * w_square):
                length = np.float32(math.sqrt(w_square))
                unit = ONE / max(length, TINY)
                out_x, out_y = bent_x * unit, bent_y * unit
                way_x, way_y = out_y, -out_x
                size = reach * rate - (length if rules[5] == ZERO else dot(w_x, w_y, out_x, out_y))
                change_x, change_y = size * out_x, size * out_y
            else:
                # The left leg if w points left of the line between the agents; otherwise the right leg.
                leg = np.float32(math.sqrt(max(apart - reach_square, ZERO)))
                if cross(x, y, bent_x, bent_y) <= ZERO:
                    leg = -leg
                unit = ONE / max(apart, TINY)
                way_x, way_y = (x * leg - y * reach) * unit, (x * reach + y * leg) * unit
                size = dot(fast_x, fast_y, way_x, way_y)
                change_x, change_y = size * way_x - fast_x, size * way_y - fast_y
            change_x, change_y = change_x * HALF, change_y * HALF
            point[one, other, 0], point[one, other, 1] = velocity[one, 0] + change_x, velocity[one, 1] + change_y
            point[other, one, 0], point[other, one, 1] = velocity[other, 0] - change_x, velocity[other, 1] - change_y
            direction[one, other, 0], direction[one, other, 1] = way_x, way_y
            direction[other, one, 0], direction[other, one, 1] = -way_x, -way_y
            square[one, other] = square[other, one] = apart


@loop
def nearest_neighbors(agent, square, rules, near, distance):  # type: ignore[no-untyped-def]
    """Fill in the neighbors within range, nearest first, and their squared distances; return their number."""
    count = 0
    for other in range(len(square)):
        apart = square[agent, other]
        if other == agent or apart >= rules[2] or (count == rules[4] and apart >= distance[count - 1]):
            continue
        at = count if count < rules[4] else count - 1
        while at > 0 and distance[at - 1] > apart:
            near[at], distance[at] = near[at - 1], distance[at - 1]
            at -= 1
        near[at], distance[at] = other, apart
        count = min(count + 1, rules[4])
    return count


@loop
def avoid(agent, point, direction, near, count, preferred, chosen, speed, work):  # type: ignore[no-untyped-def]
    """Replace a chosen velocity [2] by the allowed one that is nearest to the preferred one.

    Returns:
        Whether a velocity satisfies all half-planes; if none does, the one that violates them least is chosen.
    """
    points, directions = work[0], work[1]
    for place in range(count):
        for axis in range(2):
            points[place, axis] = point[agent, near[place], axis]
            directions[place, axis] = direction[agent, near[place], axis]
    failed = nearest(points, directions, count, chosen, preferred, speed, False)
    if failed < count:
        least_violating(points, directions, count, chosen, failed, speed, work[2:])
    return failed == count
