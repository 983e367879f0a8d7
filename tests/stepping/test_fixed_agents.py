"""A fixed set of agents plays the same episode as the agents that enter and leave."""

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test

import motion_gym
from motion_gym.contract import ActionError, SpecError
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.wrappers import FixedAgents, ScoreParallel
from tests.street import Street


@pytest.fixture(params=["windows", "stream"])
def clock(request):
    return request.param


def make(clock, **arguments):
    return ForecastEnv(Street(frames=60), clock=clock, **arguments)


def forecast(history):
    """A forecast [1, 12, 2] that depends on the history."""
    return history[None, -1:, :2] + np.arange(1, 13, dtype=np.float32)[:, None] * (history[-1, :2] - history[-2, :2])


def play_plain(env):
    observations, _ = env.reset()
    total = 0.0
    while env.agents:
        observations, rewards, *_ = env.step({name: forecast(observations[name]) for name in env.agents})
        total += sum(rewards.values())
    return total


@pytest.mark.parametrize("flat", [False, True])
def test_slots_play_the_episode_of_the_agents(clock, flat):
    plain, env = make(clock), FixedAgents(make(clock), flat=flat)
    expected = play_plain(plain)
    observations, infos = env.reset()
    slots, total, empty, steps = list(env.possible_agents), 0.0, 0, 0
    truths = []
    while env.agents:
        assert list(observations) == list(infos) == env.agents == slots
        assert all(env.observation_space(slot).contains(observations[slot]) for slot in slots)
        actions = {slot: forecast(observations[slot].reshape(8, 2)) for slot in slots}
        unused = [slot for slot in slots if slot not in env.slots.values()]
        for slot in unused:
            assert not observations[slot].any()
            actions[slot] = np.full_like(actions[slot], np.nan)
        if flat:
            actions = {slot: action.reshape(-1) for slot, action in actions.items()}
            assert env.action_space(slots[0]).shape == (24,)
        observations, rewards, terminated, truncated, infos = env.step(actions)
        assert all(rewards[slot] == 0 for slot in unused)
        assert len({*terminated.values()}) == 1 and not any(truncated.values())
        truths.append(motion_gym.truth_from_infos(infos, 0.4))
        total, empty, steps = total + sum(rewards.values()), empty + len(unused), steps + 1
    assert all(terminated.values()) and steps == env.unwrapped.clock.scenes
    assert total == pytest.approx(expected, rel=1e-9)
    assert empty > 0 or clock == "windows"
    (one, truth), (other, same) = env.unwrapped.ledger.read(), plain.ledger.read()
    np.testing.assert_array_equal(one.positions, other.positions)
    np.testing.assert_array_equal(truth.future, same.future)
    assert sum(len(part.future) for part in truths if part is not None) == len(truth.future)
    assert ScoreParallel(env).score()["ADE"].mean == ScoreParallel(plain).score()["ADE"].mean


def test_an_agent_keeps_its_slot(clock):
    env = FixedAgents(make(clock))
    env.reset()
    while env.agents:
        before = dict(env.slots)
        assert sorted(before) == sorted(env.env.agents) and len(set(before.values())) == len(before)
        env.step({slot: np.zeros((1, 12, 2), np.float32) for slot in env.agents})
        assert all(env.slots[name] == slot for name, slot in before.items() if name in env.slots)


@pytest.mark.filterwarnings("ignore:reset.. has no option")  # the test of PettingZoo gives one
@pytest.mark.parametrize("flat", [False, True])
def test_pettingzoos_test_accepts_the_wrapper(clock, flat):
    parallel_api_test(FixedAgents(make(clock), flat=flat), num_cycles=80)


def test_mistakes_are_named():
    env = FixedAgents(make("stream"))
    env.reset()
    with pytest.raises(ActionError, match="No action for `slot_"):
        env.step({})
    with pytest.raises(ActionError, match="shape"):
        env.step({slot: np.zeros((1, 3), np.float32) for slot in env.agents})
    with pytest.raises(SpecError, match="is not a ForecastEnv"):
        FixedAgents(3)
