"""Low-shot transfer: a trained modular predictor is tuned to a new style on a few scenes of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from motion_gym import training
from motion_gym.catalog import suggest, whole_number
from motion_gym.contract import FUTURE, PredictorError, SpecError, Truth
from motion_gym.predictors import pair_network
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.pair_network import AGENTS, Pairs
from motion_gym.predictors.style_loss import style_loss
from motion_gym.predictors.style_training import mean_code
from motion_gym.predictors.weighted import Weights
from motion_gym.training import Stage
from motion_gym.windows import pick_scenes

PARTS: Mapping[str, tuple[str, ...]] = {
    "all": ("encoder", "decoder", "style", "modulator", "head"),
    "style": ("decoder", "style", "modulator", "head"),
    "modulator": ("modulator",),
    "last_layer": ("decoder.weight4", "decoder.bias4"),
}
"""Weights that are tuned: everything; all but the scene encoder (psi, f, g of the paper); f alone; the last layer."""
BATCH = 64
"""Scenes of a step; the style of a step is the mean code of its own scenes."""


def transfer(
    predictor: Modular,
    scenes: Truth,
    sources: Sequence[Truth],
    batches: int,
    parts: str = "modulator",
    epochs: int = 300,
    rate: float = 1e-3,
    style_weight: float = 0.05,
    target: Truth | None = None,
) -> Modular:
    """Tune all seeds of a predictor to the first ``batches`` times 64 scenes.

    The number of epochs and the rate are fixed beforehand, and choose them on a style that is not the target. With
    ``target``, validation scenes of the target, the best epoch on these is taken, as the released program does: that
    looks at 3,000 scenes to select what was tuned on a few, and is the protocol ``paper``.

    Args:
        predictor: With weights; it stays as it is.
        scenes: Scenes of the new style, complete ones, of two agents.
        sources: Training windows of each source environment, which the style loss sets the new style apart from.
        batches: n; 0 gives an untouched copy.
        parts: What is tuned, see ``PARTS``.
        epochs: Passes over the scenes.
        rate: Learning rate of Adam.
        style_weight: Factor of the style loss.
        target: Validation scenes of the target; None under the honest protocol.

    Returns:
        A tuned copy, which has observed nothing yet; its ``selection`` says how it came about.

    Raises:
        SpecError: ``parts`` or a number is not known or allowed.
        PredictorError: there are fewer scenes than asked for, or no source.
    """
    if parts not in PARTS:
        raise SpecError(f"There is no `parts={parts}` to tune.{suggest(str(parts), PARTS)}")
    batches, epochs = whole_number("batches", batches, 0, 10**6), whole_number("epochs", epochs, 1, 10**6)
    if isinstance(rate, (bool, str)) or not 0 < rate < float("inf"):
        raise SpecError(f"`rate={rate}` must be a number above 0.")
    there = scenes.observation.scenes
    if batches * BATCH > there:
        raise PredictorError(
            f"{batches} batches of {BATCH} scenes were asked for, and there are {there} scenes: give more, or at most "
            f"{there // BATCH} batches."
        )
    if style_weight and not sources:
        raise PredictorError("The style loss compares the new style with others: give `sources`, or style_weight=0.")
    predictor.fingerprint  # noqa: B018  # loads the weights, or says that there are none
    made = type(predictor)(seed=predictor.seed)
    weights, how = predictor.stacked, "untouched"
    if batches:
        shown = pick_scenes(scenes, slice(0, batches * BATCH))
        program = TransferProgram(weights, shown, sources, parts, epochs, rate, style_weight, target)
        seeds = predictor.card.get("seeds", list(range(len(weights["prior.dt"]))))
        weights = training.train(program, seeds).weights
        weights["prior.code"] = mean_code([program.pairs, *program.sources], weights)
        chosen = "the best epoch on validation scenes of the target" if target is not None else "the last epoch"
        how = f"{parts} tuned on {batches * BATCH} scenes, {epochs} epochs at rate {rate:g}, {chosen}"
    made.use(weights, {**predictor.card, "selection": f"{predictor.selection}; then {how}"})
    return made


class TransferProgram:
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

    def state(self, models: int) -> Tensor:
        """No state."""
        return torch.zeros(0)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch."""
        rng = np.random.default_rng([epoch, len(self.pairs)])
        for index in rng.permutation(len(self.pairs)).reshape(-1, BATCH):
            own = self.pairs.take(torch.from_numpy(index))
            others = [s.take(torch.from_numpy(rng.choice(len(s), min(BATCH, len(s)), False))) for s in self.sources]
            codes = pair_network.code(torch.cat([part.path for part in (own, *others)]), weights)
            mean = codes[:, :BATCH].mean(dim=1, keepdim=True)
            off = pair_network.forecast(own.history, mean, weights) - own.moves
            loss = (off * off).sum(dim=(1, 2)) / (AGENTS * FUTURE)
            if self.style_weight:
                environment = torch.arange(1 + len(others)).repeat_interleave(
                    torch.tensor([len(part) for part in (own, *others)])
                )
                loss = loss + self.style_weight * style_loss(pair_network.embed(codes, weights), environment)
            yield loss

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] on the target's scenes, metres; the style is that of the scenes tuned on."""
        if self.target is None:
            raise RuntimeError("A transfer without a target selects nothing.")
        codes = pair_network.code(self.pairs.path, weights).mean(dim=1, keepdim=True)
        return self.target.errors(pair_network.forecast(self.target.history, codes, weights)).mean(dim=(1, 2))
