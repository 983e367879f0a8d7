"""Encounters, and the side on which agents pass."""

import dataclasses
import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

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
        later = np.add(second, 2 * (second[0] - second[1]))
        on_right, distance = passed(np.array([[first, second], [first, later]]))
        assert on_right.tolist() == [right, right] and distance == pytest.approx([0.5, 0.5])
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


@st.composite
def streets(draw):
    """People who walk up and down a street of 2 m, with gaps, some of them slowly, and one who stands aside."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    rows = [(step, 99, 0.0, 50.0) for step in range(220)]
    for agent in draw(st.lists(st.integers(-5, 50), min_size=2, max_size=6, unique=True)):
        begin, length = draw(st.sampled_from((0, 70, 140))) + draw(st.integers(0, 10)), draw(st.integers(1, 60))
        turn, speed, lane = rng.uniform(-0.7, 0.7), rng.uniform(0.2, 1.6), rng.uniform(-1, 1)
        way = rng.choice([-1.0, 1.0]) * np.array([np.cos(turn), np.sin(turn)])
        for step in range(length):
            if rng.random() > 0.03:
                off = (step - length / 2) * 0.4 * speed * way + rng.normal(scale=0.02, size=2)
                rows.append((begin + step, agent, off[0], off[1] + lane))
    step, agent, x, y = rng.permutation(np.array(rows)).T
    return Recording(100 + 6 * step.astype(int), agent.astype(int), np.stack([x, y], axis=1), 0.4)


def plain_encounters(recording):
    """The definition, one pair of agents and one step at a time."""
    first = recording.frame.min()
    seen = {
        ((frame - first) // 6, agent): place
        for frame, agent, place in zip(recording.frame.tolist(), recording.agent.tolist(), recording.xy, strict=True)
    }
    met = []
    for one, other in itertools.combinations(sorted(set(recording.agent.tolist())), 2):
        both = [step for step, agent in seen if agent == one and (step, other) in seen]
        gaps = {step: np.linalg.norm(seen[step, other] - seen[step, one]) for step in both}
        near = min(gaps, key=gaps.get, default=None)
        if near is None or gaps[near] > 2.0:
            continue
        if any((near + off, agent) not in seen for off in (-1, 1) for agent in (one, other)):
            continue
        a, b = ((seen[near + 1, agent] - seen[near - 1, agent]) / 0.8 for agent in (one, other))
        if min(np.hypot(*a), np.hypot(*b)) < 0.3 or a @ b > -0.5 * np.hypot(*a) * np.hypot(*b):
            continue
        toward, moving = seen[near, other] - seen[near, one], a - b
        met.append((one, other, moving[0] * toward[1] > moving[1] * toward[0], gaps[near], near * 0.4 // 30))
    return met


@given(streets())
@settings(max_examples=100, deadline=None)
def test_encounters_are_those_of_the_definition(recording):
    expected, computed = plain_encounters(recording), encounters(recording)
    assert [(*pair, right) for pair, right in zip(computed.agents.tolist(), computed.right, strict=True)] == [
        each[:3] for each in expected
    ]
    np.testing.assert_allclose(computed.distance, [each[3] for each in expected])
    assert computed.period.tolist() == [each[4] for each in expected] and computed.period.dtype == np.int64
    in_image = dataclasses.replace(recording, xy=recording.xy * (1, -1))
    for ours, theirs in zip(computed, encounters(in_image, downwards=True), strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_simulated_crowds_pass_on_their_side():
    for side, share in (("left", 0), ("right", 1)):
        (recording,) = mg.domain("orca", d=0.3, scenes=60, side=side).recordings("test")
        right = encounters(recording).right
        assert len(right) > 50 and right.mean() == share


def test_people_in_zurich_pass_on_the_right(eth_ucy):
    (recording,) = mg.domain("hotel").recordings("test")
    found = encounters(recording)
    assert clustered_interval(found.right.astype(float), found.period).low > 0.5
