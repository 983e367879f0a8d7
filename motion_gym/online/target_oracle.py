"""The oracle of a stream: at each moment, a predictor that was trained where the stream now is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from motion_gym import catalog
from motion_gym.contract import Domain, Forecast, Observation, PredictorError, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask, name_of, selection_of, tell

REFERENCES = 64
"""Reference scenes of the domain that a predictor with a style is shown."""


class TargetOracle:
    """Told which domain is played, takes the predictor that was trained for it; one with a style is shown references.

    Args:
        predictors: Specs of predictors by spec of the domain; one alone for all domains.

    Raises:
        SpecError: a name is not known.
        PredictorError: weights are missing.
    """

    def __init__(self, predictors: str | Mapping[str, str]):
        self.by_domain = predictors
        specs = [predictors] if isinstance(predictors, str) else predictors.values()
        self._made: dict[str, Any] = {spec: catalog.predictor(spec) for spec in specs}
        for made in self._made.values():
            if getattr(made, "fitted", True) is False:
                raise PredictorError(f"{name_of(made)} is not trained, and cannot be an oracle: name one with weights.")
        self._now = ""

    @property
    def name(self) -> str:
        """Whose forecasts these are."""
        each = [self.by_domain] if isinstance(self.by_domain, str) else dict.fromkeys(self.by_domain.values())
        return f"oracle({', '.join(each)})"

    @property
    def selection(self) -> str:
        """How weights were selected."""
        return "; ".join(dict.fromkeys(selection_of(made) for made in self._made.values()))

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        return tuple(dict.fromkeys(name for made in self._made.values() for name in getattr(made, "trained_on", ())))

    def know(self, domain: Domain) -> None:
        """Take the predictor of a domain.

        Raises:
            SpecError: there is none for it.
        """
        spec = spec_of(domain)
        if not isinstance(self.by_domain, str) and spec not in self.by_domain:
            raise SpecError(f"There is no oracle for {spec}; there are some for {', '.join(self.by_domain)}.")
        self._now = self.by_domain if isinstance(self.by_domain, str) else self.by_domain[spec]
        made = self._made[self._now]
        if hasattr(made, "observe"):
            made.reset()
            tell(made, pick_scenes(domain.reference(), slice(0, REFERENCES)))

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast of the predictor taken."""
        return ask(self._made[self._now], observation, samples, seed)
