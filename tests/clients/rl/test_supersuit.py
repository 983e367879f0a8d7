"""SuperSuit's wrappers of PettingZoo environments, and Stable-Baselines3 through its vector environments."""

import numpy as np
import pytest
import supersuit
from stable_baselines3 import PPO

import motion_gym
from motion_gym.stepping.wrappers import FixedAgents

WRAPPERS = {
    "clip_actions": supersuit.clip_actions_v0,
    "dtype": lambda env: supersuit.dtype_v0(env, "float64"),
    "flatten": supersuit.flatten_v0,
    "frame_stack": lambda env: supersuit.frame_stack_v1(supersuit.flatten_v0(env), 3),
    "nan_zeros": supersuit.nan_zeros_v0,
    "normalize_obs": supersuit.normalize_obs_v0,
    "pad_action_space": supersuit.pad_action_space_v0,
    "pad_observations": supersuit.pad_observations_v0,
    "scale_actions": lambda env: supersuit.scale_actions_v0(env, 0.5),
    "sticky_actions": lambda env: supersuit.sticky_actions_v0(env, 0.5),
}


def make(clock="windows", scenes=6, **arguments):
    return motion_gym.parallel_env("orca", clock=clock, scenes=scenes, action="displacement", **arguments)


@pytest.mark.parametrize("clock", ["windows", "stream"])
@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_a_wrapped_environment_plays_to_its_end(wrapper, clock):
    inner = make(clock, observation_bound=100)
    env = WRAPPERS[wrapper](inner)
    observations, _ = env.reset(seed=0)
    steps = 0
    while env.agents:
        assert all(env.observation_space(name).contains(observations[name]) for name in env.agents)
        observations, *_ = env.step({name: env.action_space(name).sample() for name in env.agents})
        steps += 1
    assert steps == inner.clock.scenes and inner.ledger.settled > 0


@pytest.mark.parametrize("clock", ["windows", "stream"])
def test_stable_baselines3_trains_one_policy_for_all_agents(clock):
    env = supersuit.pettingzoo_env_to_vec_env_v1(FixedAgents(make(clock)))
    copies = supersuit.concat_vec_envs_v1(env, 2, num_cpus=0, base_class="stable_baselines3")
    assert copies.num_envs == 4
    model = PPO("MlpPolicy", copies, n_steps=16, batch_size=32, n_epochs=1)
    assert model.learn(64).num_timesteps == 64
    action, _ = model.predict(np.zeros((4, 8, 2), np.float32))
    assert action.shape == (4, 1, 12, 2)
