"""Action spaces are bounded, and actions are checked."""

import gymnasium
import numpy as np
import pytest

import motion_gym
from motion_gym.contract import ActionError
from motion_gym.stepping.gymnasium_env import WindowEnv
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.spaces import BOUND, checked_action
from motion_gym.stepping.vector_env import WindowVectorEnv

PLACE = "orca:scenes=6"


def test_action_spaces_are_finite_and_an_action_beyond_them_is_accepted():
    """Stable-Baselines3 refuses a Box that is not finite."""
    parallel, single, vector = ForecastEnv(PLACE), WindowEnv(PLACE), WindowVectorEnv(PLACE, 2)
    for space in (parallel.action_space(parallel.possible_agents[0]), single.action_space, vector.action_space):
        assert isinstance(space, gymnasium.spaces.Box) and space.is_bounded()
        assert space.contains(space.sample())
    single.reset()
    reward = single.step(np.full(single.action_space.shape, 2 * BOUND, np.float32))[1]
    assert np.isfinite(reward) and reward < -BOUND


def test_float64_actions_are_cast():
    rng = np.random.default_rng(0)
    for make in (lambda: WindowEnv(PLACE), lambda: WindowVectorEnv(PLACE, 3)):
        one, other = make(), make()
        one.reset(), other.reset()
        for _ in range(4):
            action = rng.normal(size=one.action_space.shape)
            assert np.array_equal(one.step(action)[1], other.step(action.astype(np.float32))[1])
    for clock in ("windows", "stream"):
        one, other = ForecastEnv(PLACE, clock=clock), ForecastEnv(PLACE, clock=clock)
        one.reset(), other.reset()
        while one.agents:
            actions = {name: rng.normal(size=(1, 12, 2)) for name in one.agents}
            rewards = other.step({name: action.astype(np.float32) for name, action in actions.items()})[1]
            assert one.step(actions)[1] == rewards


def test_float64_beyond_float32_is_refused_as_infinite():
    env = motion_gym.parallel_env(PLACE)
    env.reset()
    with pytest.raises(ActionError, match="NaN or infinite"):
        env.step({name: np.full((1, 12, 2), 1e300) for name in env.agents})
    assert checked_action(np.ones((12, 2)), (1, 12, 2), "It", one_sample=True).dtype == np.float32
