"""How the two-agent network is trained: the stages of the released program."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.catalog import whole_number
from motion_gym.contract import FUTURE, PredictorError, SpecError, Truth
from motion_gym.data.windows import digest, pick_scenes
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import AGENTS, Pairs
from motion_gym.predictors.settings import number
from motion_gym.predictors.training.objectives import Erm, Objective, risks_of
from motion_gym.predictors.training.style_loss import style_loss
from motion_gym.training.program import Program, Stage, Weights, check_complete

PLAIN = ("encoder", "decoder")
"""Parts of the network without style."""
RATES: Mapping[str, float] = {"encoder": 1e-3, "decoder": 1e-3, "style": 5e-4, "modulator": 1e-2, "head": 1e-2}
"""Learning rates of Adam."""
STAGES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("forecast", PLAIN),
    ("style", ("style", "head")),
    ("modulator", ("modulator",)),
    ("forecast in style", ("decoder", "modulator", "style", "head")),
)
"""Name of each stage, and what is trained in it."""


@dataclass(frozen=True)
class Schedule:
    """Stages and steps.

    Attributes:
        epochs: Of the stages; one alone for a network without style.
        scenes: Scenes of each environment in a step; the style of a step is the mean code of its own scenes.
        most: Scenes of each environment that are trained on, the first ones; None for all.
        style_weight: Factor of the style loss in the last stage.
        negatives_only: See ``style_loss``.
    """

    epochs: tuple[int, ...]
    scenes: int = 64
    most: int | None = 9000
    style_weight: float = 1.0
    negatives_only: bool = False

    def __post_init__(self) -> None:
        """Raise SpecError for values that make no training."""
        if len(self.epochs) not in (1, len(STAGES)) or self.epochs[-1] == 0:
            raise SpecError(
                f"`epochs={self.epochs}` must be one number for a network without style, {len(STAGES)} for one with "
                "it, with at least one epoch in the last stage."
            )
        for epochs in self.epochs:
            whole_number("epochs", epochs, 0, 1_000_000)
        whole_number("scenes", self.scenes, 2, 1_000_000)
        number("style_weight", self.style_weight)
        if self.most is not None:
            whole_number("most", self.most, 2, 10**9)


def mean_code(environments: Sequence[Pairs], weights: Weights) -> Tensor:
    """Mean style code [M, 8] of environments, each counting the same; on the CPU."""
    with torch.no_grad():
        means = [pair_network.code(pairs.path.cpu(), weights).mean(dim=1) for pairs in environments]
    return torch.stack(means).mean(dim=0)


class StyleProgram(Program):
    """Training of the two-agent network on a set of environments.

    Args:
        train: Windows of each environment.
        validation: Windows that weights are selected on, of the same environments in the same order.
        objective: What is minimised in the first stage; after it, the sum of all errors is.
        schedule: Stages and steps.
        device: Where to train.
        config: What else the result depends on.

    Raises:
        PredictorError: nothing to train on, scenes of another number of agents than two, or one environment alone
            where several are compared.
    """

    def __init__(
        self,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        objective: Objective,
        schedule: Schedule,
        device: torch.device,
        config: Mapping[str, Any],
    ):
        check_complete(train, validation)
        if len(train) < 2 and (objective.compares or len(schedule.epochs) > 1):
            raise PredictorError(
                "Training compares environments (the objective, or the style loss), and the training set has one "
                "alone: give at least two, one Truth for each, or train `style_erm`."
            )
        train = [pick_scenes(t, slice(0, schedule.most)) for t in train]
        fewest = min(truth.observation.scenes for truth in train)
        if fewest < schedule.scenes:
            raise PredictorError(
                f"An environment has {fewest} scenes, and a step takes {schedule.scenes} of each: give more, or lower "
                "`scenes`."
            )
        self.objective, self.schedule, self.device = objective, schedule, device
        self.train = [Pairs.of(truth, device) for truth in train]
        self.validation = [Pairs.of(truth, device) for truth in validation]
        self.dt = train[0].observation.dt
        self.styled = len(schedule.epochs) > 1
        self.stages = [
            Stage(name, epochs, {part: RATES[part] for part in parts}, selects=count == len(schedule.epochs))
            for count, (epochs, (name, parts)) in enumerate(zip(schedule.epochs, STAGES, strict=False), 1)
        ]
        self.config = {
            **config,
            # Not those of the last stage: a training can be resumed to go on for longer.
            "epochs_before": list(schedule.epochs[:-1]),
            "scenes": schedule.scenes,
            "style_weight": schedule.style_weight,
            "negatives_only": schedule.negatives_only,
            "train": [digest(t) for t in train],
            "validation": [digest(v) for v in validation],
        }

    def first(self, seed: int) -> Weights:
        """First weights of one model, [1, ...]."""
        return pair_network.initial(seed, pair_network.shapes() if self.styled else pair_network.shapes(PLAIN))

    def finished(self, weights: Weights) -> Weights:
        """The trained weights, with the prior of the style and the time step."""
        if not self.styled:
            return weights
        dt = torch.full((len(weights["style.bias1"]), 1), self.dt)
        return {**weights, "prior.code": mean_code(self.train, weights), "prior.dt": dt}

    def state(self, models: int) -> Tensor:
        """State of the objective."""
        return self.objective.start(len(self.train), models, self.device)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch: as many scenes of each environment, in an order of the epoch alone."""
        rng = np.random.default_rng([epoch, len(self.train)])
        shuffled = [pairs.take(torch.from_numpy(rng.permutation(len(pairs))).to(self.device)) for pairs in self.train]
        size = self.schedule.scenes
        for step in range(min(map(len, self.train)) // size):
            parts = [pairs.take(slice(step * size, (step + 1) * size)) for pairs in shuffled]
            yield self._loss(parts, weights, state, stage)

    def _loss(self, parts: list[Pairs], weights: Weights, state: Tensor, stage: int) -> Tensor:
        environment = torch.arange(len(parts), device=self.device).repeat_interleave(self.schedule.scenes)
        codes = None
        loss = torch.zeros(len(weights["encoder.bias1"]), device=self.device)
        if stage > 0:
            codes = pair_network.code(torch.cat([part.path for part in parts]), weights)
            if stage != 2:
                weight = 1.0 if stage == 1 else self.schedule.style_weight
                embedded = pair_network.embed(codes, weights)
                loss = loss + weight * style_loss(embedded, environment, self.schedule.negatives_only)
            if stage == 1:
                return loss
            means = codes.unflatten(1, (len(parts), -1)).mean(dim=2, keepdim=True)
            codes = means.expand(-1, -1, self.schedule.scenes, -1).flatten(1, 2)
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
            target.new_full((len(parts),), self.schedule.scenes),
        )
        return loss + (self.objective if stage == 0 else Erm())(risks, state)

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M], metres, mean over the agent-windows of all environments; styles are those of 64 training scenes."""
        total, count = torch.zeros(len(generators), device=self.device), 0
        for seen, pairs in zip(self.train, self.validation, strict=True):
            codes = None
            if self.styled:
                codes = pair_network.code(seen.path[: self.schedule.scenes], weights).mean(dim=1, keepdim=True)
            total += pairs.errors(pair_network.forecast(pairs.history, codes, weights)).sum(dim=(1, 2))
            count += AGENTS * len(pairs)
        return total / count
