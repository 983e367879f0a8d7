"""Driven episodes: seeds, worlds, what a predictor sees and learns, and what happens when it fails."""

from __future__ import annotations

import json

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import DataError, PredictorError, SpecError
from motion_gym.driving.episodes import SUBSTEPS, Episodes, world_of
from motion_gym.driving.evaluation import drive, episodes_of
from motion_gym.driving.proposals import DT
from motion_gym.driving.run import METRICS, Run
from tests.bias import Bias
from tests.traffic import needs_highway_env

SPEC = "highway:scenario=roundabout,runs=1,seconds=30"
DRIVEN = {"episodes": 3, "others": "replay"}


@pytest.fixture(scope="module")
def roundabout():
    needs_highway_env()
    return motion_gym.domain(SPEC)


def test_episodes_are_seeded_and_do_not_overlap(roundabout):
    episodes = Episodes(roundabout)
    one, same, other = (episodes.draw(4, seed) for seed in (0, 0, 1))
    assert [np.array_equal(a.ego_history, b.ego_history) for a, b in zip(one, same, strict=True)] == [True] * 4
    assert not all(np.array_equal(a.ego_history, b.ego_history) for a, b in zip(one, other, strict=True))
    assert sorted({e.number for e in one}) == [e.number for e in one], "in the order of time"
    frames = [int(tick) for _, tick, _ in episodes._candidates]
    assert (np.diff(frames) >= episodes.steps).all()
    with pytest.raises(SpecError, match=r"`episodes=1000`.*more `runs`"):
        episodes.draw(1000, 0)


def test_the_same_seed_gives_the_same_scores_and_json(roundabout):
    cards = [drive("constant_velocity", roundabout, others=o, episodes=2, seed=3) for o in ("react", "react", "replay")]
    assert all(np.array_equal(cards[0].values[name], cards[1].values[name], equal_nan=True) for name in METRICS)
    result = json.loads(json.dumps(cards[0].as_dict(), allow_nan=False))
    assert result["metrics"]["score"]["episodes"] == 2 and 0 <= result["metrics"]["score"]["mean"] <= 1


@pytest.mark.parametrize(("scenario", "side"), [("straight", "left"), ("merge", "right"), ("roundabout", "left")])
def test_a_recorded_world_is_replayed(scenario, side):
    needs_highway_env()
    domain = motion_gym.domain("highway", scenario=scenario, side=side, runs=1, seconds=20.0)
    episode = episodes_of(domain).draw(1, 0)[0]
    run = Run(domain, episode, "replay")
    assert run.states[-1, :2] == pytest.approx(episode.ego_history[-1], abs=0.05)
    ahead = run.world.future(run.ahead(None, 0))
    for step in range(3):
        states = run.world.advance(run.states)
        there = ~np.isnan(states[-1, :, 0])
        assert states[-1, there, :2] == pytest.approx(episode.future[there, step])
        assert np.array_equal(states[-1, :, :2], ahead[:, step], equal_nan=True)


@pytest.mark.parametrize("side", ["right", "left"])
def test_others_react_to_the_ego_vehicle_and_a_copy_of_the_world_changes_nothing(side):
    needs_highway_env()
    domain = motion_gym.domain("highway", runs=1, seconds=20.0, side=side)
    episode = episodes_of(domain).draw(1, 0)[0]
    behind = episode.ego_history - (20.0, 0.0)
    ego = np.array([*episode.ego_history[-1], 0.0, 20.0])
    ends = {}
    for name, speed in (("stops", 0.0), ("drives", 25.0)):
        world = domain.reacting_world(behind[None], ego, episode.path.points)
        time = np.arange(1, 49) * DT / SUBSTEPS
        states = np.stack([ego[0] + speed * time, np.full(48, ego[1]), np.zeros(48), np.full(48, speed)], axis=-1)
        foreseen = world.future(states)
        steps = [world.advance(states[n : n + SUBSTEPS])[-1, :, :2] for n in range(0, 48, SUBSTEPS)]
        assert np.stack(steps, axis=1) == pytest.approx(foreseen), "the copy foresaw it and left the world as it was"
        ends[name] = steps[-1][0]
    assert ends["stops"][0] < ends["drives"][0] - 10 or abs(ends["stops"][1] - ego[1]) > 2, "it brakes or passes"


class Seen:
    """Continues at constant velocity and keeps what it sees and learns."""

    def __init__(self):
        self.observations, self.truths = [], []

    def predict(self, observation, samples=1, seed=0):
        self.observations.append(observation)
        return motion_gym.predictor("constant_velocity").predict(observation)

    def observe(self, truth):
        self.truths.append(truth)


def test_a_predictor_sees_the_past_alone_and_learns_of_the_others_alone(roundabout, monkeypatch):
    seen = Seen()
    monkeypatch.setattr("motion_gym.driving.evaluation.copied", lambda predictor: predictor)
    card = drive(seen, roundabout, **DRIVEN)
    assert not card.errors
    first = {int(o.agent[-1]): o for o in reversed(seen.observations)}
    for episode in episodes_of(roundabout).draw(3, 0):
        observation = first[episode.number * 1000 + 999]
        assert observation.xy[-1] == pytest.approx(episode.ego_history, abs=1e-4), "the ego vehicle is the last agent"
        assert observation.xy[:-1] == pytest.approx(episode.history, abs=1e-4)
    assert not any(array.flags.writeable for o in seen.observations for array in (o.history, o.agent))
    assert len(seen.truths) == len(seen.observations), "each forecast is settled once"
    for truth in seen.truths:
        assert not truth.known[-1].any(), "the ego vehicle"
    now = {int(o.time[0]): o for o in seen.observations}
    for truth in seen.truths:
        later = now.get(int(truth.observation.time[0]) + 1)
        for row, agent in enumerate(truth.observation.agent if later is not None else ()):
            if truth.known[row, 0] and agent in later.agent:
                assert truth.future[row, 0] == pytest.approx(later.xy[later.agent == agent][0, -1], abs=1e-3)


def test_adapters_learn_from_one_episode_to_the_next(roundabout):
    card = drive(Bias(motion_gym.predictor("constant_velocity")), roundabout, episodes=4, others="replay")
    plain = drive("constant_velocity", roundabout, episodes=4, others="replay")
    changed = card.values["ADE"] != plain.values["ADE"]
    assert not changed[0] and changed[1:].any(), "nothing is known before the first episode has taught it"


def test_forecasts_of_the_oracle_score_best(roundabout):
    cards = {name: drive(name, roundabout, episodes=4, others="replay") for name in ("oracle", "stand_still")}
    assert cards["oracle"].values["score"].mean() >= cards["stand_still"].values["score"].mean() - 0.02
    assert any("knows the recorded future" in leak for leak in cards["oracle"].leaks)


class Fails:
    """Fails in its third forecast."""

    def __init__(self, always=False):
        self.asked, self.always = 0, always

    def predict(self, observation, samples=1, seed=0):
        self.asked += 1
        if self.asked == 3 or self.always:
            raise RuntimeError("no sensor")
        return motion_gym.predictor("constant_velocity").predict(observation)


def test_a_predictor_that_fails_ends_one_episode_with_a_message(roundabout):
    card = drive(Fails(), roundabout, **DRIVEN)
    ((number, message),) = card.errors.items()
    assert message.startswith(f"Fails failed in episode {number} of highway:") and "step 2 of 14" in message
    assert "RuntimeError: no sensor" in message
    assert card.values["score"][0] == 0 and (card.values["score"][1:] > 0).any()
    assert card.as_dict()["metrics"]["collision"]["episodes"] == 2
    with pytest.raises(PredictorError, match=r"step 0 of 14.*no sensor"):
        drive(Fails(always=True), roundabout, **DRIVEN)


def test_bad_input(roundabout):
    with pytest.raises(SpecError, match=r"`others=reacts` is not known.*Did you mean `react`"):
        drive("constant_velocity", roundabout, others="reacts")
    with pytest.raises(SpecError, match=r"no roads to drive on.*use highway"):
        drive("constant_velocity", "orca:d=0.3,scenes=4")
    with pytest.raises(SpecError, match="`episodes=0`"):
        drive("constant_velocity", roundabout, episodes=0)
    with pytest.raises(DataError, match=r"observed for 22 steps.*more `seconds`"):
        episodes_of(motion_gym.domain("highway", runs=1, seconds=8.0))


def test_a_world_without_others_is_driven_through(roundabout):
    episode = episodes_of(roundabout).draw(1, 0)[0]
    alone = type(episode)(**{
        **vars(episode), "agent": episode.agent[:0], "history": episode.history[:0], "future": episode.future[:0]
    })  # fmt: skip
    run = Run(roundabout, alone, "react")
    assert world_of(roundabout, alone, "react", run.states[-1]).future(run.ahead(None, 0)).shape == (0, 12, 2)
    run.steer(1.0, 0.0)
    assert run.ttc == [10.0] and not run.over and len(run.observation()) == 1
