"""The oracle of a stream: at each time, a predictor that was trained on the current domain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from motion_gym import catalog
from motion_gym.contract import Domain, Forecast, Observation, PredictorError, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import ask, name_of, selection_of, tell

REFERENCES = 64
"""Number of reference scenes that a predictor with a style observes."""


class TargetOracle:
    """Uses the predictor that was trained for the current domain; a predictor with a style observes reference scenes.

    A predictor without weights that is fitted in closed form is fitted to the scored windows of the current domain.

    Args:
        predictors: Specs of predictors by spec of the domain, or one spec for all domains.

    Raises:
        SpecError: A name is not known.
        PredictorError: Weights are missing.
    """

    def __init__(self, predictors: str | Mapping[str, str]):
        self.by_domain = predictors
        specs = [predictors] if isinstance(predictors, str) else predictors.values()
        self._predictors: dict[str, Any] = {spec: catalog.predictor(spec) for spec in specs}
        for predictor in self._predictors.values():
            if getattr(predictor, "fitted", True) is False and not getattr(predictor, "fit_on_demand", True):
                raise PredictorError(
                    f"{name_of(predictor)} is not trained, and cannot be an oracle: name one with weights."
                )
        self._current = ""

    @property
    def name(self) -> str:
        """Name with the specs of the predictors."""
        each = [self.by_domain] if isinstance(self.by_domain, str) else dict.fromkeys(self.by_domain.values())
        return f"oracle({', '.join(each)})"

    @property
    def selection(self) -> str:
        """How the weights were selected."""
        fitted = "fitted to the scored windows of each domain"
        return "; ".join(
            dict.fromkeys(
                selection_of(predictor) if hasattr(predictor, "trained_on") else fitted
                for predictor in self._predictors.values()
            )
        )

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        return tuple(
            dict.fromkeys(
                name for predictor in self._predictors.values() for name in getattr(predictor, "trained_on", ())
            )
        )

    def know(self, domain: Domain) -> None:
        """Use the predictor of a domain.

        Raises:
            SpecError: There is no predictor for the domain.
        """
        spec = spec_of(domain)
        if not isinstance(self.by_domain, str) and spec not in self.by_domain:
            raise SpecError(f"There is no oracle for {spec}; there are some for {', '.join(self.by_domain)}.")
        self._current = self.by_domain if isinstance(self.by_domain, str) else self.by_domain[spec]
        predictor = self._predictors[self._current]
        if getattr(catalog.predictor(self._current), "fitted", True) is False:
            predictor.fit([domain.windows("test")], [], 0)
        if hasattr(predictor, "observe"):
            predictor.reset()
            tell(predictor, pick_scenes(domain.reference(), slice(0, REFERENCES)))

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast of the current predictor."""
        return ask(self._predictors[self._current], observation, samples, seed)
