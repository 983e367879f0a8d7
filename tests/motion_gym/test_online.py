"""Evaluation on streams: what is told when, that nothing is scored by what was learned from it, and what is refused."""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import json
import math
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog, online
from motion_gym.contract import DataError, Forecast, PredictorError, SpecError, Truth
from motion_gym.harness import ask, ready
from motion_gym.metrics import ade
from motion_gym.online import evaluate_online
from motion_gym.per_agent import PerAgent
from motion_gym.pettingzoo_env import ForecastEnv
from motion_gym.predictor_trials import synthetic
from motion_gym.snapshot import snapshot
from motion_gym.streams import Segment, Stream, stream
from motion_gym.windows import pick_scenes, stack
from tests.bias import Bias
from tests.street import Street

CROWD = "orca:d=0.3,scenes=6"
STREET = Street(frames=140)
SOURCE = "modular_invariant"
STGAT = "erm_no_sigma:weights=original/zara2"
PLAIN = "constant_velocity"
FOR_STGAT = [
    ("none", "matured"),
    ("finetune:every=6,least=4", "matured"),
    ("finetune:every=6,least=4", "stepwise"),
    ("ema_anchor:every=3", "matured"),
    ("kalman", "matured"),
    ("kalman", "stepwise"),
    ("ekf:every=6,least=6,agents=2", "matured"),
]


class Tape:
    """What was forecast and told; copies of whoever writes on it write on the same one."""

    def __init__(self):
        self.forecasts, self.told = [], []

    def __deepcopy__(self, memo):
        return self


class Taped:
    """An adapter whose forecasts, and what it is told before each, are written down."""

    def __init__(self, inner):
        self.inner, self.tape = inner, Tape()

    def __getattr__(self, name):
        if name.startswith("__") or name in ("inner", "tape"):
            raise AttributeError(name)
        return getattr(self.inner, name)

    def predict(self, observation, samples=1, seed=0):
        forecast = self.inner.predict(observation, samples, seed)
        self.tape.forecasts.append((observation.history.copy(), np.array(getattr(forecast, "positions", forecast))))
        return forecast

    def observe(self, truth):
        self.tape.told.append((len(self.tape.forecasts), truth))
        self.inner.observe(truth)


class Otherwise:
    """A domain whose positions are others after a listed frame, and whose people also leave, if they may."""

    def __init__(self, place, after, leave):
        self.place, self.after, self.leave = catalog.domain(place), after, leave
        self.windows, self.reference, self.history = self.place.windows, self.place.reference, self.place.history

    @property
    def card(self):
        return self.place.card

    def recordings(self, split):
        (recording,) = self.place.recordings(split)
        tick = np.unique(recording.frame, return_inverse=True)[1].reshape(-1)
        rng = np.random.default_rng(self.after)
        xy = np.where((tick > self.after)[:, None], recording.xy + rng.normal(0, 3, recording.xy.shape), recording.xy)
        keep = (tick <= self.after) | (rng.random(recording.agent.max() + 1)[recording.agent] > 0.5 * self.leave)
        columns = {"frame": recording.frame[keep], "agent": recording.agent[keep], "xy": xy[keep]}
        return [mg.Recording(**columns, dt=recording.dt)]


def seen_before(make, place, frames, after, leave=False, **options):
    """What differs up to ``after`` between two worlds that are the same until then, and how much there was to see."""
    tapes, cards, times = [], [], []
    for world in (catalog.domain(place), Otherwise(place, after, leave)):
        taped, played = Taped(make(world)), Stream([Segment(world, 0, frames)])
        cards.append(evaluate_online(taped, played, **options))
        tapes.append(taped.tape)
        times.append(played.clock.times)
    until = int((times[0] <= after).sum())
    found = []
    for number, (one, other) in enumerate(zip(*(t.forecasts[:until] for t in tapes), strict=True)):
        assert times[0][number] == times[1][number] and np.array_equal(one[0], other[0])
        if not np.array_equal(one[1], other[1]):
            found.append(f"forecast at {times[0][number]}")
    scored = [
        {(made, value) for made, value in zip(c.made, c.values, strict=True) if made <= after - 12} for c in cards
    ]
    if scored[0] != scored[1]:
        found.append("scores")
    told = sum(index < until for index, _ in tapes[0].told)
    return found, {"told": told, "scored": len(scored[0]), "later": tapes[0].forecasts[-1], "card": cards[0]}


@pytest.mark.parametrize("adapter", catalog.ADAPTERS)
def test_no_forecast_or_score_depends_on_truth_that_comes_later(adapter):
    def make(world):
        return catalog.adapter("refine:steps=1" if adapter == "refine" else adapter, SOURCE)

    found, there = seen_before(make, CROWD, 120, 90)
    assert found == []
    assert there["told"] > 4 and there["scored"] == 8 and (there["card"].updates > 0) == (adapter != "none")


@pytest.mark.parametrize(("adapter", "labels"), FOR_STGAT)
def test_nor_does_one_of_stgat_where_people_come_and_go(eth_ucy, adapter, labels):
    def make(world):
        return catalog.adapter(adapter, STGAT)

    found, there = seen_before(make, "hotel", 72, 56, leave=True, labels=labels)
    assert found == []
    assert there["told"] > 10 and there["scored"] > 10 and (there["card"].updates > 2) == (adapter != "none")


@pytest.mark.parametrize("labels", online.LABELS)
@pytest.mark.parametrize(("adapter", "scope"), [("kalman", "stream"), *((Bias, scope) for scope in online.SCOPES)])
def test_nor_does_a_linear_one(linear, adapter, labels, scope):
    def make(world):
        return catalog.adapter(adapter, linear)

    found, there = seen_before(make, STREET, 140, 90, leave=True, labels=labels, scope=scope)
    assert found == []
    assert there["told"] > 50 and there["scored"] > 50 and there["card"].updates > 50


class Foresees(Bias):
    """Learns from a scene's own truth before it forecasts it, though it changes nothing that it holds."""

    def __init__(self, of, world, frames):
        super().__init__(of)
        clock = Stream([Segment(world, 0, frames)]).clock
        truths = [clock.truth_at(at) for at in range(len(clock.times))]
        self.truths = {truth.observation.history.tobytes(): truth for truth in truths}

    def predict(self, observation, samples=1, seed=0):
        learned = copy.copy(self)
        learned.errors = copy.copy(self.errors)
        learned.observe(self.truths[observation.history.tobytes()])
        return Bias.predict(learned, observation, samples, seed)


def test_whoever_learns_from_a_scene_before_it_is_scored_is_found():
    def make(world):
        return Foresees(mg.predictor(PLAIN), world, 140)

    found, _ = seen_before(make, STREET, 140, 90)
    assert {"forecast at 89", "forecast at 90"} <= set(found) and "forecast at 77" not in found


@pytest.fixture(scope="module")
def linear():
    made = mg.predictor("linear")
    scenes = mg.domain(CROWD).windows("train")
    return made.fit([scenes], [scenes], 0)


def assert_same_totals(card, offline):
    np.testing.assert_array_equal(card.values, offline.values["ADE"])
    for online_one, offline_one in ((card.ade, offline.metrics["ADE"]), (card.fde, offline.metrics["FDE"])):
        bounds = [(summary.low, summary.high) for summary in (online_one, offline_one)]
        assert bounds[0] == pytest.approx(bounds[1], rel=1e-12)
        assert dataclasses.replace(online_one, low=0, high=0) == dataclasses.replace(offline_one, low=0, high=0)


@pytest.mark.parametrize("of", [PLAIN, "linear"])
def test_without_adaptation_the_scores_are_those_of_the_offline_evaluation(eth_ucy, of):
    place = mg.domain("eth", min_agents=1)
    offline = mg.evaluate(of, place)
    card = evaluate_online(catalog.adapter("none", ready(of, place)), place)
    assert_same_totals(card, offline)
    assert card.updates == card.rolled_back == card.skipped == 0


def test_nor_are_they_others_for_scenes_that_are_complete():
    offline = mg.evaluate(SOURCE, CROWD, references=0)
    card = evaluate_online(catalog.adapter("none", SOURCE), CROWD)
    assert_same_totals(card, offline)


@pytest.mark.parametrize(("of", "place"), [(PLAIN, STREET), (SOURCE, CROWD)])
def test_forecasts_are_those_of_the_stream_environment(of, place):
    env, made = ForecastEnv(place, clock="stream"), mg.predictor(of)
    observations, _ = env.reset()
    while env.agents:
        observation = mg.observation_from_dict(observations, 0.4, env.agents)
        observations, *_ = env.step(mg.forecast_to_dict(ask(made, observation), env.agents))
    card = evaluate_online(catalog.adapter("none", of), place)
    np.testing.assert_array_equal(card.values, ade(*env.ledger.matured_only()))
    assert (len(card.values), card.censored) == (env.ledger.matured, env.ledger.censored)


def played_with(labels, **options):
    taped, played = Taped(Bias(mg.predictor(PLAIN))), stream(STREET)
    evaluate_online(taped, played, labels=labels, **options)
    made = {}
    for at, time in enumerate(played.clock.times):
        truth = played.clock.truth_at(at)
        made[truth.observation.agent.tobytes() + truth.observation.history.tobytes()] = int(time), truth.known
    return taped.tape, played.clock.times, made


def each_told(tape, times, made):
    for index, truth in tape.told:
        for scene in range(truth.observation.scenes):
            one = pick_scenes(truth, [scene])
            at, known = made[one.observation.agent.tobytes() + one.observation.history.tobytes()]
            yield int(times[index]), at, one.known, known


def test_matured_labels_are_told_once_and_when_no_more_will_be_known():
    tape, times, made = played_with("matured")
    told = []
    for now, at, known, in_the_end in each_told(tape, times, made):
        told.append(at)
        np.testing.assert_array_equal(known, in_the_end)
        due = at + min(12, known.sum(axis=1).max() + 1)
        assert now == times[np.searchsorted(times, due)]
    assert len(told) == len(set(told)) and set(range(times[0], 120)) & set(times.tolist()) <= set(told)


def test_stepwise_labels_are_told_as_they_happen():
    tape, times, made = played_with("stepwise")
    waited = {}
    for now, at, known, in_the_end in each_told(tape, times, made):
        np.testing.assert_array_equal(known, in_the_end & (np.arange(1, 13) <= now - at))
        waited.setdefault(at, []).append(now)
    for at, nows in waited.items():
        assert nows == [t for t in times if nows[0] <= t <= nows[-1]]
        assert nows[0] == times[np.searchsorted(times, at + 1)] and nows[-1] - at <= 12


def test_the_truth_that_is_told_is_what_happened():
    tape, _, made = played_with("matured")
    (recording,) = STREET.recordings("test")
    frames = np.unique(recording.frame)
    for one in (pick_scenes(truth, [s]) for _, truth in tape.told for s in range(truth.observation.scenes)):
        at, _ = made[one.observation.agent.tobytes() + one.observation.history.tobytes()]
        here = recording.frame == frames[at]
        for future, known, history in zip(one.future, one.known, one.observation.history, strict=True):
            agent = recording.agent[here][np.abs(recording.xy[here] - history[-1]).sum(axis=1).argmin()]
            path = recording.xy[(recording.agent == agent) & (recording.frame > frames[at])][:12]
            np.testing.assert_allclose(future[known], path, rtol=1e-6)
            assert (future[~known] == 0).all()


@pytest.mark.parametrize("adapter", ["kalman", Bias])
def test_a_place_begins_as_if_nothing_was_before(linear, adapter):
    parts = [Segment(STREET, 0, 70), Segment(Street(seed=1), 200, 270)]
    made = catalog.adapter(adapter, linear)
    for labels in online.LABELS:
        alone = [evaluate_online(made, Stream([part]), labels=labels).values for part in parts]
        both = evaluate_online(made, Stream(parts), labels=labels, scope="place")
        np.testing.assert_array_equal(both.values, np.concatenate(alone))
    kept = evaluate_online(made, Stream(parts), labels=labels).values
    np.testing.assert_array_equal(kept[: len(alone[0])], alone[0])
    assert not np.array_equal(kept[len(alone[0]) :], alone[1])


def test_of_an_agent_of_its_own_nothing_is_learned_from_others():
    """In these crowds nobody is there when the first truth about them comes."""
    none, alone, all_of_them = (
        evaluate_online(catalog.adapter(name, SOURCE), CROWD, scope=scope)
        for name, scope in (("none", "agent"), ("finetune", "agent"), ("finetune", "stream"))
    )
    np.testing.assert_array_equal(alone.values, none.values)
    assert not np.array_equal(all_of_them.values, none.values)
    assert alone.updates == 2 * all_of_them.updates and none.updates == 0


def scene_of(agents, seed):
    scene = pick_scenes(synthetic((len(agents), 1), 2, seed), [0])
    return dataclasses.replace(scene, observation=dataclasses.replace(scene.observation, agent=np.array(agents)))


def test_each_agent_learns_from_the_scenes_that_it_is_in():
    source = Bias(mg.predictor(PLAIN))
    made, apart = PerAgent(source), {agent: copy.deepcopy(source) for agent in range(4)}
    told = [[scene_of([0, 1], 0), scene_of([0, 1, 2], 1)], [scene_of([1, 2], 2)], [scene_of([1], 3), scene_of([2], 4)]]
    for scenes in told:
        made.observe(stack(scenes))
        for agent, learner in apart.items():
            if own := [scene for scene in scenes if agent in scene.observation.agent]:
                learner.observe(stack(own))
    seen = scene_of([3, 2, 1], 5).observation
    expected = [apart[agent].predict(seen)[row] for row, agent in enumerate(seen.agent.tolist())]
    np.testing.assert_array_equal(made.predict(seen).positions, expected)
    assert set(made.own) == {1, 2} and made.updates == sum(learner.updates for learner in apart.values())
    made.reset()
    np.testing.assert_array_equal(made.predict(seen).positions, source.predict(seen))
    assert made.own == {} and made.updates == 0


class Knows:
    """An oracle: told where it is, and learns besides."""

    def __init__(self):
        self.style = 0.0

    def know(self, domain):
        self.style = domain.style

    def predict(self, observation, samples=1, seed=0):
        return np.full((len(observation), 1, 12, 2), self.style, np.float32)

    def observe(self, truth):
        pass

    def reset(self):
        pass


@pytest.mark.parametrize("scope", online.SCOPES)
def test_an_oracle_is_told_where_it_is_and_named_one_whatever_the_scope(scope):
    played = Stream([Segment(Street(0.5), 0, 80), Segment(Street(2.0), 80, 160)])
    taped = Taped(Knows())
    card = evaluate_online(taped, played, scope=scope)
    said = {float(positions.flat[0]): len(history) for history, positions in taped.tape.forecasts}
    assert card.oracle and set(said) == {0.5, 2.0}


class Counts:
    """Forecasts by how much it has learned: each truth moves it by a metre."""

    def __init__(self):
        self.learned = 0

    def predict(self, observation, samples=1, seed=0):
        return np.full((len(observation), 1, 12, 2), self.learned, np.float32)

    def observe(self, truth):
        self.learned += 1

    def reset(self):
        self.learned = 0


@pytest.mark.parametrize("cost", [0.0, 0.3, 0.4, 1.0, 5.2, 1e6])
def test_an_update_is_of_use_when_it_is_done_and_what_came_meanwhile_is_lost(cost):
    at_once, late = Taped(Counts()), Taped(Counts())
    evaluate_online(at_once, STREET)
    card = evaluate_online(late, STREET, realtime=True, cost=cost)
    told, played = {index for index, _ in at_once.tape.told}, stream(STREET)
    learned, done, expected, lost = 0, None, [], 0
    for index, time in enumerate(played.clock.times.tolist()):
        if done is not None and time >= math.ceil(round(done, 6)):
            learned, done = learned + 1, None
        if index in told and done is None and cost:
            done = time + cost / 0.4
        elif index in told:
            learned, lost = learned + (not cost), lost + bool(cost)
        expected.append(learned)
    assert [int(positions[0, 0, 0, 0]) for _, positions in late.tape.forecasts] == expected
    assert card.skipped == lost and card.updates == len(told) - lost


def test_a_declared_cost_repeats_exactly_and_one_that_never_ends_learns_nothing(linear):
    made = catalog.adapter("kalman", linear)
    one, two = (evaluate_online(made, STREET, realtime=True, cost=0.9) for _ in range(2))
    assert alike(one) == alike(two) and one.skipped > 0
    never = evaluate_online(made, STREET, realtime=True, cost=1e9)
    np.testing.assert_array_equal(never.values, evaluate_online(catalog.adapter("none", linear), STREET).values)
    measured = evaluate_online(made, STREET, realtime=True)
    assert measured.cost is None and 0 < measured.update_seconds[0] <= measured.update_seconds[1]


def alike(card):
    """All of a card that is the same for the same run."""
    plain = card.as_dict()
    for key in ("update_seconds", "tick_seconds", "peak_memory"):
        del plain[key]
    return json.dumps(plain), card.values.tobytes(), card.made.tobytes()


class Stopped(Exception):
    pass


@pytest.mark.parametrize(
    ("adapter", "of", "options"),
    [
        ("kalman", None, {"labels": "stepwise"}),
        ("kalman", None, {"scope": "place", "realtime": True, "cost": 1.3}),
        (Bias, PLAIN, {"scope": "agent"}),
        ("finetune", SOURCE, {}),
    ],
)
def test_a_run_that_was_stopped_goes_on_to_the_same_result(tmp_path, monkeypatch, linear, adapter, of, options):
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)
    path, stops, made = tmp_path / "run.checkpoint", [], catalog.adapter(adapter, of or linear)
    on = CROWD if of == SOURCE else stream([STREET, Street(frames=140, seed=1)], "recurring", 60)

    def stop(done, of, what):
        assert done >= max(stops, default=0)
        if done > max(stops, default=0):
            stops.append(done)
            raise Stopped

    whole, again = evaluate_online(made, on, **options), None
    while again is None:
        with contextlib.suppress(Stopped):
            again = evaluate_online(made, on, checkpoint=path, report=stop, **options)
    assert alike(again) == alike(whole) and not path.exists()
    assert stops == list(range(50, len(times_of(on)), 50))


def times_of(on):
    return (on if isinstance(on, Stream) else stream(on)).clock.times


KILLED = """
import os, signal, sys
from motion_gym import catalog, online
online.SAVED_EVERY = 0.0
def report(done, of, what):
    if done:
        os.kill(os.getpid(), signal.SIGKILL)
path, adapter, of, on = sys.argv[1:]
online.evaluate_online(catalog.adapter(adapter, of), on, checkpoint=online.Path(path), report=report)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_a_run_that_was_killed_goes_on_to_the_same_result(tmp_path):
    path = tmp_path / "run.checkpoint"
    names, begun = ("tests.bias:Bias", PLAIN, "tests.street:Street:frames=140"), []
    root = Path(__file__).resolve().parents[2]
    arguments = [sys.executable, "-c", KILLED, str(path), *names]
    done = subprocess.run(arguments, cwd=root, env={**os.environ}, capture_output=True, timeout=100, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    made, on = catalog.adapter(*names[:2]), names[2]
    again = evaluate_online(made, on, checkpoint=path, report=lambda done, *_: begun.append(done))
    assert begun[0] > 0 and alike(again) == alike(evaluate_online(made, on))


def test_a_checkpoint_of_another_run_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)
    path, made = Path(tmp_path / "run.checkpoint"), Bias(mg.predictor(PLAIN))

    def stop(done, of, what):
        if done:
            raise Stopped

    def run(predictor=made, on=None, **options):
        part = stream(STREET) if on is None else on
        evaluate_online(predictor, part, checkpoint=path, report=stop, **options)

    first, second = (Stream([Segment(STREET, start, start + 70)]) for start in (0, 70))
    with pytest.raises(Stopped):
        run(on=first)
    others = [{"on": second}, {"on": first, "labels": "stepwise"}, {"on": first, "realtime": True, "cost": 1.0}]
    for other in [*others, {"on": first, "predictor": Bias(mg.predictor(PLAIN), 0.1)}, {"on": first, "seed": 1}]:
        with pytest.raises(SpecError, match="is the checkpoint of another run: delete it, or choose another file"):
            run(**other)
    path.write_bytes(b"nothing")
    with pytest.raises(SpecError, match=r"is no checkpoint of an online run \(.*\): delete it"):
        run(on=first)


class LearnsWhenAsked(Bias):
    """Takes what it sees for a truth."""

    def predict(self, observation, samples=1, seed=0):
        self.bias = self.bias + np.diff(observation.xy[:, -2:], axis=1).mean()
        return super().predict(observation, samples, seed)


@pytest.mark.parametrize("scope", online.SCOPES)
def test_whoever_learns_when_asked_is_found(scope):
    with pytest.raises(PredictorError, match=r"learns when it is asked: predict changed .*bias.*Learn in observe"):
        evaluate_online(LearnsWhenAsked(mg.predictor(PLAIN)), STREET, scope=scope)


def test_what_was_given_stays_as_it_was(linear):
    made = catalog.adapter("kalman", linear)
    made.observe(mg.domain(CROWD).windows("train"))
    before = snapshot(made)
    evaluate_online(made, STREET)
    assert snapshot(made) == before


@pytest.mark.parametrize("scope", online.SCOPES)
def test_updates_that_cannot_be_used_are_taken_back_and_counted(scope):
    parts = [Segment(CROWD, 0, 60), Segment(CROWD, 60, 120)]
    card = evaluate_online(catalog.adapter("finetune:rate=1e38,memory=0", SOURCE), Stream(parts), scope=scope)
    np.testing.assert_array_equal(card.values, evaluate_online(catalog.adapter("none", SOURCE), CROWD).values)
    assert card.updates == card.rolled_back == (12 if scope == "agent" else 6)


class Nowhere(Bias):
    """Is off to infinity after a while."""

    def observe(self, truth):
        super().observe(truth)
        if self.updates > 3:
            self.bias = np.full((12, 2), np.inf)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        ({"labels": "mature"}, SpecError, "`labels=mature` is not known. Did you mean `matured`"),
        ({"scope": "places"}, SpecError, "`scope=places` is not known. Did you mean `place`"),
        ({"cost": -1.0}, SpecError, "`cost=-1.0` must be a number of seconds, 0 or more"),
        ({"seed": -1}, SpecError, "`seed=-1`"),
        ({"predictor": "linea"}, SpecError, "Did you mean `linear`"),
        ({"on": "orka"}, SpecError, "Did you mean `orca`"),
        ({"predictor": Nowhere(mg.predictor(PLAIN))}, PredictorError, "returned NaN or infinite positions"),
        ({"on": Stream([Segment(STREET, 0, 15)])}, DataError, "No forecast matured on .*stay for 20 steps"),
        ({"predictor": catalog.adapter("none", SOURCE)}, PredictorError, "exactly 2 agents|two agents"),
    ],
)
def test_what_cannot_be_run_is_refused(call, error, message):
    with pytest.raises(error, match=message):
        evaluate_online(**{"predictor": PLAIN, "on": STREET, **call})


def test_a_card_says_what_came_out_by_segment_and_over_time():
    played = Stream([Segment(STREET, 0, 70), Segment(Street(seed=1), 0, 15), Segment(STREET, 70, 140)])
    card = evaluate_online(Bias(mg.predictor(PLAIN)), played)
    assert json.loads(json.dumps(card.as_dict()))["segments"][1]["ade"]["mean"] is None
    parts = card.segments
    assert [p.start for p in parts] == pytest.approx([0, 28, 34]) and parts[-1].stop == pytest.approx(62)
    assert sum(p.ade.agent_windows for p in parts) == card.ade.agent_windows == len(card.values)
    for part, own in zip(parts, [card.made < 70, card.made < 0, card.made >= 85], strict=True):
        assert part.ade.agent_windows == own.sum()
        if own.any():
            assert part.ade.mean == pytest.approx(card.values[own].mean())
    assert sum(p.censored for p in parts) == card.censored and sum(p.updates for p in parts) == card.updates > 0
    assert parts[1].censored > 0 and not card.oracle
    assert card.curve[-1][0] == pytest.approx(card.made[-1] * 0.4, abs=0.01)
    (back,) = card.returns
    assert back == (parts[0].domain, pytest.approx(parts[0].ade.mean), pytest.approx(parts[2].ade.mean))
    assert f"over {len(card.values)} matured forecasts ({card.censored} censored)" in str(card)


def test_a_loop_of_ones_own_gives_the_same(linear):
    """Outstanding and an adapter, driven by hand over a stream."""
    made, played, errors = catalog.adapter("kalman", linear), stream(STREET), []
    waiting, truths = mg.Outstanding(), {}
    for at, now in enumerate(played.clock.times.tolist()):
        due = [s.made for s in waiting if s.made + min(12, int(truths[s.made].known.sum(axis=1).max()) + 1) <= now]
        settled: list[tuple[Forecast, Truth]] = [waiting.settle(t, truths[t].future, truths[t].known) for t in due]
        for forecast, truth in settled:
            errors += ade(forecast, truth)[truth.known.all(axis=1)].tolist()
        if settled:
            made.observe(stack([truth for _, truth in settled]))
        truths[now] = played.clock.truth_at(at)
        waiting.store(now, truths[now].observation, made.predict(truths[now].observation))
    card = evaluate_online(catalog.adapter("kalman", linear), STREET)
    np.testing.assert_array_equal(card.values[: len(errors)], errors)
    assert len(errors) > 100
