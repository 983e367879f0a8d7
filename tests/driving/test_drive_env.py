"""The Gymnasium environment `motion_gym/Drive-v0`."""

from __future__ import annotations

import pickle

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import motion_gym
from motion_gym.contract import ActionError, ParameterError, SpecError
from motion_gym.envs.highway_engine import package
from tests.traffic import needs_highway_env

SMALL = {"scenario": "roundabout", "runs": 1, "seconds": 30.0}


def make(**arguments):
    needs_highway_env()
    return gymnasium.make("motion_gym/Drive-v0", **{**SMALL, **arguments}).unwrapped


@pytest.mark.filterwarnings("ignore:.*Box")
@pytest.mark.parametrize("action", ["proposal", "control"])
def test_gymnasium_accepts_the_environment(action):
    env = make(action=action, others="replay", render_mode="rgb_array")
    check_env(env)
    again = pickle.loads(pickle.dumps(env))
    assert np.array_equal(again.reset(seed=0)[0]["history"], env.reset(seed=0)[0]["history"])


@pytest.mark.parametrize("others", ["react", "replay"])
def test_an_episode_with_a_predictor_repeats_and_ends(others):
    env, predictor = make(others=others), motion_gym.predictor("constant_velocity")
    played = []
    for _ in range(2):
        env.reset(seed=5)
        rewards, over = [], False
        while not over:
            _, reward, terminated, truncated, info = env.step(env.best_proposal(predictor.predict(env.observation)))
            rewards.append(reward)
            over = terminated or truncated
        played.append((rewards, info))
    assert played[0] == played[1]
    assert len(rewards) <= 14 and min(rewards) >= 0 and max(rewards) <= 1 and 0 <= info["score"] <= 1


def test_steering_off_the_road_earns_nothing():
    env = make(action="control", others="replay", scenario="straight")
    observed, info = env.reset(seed=1, options={"episode": 0})
    assert info["episode"] == 0
    there = observed["history"][observed["mask"] == 1]
    assert there[-1, -1] == pytest.approx(observed["ego"][:2]), "the ego vehicle is the last agent"
    assert np.diff(observed["path"], axis=0) == pytest.approx(np.tile([5.0, 0.0], (11, 1)), abs=1e-3)
    rewards = []
    for _ in range(8):
        observed, reward, terminated, _, _ = env.step(np.array([0.0, 0.1]))
        rewards.append(reward)
        if terminated:
            break
    assert observed["ego"][5] > 3, "to the left"
    assert rewards[-1] == 0 and rewards[0] > 0


def test_the_picture_shows_forecasts_and_the_plan():
    env = make(others="replay", render_mode="rgb_array")
    env.reset(seed=2)
    plain = env.render()
    env.best_proposal(motion_gym.predictor("constant_velocity").predict(env.observation))
    planned = env.render()
    assert plain.shape == planned.shape == (360, 720, 3) and plain.dtype == np.uint8
    assert (plain != planned).any(axis=2).sum() > 200


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"action": "proposals"}, SpecError, "`action=proposals` is not known.*Did you mean `proposal`"),
        ({"others": "react to me"}, SpecError, "`others=react to me`"),
        ({"scenario": "roundabot"}, SpecError, "Did you mean `roundabout`"),
        ({"style": "agressive"}, SpecError, "Did you mean `aggressive`"),
        ({"render_mode": "human"}, SpecError, "`render_mode=human`"),
        ({"styel": "calm"}, ParameterError, "Did you mean `style`"),
        ({"domain": "orca:d=0.3", "scenario": None}, ParameterError, "no parameter"),
    ],
)
def test_bad_arguments(arguments, error, message):
    from motion_gym.driving.gymnasium_env import DriveEnv

    needs_highway_env()
    with pytest.raises(error, match=message):
        DriveEnv(**{**SMALL, **arguments})


@pytest.mark.parametrize(
    ("action", "wrong"),
    [
        *(("proposal", wrong) for wrong in (16, -1, 1.0, [1, 2], None)),
        *(("control", wrong) for wrong in ([1.0], [np.nan, 0.0], "left", 3)),
    ],
)
def test_a_wrong_action_moves_nothing(action, wrong):
    env = make(action=action, others="replay")
    with pytest.raises(ActionError, match="call reset"):
        env.step(0)
    env.reset(seed=0)
    before = env.run.ego
    with pytest.raises(ActionError, match=r"The action is .*: give "):
        env.step(wrong)
    assert env.run.ego == before


def test_a_forecast_of_the_wrong_shape_and_an_unknown_option_are_named():
    env = make(others="replay")
    with pytest.raises(SpecError, match="call reset"):
        env.observation  # noqa: B018
    with pytest.warns(UserWarning, match="no option `scene`.*episode"):
        env.reset(seed=0, options={"scene": 1})
    with pytest.raises(ActionError, match="has the shape"):
        env.best_proposal(np.zeros((1, 1, 12, 3)))
    with pytest.raises(SpecError, match="`episode=999`"):
        env.reset(options={"episode": 999})


def test_highway_env_is_named_where_it_is_missing(monkeypatch):
    monkeypatch.setattr(package, "installed", lambda: None)
    from motion_gym.driving.gymnasium_env import DriveEnv

    with pytest.raises(SpecError, match=r'not installed: pip install "motion-gym\[highway\]"'):
        DriveEnv(scenario="roundabout", runs=1, seconds=29.0)
