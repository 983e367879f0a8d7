"""The windows clock."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motion_gym
from motion_gym.contract import Forecast, Observation, Recording, Truth
from motion_gym.metrics.errors import ade
from motion_gym.stepping.clocks import WindowsClock
from motion_gym.stepping.harness import ask
from motion_gym.stepping.stream_clock import StreamClock
from tests.clock_plays import play, positions_for, some
from tests.windows import windows_of


@some
@given(st.lists(st.integers(1, 3), min_size=1, max_size=6), st.integers(1, 3))
def test_windows_clock_visits_exactly_the_windows(sizes, samples):
    rng, agents = np.random.default_rng(len(sizes)), sum(sizes)
    known = rng.random((agents, 12)) < 0.7
    scene = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    observation = Observation(
        rng.normal(size=(agents, 8, 2)).astype(np.float32), scene, rng.integers(0, 5, agents), 0.4
    )
    future = np.where(known[..., None], rng.normal(size=(agents, 12, 2)), 0).astype(np.float32)
    truth = Truth(future, known, observation)
    clock = WindowsClock(truth)
    for _ in range(2):
        played = play(clock, samples)
        assert played.times == list(range(len(sizes) + 1))
        assert [len(s.observation) for s in played.steps] == [*sizes, 0]
        assert [i for s in played.steps for i in s.identity.tolist()] == list(range(agents))
        _, seen = played.ledger.read()
        for one, other in ((seen.future, truth.future), (seen.known, known), (seen.observation.scene, scene)):
            np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(seen.observation.history, observation.history)
        for window, step in enumerate(played.steps[1:]):
            here = range(scene[window], scene[window + 1])
            points = positions_for(list(here), window, samples)[:, 0].astype(float)
            for agent, path, reward in zip(here, points, step.reward, strict=True):
                errors = [np.hypot(*(path[t] - future[agent, t])) for t in range(12) if known[agent, t]]
                assert reward == pytest.approx(-np.mean(errors) if errors else 0, rel=1e-12)
            assert step.settled.made.tolist() == [window] * len(here)
            assert step.settled.identity.tolist() == list(here)
            assert step.settled.matured.tolist() == known[list(here)].all(axis=1).tolist()
            np.testing.assert_array_equal(step.settled.truth.future, future[list(here)])
            np.testing.assert_array_equal(step.settled.forecast.positions[:, 0], points.astype(np.float32))
            assert step.settled.person.tolist() == observation.agent[list(here)].tolist()


def test_windows_clock_names_window_and_agent():
    observation = Observation(np.zeros((3, 8, 2), np.float32), np.array([0, 1, 3]), np.array([5, 5, 8]), 0.4)
    clock = WindowsClock(Truth(np.zeros((3, 12, 2), np.float32), np.ones((3, 12), bool), observation))
    assert [clock.name(i) for i in range(3)] == ["window_0_agent_5", "window_1_agent_5", "window_1_agent_8"]


def test_the_real_windows_clock_scores_as_offline(eth_ucy):
    truth = motion_gym.domain("eth").windows("test")
    predictor = motion_gym.predictor("constant_velocity")
    clock, step, rewards = WindowsClock(truth), WindowsClock(truth).reset(), []
    while len(step.observation):
        step = clock.step(ask(predictor, step.observation))
        rewards.append(step.reward)
    np.testing.assert_array_equal(-np.concatenate(rewards), ade(ask(predictor, truth.observation), truth))
    assert -np.concatenate(rewards).mean() == pytest.approx(0.995, abs=5e-4)


def test_weights_say_which_sample_is_scored():
    truth = windows_of([Recording(np.arange(20), np.zeros(20, np.int64), np.zeros((20, 2)), 0.4)])
    positions = np.stack([np.full((1, 12, 2), 3.0), np.zeros((1, 12, 2))], axis=1).astype(np.float32)
    for weights, expected in ((None, -np.hypot(3, 3)), ([[0.4, 0.6]], 0.0), ([[0.6, 0.4]], -np.hypot(3, 3))):
        forecast = Forecast(positions, None if weights is None else np.array(weights, np.float32))
        windows, stream = (
            WindowsClock(truth),
            StreamClock([Recording(np.arange(9), np.zeros(9, np.int64), np.zeros((9, 2)), 0.4)]),
        )
        windows.reset(), stream.reset()
        assert windows.step(forecast).reward.tolist() == stream.step(forecast).reward.tolist() == [expected]
