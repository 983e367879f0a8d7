"""Training of the two-agent network whose style has factors, each with a label in every environment."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import PredictorError, Truth
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import FACTORS
from motion_gym.predictors.training.style_loss import style_loss
from motion_gym.predictors.training.style_training import StyleProgram
from motion_gym.specs import number
from motion_gym.training.program import Weights

START = {1: "d", 2: "side"}
"""Factor that has most of the units of a block of the modulator at first. The latent then holds how far agents go out
of their way, and the side is chosen behind it, as in the simulation."""
OVERLAP = 0.1
"""Factor of the penalty on units that several factors change."""


class FactorProgram(StyleProgram):
    """The stages of ``StyleProgram``, with a style of factors.

    The style loss is a sum over factors: codes of a factor are drawn together over all environments with the same
    label, and apart from those of other labels. It compares the codes themselves, without a projection head, so that
    nothing else is left in them. The code of a factor that forecasts of an environment receive is the
    mean code of the scenes of a random environment with the same label, so that it cannot tell the other factors. The
    penalty on modulators is ``overlap`` times the sum over units of the product of the gates of the factors.

    Args:
        predictor: A ``ModularFactors``.
        train: See ``StyleProgram``.
        validation: See ``StyleProgram``.
        labels: Label of each environment, by factor.
        overlap: Factor of the penalty.
        **options: Options of ``StyleProgram``.

    Raises:
        SpecError: a number is not allowed.
        PredictorError: a factor has no label for each environment, or the same one for all; or see ``StyleProgram``.
    """

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        labels: Mapping[str, Sequence[Any]],
        overlap: float = OVERLAP,
        device: torch.device,
        epochs: Sequence[int] | None = None,
        scenes: int = 64,
        most: int | None = 9000,
    ):
        super().__init__(predictor, train, validation, device=device, epochs=epochs, scenes=scenes, most=most)
        self.overlap = number("overlap", overlap)
        values = {factor: list(labels.get(factor, ())) for factor in FACTORS}
        for factor, of_environments in values.items():
            if len(of_environments) != len(train) or len(set(of_environments)) < 2:
                raise PredictorError(
                    f"The factor `{factor}` of {predictor.name} has the labels {of_environments} for {len(train)} "
                    "training domains: each domain needs a label, and at least two must differ."
                )
        self.labels = {factor: [listed.index(value) for value in listed] for factor, listed in values.items()}
        """Number of the first environment with the same label, by factor and environment."""
        self.config |= {"labels": values, "overlap": overlap}

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]; see ``START``."""
        weights = super().first(seed)
        for block, name in START.items():
            gate = torch.tensor([1.0 if factor == name else -1.0 for factor in FACTORS])
            weights[f"modulator_gate.weight{block}"] = gate[None, :, None] + weights[f"modulator_gate.weight{block}"]
        return weights

    def _contrast(self, embedding: Tensor, environment: Tensor) -> Tensor:
        total = torch.zeros(len(embedding), device=self.device)
        for part, of_environments in zip(self._by_factor(embedding), self.labels.values(), strict=True):
            total = total + style_loss(part, torch.tensor(of_environments, device=self.device)[environment])
        return total

    def _styles(self, means: Tensor, rng: np.random.Generator) -> Tensor:
        codes = []
        for part, of_environments in zip(self._by_factor(means), self.labels.values(), strict=True):
            alike = np.equal.outer(of_environments, of_environments)
            chosen = [int(rng.choice(np.flatnonzero(row))) for row in alike]
            codes.append(part[:, chosen])
        return torch.cat(codes, dim=-1)

    def _penalty(self, weights: Weights) -> Tensor:
        shared = [pair_network.gates(weights, block).prod(dim=1).sum(dim=-1) for block in (1, 2)]
        return self.overlap * (shared[0] + shared[1])

    @staticmethod
    def _by_factor(codes: Tensor) -> tuple[Tensor, ...]:
        """The values of each factor."""
        return codes.chunk(len(FACTORS), dim=-1)
