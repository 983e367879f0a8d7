"""Training of STGAT with a style: the stages of STGAT, then those of the style as for the two-agent network."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, PredictorError, SpecError, Truth
from motion_gym.predictors.networks import pair_network, stgat_style
from motion_gym.predictors.networks.neighbour_pairs import NeighbourPairs, whole_paths
from motion_gym.predictors.networks.stgat_network import Draws
from motion_gym.predictors.training.objectives import Erm, risks_of
from motion_gym.predictors.training.stgat_training import Batch, StgatProgram
from motion_gym.predictors.training.style_loss import style_loss
from motion_gym.training.program import Weights

SHOWN = 64
"""Number of training scenes of an environment to read its style from in validation."""
STAGES: tuple[tuple[str, Mapping[str, float]], ...] = (
    ("style", {"style": 1e-3, "head": 1e-2}),
    ("modulator", {"modulator": 1e-3}),
    ("forecast in style", {"decoder": 1e-3, "stage3": 1e-3, "modulator": 1e-3, "style": 5e-4, "head": 1e-2}),
)
"""Stages after those of STGAT, and learning rates of Adam; the scene encoders are frozen."""


class Paths:
    """Relative paths of the pairs of neighbours of an environment, by scene.

    Args:
        truth: The environment.
    """

    def __init__(self, truth: Truth):
        pairs = NeighbourPairs.of(truth)
        self.paths = pairs.paths(whole_paths(truth))
        self.count = np.bincount(pairs.scene, minlength=truth.observation.scenes)
        """[S] number of pairs of each scene."""
        self.first = np.cumsum(self.count) - self.count

    def of(self, scenes: np.ndarray) -> tuple[Tensor, np.ndarray]:
        """Paths [P, 40] of some scenes, and the index [P] of each path's scene among these scenes."""
        count = self.count[scenes]
        within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        return self.paths[np.repeat(self.first[scenes], count) + within], np.repeat(np.arange(len(scenes)), count)


class StyledStgatProgram(StgatProgram):
    """Training of STGAT with a style on a set of environments.

    The stages after those of STGAT are style, modulator and forecast in style; they minimise the sum of all errors.

    Args:
        predictor: A ``ModularStgat``.
        train: Windows of each environment.
        validation: Windows for model selection, of the same environments in the same order.
        device: Device of the tensors.
        epochs: Epochs of the six stages.
        scenes: Scenes per step, an equal part from each environment.

    Raises:
        SpecError: a number is not allowed.
        PredictorError: a set is empty, there is only one environment, or an environment has no neighbours.
    """

    further = STAGES

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        device: torch.device,
        epochs: Sequence[int] = (40, 30, 30, 10, 5, 40),
        scenes: int = 64,
    ):
        super().__init__(predictor, train, validation, device=device, epochs=epochs, scenes=scenes, joint=True)
        if len(self.train) < 2 or len(self.train) != len(validation):
            raise PredictorError(
                "The style loss compares environments: give at least two to train on, one Truth for each, and the same "
                f"ones to validate on ({len(self.train)} and {len(validation)} were given), or train `erm_no_sigma`."
            )
        if scenes < 2 * len(self.train):
            raise SpecError(f"`scenes={scenes}` must be at least 2 for each of the {len(self.train)} environments.")
        self.pairs = [Paths(truth) for truth in self.train]
        for number, pairs in enumerate(self.pairs):
            if (pairs.count > 0).sum() < 2:
                raise PredictorError(
                    f"Environment {number} of the training set has no scenes of two agents or more that are known over "
                    "all 20 steps, so it has no style: give other scenes, or train `erm_no_sigma`."
                )
        self.validation = self._validation(validation)

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        return stgat_style.initial(self.features, seed)

    def finished(self, weights: Weights) -> Weights:
        """The weights with the prior of the style, an average with equal weight per environment, and the time step."""
        dt = torch.full((len(weights["style.bias1"]), 1), self.train[0].observation.dt)
        with torch.no_grad():
            means = [self._mean_code(number, None, weights) for number in range(len(self.train))]
        return {**weights, "prior.code": torch.stack(means).mean(dim=0)[:, 0], "prior.dt": dt}

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch."""
        if stage < 3:
            yield from super().losses(weights, state, stage, generators, epoch)
            return
        for parts in self._shuffled(epoch):
            environment = torch.arange(len(parts)).repeat_interleave(torch.tensor([len(s) for _, s in parts]))
            environment = environment.to(self.device)
            codes, paired = self._codes(parts, weights)
            loss = torch.zeros(len(codes), device=self.device)
            if stage != 4:
                loss = self._style_loss(codes, environment, paired, weights)
            if stage > 3:
                batch = self._batch(parts)
                total = codes.new_zeros(len(codes), len(parts), codes.shape[2]).index_add(1, environment, codes)
                count = torch.bincount(environment[paired], minlength=len(parts)).clamp(min=1)
                style = (total / count[:, None])[:, batch.environment]
                draws = Draws.from_generators(generators, batch.layout)
                forecast = stgat_style.forecast(batch.steps, draws, batch.layout, style, weights)
                weight = batch.known * (batch.share / FUTURE)
                scene = batch.layout.scene
                risks = risks_of(forecast, batch.moves, weight, scene, batch.environment, batch.count)
                loss = loss + Erm()(risks, state)
            yield loss

    def _forecast(self, batch: Batch, draws: Draws, environment: int, weights: Weights) -> Tensor:
        """Displacements [12, M, A, 2] in the style of 64 training scenes of the environment."""
        style = self._mean_code(environment, SHOWN, weights)
        return stgat_style.forecast(batch.steps, draws, batch.layout, style, weights)

    def _mean_code(self, number: int, most: int | None, weights: Weights) -> Tensor:
        """Mean code [M, 1, 8] of the first scenes of an environment that have pairs."""
        scenes = np.flatnonzero(self.pairs[number].count)[:most]
        codes, _ = self._codes([(number, scenes)], weights)
        return codes.mean(dim=1, keepdim=True)

    @staticmethod
    def _style_loss(codes: Tensor, environment: Tensor, paired: Tensor, weights: Weights) -> Tensor:
        """Style loss [M] over scenes with pairs, of environments with at least two; 0 for a single environment."""
        several = torch.bincount(environment[paired], minlength=len(environment)) > 1
        if several.sum() < 2:
            return codes.sum(dim=(1, 2)) * 0
        used = paired & several[environment]
        return style_loss(pair_network.embed(codes[:, used], weights), environment[used])

    def _codes(self, parts: Sequence[tuple[int, np.ndarray]], weights: Weights) -> tuple[Tensor, Tensor]:
        """Codes [M, S, 8] of the scenes of a step, and whether they have pairs, [S] bool."""
        paths, owners, scenes = [], [], 0
        for number, chosen in parts:
            part, owner = self.pairs[number].of(chosen)
            paths.append(part)
            owners.append(owner + scenes)
            scenes += len(chosen)
        device = weights["style.bias1"].device
        scene = torch.from_numpy(np.concatenate(owners)).to(device)
        codes = stgat_style.scene_codes(torch.cat(paths).to(device), scene, scenes, weights)
        return codes, torch.bincount(scene, minlength=scenes) > 0
