"""A predictor that is asked through the harness, so that it answers with a checked Forecast whatever it returns."""

from __future__ import annotations

from typing import Any

from motion_gym.contract import Forecast, Observation
from motion_gym.stepping.harness import ask, name_of


class Asked:
    """Stands for a predictor; its ``predict`` returns a checked Forecast, everything else is the predictor's own.

    An adapter of a user's own is given this instead of a predictor, which may return an array alone.

    Args:
        inner: The predictor.
    """

    def __init__(self, inner: Any):
        vars(self)["inner"] = inner

    @property
    def name(self) -> str:
        """The name of the predictor."""
        return name_of(self.inner)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """The checked forecast of the predictor."""
        return ask(self.inner, observation, samples, seed)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__") or name == "inner":
            raise AttributeError(name)
        return getattr(self.inner, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self.inner, name, value)
