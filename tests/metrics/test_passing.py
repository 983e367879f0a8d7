"""Encounters, and the side on which agents pass."""

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.contract import Recording
from motion_gym.metrics.bootstrap import clustered_interval
from motion_gym.metrics.passing import encounters, passed

EAST = np.stack([np.linspace(-4, 4, 21), np.zeros(21)], axis=1)
"""A walk to the east at 1 m/s, in steps of 0.4 s."""


def recording_of(*paths):
    """A recording in which all paths [T, 2] begin in the same step."""
    rows = [(step, agent, *place) for agent, path in enumerate(paths) for step, place in enumerate(path)]
    frame, agent, x, y = np.array(sorted(rows)).T
    return Recording(frame, agent, np.stack([x, y], axis=1), 0.4)


@pytest.mark.parametrize(("north", "right"), [(0.5, True), (-0.5, False)])
def test_an_agent_with_the_other_on_its_left_passes_on_the_right(north, right):
    west = np.add(EAST[::-1], (0, north))
    for first, second in ((EAST, west), (west, EAST)):
        one = encounters(recording_of(first, second))
        assert one.right.tolist() == [right] and one.agents.tolist() == [[0, 1]]
        assert one.distance == pytest.approx([0.5])
        on_right, distance = passed(np.stack([first, second])[None])
        assert on_right.tolist() == [right] and distance == pytest.approx([0.5])
    assert encounters(recording_of(EAST, west), downwards=True).right.tolist() == [not right]


@pytest.mark.parametrize(
    "other",
    [
        np.add(EAST, (0.5, 0.5)),  # the same way
        np.add(EAST[::-1], (0, 2.5)),  # too far
        np.tile((0, 0.5), (21, 1)),  # stands
        np.add(EAST[:, ::-1], (0, 0.5)),  # crosses
        np.add(EAST[::-1][:11], (0, 0.5)),  # leaves where they are nearest
    ],
)
def test_other_pairs_are_no_encounters(other):
    assert len(encounters(recording_of(EAST, other)).right) == 0


def test_simulated_crowds_pass_on_their_side():
    for side, share in (("left", 0), ("right", 1)):
        (recording,) = mg.domain("orca", d=0.3, scenes=60, side=side).recordings("test")
        right = encounters(recording).right
        assert len(right) > 50 and right.mean() == share


def test_people_in_zurich_pass_on_the_right(eth_ucy):
    (recording,) = mg.domain("hotel").recordings("test")
    found = encounters(recording)
    assert clustered_interval(found.right.astype(float), found.period).low > 0.5
