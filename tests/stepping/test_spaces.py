"""Action spaces are bounded, and actions are checked."""

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import motion_gym
from motion_gym.contract import ActionError, Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.gymnasium_env import WindowEnv
from motion_gym.stepping.pettingzoo_env import ForecastEnv
from motion_gym.stepping.spaces import BOUND, Actions, checked_action
from motion_gym.stepping.vector_env import WindowVectorEnv

PLACE = "orca:scenes=6"
ENVIRONMENTS = {
    "one window": lambda **arguments: WindowEnv(PLACE, **arguments),
    "vector": lambda **arguments: WindowVectorEnv(PLACE, 2, **arguments),
    "windows clock": lambda **arguments: ForecastEnv(PLACE, **arguments),
    "stream clock": lambda **arguments: ForecastEnv(PLACE, clock="stream", **arguments),
}


def space_of(env):
    """Action space of an environment, of the first agent where there are several."""
    return env.action_space(env.possible_agents[0]) if isinstance(env, ForecastEnv) else env.action_space


def begin(env):
    """A function that steps an environment, and returns the rewards.

    Every agent of a PettingZoo environment gets the same action. An action may be a function of the last positions
    [..., 1, 1, 2].
    """
    state = [env.reset()[0]]

    def take(action, history):
        return action(history[..., -1, None, None, :2]).astype(np.float32) if callable(action) else action

    def step(action):
        observations = state[0]
        if isinstance(env, ForecastEnv):
            given = {name: take(action, observations[name]) for name in env.agents}
        else:
            given = take(action, observations["history"])
        state[0], reward, *_ = env.step(given)
        return [*reward.values()] if isinstance(env, ForecastEnv) else np.ravel(reward).tolist()

    return step


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


class Pixels(RecordedDomain):
    """Two walkers in pixels."""

    name, unit = "pixels", "px"

    def recordings(self, split):
        frame, agent = np.repeat(np.arange(20), 2), np.tile([0, 1], 20)
        return [Recording(frame, agent, np.stack([frame * 9.0, agent * 50.0], axis=1), self.dt)]


@given(st.integers(0, 2**32), st.floats(0.01, 5))
def test_displacements_are_clipped_scaled_and_added_up_from_the_last_position(seed, limit):
    rng = np.random.default_rng(seed)
    last, action = rng.normal(0, 50, (3, 2)).astype(np.float32), rng.uniform(-2, 2, (3, 2, 12, 2)).astype(np.float32)
    start = np.broadcast_to(last[:, None, None], (3, 2, 1, 2))
    path = np.concatenate([start, Actions("displacement", limit).positions(action, last)], axis=2).astype(np.float64)
    np.testing.assert_allclose(np.diff(path, axis=2), np.clip(action, -1, 1) * limit, atol=1e-4)


@pytest.mark.parametrize("make", ENVIRONMENTS.values(), ids=ENVIRONMENTS)
def test_a_displacement_is_rewarded_as_the_position_it_leads_to(make):
    """A walker of constant velocity: 1 m in a step, half the limit."""
    scaled, plain = make(action="displacement", displacement_limit=2.0), make()
    assert space_of(scaled).low.min() == -1 and space_of(scaled).high.max() == 1
    rng = np.random.default_rng(0)
    one, other = begin(scaled), begin(plain)
    for _ in range(3):
        action = rng.uniform(-1, 1, space_of(scaled).shape).astype(np.float32)
        assert one(action) == pytest.approx(
            other(lambda last, a=action: last + 2 * a.astype(float).cumsum(axis=-2)), rel=1e-5
        )


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("make", ENVIRONMENTS.values(), ids=ENVIRONMENTS)
def test_a_displacement_that_is_not_finite_is_refused(make, value):
    env = make(action="displacement")
    action = np.zeros(space_of(env).shape, np.float32)
    action[..., 3, 1] = value
    with pytest.raises(ActionError, match="NaN or infinite"):
        begin(env)(action)


REFUSED = {
    "unknown kind": ({"action": "velocity"}, "action=velocity.*displacement, position"),
    "no limit": ({"action": "displacement", "displacement_limit": 0}, "displacement_limit=0.*above 0"),
    "text": ({"action": "displacement", "displacement_limit": "1"}, "displacement_limit=1.*number"),
    "limit of positions": ({"displacement_limit": 2.0}, "no effect on positions.*action='displacement'"),
    "bound too small": ({"observation_bound": 1.0}, r"observation_bound=1.*too small.*reach \d"),
    "bound of zero": ({"observation_bound": 0}, "observation_bound=0.*above 0"),
    "unknown order": ({"order": "random"}, "order=random.*published, shuffled"),
}


@pytest.mark.parametrize("make", ENVIRONMENTS.values(), ids=ENVIRONMENTS)
@pytest.mark.parametrize("kind", REFUSED)
def test_arguments_that_cannot_be_are_refused(make, kind):
    arguments, message = REFUSED[kind]
    with pytest.raises(SpecError, match=message):
        make(**arguments)


def test_the_limit_must_be_stated_where_positions_are_not_in_metres():
    with pytest.raises(SpecError, match=r"needs `displacement_limit`.*in px"):
        WindowEnv(Pixels(), action="displacement")
    assert WindowEnv(Pixels(), action="displacement", displacement_limit=20.0).padded.actions.limit == 20


@pytest.mark.parametrize("make", ENVIRONMENTS.values(), ids=ENVIRONMENTS)
def test_observations_lie_in_a_finite_space_on_request(make):
    env = make(observation_bound=50.0)
    space = env.observation_space(env.possible_agents[0]) if isinstance(env, ForecastEnv) else env.observation_space
    boxes = [space] if isinstance(space, gymnasium.spaces.Box) else [space["history"]]
    assert all(box.is_bounded() and box.high.max() == 50 for box in boxes)
    observation = env.reset()[0]
    shown = [*observation.values()] if isinstance(env, ForecastEnv) else [observation]
    assert all(space.contains(part) for part in shown)
