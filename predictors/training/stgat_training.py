"""Training of STGAT: batches of windows as tensors, and the three stages of the released program."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, HISTORY, Observation, PredictorError, Truth
from motion_gym.data.windows import pick_scenes, stack
from motion_gym.predictors.networks.graph_attention import Layout
from motion_gym.predictors.networks.stgat_network import Draws, initial, stage1, stage2, stage3
from motion_gym.predictors.training.objectives import Objective, risks_of
from motion_gym.specs import one_of, whole_number
from motion_gym.training.program import Program, Stage, Weights, check_epochs, digests

Inputs = Callable[[Observation], np.ndarray]
"""Converts an Observation into the network's input [8, A, F]."""

VALIDATED_AT_ONCE = 256
"""Scenes of one forward pass of validation."""
ENCODERS = {"trajectory": 1e-2, "graph": 1e-2, "attention1": 3e-2, "attention2": 3e-2, "": 1e-3}
STAGES: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("reconstruction", ENCODERS),
    ("graph reconstruction", ENCODERS),
    ("forecast", {"": 5e-3}),
)
"""Name of each stage, and learning rates of Adam."""


@dataclass(frozen=True)
class Batch:
    """Scenes of one step, as tensors.

    Attributes:
        steps: [8, A, F] input of the network.
        moves: [12, A, 2] true displacements of the future.
        known: [12, A] float32, 1 where the displacement is known.
        layout: The scenes.
        share: [A] 1 / agents of the scene.
        environment: [A] int64 environment of each agent, numbered within the batch.
        count: [E] number of scenes of each environment in a full step.
    """

    steps: Tensor
    moves: Tensor
    known: Tensor
    layout: Layout
    share: Tensor
    environment: Tensor
    count: Tensor

    @classmethod
    def of(cls, parts: Sequence[Truth], inputs: Inputs, device: torch.device, full: int = 0) -> Batch:
        """A batch of scenes, with one part for each environment; ``full`` as ``count``, or 0 for the scenes given."""

        def tensor(array: np.ndarray) -> Tensor:
            return torch.as_tensor(np.ascontiguousarray(array), dtype=torch.float32, device=device)

        truth = stack(parts)
        observation = truth.observation
        path = np.concatenate([observation.xy[:, -1:], truth.future], axis=1).astype(np.float64)
        known = truth.known.copy()
        known[:, 1:] &= truth.known[:, :-1]
        sizes = np.diff(observation.scene)
        environment = torch.arange(len(parts)).repeat_interleave(torch.tensor([len(p.observation) for p in parts]))
        return cls(
            steps=tensor(inputs(observation)),
            moves=tensor(np.diff(path, axis=1).round(4).transpose(1, 0, 2)),
            known=tensor(known.T),
            layout=Layout.of(observation.scene, device),
            share=tensor(np.repeat(1 / sizes, sizes)),
            environment=environment.to(device),
            count=tensor(np.array([full or part.observation.scenes for part in parts])),
        )

    def errors(self, moves: Tensor) -> tuple[Tensor, Tensor]:
        """Sum [M] of the ADE, metres, over agents with a known step, and their number; moves are [12, M, A, 2]."""
        off = (moves - self.moves[:, None]).cumsum(dim=0).norm(dim=-1) * self.known[:, None]
        known = self.known.sum(dim=0)
        return (off / known.clamp(min=1)).sum(dim=(0, 2)), (known > 0).sum()


class StgatProgram(Program):
    """Training of STGAT on a set of environments.

    Stage 1 reconstructs the history from the trajectory LSTM, stage 2 from both LSTMs, stage 3 forecasts.

    Args:
        predictor: A ``Stgat``.
        train: Windows of each environment.
        validation: Windows for model selection, by the ADE of the first sample, metres.
        device: Device of the tensors.
        epochs: Epochs of each stage.
        scenes: Scenes per step; if a step holds several environments, an equal part from each.
        joint: If True, each step holds shuffled scenes of all environments. An epoch has as many steps as are needed
            for all scenes together, so scenes of small environments occur more than once. If False, each step holds
            scenes of one environment, environments follow one another without shuffling, and an epoch sees each scene
            once, as in the released program.
        until: End of a joint epoch. ``"all"``: when all scenes together could have been seen once. ``"shortest"``: when
            the environment with the fewest scenes has been seen once, as in the released program on original data.

    Raises:
        SpecError: a number is not allowed.
        PredictorError: a set is empty, or the objective compares environments and there is only one.
    """

    further: tuple[tuple[str, Mapping[str, float]], ...] = ()
    """Name and learning rates of each stage after the three of STGAT."""

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        device: torch.device,
        epochs: Sequence[int] = (150, 100, 150),
        scenes: int = 64,
        joint: bool = False,
        until: str = "all",
    ):
        stages = (*STAGES, *self.further)
        epochs = check_epochs(predictor.name, epochs, len(stages))
        self.scenes = whole_number("scenes", scenes, 1, 1_000_000)
        objective: Objective = predictor.objective
        for name, truths in (("training", train), ("validation", validation)):
            if not sum(truth.observation.scenes for truth in truths):
                raise PredictorError(f"The {name} set is empty: it needs at least one window.")
        train = [truth for truth in train if truth.observation.scenes]
        if len(train) < 2 and objective.compares:
            raise PredictorError(
                f"The objective {type(objective).__name__} compares environments, but the training set has one alone: "
                "give at least two, one Truth for each, or train `erm`."
            )
        self.train, self.inputs, self.objective, self.device = train, predictor.inputs, objective, device
        self.features, self.counterfactual = predictor.features, predictor.counterfactual
        self.joint = joint or objective.joint
        self.until = one_of("until", until, ("all", "shortest"))
        self.validation = self._validation([stack([v for v in validation if v.observation.scenes])])
        self.in_turn = [
            self._batch([(number, np.arange(first, min(first + self.scenes, truth.observation.scenes)))])
            for number, truth in enumerate([] if self.joint else train)
            for first in range(0, truth.observation.scenes, self.scenes)
        ]
        """The steps of every epoch that is not joint."""
        self.stages = [
            Stage(name, count, rates, selects=number == len(stages))
            for number, (count, (name, rates)) in enumerate(zip(epochs, stages, strict=True), 1)
        ]
        self.config = {
            "predictor": predictor.name,
            "objective": type(objective).__name__,
            **vars(objective),
            "features": self.features,
            "counterfactual": self.counterfactual,
            # Without the last stage: a resumed training may have more epochs in it.
            "epochs_before": list(epochs[:-1]),
            "scenes": scenes,
            "joint": self.joint,
            **({} if until == "all" else {"until": until}),
            **digests(train, validation),
        }

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        return initial(self.features, seed)

    def state(self, models: int) -> Tensor:
        """Initial state of the objective."""
        return self.objective.start(len(self.train), models, self.device)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch."""
        for batch in map(self._batch, self._shuffled(epoch)) if self.joint else self.in_turn:
            draws = Draws.from_generators(generators, batch.layout)
            if stage == 2:
                output = stage3(batch.steps, draws, batch.layout, weights, self.counterfactual)
                target, weight = batch.moves, batch.known * (batch.share / FUTURE)
            else:
                target = batch.steps[..., :2]
                weight = (batch.share / HISTORY).expand(HISTORY, -1)
                output = stage1(batch.steps, draws, weights)
                if stage == 1:
                    output = stage2(batch.steps, draws, batch.layout, weights)
            risks = risks_of(output, target, weight, batch.layout.scene, batch.environment, batch.count)
            yield self.objective(risks, state)

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] of the first sample, metres, mean over the agent-windows of all environments."""
        total = torch.zeros(len(generators), device=self.device)
        count = torch.zeros((), device=self.device)
        for environment, batch in self.validation:
            draws = Draws.from_generators(generators, batch.layout)
            errors, known = batch.errors(self._forecast(batch, draws, environment, weights))
            total += errors
            count += known
        return total / count

    def _forecast(self, batch: Batch, draws: Draws, environment: int, weights: Weights) -> Tensor:
        """Displacements [12, M, A, 2] for validation windows of an environment."""
        return stage3(batch.steps, draws, batch.layout, weights, self.counterfactual)

    def _shuffled(self, epoch: int) -> Iterator[list[tuple[int, np.ndarray]]]:
        """Environment and scenes for each step of a joint epoch; the order depends only on the epoch."""
        sizes = [truth.observation.scenes for truth in self.train]
        each = max(self.scenes // len(sizes), 1)
        steps = -(-min(sizes) // each) if self.until == "shortest" else -(-sum(sizes) // self.scenes)
        rng = np.random.default_rng([epoch, len(sizes)])
        orders = [
            np.concatenate([rng.permutation(size) for _ in range(0, steps * each, size)])  # repeated as often as needed
            for size in sizes
        ]
        for step in range(steps):
            part = slice(step * each, (step + 1) * each)
            yield [(number, order[part]) for number, order in enumerate(orders)]

    def _batch(self, parts: Sequence[tuple[int, np.ndarray]]) -> Batch:
        truths = [pick_scenes(self.train[number], scenes) for number, scenes in parts]
        # In turn, the last step of an environment may hold fewer scenes than the others.
        return Batch.of(truths, self.inputs, self.device, 0 if self.joint else self.scenes)

    def _validation(self, truths: Sequence[Truth]) -> list[tuple[int, Batch]]:
        """Batches of windows, each with the index of its Truth."""
        return [
            (number, Batch.of([pick_scenes(truth, slice(first, first + VALIDATED_AT_ONCE))], self.inputs, self.device))
            for number, truth in enumerate(truths)
            for first in range(0, truth.observation.scenes, VALIDATED_AT_ONCE)
        ]
