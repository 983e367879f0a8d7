"""Base class of predictors that wrap another predictor."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from motion_gym import catalog
from motion_gym.contract import Domain, Forecast, Observation, PredictorError, SpecError, Truth
from motion_gym.predictors.settings import check_settings, name_of_settings
from motion_gym.stepping.harness import ask, name_of, selection_of

SOURCE = "modular_invariant"
"""The default predictor to wrap."""


@dataclass(eq=False, repr=False)
class Around:
    """A predictor that wraps a copy of another predictor. Subclasses declare their settings as dataclass fields.

    Args:
        of: Name of a predictor, or a predictor object, which is copied.
        weights: Weights of the predictor, if ``of`` is a name.
        seed: Seed of the predictor's weights, if ``of`` is a name.

    Raises:
        SpecError: a setting is not allowed, or ``of`` is an object and ``weights`` or ``seed`` are set.
    """

    of: InitVar[Any] = SOURCE
    weights: InitVar[str | Path | None] = field(default=None, kw_only=True)
    seed: InitVar[int | None] = field(default=None, kw_only=True)
    kind: ClassVar[str]

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        check_settings(self)
        options = {name: value for name, value in (("weights", weights), ("seed", seed)) if value is not None}
        if options and not isinstance(of, str):
            raise SpecError("`weights` and `seed` go with the name of a predictor, but `of` is a predictor object.")
        self.inner: Any = copy.deepcopy(catalog.predictor(of, **options))
        self._prepare()

    def _prepare(self) -> None:
        """Check the wrapped predictor and set the initial state; called by the constructor and by ``fit``."""

    @property
    def name(self) -> str:
        """Spec with the settings that differ from the defaults, including the name of the wrapped predictor."""
        inner = name_of(self.inner)
        return name_of_settings(self, **({} if inner == getattr(type(self), "of", SOURCE) else {"of": inner}))

    @property
    def fingerprint(self) -> str:
        """sha256 of the weights."""
        return str(getattr(self.inner, "fingerprint", ""))

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        return tuple(getattr(self.inner, "trained_on", ()))

    @trained_on.setter
    def trained_on(self, names: tuple[str, ...]) -> None:
        self.inner.trained_on = names

    @property
    def fitted(self) -> bool:
        """Whether the wrapped predictor can forecast."""
        return getattr(self.inner, "fitted", True) is not False

    @property
    def fit_on_demand(self) -> bool:
        """Whether the wrapped predictor is fitted when it is evaluated by name."""
        return bool(getattr(self.inner, "fit_on_demand", True))

    def fit(self, train: Sequence[Truth], validation: Sequence[Truth], seed: int = 0) -> Around:
        """Fit the wrapped predictor, and begin anew.

        Raises:
            PredictorError: the wrapped predictor has no ``fit``.
        """
        if not hasattr(self.inner, "fit"):
            raise PredictorError(f"{name_of(self.inner)} has no `fit`: it is used as it is.")
        self.inner.fit(train, validation, seed)
        self._prepare()
        return self

    @property
    def selection(self) -> str:
        """How the weights were selected."""
        return selection_of(self.inner)

    def choose_weights(self, domains: Sequence[Domain]) -> None:
        """Let the wrapped predictor choose its weights, if it has several sets."""
        if hasattr(self.inner, "choose_weights"):
            self.inner.choose_weights(domains)

    def observe(self, truth: Truth) -> None:
        """Read the style from scenes whose 20 steps are all known."""
        self.inner.observe(truth)

    def reset(self) -> None:
        """Forget all observed scenes."""
        self.inner.reset()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres."""
        return ask(self.inner, observation, samples, seed)
