"""Training of a modular predictor on a few scenes of a new style, all seeds in one pass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

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
"""Tunable weights: all; all but the scene encoder (psi, f, g of the paper); f alone; the last layer."""
BATCH = 64
"""Scenes per step; the style of a step is the mean code of its own scenes."""
SCHEDULES: Mapping[str, tuple[int, float]] = {
    "all": (100, 1e-4),
    "style": (100, 1e-4),
    "modulator": (100, 1e-3),
    "last_layer": (100, 1e-3),
}
"""Epochs and learning rate for each part, chosen on a held-out style (`motion-gym run transfer`)."""
PUBLISHED = (300, 1e-3)
"""Epochs and learning rate of the released program, which selects the best epoch on target validation scenes."""


class TransferProgram(Program):
    """Training of some parts on a few scenes of one environment.

    Args:
        weights: Initial weights, [M, ...].
        scenes: Scenes of the new style, a multiple of 64.
        sources: Training windows of each source.
        parts: Weights to tune, see ``PARTS``.
        epochs: Passes over the scenes.
        rate: Learning rate.
        style_weight: Factor of the style loss.
        target: Scenes for model selection; None to use the last epoch.
    """

    tunable: ClassVar[Mapping[str, tuple[str, ...]]] = PARTS
    """Weights that can be tuned, by the name of the part."""
    scenes_per_batch: ClassVar[int] = BATCH
    """The number of scenes must be a multiple of this."""
    schedules: ClassVar[Mapping[str, tuple[int, float]]] = SCHEDULES
    published: ClassVar[tuple[int, float]] = PUBLISHED
    reads_style: ClassVar[bool] = True
    """Whether the program compares the style of the scenes with that of the training domains."""
    chosen_on: ClassVar[str] = "style"
    """What was left out of training to choose the schedules."""
    device: ClassVar[str] = "cpu"

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
        rates = dict.fromkeys(sorted(name for name in weights if name.startswith(PARTS[parts])), rate)
        self.stages = [Stage("transfer", epochs, rates, selects=target is not None)]
        self.config = {"parts": parts, "style_weight": style_weight}

    def initial(self, seeds: Sequence[int]) -> Weights:
        """A copy of the initial weights."""
        return {name: value.clone() for name, value in self.begin.items()}

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch."""
        rng = np.random.default_rng([epoch, len(self.pairs)])
        for index in rng.permutation(len(self.pairs)).reshape(-1, BATCH):
            batch = self.pairs.take(torch.from_numpy(index))
            compared = [batch]
            if self.style_weight:
                for source in self.sources:
                    chosen = rng.choice(len(source), min(BATCH, len(source)), False)
                    compared.append(source.take(torch.from_numpy(chosen)))
            codes = pair_network.code(torch.cat([part.path for part in compared]), weights)
            style = codes[:, :BATCH].mean(dim=1, keepdim=True)
            off = pair_network.forecast(batch.history, style, weights) - batch.moves
            loss = (off * off).sum(dim=(1, 2)) / (AGENTS * FUTURE)
            if self.style_weight:
                sizes = torch.tensor([len(part) for part in compared])
                environment = torch.arange(len(compared)).repeat_interleave(sizes)
                loss = loss + self.style_weight * style_loss(pair_network.embed(codes, weights), environment)
            yield loss

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] on the scenes for model selection, metres, in the style of the tuned scenes."""
        if self.target is None:
            raise RuntimeError("A transfer without a target selects nothing.")
        codes = pair_network.code(self.pairs.path, weights).mean(dim=1, keepdim=True)
        return self.target.errors(pair_network.forecast(self.target.history, codes, weights)).mean(dim=(1, 2))
