"""Wrappers that score whatever acts in an environment, however it acts."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from pettingzoo.utils import BaseParallelWrapper

from motion_gym.contract import Forecast, SpecError, Truth
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
        SpecError: it is something else.
    """

    def __init__(self, env: Any):
        _must_be(env, ForecastEnv)
        super().__init__(env)

    @property
    def censored(self) -> int:
        """Forecasts that cannot be scored in full, because their agent left."""
        return self.unwrapped.ledger.censored  # type: ignore[attr-defined]

    def score(self) -> dict[str, Summary]:
        """Mean, interval and counts of every metric over the forecasts of this episode that have matured.

        Raises:
            SpecError: none has matured yet.
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
        SpecError: it is something else.
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
            SpecError: no window was forecast yet.
        """
        if not self._forecasts:
            raise SpecError("No window has been forecast yet: step the environment before you ask for a score.")
        forecast = Forecast(np.concatenate(self._forecasts))
        env: Any = self.unwrapped
        truth = pick_scenes(env.padded.truth, self._windows)
        return _summary(forecast, truth, env.domain.card.unit)


def _summary(forecast: Forecast, truth: Truth, unit: str) -> dict[str, Summary]:
    """Every metric for as many samples as the forecast has."""
    return summarise(score(forecast, truth, forecast.positions.shape[1], unit), truth.observation)


def _must_be(env: Any, kind: type) -> None:
    if not isinstance(getattr(env, "unwrapped", None), kind):
        raise SpecError(f"{type(env).__name__} is not a {kind.__name__} of motion-gym, nor a wrapper around one.")
