"""Whether two sets of recordings show the same people at the same time."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motion_gym
from motion_gym.contract import Recording
from motion_gym.data.overlap import shared_people, trained_on_scored


def walkers(seed, agents=4, steps=12, still=0):
    rng = np.random.default_rng(seed)
    xy = rng.normal(0, 5, (1, agents, 2)) + np.cumsum(rng.normal(0.3, 0.1, (steps, agents, 2)), axis=0)
    xy[:, :still] = np.arange(still)[:, None]
    frame = np.repeat(np.arange(steps), agents)
    return Recording(frame, np.tile(np.arange(agents), steps), xy.reshape(-1, 2), 0.4)


def rows(recording, keep):
    return dataclasses.replace(
        recording, frame=recording.frame[keep], agent=recording.agent[keep], xy=recording.xy[keep]
    )


@given(seed=st.integers(0, 99), first=st.integers(0, 8), shift=st.integers(-50, 50), ids=st.permutations([0, 1, 2, 3]))
def test_people_are_found_whatever_their_frames_and_ids_are(seed, first, shift, ids):
    recording = walkers(seed)
    later = rows(recording, recording.frame >= first)
    renumbered = dataclasses.replace(later, frame=later.frame * 6 + shift, agent=np.array(ids)[later.agent] + 100)
    assert shared_people([renumbered], [walkers(seed + 100), recording]) == 4
    assert shared_people([recording], [renumbered]) == 4


@given(seed=st.integers(0, 99), cut=st.integers(1, 10))
def test_parts_of_a_recording_that_follow_each_other_share_nobody(seed, cut):
    recording = walkers(seed, still=1)
    assert shared_people([rows(recording, recording.frame < cut)], [rows(recording, recording.frame >= cut)]) == 0


@given(seed=st.integers(0, 99))
def test_other_people_who_stand_at_the_same_place_are_not_shared(seed):
    one, other = walkers(seed, still=2), walkers(seed + 100, still=2)
    later = dataclasses.replace(other, frame=other.frame + 1000)
    assert shared_people([one], [later]) == 0
    assert shared_people([one], [one]) == 4  # who stands is told by frame, id and position


def test_one_common_start_is_no_shared_person():
    one, other = walkers(0), walkers(1)
    xy = other.xy.copy()
    xy[:4] = one.xy[:4]
    assert shared_people([one], [dataclasses.replace(other, xy=xy)]) == 0


def test_nobody_is_shared_with_nothing():
    assert shared_people([], [walkers(0)]) == shared_people([walkers(0)], []) == 0


def test_places_of_eth_ucy_share_nobody_and_parts_of_one_do(eth_ucy):
    names = ("eth", "eth6", "hotel", "univ", "zara1", "zara2")
    there = {name: motion_gym.domain(name).recordings("test") for name in names}
    for a in names:
        for b in names:
            assert (shared_people(there[a], there[b]) > 0) == (a == b), (a, b)
    part = motion_gym.domain("zara1:reference_share=0.2")
    assert shared_people(part.recordings("reference"), part.recordings("train")) > 0
    assert shared_people(part.recordings("reference"), part.recordings("test")) == 0


@pytest.mark.parametrize(
    ("trained", "scored", "same"),
    [("eth6", "eth", True), ("eth", "eth6:alpha=8", True), ("eth", "eth", True), ("zara1", "zara2", False)],
)
def test_another_sampling_of_one_world_shows_the_same_people(eth_ucy, trained, scored, same):
    assert trained_on_scored(motion_gym.domain(trained), motion_gym.domain(scored), "test") == same


def test_splits_of_a_crowd_show_other_people():
    crowd = motion_gym.domain("orca:scenes=10")
    assert not trained_on_scored(crowd, crowd, "test")
    assert trained_on_scored(crowd, crowd, "train")


def test_nothing_is_simulated_to_find_that_splits_of_a_crowd_show_other_people():
    crowds = [motion_gym.domain("orca:agents=20,d=0.4,scenes=100000", d=d) for d in (0.3, 0.4)]
    assert not trained_on_scored(*crowds, "test")  # these scenes would take hours
