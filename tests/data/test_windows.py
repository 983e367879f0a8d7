from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motion_gym
from motion_gym.contract import DataError, Observation, Recording, Truth
from motion_gym.data.windows import Tracks, pick_scenes, positions_only, stack, step_numbers
from motion_gym.stepping.stream_clock import StreamClock
from tests.windows import windows_of

WHOLE = {
    "eth": (70, 181),
    "hotel": (301, 1053),
    "univ": (947, 24334),
    "zara1": (602, 2253),
    "zara2": (921, 5833),
}
TRAINING = {
    "biwi_hotel": ("hotel", (231, 758)),
    "crowds_zara01": ("zara1", (503, 1900)),
    "crowds_zara02": ("zara2", (713, 4403)),
    "crowds_zara03": ("zara2", (430, 1646)),
    "students001": ("univ", (336, 11691)),
    "students003": ("univ", (413, 8988)),
    "uni_examples": ("univ", (159, 423)),
}


SPELLS = st.sampled_from((1, 7, 8, 12, 19, 20, 22, 30))


@st.composite
def recordings(draw):
    """Up to five agents, each in sight for up to three spells; a frame is listed only if an agent is in sight."""
    rows = []
    for agent in draw(st.lists(st.integers(0, 9), unique=True, max_size=5)):
        frame = draw(st.integers(0, 6))
        for spell in draw(st.lists(SPELLS, min_size=1, max_size=3)):
            rows += [(5 + 10 * f, agent) for f in range(frame, frame + spell)]
            frame += spell + draw(st.integers(1, 4))
    frame, agent = np.array(sorted(rows), np.int64).reshape(-1, 2).T
    xy = np.random.default_rng(draw(st.integers(0, 99))).normal(size=(len(rows), 2))
    return Recording(frame, agent, xy, 0.4, listed=True)


def plain_windows(recording: Recording, min_agents: int, stride: int):
    """[(ids, positions)] of every window, without an array operation."""
    frames = sorted({int(f) for f in recording.frame})
    where = {
        (int(f), int(a)): tuple(xy) for f, a, xy in zip(recording.frame, recording.agent, recording.xy, strict=True)
    }
    ids = sorted({a for _, a in where})
    windows = []
    for start in range(0, len(frames) - 19, stride):
        chosen = frames[start : start + 20]
        complete = [a for a in ids if all((f, a) in where for f in chosen)]
        if len(complete) >= max(1, min_agents):
            windows.append((complete, [[where[f, a] for f in chosen] for a in complete]))
    return windows


def assert_windows(truth: Truth, expected) -> None:
    observation = truth.observation
    assert np.diff(observation.scene).tolist() == [len(ids) for ids, _ in expected]
    assert observation.agent.tolist() == [a for ids, _ in expected for a in ids]
    positions = np.array([p for _, paths in expected for p in paths], np.float32).reshape(-1, 20, 2)
    np.testing.assert_array_equal(np.concatenate([observation.xy, truth.future], axis=1), positions)
    assert truth.known.all() and truth.known.shape == (len(positions), 12)


def random_truth(sizes: list[int], seed: int = 0, features: int = 3) -> Truth:
    rng, agents = np.random.default_rng(seed), sum(sizes)
    scene = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    history = rng.normal(size=(agents, 8, features)).astype(np.float32)
    future = rng.normal(size=(agents, 12, 2)).astype(np.float32)
    return Truth(future, rng.random((agents, 12)) < 0.8, Observation(history, scene, rng.integers(0, 9, agents), 0.4))


def assert_same(one: Truth, other: Truth) -> None:
    for key in ("future", "known"):
        np.testing.assert_array_equal(getattr(one, key), getattr(other, key))
    for key in ("history", "scene", "agent", "dt"):
        np.testing.assert_array_equal(getattr(one.observation, key), getattr(other.observation, key))


def counts(truth: Truth) -> tuple[int, int]:
    return truth.observation.scenes, len(truth.future)


@pytest.mark.parametrize("place", WHOLE)
def test_whole_recordings_have_the_published_windows(eth_ucy, place):
    assert counts(motion_gym.domain(place).windows("test")) == WHOLE[place]


def test_eth6_has_the_published_agent_windows(eth_ucy):
    assert len(motion_gym.domain("eth6").windows("test").future) == 2313


@pytest.mark.parametrize("file", TRAINING)
def test_training_files_have_the_published_windows(eth_ucy, file):
    place, expected = TRAINING[file]
    recording = next(r for r in motion_gym.domain(place).recordings("train") if r.name == file)
    assert counts(windows_of([recording], min_agents=2)) == expected


def test_training_windows_of_a_place_are_those_of_its_files(eth_ucy):
    truth = motion_gym.domain("univ").windows("train")
    assert counts(truth) == (336 + 413 + 159, 11691 + 8988 + 423)


@pytest.mark.parametrize("place, stride", [("eth", 1), ("eth6", 3), ("hotel", 1), ("univ", 17), ("zara2", 7)])
def test_real_windows_equal_plain_python(eth_ucy, place, stride):
    recordings = motion_gym.domain(place).recordings("test")[:1]
    for least in (1, 2):
        expected = plain_windows(recordings[0], least, stride)
        assert expected, "nothing was compared"
        assert_windows(windows_of(recordings, min_agents=least, stride=stride), expected)


@given(recordings(), st.integers(1, 3), st.integers(1, 5))
def test_windows_equal_plain_python(recording, least, stride):
    assert_windows(windows_of([recording], min_agents=least, stride=stride), plain_windows(recording, least, stride))


@given(st.lists(recordings(), min_size=1, max_size=3), st.integers(1, 2))
def test_several_recordings_are_stacked_and_their_agents_differ(parts, least):
    together, shift, alone = windows_of(parts, min_agents=least), 0, []
    for part in parts:
        truth = windows_of([part], min_agents=least)
        alone.append(pick_scenes(truth, slice(None)))
        alone[-1].observation.agent[:] += shift
        shift += int(part.agent.max(initial=-1)) + 1
    assert_same(together, stack(alone))


@given(st.lists(recordings(), min_size=1, max_size=3))
def test_a_scene_has_the_number_of_its_last_observed_frame(parts):
    times, before = [], 0
    for part in parts:
        frames = np.unique(part.frame)
        rows = [
            Recording(
                part.frame, part.agent, np.stack([np.searchsorted(frames, part.frame)] * 2, 1) * 1.0, 0.4, listed=True
            )
        ]
        observation = windows_of(rows).observation
        times += (observation.history[observation.scene[:-1], -1, 0] + before).tolist()
        before += len(frames)
    assert windows_of(parts).observation.time.tolist() == times


@given(recordings())
def test_tracks_count_steps_before_and_after(recording):
    tracks = Tracks.of(recording)
    frames = np.unique(recording.frame)
    present = set(zip(recording.frame.tolist(), recording.agent.tolist(), strict=True))
    assert set(zip(frames[tracks.tick].tolist(), tracks.agent.tolist(), strict=True)) == present

    def steps(tick: int, agent: int, way: int) -> int:
        n = 0
        while 0 <= tick + way * (n + 1) < len(frames) and (int(frames[tick + way * (n + 1)]), agent) in present:
            n += 1
        return n

    who = list(zip(tracks.tick.tolist(), tracks.agent.tolist(), strict=True))
    assert tracks.age.tolist() == [steps(t, a, -1) for t, a in who]
    assert tracks.left.tolist() == [steps(t, a, +1) for t, a in who]
    assert tracks.ticks == len(frames)


def test_a_found_again_agent_is_not_windowed_across_its_gap():
    # Agent 1 is lost for frame 12, at which agent 2 keeps the clock going: no 20 steps in a row are left.
    frame = np.concatenate([np.delete(np.arange(25), 12), np.arange(25)])
    agent = np.repeat([1, 2], [24, 25])
    order = np.lexsort((agent, frame))
    recording = Recording(frame[order], agent[order], np.zeros((49, 2)), 0.4)
    assert set(windows_of([recording]).observation.agent) == {2}


def test_frames_at_which_nobody_was_annotated_do_not_count():
    # Nobody in sight at frames 10 to 12: frames 9 and 13 are one step apart, as in the released program.
    frame = np.concatenate([np.arange(10), np.arange(13, 23)])
    recording = Recording(frame, np.zeros(20, np.int64), np.stack([frame, frame], 1).astype(float), 0.4, listed=True)
    truth = windows_of([recording])
    assert truth.observation.history[0, -1, 0] == 7 and truth.future[0, :3, 0].tolist() == [8, 9, 13]


def test_features_see_all_20_steps_and_give_the_history():
    recording = Recording(np.arange(21), np.zeros(21, np.int64), np.arange(42.0).reshape(21, 2), 0.4)

    def ahead(positions, known):
        assert known.all()
        return np.concatenate([positions[:, :8], positions[:, 12:, :1]], axis=2)

    truth = windows_of([recording], ahead)
    assert truth.observation.history.dtype == np.float32
    assert truth.observation.history[1, :, 2].tolist() == [2.0 * (13 + i) for i in range(8)]
    np.testing.assert_array_equal(truth.observation.xy, windows_of([recording], positions_only).observation.history)


@pytest.mark.parametrize("rows", [0, 1, 19])
def test_a_recording_that_is_too_short_has_no_window(rows):
    recording = Recording(np.arange(rows), np.zeros(rows, np.int64), np.zeros((rows, 2)), 0.4)
    truth = windows_of([recording])
    assert counts(truth) == (0, 0)
    assert truth.observation.history.shape == (0, 8, 2) and truth.observation.scene.tolist() == [0]


sizes = st.lists(st.integers(0, 3), max_size=6)


@given(st.lists(sizes, min_size=1, max_size=4))
def test_stack_keeps_scenes_apart_and_pick_scenes_undoes_it(parts):
    truths = [random_truth(part, seed) for seed, part in enumerate(parts)]
    together = stack(truths)
    assert np.diff(together.observation.scene).tolist() == [n for part in parts for n in part]
    first = 0
    for truth in truths:
        assert_same(pick_scenes(together, slice(first, first + truth.observation.scenes)), truth)
        first += truth.observation.scenes


@given(sizes, st.data())
def test_pick_scenes_gives_the_chosen_scenes_in_the_chosen_order(parts, data):
    truth = random_truth(parts)
    chosen = data.draw(st.lists(st.integers(0, len(parts) - 1), max_size=8) if parts else st.just([]))
    picked = pick_scenes(truth, np.array(chosen, np.int64))
    assert picked.observation.scenes == len(chosen)
    for at, scene in enumerate(chosen):
        here = slice(*truth.observation.scene[scene : scene + 2])
        there = slice(*picked.observation.scene[at : at + 2])
        np.testing.assert_array_equal(picked.future[there], truth.future[here])
        np.testing.assert_array_equal(picked.known[there], truth.known[here])
        np.testing.assert_array_equal(picked.observation.history[there], truth.observation.history[here])
        np.testing.assert_array_equal(picked.observation.agent[there], truth.observation.agent[here])
        assert (picked.observation.scene_index[there] == at).all()


def test_pick_scenes_gives_copies():
    truth = random_truth([2, 1])
    picked = pick_scenes(truth, slice(None))
    for one, other in ((picked.future, truth.future), (picked.observation.history, truth.observation.history)):
        assert not np.shares_memory(one, other)


def test_stack_refuses_what_does_not_fit():
    with pytest.raises(ValueError, match="at least one"):
        stack([])
    with pytest.raises(ValueError, match="number of features"):
        stack([random_truth([1], features=2), random_truth([1], features=3)])


def gapped(frames, listed=False):
    frames = np.array(frames)
    return Recording(
        frames, np.zeros(len(frames), np.int64), np.stack([frames, frames], 1) / 20, 0.4, "gapped", listed=listed
    )


@pytest.mark.parametrize(
    ("frames", "steps"),
    [
        (range(0, 250, 10), list(range(25))),
        ([0, 10, 20, 50, 60], [0, 1, 2, 5, 6]),
        ([0, 10, 20, 10_000_000, 10_000_010], [0, 1, 2, 22, 23]),
        ([-30, -20, 0], [0, 1, 3]),
        ([5], [0]),
        ([], []),
    ],
)
def test_missing_frame_numbers_are_steps_unless_frames_are_listed(frames, steps):
    assert step_numbers(gapped(list(frames)))[1].tolist() == steps
    assert step_numbers(gapped(list(frames), listed=True))[1].tolist() == list(range(len(steps)))


def test_a_gap_ends_windows_on_both_clocks_and_listed_frames_have_none():
    frames = [*range(0, 100, 10), *range(840, 940, 10)]
    assert not len(windows_of([gapped(frames)]).future)
    assert len(windows_of([gapped(frames, listed=True)]).future) == 1
    assert StreamClock([gapped(frames)]).count == 2 * 3 and StreamClock([gapped(frames, listed=True)]).count == 13


def test_a_frame_between_the_steps_is_named():
    with pytest.raises(DataError, match=r"gapped: frame 203 comes 3 after frame 200, and a step is 10 .*listed=True"):
        step_numbers(gapped(sorted([*range(0, 400, 10), 203])))
