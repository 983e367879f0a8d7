"""Training of ``heatmap`` on sets of environments, and on a few windows of a new one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Truth
from motion_gym.data.windows import stack
from motion_gym.predictors.networks import unet
from motion_gym.predictors.networks.ego_crops import COARSE, crops_of, gaussians, mean_place
from motion_gym.specs import number, whole_number
from motion_gym.training.program import Program, Stage, Weights, check_complete, check_epochs, digests

RATE = 1e-3
GUIDED = 0.5
"""Share of the training windows whose future steps are forecast towards the true goal, not the mean goal."""
UNKNOWN = 0.25
"""Share of the training windows whose ground is hidden, so that the network also forecasts without images."""
GOAL, PATH = 0.2, 0.1
"""Factors of the cross-entropies of the maps; errors of positions count in cells of the goal map."""
FEW = 8
"""Scenes of a step of a transfer, as in the released program of the paper's appendix."""
AT_ONCE = 256
"""Windows of one forward pass in validation, to bound memory."""
PARTS: Mapping[str, tuple[str, ...]] = {
    "all": ("encoder", "goal", "path", "summary", "offset"),
    "modulator": ("modulator",),
    "low_rank": ("low_rank",),
    "last_layer": ("offset",),
}
"""Tunable weights: all but the adapters; the modulators; the low-rank adapters of the encoder; the last layer."""


@dataclass(frozen=True)
class Batch:
    """Windows in coordinates of their crops.

    Attributes:
        history: [B, 8, 2] observed positions.
        future: [B, 12, 2] future positions.
        labels: [B, 32, 32] uint8, labels of the ground.
        half: [B] half widths, in the unit of the domain.
        guided: [B] bool, windows whose future steps are forecast towards the true goal.
    """

    history: Tensor
    future: Tensor
    labels: Tensor
    half: Tensor
    guided: Tensor

    @classmethod
    def of(cls, truth: Truth, device: torch.device, rng: np.random.Generator | None = None, **copy: float) -> Batch:
        """All windows of a ground truth; with ``rng`` mirrored, turned and stretched at random, some without ground.

        Args:
            truth: Complete windows.
            device: Device of the tensors.
            rng: Source of random numbers; None for the windows as they are.
            **copy: ``angle``, the standard deviation of the turn in radians, and ``stretch``, the largest absolute
                logarithm of the factor on the half width.
        """
        observation, count = truth.observation, len(truth.future)
        if rng is None:
            crops = crops_of(observation)
        else:
            factor = np.exp(rng.uniform(-copy["stretch"], copy["stretch"], count))
            crops = crops_of(observation, copy["angle"] * rng.normal(size=count), factor)
        history, future, labels = crops.inside(observation.xy), crops.inside(truth.future), crops.labels
        guided = np.zeros(count, bool)
        if rng is not None:
            mirrored = rng.random(count) < 0.5
            history[mirrored, :, 1] *= -1
            future[mirrored, :, 1] *= -1
            labels[mirrored] = labels[mirrored, ::-1]
            guided = rng.random(count) < GUIDED
            labels[rng.random(count) < UNKNOWN] = 0
        arrays = (history, future, labels, crops.half.astype(np.float32), guided)
        return cls(*(torch.from_numpy(array).to(device) for array in arrays))

    def take(self, index: Tensor | slice) -> Batch:
        """Some of the windows."""
        return Batch(*(value[index] for value in vars(self).values()))


class HeatmapProgram(Program):
    """Training on all windows of a set of environments, each counting the same.

    In each epoch every window is mirrored with probability 1/2, turned by a small random angle, and its crop is
    stretched by a random factor; the ground of a quarter of the windows is hidden. The loss is the mean distance of the
    forecast from the future positions, plus the cross-entropies of the maps of the goal and of the future steps under
    Gaussians around the true places. Half of the windows are forecast towards the true goal, the others towards the
    mean goal, as in a forecast with k = 1.

    Args:
        predictor: A ``Heatmap``.
        train: Complete windows of each environment.
        validation: Windows for model selection, of the same environments in the same order.
        device: Device of the tensors.
        epochs: Number of epochs, as a sequence of one; the learning rate decays to 0.
        batch: Windows of a step.
        angle: Standard deviation of the turn of a crop, radians.
        stretch: Largest absolute logarithm of the factor on the half width of a crop.

    Raises:
        SpecError: a number is not allowed.
        PredictorError: a set is empty or not complete.
    """

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        device: torch.device,
        epochs: Sequence[int] = (40,),
        batch: int = 32,
        angle: float = 0.1,
        stretch: float = 0.2,
    ):
        check_complete(train, validation)
        (count,) = check_epochs(predictor.name, epochs, 1)
        self.batch = whole_number("batch", batch, 1, 10**9)
        self.copy = {"angle": number("angle", angle), "stretch": number("stretch", stretch)}
        self.device, self.train = device, stack(train)
        self.validation = Batch.of(stack(validation), device)
        self.size = float(Batch.of(self.train, device).half.mean().clamp(min=1e-9))
        """Mean half width of the training windows."""
        rates = {"modulator": 0.0, "low_rank": 0.0, "": RATE}
        self.stages = [Stage("forecast", count, rates, selects=True, decays=True)]
        self.config = {
            "predictor": predictor.name,
            "batch": batch,
            **self.copy,
            **digests(train, validation),
            "labels": train[0].observation.images is not None,
        }

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        return unet.initial(seed)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch; all models see the same copies of the windows."""
        rng = np.random.default_rng([epoch, len(self.train.future)])
        windows = Batch.of(self.train, self.device, rng, **self.copy)
        order = torch.from_numpy(rng.permutation(len(windows.half))).to(self.device)
        for index in order.split(self.batch):
            yield loss_of(windows.take(index), self.size, weights)

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] of the forecast with k = 1 on the windows for model selection, in the unit of the domain."""
        return mean_error(self.validation, weights)


class HeatmapTransfer(HeatmapProgram):
    """Training of some parts of trained weights on a few windows of a new environment.

    Args:
        weights: Initial weights, [M, ...].
        scenes: Windows of the new environment.
        sources: Not used: the network reads no style.
        parts: Weights to tune, see ``PARTS``.
        epochs: Passes over the windows.
        rate: Learning rate.
        style_weight: Not used.
        target: Windows for model selection; None to use the last epoch.
    """

    tunable: ClassVar[Mapping[str, tuple[str, ...]]] = PARTS
    scenes_per_batch: ClassVar[int] = 1
    """Any number of scenes will do: the last step of an epoch may have fewer than the others."""
    schedules: ClassVar[Mapping[str, tuple[int, float]]] = {
        "all": (30, 3e-4),
        "modulator": (30, 3e-3),
        "low_rank": (30, 3e-3),
        "last_layer": (10, 1e-4),
    }
    """Epochs and learning rate for each part, chosen on a held-out speed domain (`motion-gym run sdd`)."""
    published: ClassVar[tuple[int, float]] = (30, 1e-3)
    """Epochs and learning rate by which the best epoch on target validation windows is selected."""
    reads_style: ClassVar[bool] = False
    chosen_on: ClassVar[str] = "speed domain"

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
        self.begin, self.sources = weights, sources
        self.device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
        self.train, self.copy = scenes, {"angle": 0.1, "stretch": 0.2}
        self.batch = math.ceil(len(scenes.future) * FEW / scenes.observation.scenes)
        self.size = float(Batch.of(scenes, self.device).half.mean().clamp(min=1e-9))
        if target is not None:
            self.validation = Batch.of(target, self.device)
        rates = {part: rate for part in PARTS[parts]}
        self.stages = [Stage("transfer", epochs, rates, selects=target is not None)]
        self.config = {"predictor": "heatmap", "parts": parts}

    def initial(self, seeds: Sequence[int]) -> Weights:
        """A copy of the initial weights."""
        return {name: value.clone() for name, value in self.begin.items()}


def loss_of(batch: Batch, size: float, weights: Weights) -> Tensor:
    """Loss [M] of a step; ``size`` is the half width whose errors count as they are."""
    features = unet.encode(batch.history, batch.labels, weights)
    goals = unet.goal_map(features, weights)
    true_goal = batch.future[:, None, -1].expand(-1, goals.shape[1], -1)
    goal = torch.where(batch.guided[:, None, None], true_goal, mean_place(goals).detach())
    paths = unet.path_maps(features, goal, weights)
    forecast = mean_place(paths) + unet.offsets(unet.summary(features, batch.history, weights), weights)
    distance = (forecast - batch.future[:, None]).square().sum(dim=-1).add(1e-10).sqrt().mean(dim=-1)
    error = (distance * (batch.half[:, None] / size)).mean(dim=0) * COARSE
    future = batch.future[:, None]
    return error + GOAL * cross_entropy(goals, future[:, :, -1]) + PATH * cross_entropy(paths, future)


def cross_entropy(logits: Tensor, true_places: Tensor) -> Tensor:
    """Cross-entropy [M] of maps [B, M, ..., cells, cells] under Gaussians around places [B, 1, ..., 2], in nats."""
    cells = logits.shape[-1]
    target = gaussians(true_places.clamp(-1 + 1 / cells, 1 - 1 / cells), cells)
    target = target / target.sum(dim=(-2, -1), keepdim=True)
    likelihood = logits.flatten(-2).log_softmax(dim=-1).view(logits.shape)
    by_model = -(target * likelihood).sum(dim=(-2, -1)).transpose(0, 1).flatten(1)
    return by_model.mean(dim=1)


def mean_error(windows: Batch, weights: Weights) -> Tensor:
    """ADE [M] of the forecast with k = 1, in the unit of the domain."""
    total = torch.zeros(len(weights["offset.bias1"]), device=windows.half.device)
    for first in range(0, len(windows.half), AT_ONCE):
        part = windows.take(slice(first, first + AT_ONCE))
        maps, hidden = unet.places(part.history, part.labels, weights)
        distance = (maps + unet.offsets(hidden, weights) - part.future[:, None]).norm(dim=-1).mean(dim=-1)
        total += (distance * part.half[:, None]).sum(dim=0)
    return total / len(windows.half)
