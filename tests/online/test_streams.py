"""Streams: the order of frames and domains, borders between segments, and refused arguments."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motion_gym.contract import HISTORY, SpecError
from motion_gym.online.streams import BLOCKS, KINDS, UNIT, Segment, Stream, frames_of, stream, stream_name
from tests.street import Street
from tests.taped import scenes_of

SLOW, FAST, OTHER = (Street(style, seed, 900) for style, seed in ((0.5, 0), (2.0, 0), (0.5, 1)))
"""The first two domains are one place with two walking styles."""
CUTS = [(0, 100), (100, 160)]


def bounds(played):
    return [(label, part.start, part.stop) for label, part in zip(played.labels, played.segments, strict=True)]


def lengths(played):
    return [part.stop - part.start for part in played.segments]


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(sorted(KINDS)),
    st.lists(st.sampled_from((SLOW, FAST, OTHER)), min_size=2, max_size=3, unique=True),
    st.integers(0, 5),
    st.integers(1, 2),
    st.sampled_from((200, 215)),
)
def test_every_frame_is_played_at_most_once_and_as_many_as_were_asked_for(kind, places, seed, cycles, frames):
    visits = cycles if kind in ("recurring", "mixed") else 1
    played = stream(places, kind, frames, cycles=cycles, seed=seed)
    shown = [{(p.domain.seed, frame) for frame in range(p.start, p.stop)} for p in played.segments]
    assert sum(map(len, shown)) == len(set().union(*shown)) == played.ends[-1] == sum(lengths(played))
    assert all(0 <= p.start < p.stop <= 900 and p.start % UNIT == p.stop % UNIT == 0 for p in played.segments)
    each = {p: sum(n for n, s in zip(lengths(played), played.segments, strict=True) if s.domain is p) for p in places}
    whole = frames // UNIT * UNIT * visits
    if kind in ("sudden", "recurring"):
        assert set(each.values()) == {whole} and len(played.segments) == len(places) * visits
    elif kind == "mixed":
        assert set(each.values()) == {whole // (BLOCKS * UNIT) * BLOCKS * UNIT}
    assert 0 < sum(each.values()) <= whole * len(places)
    assert bounds(played) == bounds(stream(places, kind, frames, cycles=cycles, seed=seed))
    assert played.name == stream_name(places, kind, frames, cycles=cycles, seed=seed)
    np.testing.assert_array_equal(
        played.segment_at(np.arange(played.ends[-1])), np.repeat(np.arange(len(played.ends)), lengths(played))
    )


def test_sudden_and_recurring_visits_go_on_where_the_last_one_ended():
    sudden = bounds(stream([SLOW, OTHER, FAST], frames=200, seed=3))
    assert [label for label, *_ in sudden] == [
        "street:style=0.5,frames=900",
        "street:style=0.5,seed=1,frames=900",
        "street:style=2.0,frames=900",
    ]
    assert sudden[2][1] == sudden[0][2]
    again = bounds(stream([SLOW, OTHER], "recurring", 200, cycles=3, seed=3))
    assert [label for label, *_ in again] == ["street:style=0.5,frames=900", "street:style=0.5,seed=1,frames=900"] * 3
    for first, later in itertools.pairwise(again[0::2]):
        assert first[2] == later[1]


def test_gradual_streams_go_from_one_domain_to_the_next():
    """Blocks are random, so shares are computed over several seeds."""
    quarters, back_and_forth = [], 0
    for seed in range(8):
        played = stream([SLOW, OTHER], "gradual", 800, seed=seed)
        later = np.array([part.domain is OTHER for part in played.segments])
        back_and_forth += len(later) > 2
        each_frame = later[played.segment_at(np.arange(played.ends[-1]))]
        quarters.append([part.mean() for part in np.array_split(each_frame, 4)])
    shares = np.mean(quarters, axis=0)
    assert shares[0] == 0 and shares[3] == 1 and 0 < shares[1] < 0.5 < shares[2] < 1
    assert back_and_forth > 4


def test_mixed_blocks_are_in_an_order_of_the_seed():
    orders = [[p.domain for p in stream([SLOW, OTHER], "mixed", 200, cycles=1, seed=s).segments] for s in range(4)]
    assert any(order != orders[0] for order in orders)
    assert all(one is not other for order in orders for one, other in itertools.pairwise(order))


def test_the_seed_says_which_part_is_played():
    starts = {stream([SLOW, OTHER], frames=200, seed=seed).segments[0].start for seed in range(8)}
    assert len(starts) > 2


def test_one_domain_is_played_whole():
    played, spec = stream(Street(frames=130, places=2)), "street:style=1.0,frames=130,places=2"
    assert played.name == spec and bounds(played) == [(spec, 0, 130)]
    assert stream([SLOW, OTHER]).ends.tolist() == [900, 1800]


def test_what_is_played_is_what_the_segment_shows():
    place = Street(frames=400, places=2)
    frames = [np.unique(recording.frame) for recording in place.recordings("test")]
    played = Stream([Segment(place, 150, 330)])
    for time, scene in scenes_of(played.clock).items():
        frame = 150 + time
        recording = place.recordings("test")[frame // 200]
        now = recording.frame == frames[frame // 200][frame % 200]
        here = {tuple(xy) for xy in recording.xy[now].astype(np.float32).tolist()}
        assert {tuple(xy) for xy in scene.observation.xy[:, -1].tolist()} <= here


@pytest.mark.parametrize(
    "segments",
    [[(SLOW, *cut) for cut in CUTS], [(SLOW, 0, 100), (OTHER, 0, 60)], [(SLOW, 0, 70), (FAST, 70, 130)]],
)
def test_nobody_is_carried_over_from_one_segment_to_the_next(segments):
    played = Stream([Segment(*segment) for segment in segments])
    seen, starts = {}, np.concatenate([[0], played.ends])
    tracks = played.clock.tracks
    for time, truth in scenes_of(played.clock).items():
        segment = int(played.segment_at(time))
        assert time >= starts[segment] + HISTORY - 1
        persons = tracks.agent[(tracks.tick == time) & (tracks.age >= HISTORY - 1)]
        assert time + truth.known.sum(axis=1).max() < played.ends[segment]
        for identity, person in zip(truth.observation.agent.tolist(), persons, strict=True):
            assert seen.setdefault(identity, (segment, person)) == (segment, person)
    assert {segment for segment, _ in seen.values()} == set(range(len(segments)))
    people = [{person for s, person in seen.values() if s == segment} for segment in range(len(segments))]
    assert not people[0] & people[1]


def test_each_segment_shows_the_features_of_its_domain():
    calm, loud = Street(noise=1.0), Street(noise=64.0)
    played = stream([calm, loud], frames=100)
    seen = {label: set() for label in played.labels}
    for time, scene in scenes_of(played.clock).items():
        history = scene.observation.history
        seen[played.labels[int(played.segment_at(time))]] |= set(np.unique(history[..., 2]).tolist())
    assert seen == {"street:style=1.0,noise=1.0": {1.0}, "street:style=1.0,noise=64.0": {64.0}}


def test_frames_of_all_recordings_are_counted():
    assert frames_of(Street(frames=130, places=2), "test") == 130
    assert frames_of(Street(), "train") == 0


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Stream([]), "needs at least one segment"),
        (lambda: Stream([Segment("orka", 0, 100)]), "no domain `orka`. Did you mean `orca`"),
        (
            lambda: Stream([Segment(SLOW, 100, 100)]),
            "frames 100 to 100: it must have at least one frame, and end at 900",
        ),
        (lambda: Stream([Segment(SLOW, -20, 100)]), "`start of a segment=-20` must be a whole number"),
        (lambda: Stream([Segment(SLOW, 0, 920)]), "frames 0 to 920: .* end at 900"),
        (lambda: Stream([Segment(SLOW, 0, 100), Segment(FAST, 80, 120)]), "both play frames 80 to 100 of street"),
        (lambda: Stream([Segment(SLOW, 0, 100), Segment(Street(dt=0.5), 0, 40)]), "dt=0.4 s and street dt=0.5 s"),
        (lambda: Stream([Segment(SLOW, 0, 100), Segment(Street(noise=2.0, seed=3), 0, 40)]), "x, y and street x, y, n"),
        (lambda: Stream([Segment(SLOW, 0, 7)]), "Nobody is observed for 8 frames in .*: give longer segments"),
        (lambda: Stream([Segment(SLOW, 0, 99.5)]), "`stop of a segment=99.5` must be a whole number"),
        (lambda: Stream([(SLOW, 0, 100)]), r"is no segment: write motion_gym.Segment\(domain, start, stop\)"),
        (lambda: stream([SLOW, OTHER], frames=920), r"street:\S* has 900 frames .* ask for at most 900"),
        (lambda: stream({SLOW, OTHER}), "are played in order: give a list, not a set"),
        (lambda: stream([]), "needs at least one domain"),
        (lambda: stream("orka"), "no domain `orka`. Did you mean `orca`"),
        (lambda: stream([SLOW, OTHER], "suden"), "`kind=suden` is not known. Did you mean `sudden`"),
        (lambda: stream([SLOW, OTHER], split="tets"), "no split `tets`. Did you mean `test`"),
        (lambda: stream([SLOW, OTHER], seed=-1), "`seed=-1`"),
        (lambda: stream([SLOW, OTHER], "mixed", cycles=0), "`cycles=0`"),
        (lambda: stream([SLOW, OTHER], frames=10), "must be a whole number, 20 or more"),
        (lambda: stream([SLOW, FAST], frames=460), r"street:\S* has 900 frames .* for 2 visits .* ask for at most 440"),
        (lambda: stream([SLOW, OTHER], frames=0.5), "`frames=0.5`"),
        (lambda: stream([SLOW, OTHER], "gradual", 180), "10 blocks of at least 20 frames, give 200 or more"),
        (lambda: stream([SLOW, Street(dt=0.1)]), "have one step"),
    ],
)
def test_what_cannot_be_played_is_refused(make, message):
    with pytest.raises(SpecError, match=message):
        make()


def test_a_shift_of_a_feature_of_a_real_place(eth_ucy):
    played = stream(["eth:alpha=1", "eth:alpha=64"], frames=200, seed=2)
    assert played.labels == ["eth:alpha=1.0", "eth:alpha=64.0"]
    assert played.segments[0].stop == played.segments[1].start
    scenes = scenes_of(played.clock).items()
    noise = [
        np.concatenate([s.observation.history[..., 2].ravel() for time, s in scenes if played.segment_at(time) == part])
        for part in (0, 1)
    ]
    assert noise[1].mean() > 8 * noise[0].mean()
