"""Paths, footprints, proposals and the choice among them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_gym.driving.footprints import RADIUS, clearance, states_of, time_to_collision
from motion_gym.driving.paths import Path
from motion_gym.driving.planner import plan
from motion_gym.driving.proposals import BRAKE, DT, FRACTIONS, Ego, propose, state_of

ROAD = Path(np.array([[0.0, 0.0], [600.0, 0.0]]), 4.0, -4.0, 4.0, 25.0)
TURN = np.linspace(0, np.pi / 2, 30)
CURVE = Path(30 * np.stack([np.sin(TURN), 1 - np.cos(TURN)], axis=-1), 1.0, -1.0, 1.0, 10.0)
NOBODY = np.zeros((0, 13, 2))
NO_HEADING = np.zeros(0)


def driving(x, y, speed):
    """[1, 13, 2] a vehicle that drives along x at a speed, now and at the 12 steps ahead."""
    at = x + speed * DT * np.arange(13)
    return np.stack([at, np.full(13, y)], axis=-1)[None]


@given(st.floats(-20, 60), st.floats(-2, 2))
def test_positions_on_a_path_are_found_again(s, d):
    there = CURVE.position(np.array(s), np.array(d))
    again = np.array(CURVE.local(there))
    assert again == pytest.approx([s, d], abs=0.15)


def test_a_mirrored_path_has_its_left_at_the_right():
    mirror = CURVE.mirrored()
    s, d = np.array([10.0, 40.0]), np.array([0.5, 1.0])
    assert mirror.position(s, -d) == pytest.approx(CURVE.position(s, d) * (1, -1))


def test_footprints_touch_and_collide_when_they_should():
    ego = np.array([0.0, 0.0, 0.0, 20.0])
    ahead = np.array([[30.0, 0.0, 0.0, 10.0], [30.0, 4.0, 0.0, 10.0], [-30.0, 0.0, 0.0, 10.0]])
    gap = 30 - 2 * (5 / 3) - 2 * RADIUS
    assert clearance(ego, ahead)[0] == pytest.approx(gap)
    assert time_to_collision(ego, ahead) == pytest.approx([gap / 10, np.inf, np.inf])
    beside = np.array([[0.0, 2.0, 0.0, 20.0], [0.0, 4.0, 0.0, 20.0]])
    assert (clearance(ego, beside) < 0).tolist() == [True, False]
    assert time_to_collision(ego, beside).tolist() == [0.0, np.inf]


def test_a_standing_vehicle_keeps_its_heading():
    xy = np.array([[[0.0, 0.0], [0.0, 4.0], [0.01, 4.0]], [[5.0, 5.0]] * 3])
    states = states_of(xy, DT, np.array([0.0, 1.0]))
    assert states[:, :, 2] == pytest.approx(np.array([[np.pi / 2] * 2, [1.0] * 2]))
    assert states[0, :, 3] == pytest.approx([10.0, 0.025])


def test_proposals_reach_their_speeds_and_lanes_on_an_empty_road():
    plans = propose(Ego(10.0, 15.0, 0.4), ROAD, NOBODY)
    assert plans.goal[:BRAKE] == pytest.approx(np.repeat([0.0, 4.0, -4.0], 5))
    assert (np.diff(plans.speed[:5, -1]) < 0).all(), "a lower fraction is slower"
    assert plans.speed[4, -1] < 8 and 15 < plans.speed[0, -1] <= 25 * FRACTIONS[0]
    assert np.abs(plans.d[:BRAKE, -1] - plans.goal[:BRAKE]).max() < 0.25
    assert plans.speed[BRAKE, -1] == 0 and (np.diff(plans.s, axis=1) >= 0).all()


@given(st.floats(0, 30), st.floats(-4, 4), st.floats(-1, 1), st.integers(0, BRAKE))
def test_the_first_step_of_a_plan_is_driven_as_it_was_planned(speed, d, drift, number):
    plans = propose(Ego(10.0, speed, d, drift), ROAD, NOBODY)
    later = plans.after(number, DT)
    planned = [x[number, 1] for x in (plans.s, plans.speed, plans.d, plans.drift)]
    assert [later.s, later.speed, later.d, later.drift] == pytest.approx(planned, abs=1e-9)


def test_a_leader_is_followed_in_its_lane_only():
    plans = propose(Ego(10.0, 25.0, 0.0), ROAD, driving(50.0, 0.0, 10.0))
    assert plans.speed[0, -1] < 15 and plans.s[0, -1] < 50 + 10 * 4.8
    # The lane beside it is free, but the leader counts until the ego vehicle has left its lane.
    assert propose(Ego(10.0, 25.0, 4.0), ROAD, driving(50.0, 0.0, 10.0)).speed[0, -1] > 24


def test_the_planner_drives_on_where_nobody_is():
    plans, scored, number = plan(Ego(10.0, 25.0, 0.0), ROAD, NOBODY, NO_HEADING)
    assert number == 0 and scored.total[0] == pytest.approx(1.0)
    assert not scored.on_road[np.abs(plans.goal) > 4].any()


def test_the_planner_brakes_where_every_proposal_collides():
    wall = np.concatenate([driving(30.0, y, 0.0) for y in (-4.0, -2.0, 0.0, 2.0, 4.0)])
    _, scored, number = plan(Ego(10.0, 25.0, 0.0), ROAD, wall, np.zeros(5))
    assert number == BRAKE and scored.collides[:BRAKE].all()


def test_a_vehicle_that_hits_from_behind_is_no_collision_of_the_ego_vehicle():
    behind = driving(0.0, 0.0, 40.0)
    plans, scored, number = plan(Ego(20.0, 20.0, 0.0), ROAD, behind, np.zeros(1))
    assert not scored.collides[: len(FRACTIONS)].any() and plans.goal[number] == 0


def test_forecasts_decide_whether_the_ego_vehicle_passes():
    ego, path = Ego(0.0, 8.0, 0.0), CURVE
    there = state_of(Ego(24.0, 0.0, 0.0), path)[:2]
    crossing = there + np.linspace(-24, 24, 13)[:, None] * np.array([0.6, -0.8])  # on the path after 2.4 s
    away = there + 24 + np.zeros((13, 2))
    chosen = {}
    for name, others in (("crossing", crossing), ("away", away)):
        plans, scored, number = plan(ego, path, others[None], np.array([-0.9]))
        chosen[name] = plans.s[number, -1]
        assert not scored.collides[number]
    assert chosen["crossing"] < chosen["away"]
