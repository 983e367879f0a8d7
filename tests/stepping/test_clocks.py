from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import motion_gym
from motion_gym.contract import DataError, Forecast, Recording
from motion_gym.metrics.errors import ade
from motion_gym.stepping.clocks import Step, WindowsClock
from motion_gym.stepping.harness import ask
from motion_gym.stepping.stream_clock import StreamClock
from tests.clock_plays import play, positions_for, recordings, some
from tests.windows import windows_of


@dataclass
class PlainStep:
    time: int
    names: list[int]
    agents: list[tuple[int, int]]
    histories: list[list]
    rewards: list[float] = field(default_factory=list)
    settled: list[tuple] = field(default_factory=list)
    """(made, name, agent, future, known) of each forecast that was settled before this step"""


def plain_stream(places: list[Recording]) -> list[PlainStep]:
    """The stream clock from its definition, one frame and one agent at a time, with the forecasts of ``play``."""
    here: list[dict[tuple[int, int], np.ndarray]] = []
    for number, place in enumerate(places):
        for frame in np.unique(place.frame):
            rows = np.flatnonzero(place.frame == frame)
            here.append({(number, int(place.agent[r])): place.xy[r] for r in rows})
    path: dict[tuple[int, int], list] = {}
    name_of: dict[tuple[int, int], int] = {}
    names, steps = 0, [PlainStep(-1, [], [], [])]
    outstanding: list[dict] = []
    waiting = PlainStep(-1, [], [], [])
    for time, seen in enumerate([*here, {}]):
        for agent in list(path):
            if agent not in seen:
                del path[agent]
                name_of.pop(agent, None)
        for agent in seen:
            path.setdefault(agent, []).append(seen[agent])
        errors: dict[int, list[float]] = {}
        for forecast in outstanding:
            if forecast["done"]:
                continue
            if name_of.get(forecast["agent"]) == forecast["name"]:
                known = path[forecast["agent"]][-1]
                point = forecast["points"][len(forecast["future"])]
                errors.setdefault(forecast["name"], []).append(float(np.hypot(*(point.astype(float) - known))))
                forecast["future"].append(known)
                forecast["done"] = len(forecast["future"]) == 12
            else:
                forecast["done"] = True
        rewards = [-np.mean(errors[n]) if n in errors else 0.0 for n in steps[-1].names]
        waiting.rewards = [a + b for a, b in zip(waiting.rewards or [0.0] * len(rewards), rewards, strict=True)]
        open_scenes = {m["made"] for m in outstanding if not m["done"]}
        over = [m for m in outstanding if m["made"] not in open_scenes]
        waiting.settled += [(m["made"], m["name"], m["agent"], m["future"]) for m in over]
        outstanding = [m for m in outstanding if m["made"] in open_scenes]
        observed = sorted(agent for agent in path if len(path[agent]) >= 8)
        for agent in observed:
            if agent not in name_of:
                name_of[agent], names = names, names + 1
        if not observed and time < len(here):
            continue
        waiting.time, waiting.agents, waiting.names = time, observed, [name_of[a] for a in observed]
        waiting.histories = [path[a][-8:] for a in observed]
        steps.append(waiting)
        for agent, points in zip(observed, positions_for(waiting.names, time)[:, 0], strict=True):
            forecast = dict(made=time, name=name_of[agent], agent=agent, points=points, future=[], done=False)
            outstanding.append(forecast)
        waiting = PlainStep(-1, [], [], [])
    return steps[1:]


@some
@given(recordings())
def test_stream_shows_each_agent_from_its_8th_frame_to_its_last_and_nothing_else(places):
    played, plain = play(StreamClock(places)), plain_stream(places)
    assert played.times == [p.time for p in plain]
    for step, expected in zip(played.steps, plain, strict=True):
        assert step.identity.tolist() == expected.names == step.observation.agent.tolist()
        histories = np.array(expected.histories, np.float32).reshape(-1, 8, 2)
        np.testing.assert_array_equal(step.observation.history, histories)
        assert step.observation.scene.tolist() == ([0, len(expected.names)] if expected.names else [0])


@some
@given(recordings())
def test_stream_rewards_are_those_of_the_definition(places):
    for step, expected in zip(play(StreamClock(places)).steps, plain_stream(places), strict=True):
        assert step.reward.dtype == np.float64
        np.testing.assert_allclose(step.reward, expected.rewards, rtol=1e-12, atol=1e-12)


@some
@given(recordings())
def test_stream_settles_each_scene_once_and_when_it_is_due(places):
    settled_forecasts = set()
    for step, expected in zip(play(StreamClock(places)).steps, plain_stream(places), strict=True):
        settled = step.settled
        assert (settled is None) == (not expected.settled)
        if settled is None:
            continue
        rows = sorted(expected.settled, key=lambda row: (row[0], row[2]))
        assert settled.made.tolist() == [row[0] for row in rows]
        assert settled.identity.tolist() == [row[1] for row in rows]
        assert settled.matured.tolist() == [len(row[3]) == 12 for row in rows]
        assert settled.truth.known.sum(axis=1).tolist() == [len(row[3]) for row in rows]
        for i, (time, name, _, future) in enumerate(rows):
            known = settled.truth.known[i]
            assert known[: len(future)].all()
            np.testing.assert_array_equal(settled.truth.future[i, known], np.array(future, np.float32).reshape(-1, 2))
            assert (settled.truth.future[i, ~known] == 0).all()
            np.testing.assert_array_equal(settled.forecast.positions[i], positions_for([name], time)[0])
            assert (time, name) not in settled_forecasts
            settled_forecasts.add((time, name))
    assert settled_forecasts == {(p.time, name) for p in plain_stream(places) for name in p.names}


def cut(places: list[Recording], time: int) -> list[Recording]:
    """Recordings up to a time, in listed frames over all recordings."""
    parts, start = [], 0
    for place in places:
        frames = np.unique(place.frame)
        keep = np.isin(place.frame, frames[: max(0, time + 1 - start)])
        part = dataclasses.replace(place, frame=place.frame[keep], agent=place.agent[keep], xy=place.xy[keep])
        if keep.any() or not len(frames):
            parts.append(part)
        start += len(frames)
    return parts


def assert_same_step(one: Step, other: Step) -> None:
    def arrays(step: Step) -> list[np.ndarray]:
        s, o = step.settled, step.observation
        shown = [o.history, o.scene, o.agent, o.time, step.identity, step.reward]
        if s is None:
            return shown
        seen = s.truth.observation
        return [
            *shown, s.forecast.positions, s.identity, s.person, s.made, s.truth.future, s.truth.known, seen.history,
            seen.scene, seen.time,
        ]  # fmt: skip

    for a, b in zip(arrays(one), arrays(other), strict=True):
        np.testing.assert_array_equal(a, b)


@some
@given(recordings(), st.data())
def test_nothing_before_a_time_depends_on_what_comes_after_it(places, data):
    whole = play(StreamClock(places))
    assert whole.times[-1] == sum(len(np.unique(p.frame)) for p in places)
    time = data.draw(st.sampled_from(whole.times))
    part = play(StreamClock(cut(places, time)))
    seen = [i for i, t in enumerate(whole.times) if t <= time and len(whole.steps[i].identity)]
    assert part.times[: len(seen)] == [whole.times[i] for i in seen]
    for i in seen:
        assert_same_step(whole.steps[i], part.steps[i])


@some
@given(recordings())
def test_ids_are_given_as_agents_enter_and_never_return(places):
    clock = StreamClock(places)
    here, gone, entered = set(), set(), []
    for step in play(clock).steps:
        now = set(step.identity.tolist())
        assert len(now) == len(step.identity)
        gone |= here - now
        assert not now & gone
        entered += [i for i in step.identity.tolist() if i not in here]
        here = now
    assert entered == list(range(clock.size))
    assert len({clock.name(i) for i in entered}) == clock.size


@some
@given(recordings())
def test_matured_forecasts_are_the_windows_of_the_recordings(places):
    played, expected = play(StreamClock(places)), windows_of(places, min_agents=1)
    assert played.ledger.settled == played.ledger.matured + played.ledger.censored
    assert len(played.ledger) == 0, "nothing waits after the end"
    if not played.ledger.settled:
        assert not len(expected.future)
        return
    assert played.ledger.matured == len(expected.future)
    _, truth = played.ledger.matured_only()
    for key in ("future", "known"):
        np.testing.assert_array_equal(getattr(truth, key), getattr(expected, key))
    for key in ("history", "scene", "agent", "time"):
        np.testing.assert_array_equal(getattr(truth.observation, key), getattr(expected.observation, key))


@some
@given(recordings())
def test_stream_begins_again_as_before(places):
    clock = StreamClock(places)
    first = clock.reset()
    if len(first.observation):
        clock.step(Forecast(positions_for(first.identity.tolist(), clock.time)))
    one, two = play(clock), play(clock)
    assert one.times == two.times
    for a, b in zip(one.steps, two.steps, strict=True):
        assert_same_step(a, b)


@some
@given(recordings())
def test_extent_holds_all_positions_and_no_more(places):
    xy = np.concatenate([p.xy for p in places])
    if len(xy):
        np.testing.assert_array_equal(StreamClock(places).extent, [xy.min(axis=0), xy.max(axis=0)])
    truth = windows_of(places)
    if len(truth.future):
        both = np.concatenate([truth.observation.xy.reshape(-1, 2), truth.future.reshape(-1, 2)])
        np.testing.assert_array_equal(WindowsClock(truth).extent, [both.min(axis=0), both.max(axis=0)])


@some
@given(recordings())
def test_latest_paths_are_the_last_forecasts_of_those_who_stayed(places):
    clock = StreamClock(places)
    step = clock.reset()
    assert clock.latest_paths().shape == (0, 1, 13, 2)
    while len(step.observation):
        names, now, last = step.identity.tolist(), clock.time, step.observation.xy[:, -1]
        positions = positions_for(names, now)
        step = clock.step(Forecast(positions))
        stayed = [i for i, name in enumerate(names) if name in step.identity]
        expected = np.concatenate([np.repeat(last[stayed, None, None], 2, axis=1), positions[stayed]], axis=2)
        if stayed:
            np.testing.assert_allclose(clock.latest_paths(), expected, rtol=1e-6)
        assert all(now - stored.made < 12 for stored in clock.ledger)


@settings(max_examples=10, deadline=None)
@given(recordings())
def test_what_is_known_so_far_are_the_positions_up_to_now(places):
    clock = StreamClock(places)
    step = clock.reset()
    assert clock.so_far() is None
    path, settled = {}, set()
    while len(step.observation):
        now, names = clock.time, step.identity.tolist()
        path |= {(name, now): place for name, place in zip(names, step.observation.xy[:, -1], strict=True)}
        truth = clock.so_far()
        waiting = [(name, stored.made) for stored in clock.ledger for name in stored.observation.agent.tolist()]
        assert (truth is None) == (not waiting)
        if truth is not None:
            assert truth.observation.agent.tolist() == [name for name, _ in waiting]
            for (name, made), future, known in zip(waiting, truth.future, truth.known, strict=True):
                expected = [(name, made + ahead) in path for ahead in range(1, 13)]
                assert known.tolist() == expected
                places_then = [path[name, made + ahead + 1] for ahead in np.flatnonzero(known).tolist()]
                assert np.array_equal(future[known], np.reshape(places_then, (-1, 2)))
        step = clock.step(Forecast(positions_for(names, now)))
        if step.settled is not None:
            settled |= set(step.settled.made.tolist())
        assert settled.isdisjoint(stored.made for stored in clock.ledger)


def test_the_extent_of_nothing_is_the_unit_square():
    nothing = Recording(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), 0.4)
    for clock in (StreamClock([nothing]), WindowsClock(windows_of([nothing]))):
        assert clock.extent.tolist() == [[0, 0], [1, 1]]


def test_an_agent_lost_for_one_frame_is_a_new_agent_but_the_same_person():
    frame = np.concatenate([np.delete(np.arange(60), 30), np.arange(60)])
    agent = np.repeat([4, 7], [59, 60])
    order = np.lexsort((agent, frame))
    clock = StreamClock([Recording(frame[order], agent[order], np.zeros((119, 2)), 0.4)])
    played = play(clock)
    assert clock.size == 3
    assert [s.identity.tolist() for s, t in zip(played.steps, played.times, strict=True) if t in (29, 30, 37, 38)] == [
        [0, 1],
        [1],
        [1],
        [2, 1],
    ]
    person = {(int(i), int(p)) for s in played.settled() for i, p in zip(s.identity, s.person, strict=True)}
    assert person == {(0, 4), (1, 7), (2, 4)}


def test_recordings_of_one_stream_have_one_time_step():
    places = [Recording(np.arange(9), np.zeros(9, np.int64), np.zeros((9, 2)), dt) for dt in (0.4, 0.5)]
    with pytest.raises(DataError, match=r"\[0.4, 0.5\]"):
        StreamClock(places)


def test_a_stream_of_nothing_is_over_at_once():
    empty = Recording(np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros((0, 2)), 0.4)
    for places in ([], [empty], [Recording(np.arange(7), np.zeros(7, np.int64), np.zeros((7, 2)), 0.4)]):
        clock = StreamClock(places)
        assert clock.size == 0 and len(clock.reset().observation) == 0


@pytest.mark.parametrize("place", ["eth", "univ"])
def test_matured_forecasts_of_a_real_stream_score_as_offline(eth_ucy, place):
    domain = motion_gym.domain(place, min_agents=1)
    predictor = motion_gym.predictor("constant_velocity")
    clock = StreamClock(domain.recordings("test"), domain.history)
    step = clock.reset()
    while len(step.observation):
        step = clock.step(ask(predictor, step.observation))
    truth = domain.windows("test")
    forecast, matured = clock.ledger.matured_only()
    np.testing.assert_array_equal(matured.observation.scene, truth.observation.scene)
    np.testing.assert_array_equal(matured.observation.agent, truth.observation.agent)
    offline = ade(ask(predictor, truth.observation), truth)
    np.testing.assert_array_equal(ade(forecast, matured), offline)
    paper = motion_gym.domain(place).windows("test")
    paired = np.diff(truth.observation.scene)[truth.observation.scene_index] >= 2
    np.testing.assert_array_equal(offline[paired], ade(ask(predictor, paper.observation), paper))
