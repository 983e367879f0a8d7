"""Wrappers that score the forecasts of an environment, and one for clients that need a fixed set of agents."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import flatten_space
from pettingzoo.utils import BaseParallelWrapper

from motion_gym.contract import ActionError, Forecast, SpecError, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.bootstrap import Summary, summarise
from motion_gym.metrics.errors import score
from motion_gym.stepping.gymnasium_env import WindowEnv
from motion_gym.stepping.pettingzoo_env import ForecastEnv


class ScoreParallel(BaseParallelWrapper):
    """Scores the matured forecasts of a PettingZoo environment of motion-gym; both clocks.

    Args:
        env: A ``ForecastEnv``, or a wrapper around one.

    Raises:
        SpecError: The environment is of another class.
    """

    def __init__(self, env: Any):
        _must_be(env, ForecastEnv)
        super().__init__(env)

    @property
    def censored(self) -> int:
        """Number of forecasts whose agent left before the last step."""
        return self.unwrapped.ledger.censored  # type: ignore[attr-defined]

    def score(self) -> dict[str, Summary]:
        """Mean, interval and counts of every metric over the forecasts of this episode that have matured.

        Raises:
            SpecError: No forecast has matured yet.
        """
        ledger: Any = self.unwrapped.ledger  # type: ignore[attr-defined]
        if not ledger.matured:
            raise SpecError("No forecast has matured yet: step the environment further before you ask for a score.")
        forecast, truth = ledger.matured_only()
        return _summary(forecast, truth, self.unwrapped.domain.card.unit)  # type: ignore[attr-defined]


class ScoreWindows(gymnasium.Wrapper):
    """Scores every window of a Gymnasium environment of motion-gym.

    Args:
        env: A ``WindowEnv``, or a wrapper around one.

    Raises:
        SpecError: The environment is of another class.
    """

    def __init__(self, env: gymnasium.Env):
        _must_be(env, WindowEnv)
        super().__init__(env)
        self._forecasts: list[np.ndarray] = []
        self._windows: list[int] = []

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Reset, and forget the scores of the last episode."""
        self._forecasts, self._windows = [], []
        return super().reset(**arguments)

    def step(self, action: np.ndarray) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step, and keep the forecasts of this window."""
        window = self.unwrapped.window  # type: ignore[attr-defined]
        outcome = super().step(action)
        self._windows.append(window)
        self._forecasts.append(self.unwrapped.forecast.positions)  # type: ignore[attr-defined]
        return outcome

    def score(self) -> dict[str, Summary]:
        """Mean, interval and counts of every metric over the windows of this episode so far.

        Raises:
            SpecError: No window was forecast yet.
        """
        if not self._forecasts:
            raise SpecError("No window has been forecast yet: step the environment before you ask for a score.")
        forecast = Forecast(np.concatenate(self._forecasts))
        env: Any = self.unwrapped
        truth = pick_scenes(env.padded.truth, self._windows)
        return _summary(forecast, truth, env.domain.card.unit)


class FixedAgents(BaseParallelWrapper):
    """Lets ``slot_0`` to ``slot_N`` act for the agents of a PettingZoo environment of motion-gym; both clocks.

    There are as many slots as agents are ever there at once, and all of them stay from ``reset`` to the last step, when
    all terminate. An agent takes the first free slot when it enters and keeps it until it leaves; another agent may
    take the slot afterwards. A slot without an agent observes zeros and has the reward 0, and its action is ignored.
    The reward and the infos of a step are those of the agent that acted.

    Args:
        env: A ``ForecastEnv``, or a wrapper around one.
        flat: Observations and actions of one dimension, for clients that take no others.

    Attributes:
        slots: Slot of each agent that is there, by the agent's name.

    Raises:
        SpecError: The environment is of another class.
    """

    def __init__(self, env: Any, flat: bool = False):
        _must_be(env, ForecastEnv)
        super().__init__(env)
        inner: Any = self.unwrapped
        agent, self._flat = inner.possible_agents[0], flat
        spaces = env.observation_space(agent), env.action_space(agent)
        self._action_shape = spaces[1].shape
        self._observation_space = flatten_space(spaces[0]) if flat else spaces[0]
        self._action_space = flatten_space(spaces[1]) if flat else spaces[1]
        self.possible_agents = [f"slot_{number}" for number in range(inner.clock.most)]
        self.agents: list[str] = []
        self.slots: dict[str, str] = {}

    def observation_space(self, agent: str) -> gymnasium.spaces.Space:
        """The same for all slots."""
        return self._observation_space

    def action_space(self, agent: str) -> gymnasium.spaces.Space:
        """The same for all slots."""
        return self._action_space

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Reset the environment; its first agents take the first slots."""
        observations, _ = self.env.reset(seed=seed, options=options)
        self.agents, self.slots = list(self.possible_agents), {}
        self._enter()
        return self._observe(observations), {slot: {} for slot in self.agents}

    def step(self, actions: Mapping[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """Hand the actions of the slots to their agents.

        Raises:
            ActionError: A slot with an agent has no action, or as for the environment.
        """
        missing = [slot for slot in self.slots.values() if slot not in actions]
        if missing:
            raise ActionError(f"No action for `{missing[0]}`: every slot of `env.agents` needs an action.")
        acted = dict(self.slots)
        actions_by_name = {name: self._action(actions[slot]) for name, slot in acted.items()}
        observations, rewards, _, _, infos = self.env.step(actions_by_name)
        here = set(self.env.agents)
        self.slots = {name: slot for name, slot in acted.items() if name in here}
        self._enter()
        ended = not here
        reward = dict.fromkeys(self.possible_agents, 0.0) | {slot: rewards[name] for name, slot in acted.items()}
        if ended:
            self.agents = []
        flags = dict.fromkeys(self.possible_agents, ended)
        reported = {slot: infos[name] for name, slot in acted.items()}
        info = {slot: reported.get(slot, {}) for slot in self.possible_agents}
        return self._observe(observations), reward, flags, dict.fromkeys(self.possible_agents, False), info

    def _enter(self) -> None:
        taken = set(self.slots.values())
        free = (slot for slot in self.possible_agents if slot not in taken)
        for name in self.env.agents:
            if name not in self.slots:
                self.slots[name] = next(free)

    def _action(self, action: Any) -> Any:
        fits = self._flat and isinstance(action, np.ndarray) and action.shape == self._action_space.shape
        return action.reshape(self._action_shape) if fits else action

    def _observe(self, observations: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        shape, dtype = self._observation_space.shape or (), self._observation_space.dtype
        occupied = {slot: observations[name].reshape(shape) for name, slot in self.slots.items()}
        return {slot: occupied[slot] if slot in occupied else np.zeros(shape, dtype) for slot in self.possible_agents}


def _summary(forecast: Forecast, truth: Truth, unit: str) -> dict[str, Summary]:
    """Every metric for as many samples as the forecast has."""
    return summarise(score(forecast, truth, forecast.positions.shape[1], unit), truth.observation)


def _must_be(env: Any, kind: type) -> None:
    if not isinstance(getattr(env, "unwrapped", None), kind):
        raise SpecError(f"{type(env).__name__} is not a {kind.__name__} of motion-gym, nor a wrapper around one.")
