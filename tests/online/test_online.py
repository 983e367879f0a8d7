"""Evaluation on streams: totals, labels, scopes, costs of updates, and refused arguments."""

from __future__ import annotations

import copy
import dataclasses
import json
import math

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.checks.predictor_trials import synthetic
from motion_gym.contract import DataError, PredictorError, SpecError
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.metrics.errors import ade
from motion_gym.online import evaluation as online
from motion_gym.online.evaluation import evaluate_online
from motion_gym.online.per_agent import PerAgent
from motion_gym.online.streams import Segment, Stream, stream
from motion_gym.stepping.harness import ask, ready
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.snapshot import snapshot
from tests.bias import Bias
from tests.street import Street
from tests.taped import Taped, alike, fitted_linear, scenes_of

CROWD = "orca:d=0.3,scenes=6"
STREET = Street(frames=140)
SOURCE = "modular_invariant"
PLAIN = "constant_velocity"


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
    return taped.tape, played.clock.times, scenes_of(played.clock)


def each_told(tape, times, scenes):
    for index, truth in tape.told:
        for scene in range(truth.observation.scenes):
            one = pick_scenes(truth, [scene])
            (at,) = one.observation.time.tolist()
            np.testing.assert_array_equal(one.observation.agent, scenes[at].observation.agent)
            np.testing.assert_array_equal(one.observation.history, scenes[at].observation.history)
            yield int(times[index]), at, one.known, scenes[at].known


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
    tape, _, _ = played_with("matured")
    (recording,) = STREET.recordings("test")
    frames = np.unique(recording.frame)
    for one in (pick_scenes(truth, [s]) for _, truth in tape.told for s in range(truth.observation.scenes)):
        (at,) = one.observation.time.tolist()
        here = recording.frame == frames[at]
        for future, known, history in zip(one.future, one.known, one.observation.history, strict=True):
            agent = recording.agent[here][np.abs(recording.xy[here] - history[-1]).sum(axis=1).argmin()]
            path = recording.xy[(recording.agent == agent) & (recording.frame > frames[at])][:12]
            np.testing.assert_allclose(future[known], path, rtol=1e-6)
            assert (future[~known] == 0).all()


@pytest.mark.parametrize("adapter", ["kalman", Bias])
def test_a_place_begins_as_if_nothing_was_before(adapter):
    parts = [Segment(STREET, 0, 70), Segment(Street(seed=1), 200, 270)]
    made = catalog.adapter(adapter, fitted_linear())
    for labels in online.LABELS:
        alone = [evaluate_online(made, Stream([part]), labels=labels).values for part in parts]
        both = evaluate_online(made, Stream(parts), labels=labels, scope="place")
        np.testing.assert_array_equal(both.values, np.concatenate(alone))
    kept = evaluate_online(made, Stream(parts), labels=labels).values
    np.testing.assert_array_equal(kept[: len(alone[0])], alone[0])
    assert not np.array_equal(kept[len(alone[0]) :], alone[1])


def test_of_an_agent_of_its_own_nothing_is_learned_from_others():
    """In these crowds all agents have left before the first ground truth is revealed."""
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
    """An oracle that also learns."""

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
    """Each observation moves its forecasts by a metre."""

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


def test_a_declared_cost_repeats_exactly_and_one_that_never_ends_learns_nothing():
    made = catalog.adapter("kalman", fitted_linear())
    one, two = (evaluate_online(made, STREET, realtime=True, cost=0.9) for _ in range(2))
    assert alike(one) == alike(two) and one.skipped > 0
    never = evaluate_online(made, STREET, realtime=True, cost=1e9)
    np.testing.assert_array_equal(
        never.values, evaluate_online(catalog.adapter("none", fitted_linear()), STREET).values
    )
    measured = evaluate_online(made, STREET, realtime=True)
    assert measured.cost is None and 0 < measured.update_seconds[0] <= measured.update_seconds[1]


class LearnsWhenAsked(Bias):
    """Learns from observations in predict."""

    def predict(self, observation, samples=1, seed=0):
        self.bias = self.bias + np.diff(observation.xy[:, -2:], axis=1).mean()
        return super().predict(observation, samples, seed)


@pytest.mark.parametrize("scope", online.SCOPES)
def test_whoever_learns_when_asked_is_found(scope):
    with pytest.raises(PredictorError, match=r"learns when it is asked: predict changed .*bias.*Learn in observe"):
        evaluate_online(LearnsWhenAsked(mg.predictor(PLAIN)), STREET, scope=scope)


def test_what_was_given_stays_as_it_was():
    made = catalog.adapter("kalman", fitted_linear())
    made.observe(mg.domain(CROWD).windows("train"))
    before = snapshot(made)
    evaluate_online(made, STREET)
    assert snapshot(made) == before


@pytest.mark.parametrize("scope", online.SCOPES)
def test_updates_that_cannot_be_used_are_taken_back_and_counted(scope):
    parts = [Segment(CROWD, 0, 60), Segment(CROWD, 60, 120)]
    card = evaluate_online(catalog.adapter("finetune:rate=1e30,memory=0", SOURCE), Stream(parts), scope=scope)
    np.testing.assert_array_equal(card.values, evaluate_online(catalog.adapter("none", SOURCE), CROWD).values)
    assert card.updates == card.rolled_back == (12 if scope == "agent" else 6)


class Nowhere(Bias):
    """Forecasts infinite positions after some updates."""

    def observe(self, truth):
        super().observe(truth)
        if self.updates > 3:
            self.bias = np.full((12, 2), np.inf)


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        ({"labels": "mature"}, SpecError, "`labels=mature` is not known. Did you mean `matured`"),
        ({"scope": "places"}, SpecError, "`scope=places` is not known. Did you mean `place`"),
        ({"cost": -1.0}, SpecError, "`cost=-1.0` must be a number, 0 or more"),
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


def test_a_loop_of_ones_own_gives_the_same():
    """A loop over a stream with Outstanding and an adapter."""
    made, errors, waiting = catalog.adapter("kalman", fitted_linear()), [], mg.Outstanding()
    scenes = scenes_of(stream(STREET).clock)
    for now, scene in scenes.items():
        due = [s.made for s in waiting if s.made + min(12, int(scenes[s.made].known.sum(axis=1).max()) + 1) <= now]
        settled = [waiting.settle(t, scenes[t].future, scenes[t].known) for t in due]
        for forecast, truth in settled:
            errors += ade(forecast, truth)[truth.known.all(axis=1)].tolist()
        if settled:
            made.observe(stack([truth for _, truth in settled]))
        waiting.store(now, scene.observation, made.predict(scene.observation))
    card = evaluate_online(catalog.adapter("kalman", fitted_linear()), STREET)
    np.testing.assert_array_equal(card.values[: len(errors)], errors)
    assert len(errors) > 100
