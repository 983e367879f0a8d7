"""Training of the two-agent network: the stages of the released program."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, PredictorError, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import AGENTS, PLAIN, Pairs
from motion_gym.predictors.settings import optional, whole
from motion_gym.predictors.training.objectives import Erm, Objective, risks_of
from motion_gym.predictors.training.style_loss import style_loss
from motion_gym.specs import whole_number
from motion_gym.training.program import Program, Stage, Weights, check_complete, check_epochs, digests

RATES: Mapping[str, float] = {"encoder": 1e-3, "decoder": 1e-3, "style": 5e-4, "modulator": 1e-2, "head": 1e-2}
"""Learning rates of Adam."""
STAGES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("forecast", PLAIN),
    ("style", ("style", "head")),
    ("modulator", ("modulator",)),
    ("forecast in style", ("decoder", "modulator", "style", "head")),
)
"""Name of each stage, and the parts that it trains."""


def mean_code(environments: Sequence[Pairs], weights: Weights) -> Tensor:
    """Mean style code [M, 8] of environments, each with equal weight; on the CPU."""
    with torch.no_grad():
        means = [pair_network.code(pairs.path.cpu(), weights).mean(dim=1) for pairs in environments]
    return torch.stack(means).mean(dim=0)


class StyleProgram(Program):
    """Training of the two-agent network on a set of environments.

    The first stage minimises the objective of the predictor, the others the sum of all errors. The style of a step is
    the mean code of its own scenes.

    Args:
        predictor: A ``StyleErm``; a predictor with a style has four stages.
        train: Windows of each environment, of two agents each.
        validation: Windows for model selection, of the same environments in the same order.
        device: Device of the tensors.
        epochs: Epochs of each stage; by default those of the released program.
        scenes: Scenes of each environment per step.
        most: Train on the first ``most`` scenes of each environment; None for all.

    Raises:
        SpecError: a number is not allowed.
        PredictorError: a set is empty or not complete, a scene does not have two agents, or there is only one
            environment and training compares environments.
    """

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        device: torch.device,
        epochs: Sequence[int] | None = None,
        scenes: int = 64,
        most: int | None = 9000,
    ):
        epochs = check_epochs(predictor.name, predictor.epochs if epochs is None else epochs, len(predictor.epochs))
        self.scenes, most = whole_number("scenes", scenes, 2, 1_000_000), optional(whole(2, 10**9))("most", most)
        self.objective: Objective = predictor.objective
        self.device, self.styled = device, len(epochs) > 1
        check_complete(train, validation)
        if len(train) < 2 and (self.objective.compares or self.styled):
            raise PredictorError(
                "Training compares environments (the objective, or the style loss), but the training set has one "
                "alone: give at least two, one Truth for each, or train `style_erm`."
            )
        train = [pick_scenes(truth, slice(0, most)) for truth in train]
        self.shapes = {name: shape for name, shape in predictor.expected.items() if not name.startswith("prior.")}
        fewest = min(truth.observation.scenes for truth in train)
        if fewest < scenes:
            raise PredictorError(
                f"An environment has {fewest} scenes, and a step takes {scenes} of each: give more, or lower `scenes`."
            )
        self.train = [Pairs.of(truth, device) for truth in train]
        self.validation = [Pairs.of(truth, device) for truth in validation]
        self.dt = train[0].observation.dt
        self.stages = [
            Stage(name, count, self._rates(parts), selects=number == len(epochs))
            for number, (count, (name, parts)) in enumerate(zip(epochs, STAGES, strict=False), 1)
        ]
        self.config = {
            "predictor": predictor.name,
            "objective": type(self.objective).__name__,
            **vars(self.objective),
            # Without the last stage: a resumed training may have more epochs in it.
            "epochs_before": list(epochs[:-1]),
            "scenes": scenes,
            **digests(train, validation),
        }

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        return pair_network.initial(seed, self.shapes)

    def _rates(self, parts: Sequence[str]) -> dict[str, float]:
        """Learning rates of some parts; with factors, each factor has parts of its own, as ``style_side``."""
        names = dict.fromkeys(name.split(".")[0] for name in self.shapes)
        return {name: RATES[part] for part in parts for name in names if name.split("_")[0] == part}

    def finished(self, weights: Weights) -> Weights:
        """The trained weights, with the prior of the style and the time step."""
        if not self.styled:
            return weights
        dt = torch.full((len(weights["encoder.bias1"]), 1), self.dt)
        return {**weights, "prior.code": mean_code(self.train, weights), "prior.dt": dt}

    def state(self, models: int) -> Tensor:
        """Initial state of the objective."""
        return self.objective.start(len(self.train), models, self.device)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch: equally many scenes per environment, in an order of the epoch alone."""
        rng = np.random.default_rng([epoch, len(self.train)])
        shuffled = [pairs.take(torch.from_numpy(rng.permutation(len(pairs))).to(self.device)) for pairs in self.train]
        size = self.scenes
        for step in range(min(map(len, self.train)) // size):
            parts = [pairs.take(slice(step * size, (step + 1) * size)) for pairs in shuffled]
            yield self._loss(parts, weights, state, stage, rng)

    def _loss(
        self, parts: list[Pairs], weights: Weights, state: Tensor, stage: int, rng: np.random.Generator
    ) -> Tensor:
        environment = torch.arange(len(parts), device=self.device).repeat_interleave(self.scenes)
        codes = None
        loss = torch.zeros(len(weights["encoder.bias1"]), device=self.device)
        if stage > 0:
            codes = pair_network.code(torch.cat([part.path for part in parts]), weights)
            if stage != 2:
                loss = loss + self._contrast(pair_network.embed(codes, weights), environment)
            if stage == 1:
                return loss
            means = self._styles(codes.unflatten(1, (len(parts), -1)).mean(dim=2, keepdim=True), rng)
            codes = means.expand(-1, -1, self.scenes, -1).flatten(1, 2)
            loss = loss + self._penalty(weights)
        history = torch.cat([part.history for part in parts])
        forecast = pair_network.forecast(history, codes, weights)
        target = torch.cat([part.moves for part in parts])
        agents = AGENTS * len(history)
        risks = risks_of(
            forecast.view(len(forecast), agents, FUTURE, 2).permute(2, 0, 1, 3),
            target.view(agents, FUTURE, 2).transpose(0, 1),
            target.new_full((FUTURE, agents), 1 / (FUTURE * AGENTS)),
            torch.arange(len(history), device=self.device).repeat_interleave(AGENTS),
            environment.repeat_interleave(AGENTS),
            target.new_full((len(parts),), self.scenes),
        )
        return loss + (self.objective if stage == 0 else Erm())(risks, state)

    def _contrast(self, embedding: Tensor, environment: Tensor) -> Tensor:
        """Style loss [M] of embeddings [M, S, 8] of scenes of environments [S]."""
        return style_loss(embedding, environment)

    def _styles(self, means: Tensor, rng: np.random.Generator) -> Tensor:
        """Style of each environment, from the mean codes [M, E, 1, 8] of their scenes."""
        return means

    def _penalty(self, weights: Weights) -> Tensor | float:
        """Penalty [M] on the weights of the modulators."""
        return 0.0

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M], metres, mean over the agent-windows of all environments, with styles of 64 training scenes."""
        total, count = torch.zeros(len(generators), device=self.device), 0
        for source, pairs in zip(self.train, self.validation, strict=True):
            codes = None
            if self.styled:
                codes = pair_network.code(source.path[: self.scenes], weights).mean(dim=1, keepdim=True)
            total += pairs.errors(pair_network.forecast(pairs.history, codes, weights)).sum(dim=(1, 2))
            count += AGENTS * len(pairs)
        return total / count
