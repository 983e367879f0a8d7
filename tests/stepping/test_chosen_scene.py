"""``reset(options={"scene": n})`` begins an episode with a scene of one's choice."""

import numpy as np
import pytest

from motion_gym.contract import SpecError
from motion_gym.stepping.gymnasium_env import WindowEnv
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.vector_env import WindowVectorEnv
from motion_gym.stepping.wrappers import ScoreWindows
from tests.street import Street

PLACE, WINDOWS = "orca:scenes=8", 8


def windows_of(env, **reset):
    """Numbers of the windows of an episode."""
    env.reset(**reset)
    windows, ended = [], False
    while not ended:
        *_, ended, _, info = env.step(np.zeros(env.action_space.shape, np.float32))
        windows.append(info["window"])
    return windows


def test_an_episode_begins_with_the_scene_and_goes_on():
    env = WindowEnv(PLACE)
    assert windows_of(env, options={"scene": 5}) == [5, 6, 7]
    assert windows_of(env) == list(range(WINDOWS))
    shuffled = WindowEnv(PLACE, order="shuffled")
    whole = windows_of(shuffled, seed=3)
    assert windows_of(shuffled, seed=3, options={"scene": whole[4]}) == whole[4:]


def test_the_score_is_that_of_the_scenes_that_were_played():
    env = ScoreWindows(WindowEnv(PLACE))
    env.reset(options={"scene": 6})
    rewards = [env.step(np.zeros(env.action_space.shape, np.float32))[1] for _ in range(2)]
    assert env.score()["ADE"].mean == pytest.approx(-np.mean(rewards), rel=1e-6)


def test_a_vector_environment_takes_one_scene_or_one_for_each():
    env = WindowVectorEnv(PLACE, 3)
    for scene, expected in ((4, [4, 4, 4]), ([7, 0, 2], [7, 0, 2]), (np.array([1, 2, 3]), [1, 2, 3])):
        env.reset(options={"scene": scene})
        assert env.window.tolist() == expected
    env.reset(options={"scene": [7, 0, 2]})
    ended = env.step(np.zeros(env.action_space.shape, np.float32))[2]
    assert ended.tolist() == [True, False, False] and env.window[1:].tolist() == [3, 5]
    with pytest.raises(SpecError, match="has 2 numbers: give one, or one for each of the 3"):
        env.reset(options={"scene": [1, 2]})


def test_the_clocks_of_pettingzoo_begin_with_the_scene():
    windows = ForecastEnv(PLACE)
    windows.reset(options={"scene": 5})
    assert {name.split("_agent")[0] for name in windows.agents} == {"window_5"}
    street = Street(frames=60)
    whole, cut = ForecastEnv(street, clock="stream"), ForecastEnv(street, clock="stream")
    observations, _ = whole.reset()
    for _ in range(4):
        observations, *_ = whole.step({name: np.zeros((1, 12, 2), np.float32) for name in whole.agents})
    begun, _ = cut.reset(options={"scene": 4})
    assert cut.agents == whole.agents and cut.clock.time == whole.clock.time
    assert all(np.array_equal(begun[name], observations[name]) for name in cut.agents)
    steps = 0
    while cut.agents:
        cut.step({name: np.zeros((1, 12, 2), np.float32) for name in cut.agents})
        steps += 1
    assert steps == cut.clock.scenes - 4


def test_shuffled_windows_of_pettingzoo_follow_the_seed():
    def order(env, seed=None):
        env.reset(seed=seed)
        names = []
        while env.agents:
            names.append(env.agents[0])
            env.step({name: np.zeros((1, 12, 2), np.float32) for name in env.agents})
        return names

    env, published = ForecastEnv(PLACE, order="shuffled"), order(ForecastEnv(PLACE), 1)
    first = order(env, 1)
    assert first == order(env, 1) != order(env, 2) and sorted(first) == sorted(published) != first
    with pytest.raises(SpecError, match="a stream is played in the order of time"):
        ForecastEnv(PLACE, clock="stream", order="shuffled")


@pytest.mark.parametrize("scene", [-1, WINDOWS, 2.0, "3", True])
@pytest.mark.parametrize(
    "env", [WindowEnv(PLACE), WindowVectorEnv(PLACE, 2), ForecastEnv(PLACE)], ids=lambda env: type(env).__name__
)
def test_a_scene_that_is_not_there_is_refused(env, scene):
    with pytest.raises(SpecError, match=r"`scene=.*` must be a whole number, from 0 to 7"):
        env.reset(options={"scene": scene})


def test_another_option_is_named_in_a_warning():
    with pytest.warns(UserWarning, match=r"no option `scenes`.*Did you mean `scene`"):
        WindowEnv(PLACE).reset(options={"scenes": 3})
    with pytest.raises(SpecError, match="is a dict"):
        WindowEnv(PLACE).reset(options=3)
