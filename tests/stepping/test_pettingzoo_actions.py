"""Actions and arguments that the PettingZoo environment refuses."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

import motion_gym
from motion_gym.contract import ActionError, SpecError
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from tests.crowd import Crowd, assert_same, clocks, episode, random_actions

good = np.zeros((2, 12, 2), np.float32)
BAD = {
    "one step too few": (good[:, :11], r"shape \(2, 11, 2\), expected \(2, 12, 2\)"),
    "one sample too few": (good[:1], r"shape \(1, 12, 2\), expected \(2, 12, 2\)"),
    "no samples": (good[0], r"shape \(12, 2\), expected \(2, 12, 2\)"),
    "three coordinates": (np.zeros((2, 12, 3), np.float32), r"shape \(2, 12, 3\)"),
    "flat": (good.reshape(-1), r"shape \(48,\)"),
    "float16": (good.astype(np.float16), "dtype float16"),
    "int": (good.astype(np.int32), "dtype int32"),
    "list": (good.tolist(), "type list"),
    "None": (None, "type NoneType"),
    "NaN": (np.where(np.arange(48).reshape(2, 12, 2) == 47, np.nan, good).astype(np.float32), "NaN or infinite"),
    "inf": (np.where(np.arange(48).reshape(2, 12, 2) == 0, -np.inf, good).astype(np.float32), "NaN or infinite"),
}


def assert_unmoved(env: ForecastEnv, twin: ForecastEnv, bad, message: str) -> None:
    """A bad action is refused, and does not change the rest of the episode."""
    rng = np.random.default_rng(1)
    with pytest.raises(ActionError, match=message):
        env.step(bad)
    assert env.agents == twin.agents and env.ledger.settled == twin.ledger.settled
    for _ in range(3):
        actions = random_actions(twin, rng)
        assert_same(env.step(actions), twin.step(actions))


def pair_in_midst(clock: str) -> tuple[ForecastEnv, ForecastEnv]:
    env, rng = ForecastEnv(Crowd(), clock=clock, samples=2), np.random.default_rng(0)
    env.reset()
    for _ in range(15 if clock == "stream" else 3):
        env.step(random_actions(env, rng))
    assert len(env.agents) > 1
    return env, pickle.loads(pickle.dumps(env))


@clocks
@pytest.mark.parametrize("kind", BAD)
def test_a_bad_action_is_refused_by_name(clock, kind):
    env, twin = pair_in_midst(clock)
    bad, message = BAD[kind]
    name = env.agents[1]
    assert_unmoved(env, twin, {**dict.fromkeys(env.agents, good), name: bad}, f"`{name}` has .*{message}")


@clocks
def test_a_missing_action_is_refused_by_name(clock):
    env, twin = pair_in_midst(clock)
    name = env.agents[1]
    bad = {other: good for other in env.agents if other != name}
    assert_unmoved(env, twin, bad, f"No action for 1 of {len(env.agents)} agents, {name}")
    assert_unmoved(env, twin, {}, f"{len(env.agents)} agents, {env.agents[0]} first")


@clocks
def test_an_action_for_somebody_else_is_refused_by_name(clock):
    env, twin = pair_in_midst(clock)
    bad = {**dict.fromkeys(env.agents, good), "somebody": good}
    assert_unmoved(env, twin, bad, "`somebody`, which is not an agent")


@clocks
def test_an_action_for_one_who_has_left_or_not_yet_come_is_refused_by_name(clock):
    env = ForecastEnv(Crowd(), clock=clock, samples=2)
    last = env.possible_agents[-1]
    env.reset()
    with pytest.raises(ActionError, match=f"`{last}`, which is not here"):
        env.step({**dict.fromkeys(env.agents, good), last: good})
    first = list(env.agents)
    while set(first) <= set(env.agents):
        env.step(random_actions(env, np.random.default_rng(0)))
    gone = next(name for name in first if name not in env.agents)
    twin = pickle.loads(pickle.dumps(env))
    assert_unmoved(env, twin, {**dict.fromkeys(env.agents, good), gone: good}, f"`{gone}`, which is not here")


@clocks
@pytest.mark.parametrize("bad", [None, [good], good])
def test_actions_that_are_no_dict_are_refused(clock, bad):
    env, twin = pair_in_midst(clock)
    assert_unmoved(env, twin, bad, "dict from the names in `env.agents`")


@clocks
def test_a_step_before_reset_or_after_the_end_is_refused(clock):
    env = ForecastEnv(Crowd(), clock=clock)
    with pytest.raises(ActionError, match=r"not begun.*reset"):
        env.step({})
    episode(env)
    with pytest.raises(ActionError, match=r"over.*reset"):
        env.step(dict.fromkeys(env.possible_agents, good[:1]))
    assert_same(episode(env), episode(ForecastEnv(Crowd(), clock=clock)))


@pytest.mark.parametrize(
    "arguments, message",
    [
        ({"clock": "strem"}, "`clock=strem` is not known.*Did you mean `stream`"),
        ({"samples": 0}, "samples=0"),
        ({"samples": True}, "samples=True"),
        ({"samples": 1.0}, "samples=1.0"),
        ({"split": "tset"}, "no split `tset`.*Did you mean `test`"),
        ({"split": "reference"}, "no agent to observe"),
        ({"split": "reference", "clock": "stream"}, "no agent to observe"),
        ({"render_mode": "rgb_aray"}, "`render_mode=rgb_aray` is not known.*Did you mean `rgb_array`"),
    ],
)
def test_arguments_that_cannot_be_are_refused(arguments, message):
    with pytest.raises(SpecError, match=message):
        ForecastEnv(Crowd(), **arguments)


def test_a_parameter_that_does_not_exist_is_refused():
    with pytest.raises(SpecError, match=r"no parameter `scene`.*Did you mean `scenes`"):
        motion_gym.parallel_env("orca", scene=5)
