"""What predictors around another one share."""

from __future__ import annotations

import copy
import inspect
from pathlib import Path
from typing import Any, ClassVar

from motion_gym import catalog
from motion_gym.contract import Forecast, Observation, SpecError, Truth
from motion_gym.stepping.harness import name_of, selection_of


class Around:
    """A predictor around a copy of another one.

    Args:
        of: Name of a predictor with weights, or a predictor.
        weights: Of the predictor, where it is given by name.
        seed: Of the predictor, where it is given by name.
    """

    kind: ClassVar[str]
    settings: ClassVar[tuple[str, ...]]
    """Arguments that make another row of a table."""

    def __init__(self, of: Any, weights: str | Path | None, seed: int | None):
        if isinstance(of, str):
            given = {"weights": weights, "seed": seed}
            name, parameters = catalog.parse_spec(of)
            known = {key: value for key, value in given.items() if value is not None}
            of = catalog.predictor(catalog.format_spec(name, {**parameters, **known}))
        elif weights is not None or seed is not None:
            raise SpecError("`weights` and `seed` go with the name of a predictor, and `of` is one already.")
        self.inner: Any = copy.deepcopy(of)

    @property
    def name(self) -> str:
        """What is done to which predictor; a name for people where that one has settings of its own."""
        defaults = {name: p.default for name, p in inspect.signature(type(self)).parameters.items()}
        set_to = {"of": name_of(self.inner), **{k: getattr(self, k) for k in self.settings}}
        return catalog.format_spec(self.kind, {k: v for k, v in set_to.items() if v != defaults[k]})

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
        """Forget all that was observed."""
        self.inner.reset()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres."""
        return self.inner.predict(observation, samples, seed)  # type: ignore[no-any-return]
