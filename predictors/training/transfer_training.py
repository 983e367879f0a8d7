"""How a trained modular predictor is tuned to a new style on a few scenes of it, all seeds in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import AGENTS, Pairs
from motion_gym.predictors.training.style_loss import style_loss
from motion_gym.training.program import Program, Stage, Weights

PARTS: Mapping[str, tuple[str, ...]] = {
    "all": ("encoder", "decoder", "style", "modulator", "head"),
    "style": ("decoder", "style", "modulator", "head"),
    "modulator": ("modulator",),
    "last_layer": ("decoder.weight4", "decoder.bias4"),
}
"""Weights that are tuned: everything; all but the scene encoder (psi, f, g of the paper); f alone; the last layer."""
BATCH = 64
"""Scenes of a step; the style of a step is the mean code of its own scenes."""


class TransferProgram(Program):
    """Training of some parts on a few scenes of one environment.

    Args:
        weights: To begin with, [M, ...].
        scenes: Of the new style, a multiple of 64.
        sources: Training windows of each source.
        parts: What is tuned, see ``PARTS``.
        epochs: Passes over the scenes.
        rate: Learning rate.
        style_weight: Factor of the style loss.
        target: Scenes that the epoch is selected on; None for the last one.
    """

    def __init__(
        self,
        weights: Weights,
        scenes: Truth,
        sources: Sequence[Truth],
        parts: str,
        epochs: int,
        rate: float,
        style_weight: float,
        target: Truth | None,
    ):
        self.begin, self.pairs, self.style_weight = weights, Pairs.of(scenes), style_weight
        self.sources = [Pairs.of(pick_scenes(source, slice(0, 50 * BATCH))) for source in sources]
        self.target = None if target is None else Pairs.of(target)
        rates = {part: rate for part in PARTS[parts]}
        self.stages = [Stage("transfer", epochs, rates, selects=target is not None)]
        self.config = {"parts": parts, "style_weight": style_weight}

    def initial(self, seeds: Sequence[int]) -> Weights:
        """A copy of the weights."""
        return {name: value.clone() for name, value in self.begin.items()}

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch."""
        rng = np.random.default_rng([epoch, len(self.pairs)])
        for index in rng.permutation(len(self.pairs)).reshape(-1, BATCH):
            own = self.pairs.take(torch.from_numpy(index))
            compared = [own]
            if self.style_weight:
                few = (torch.from_numpy(rng.choice(len(s), min(BATCH, len(s)), False)) for s in self.sources)
                compared += [source.take(index) for source, index in zip(self.sources, few, strict=True)]
            codes = pair_network.code(torch.cat([part.path for part in compared]), weights)
            mean = codes[:, :BATCH].mean(dim=1, keepdim=True)
            off = pair_network.forecast(own.history, mean, weights) - own.moves
            loss = (off * off).sum(dim=(1, 2)) / (AGENTS * FUTURE)
            if self.style_weight:
                environment = torch.arange(len(compared)).repeat_interleave(
                    torch.tensor([len(part) for part in compared])
                )
                loss = loss + self.style_weight * style_loss(pair_network.embed(codes, weights), environment)
            yield loss

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] on the target's scenes, metres; the style is that of the scenes tuned on."""
        if self.target is None:
            raise RuntimeError("A transfer without a target selects nothing.")
        codes = pair_network.code(self.pairs.path, weights).mean(dim=1, keepdim=True)
        return self.target.errors(pair_network.forecast(self.target.history, codes, weights)).mean(dim=(1, 2))
