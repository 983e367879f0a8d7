"""The oracle of a stream: at each moment, a predictor that was trained where the stream now is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from motion_gym import catalog
from motion_gym.contract import Domain, Forecast, Observation, SpecError
from motion_gym.domains import spec_of
from motion_gym.harness import ask, tell
from motion_gym.windows import pick_scenes

REFERENCES = 64
"""Reference scenes of the domain that a predictor with a style is shown."""


class TargetOracle:
    """Told which domain is played, takes the predictor that was trained for it; one with a style is shown references.

    Args:
        predictors: Predictors, or their specs, by spec of the domain; one alone for all domains.
    """

    def __init__(self, predictors: str | Mapping[str, str]):
        self.by_domain = predictors
        self._made: dict[str, Any] = {}
        self._now = ""

    @property
    def name(self) -> str:
        """Whose forecasts these are."""
        each = [self.by_domain] if isinstance(self.by_domain, str) else dict.fromkeys(self.by_domain.values())
        return f"oracle({', '.join(each)})"

    @property
    def selection(self) -> str:
        """How weights were selected."""
        return "trained on the domains of the stream; the epoch with the lowest ADE on their validation windows"

    def know(self, domain: Domain) -> None:
        """Take the predictor of a domain.

        Raises:
            SpecError: there is none for it.
        """
        spec = spec_of(domain)
        if not isinstance(self.by_domain, str) and spec not in self.by_domain:
            raise SpecError(f"There is no oracle for {spec}; there are some for {', '.join(self.by_domain)}.")
        self._now = self.by_domain if isinstance(self.by_domain, str) else self.by_domain[spec]
        made = self._made.setdefault(self._now, catalog.predictor(self._now))
        if hasattr(made, "observe"):
            made.reset()
            tell(made, pick_scenes(domain.reference(), slice(0, REFERENCES)))

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast of the predictor taken."""
        return ask(self._made[self._now], observation, samples, seed)
