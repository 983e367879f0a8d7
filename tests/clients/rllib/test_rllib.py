"""RLlib samples from PettingZoo environments with a fixed set of agents, and updates a policy with the samples.

The classes that an algorithm of RLlib consists of are used without Ray's cluster of processes.
"""

import numpy as np
import pytest
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.learner.training_data import TrainingData
from ray.rllib.env.multi_agent_env_runner import MultiAgentEnvRunner
from ray.rllib.env.wrappers.pettingzoo_env import ParallelPettingZooEnv
from ray.tune.registry import register_env

import motion_gym
from motion_gym.stepping.wrappers import FixedAgents


def make(config):
    inner = motion_gym.parallel_env("orca", scenes=8, action="displacement", clock=config["clock"])
    return ParallelPettingZooEnv(FixedAgents(inner, flat=True))


@pytest.mark.parametrize("clock", ["windows", "stream"])
def test_an_episode_ends_for_all_slots_at_once(clock):
    env = make({"clock": clock})
    observations, _ = env.reset(seed=0)
    ended, steps = False, 0
    while not ended:
        assert set(observations) == set(env.possible_agents) == {"slot_0", "slot_1"}
        assert all(env.observation_space[name].contains(value) for name, value in observations.items())
        observations, rewards, terminations, _, _ = env.step({n: env.action_space[n].sample() for n in observations})
        ended, steps = terminations["__all__"], steps + 1
    assert steps == env.par_env.unwrapped.clock.scenes and set(rewards) == {"slot_0", "slot_1"}


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_ppo_samples_and_updates():
    register_env("forecast", make)
    config = (
        PPOConfig()
        .environment("forecast", env_config={"clock": "windows"})
        .env_runners(num_env_runners=0)
        .multi_agent(policies={"shared"}, policy_mapping_fn=lambda *arguments, **keywords: "shared")
        .training(train_batch_size_per_learner=32, minibatch_size=16, num_epochs=1)
    )
    runner = MultiAgentEnvRunner(config=config)
    episodes = runner.sample(num_timesteps=24, random_actions=False)
    assert sum(episode.env_steps() for episode in episodes) >= 24
    assert all(np.isfinite(episode.get_return()) and episode.get_return() < 0 for episode in episodes)
    learner = config.build_learner(env=None, spaces=runner.get_spaces())
    before = {name: value.clone() for name, value in learner.module["shared"].state_dict().items()}
    learner.update(training_data=TrainingData(episodes=episodes))
    after = learner.module["shared"].state_dict()
    assert any(bool((after[name] != value).any()) for name, value in before.items())
