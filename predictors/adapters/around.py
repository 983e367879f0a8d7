"""What predictors around another one share."""

from __future__ import annotations

import copy
from dataclasses import InitVar, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

from motion_gym import catalog
from motion_gym.contract import Forecast, Observation, SpecError, Truth
from motion_gym.predictors.settings import check_settings, name_of_settings
from motion_gym.stepping.harness import ask, name_of, selection_of

SOURCE = "modular_invariant"
"""The predictor that is adapted where none is given."""


@dataclass(eq=False, repr=False)
class Around:
    """A predictor around a copy of another one; a subclass declares its settings as fields.

    Args:
        of: Name of a predictor, or a predictor; a copy of it is used.
        weights: Weights of the predictor, where ``of`` is a name.
        seed: Seed of the predictor's weights, where ``of`` is a name.

    Raises:
        SpecError: a setting is not allowed, or ``weights`` or ``seed`` are given with a predictor.
    """

    of: InitVar[Any] = SOURCE
    weights: InitVar[str | Path | None] = field(default=None, kw_only=True)
    seed: InitVar[int | None] = field(default=None, kw_only=True)
    kind: ClassVar[str]

    def __post_init__(self, of: Any, weights: str | Path | None, seed: int | None) -> None:
        check_settings(self)
        if isinstance(of, str):
            name, parameters = catalog.parse_spec(of)
            given = {key: value for key, value in (("weights", weights), ("seed", seed)) if value is not None}
            of = catalog.predictor(catalog.format_spec(name, {**parameters, **given}))
        elif weights is not None or seed is not None:
            raise SpecError("`weights` and `seed` go with the name of a predictor, and `of` is one already.")
        self.inner: Any = copy.deepcopy(of)

    @property
    def name(self) -> str:
        """What is done to which predictor; a name for people where that one has settings of its own."""
        inner = name_of(self.inner)
        return name_of_settings(self, **({} if inner == getattr(type(self), "of", SOURCE) else {"of": inner}))

    @property
    def weights_name(self) -> str:
        """Row of a table whose weights are used."""
        return str(getattr(self.inner, "weights_name", name_of(self.inner)))

    @property
    def fingerprint(self) -> str:
        """sha256 of the weights."""
        return str(getattr(self.inner, "fingerprint", ""))

    @property
    def trained_on(self) -> tuple[str, ...]:
        """Names of the domains whose windows the weights were trained on."""
        return tuple(getattr(self.inner, "trained_on", ()))

    @property
    def selection(self) -> str:
        """How the weights were selected."""
        return selection_of(self.inner)

    def observe(self, truth: Truth) -> None:
        """Read the style from scenes whose 20 steps are all known."""
        self.inner.observe(truth)

    def reset(self) -> None:
        """Forget everything that was observed."""
        self.inner.reset()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres."""
        return ask(self.inner, observation, samples, seed)
