"""Training programs and their stages, and checks of training sets."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from motion_gym.contract import PredictorError, SpecError, Truth
from motion_gym.data.windows import digest
from motion_gym.specs import whole_number

Weights = dict[str, Tensor]


@dataclass(frozen=True)
class Stage:
    """One stage of a training.

    Attributes:
        name: Name for the progress bar and the card.
        epochs: Number of epochs.
        rates: Learning rates of Adam, by the name of a weight or its first part; ``""`` for the rest. Weights without a
            rate are frozen.
        selects: Whether the validation scores of this stage select the weights.
        decays: Whether the learning rates decay to 0 along a half cosine; the number of epochs is then part of the
            configuration.
    """

    name: str
    epochs: int
    rates: Mapping[str, float]
    selects: bool = False
    decays: bool = False


class Program:
    """A training program; a subclass sets the attributes and defines initial weights, losses and validation scores.

    Attributes:
        stages: The stages in order.
        config: All settings that the result depends on, in JSON types; must match that of a resumed checkpoint.
    """

    stages: list[Stage]
    config: dict[str, Any]

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        raise NotImplementedError

    def initial(self, seeds: Sequence[int]) -> Weights:
        """Initial weights [M, ...] of all models."""
        models = [self.first(seed) for seed in seeds]
        return {name: torch.cat([weights[name] for weights in models]) for name in models[0]}

    def state(self, models: int) -> Tensor:
        """Initial state of the objective in each stage. The base class has none."""
        return torch.zeros(0)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch, one after the other; the weights change between steps."""
        raise NotImplementedError

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """Validation scores [M], lower is better."""
        raise NotImplementedError

    def finished(self, weights: Weights) -> Weights:
        """The weights to save, on the CPU. The base class returns the trained weights."""
        return weights


def digests(train: Sequence[Truth], validation: Sequence[Truth]) -> dict[str, Any]:
    """Digests of both sets, for the configuration of a program."""
    return {"train": [digest(truth) for truth in train], "validation": [digest(truth) for truth in validation]}


def check_epochs(name: str, epochs: Any, stages: int) -> tuple[int, ...]:
    """The epochs of each stage of a predictor.

    Raises:
        SpecError: there is not one whole number for each stage, or the last stage has no epochs.
    """
    listed = epochs if isinstance(epochs, Iterable) else ()
    counts = tuple(whole_number("epochs", count, 0, 1_000_000) for count in listed)
    if len(counts) != stages or not counts[-1]:
        raise SpecError(
            f"`epochs={epochs}` must be a list of {stages} for {name}, a number for each stage, with at least one "
            "epoch in the last stage."
        )
    return counts


def check_complete(train: Sequence[Truth], validation: Sequence[Truth]) -> None:
    """Raise PredictorError unless both sets have the same number of environments, and these have complete windows."""
    if isinstance(train, Truth) or isinstance(validation, Truth):
        raise PredictorError(
            "Training and validation sets are sequences of Truth, one for each environment: give [truth]."
        )
    if not train or len(train) != len(validation):
        raise PredictorError(
            f"The training set has {len(train)} environments and the validation set {len(validation)}: give at "
            "least one, and the same ones for both."
        )
    for name, truths in (("training", train), ("validation", validation)):
        for number, truth in enumerate(truths):
            if not len(truth.future):
                raise PredictorError(f"Environment {number} of the {name} set is empty: it needs at least one window.")
            if not math.isclose(truth.observation.dt, train[0].observation.dt, rel_tol=1e-3):
                raise PredictorError(
                    f"Environment {number} of the {name} set has steps of {truth.observation.dt:.3g} s, the first of "
                    f"the training set {train[0].observation.dt:.3g} s: resample them."
                )
            if not truth.known.all():
                raise PredictorError(
                    f"Environment {number} of the {name} set has unknown future steps: give complete windows."
                )
