"""Training of the ego-frame predictors."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import PredictorError, Truth
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.networks import ego_network
from motion_gym.predictors.networks.ego_features import FREE, Scenes, kept_distances, scenes_of
from motion_gym.predictors.settings import optional, whole
from motion_gym.specs import whole_number
from motion_gym.training.program import Program, Stage, Weights, check_complete, check_epochs, digests

STYLED = "manoeuvre"
"""Name of the network with a style."""
RATE = 2e-3
SHOWN = 64
"""Number of scenes to read a style from in training."""
DRAWN = 64
"""Number of styles, each of ``SHOWN`` random scenes, per environment."""
NOISE = 0.3
"""Standard deviation of the log of the factor that disturbs half of the distances in training the correction."""
AT_ONCE = 2000
"""Agents of one forward pass of validation."""
FARTHEST = 3.0
"""Largest distance that is believed, as a factor of the mean distance in training. Twice the largest d of the benchmark
``style`` is 2.7 times that mean. Farther agents do not keep a distance, but have nothing to do with each other."""
TRUST = 0.05
"""Weight of the observed scenes at which the networks with and without a style contribute equally."""


def distance_and_trust(state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distance that agents keep, metres, and the weight [0, 1) of the styled network in a forecast.

    Args:
        state: [..., 2] sums of ``kept_distances`` over scenes.
    """
    weight = state[..., 0]
    return state[..., 1] / np.maximum(weight, 1e-9), weight / (weight + TRUST)


class EgoProgram(Program):
    """Training of the ego-frame networks on a set of environments.

    Args:
        predictor: An ``EgoErm``, which names the networks to train.
        train: Complete windows of each environment.
        validation: Windows for model selection, of the same environments in the same order.
        device: Device of the tensors.
        epochs: Number of epochs, as a sequence of one; the learning rates decay to 0.
        agents: Agents per step, over all environments.
        most: Train on the first ``most`` scenes of each environment; None for all.

    Raises:
        PredictorError: a set is empty or not complete, or an environment has no style.
    """

    def __init__(
        self,
        predictor: Any,
        train: Sequence[Truth],
        validation: Sequence[Truth],
        *,
        device: torch.device,
        epochs: Sequence[int] = (15,),
        agents: int = 256,
        most: int | None = 9000,
    ):
        check_complete(train, validation)
        most = optional(whole(1, 10**9))("most", most)
        train = [pick_scenes(truth, slice(0, most)) for truth in train]
        self.networks, self.agents, self.device = predictor.networks, whole_number("agents", agents, 1, 10**9), device
        (count,) = check_epochs(predictor.name, epochs, 1)
        parts = [self._tensors(truth) for truth in train]
        self.scenes = Scenes.join([scenes for scenes, _ in parts])
        self.target = torch.cat([target for _, target in parts])
        self.environment = torch.arange(len(parts)).repeat_interleave(torch.tensor([len(t) for _, t in parts]))
        self.environment = self.environment.to(device)
        self.validation = [self._tensors(truth) for truth in validation]
        self.styles = np.zeros((len(train), 2))
        """[E, 2] a style of each environment, for validation."""
        self.distances = torch.ones(len(train), 1, device=device)
        """[E, D] distance of each drawn style, metres."""
        if STYLED in self.networks:
            drawn = self._draw_styles(train)
            self.styles = drawn[:, 0]
            self.distances = torch.tensor(distance_and_trust(drawn)[0], dtype=torch.float32, device=self.device)
        rates = {name: RATE for network in self.networks for name in (network, ego_network.GAINS[network])}
        self.stages = [Stage("forecast", count, rates, selects=True, decays=True)]
        self.config = {"predictor": predictor.name, "agents": agents, **digests(train, validation)}

    def _tensors(self, truth: Truth) -> tuple[Scenes, Tensor]:
        """Scenes, and the true offsets [A, 24]."""
        scenes, frame = scenes_of(truth.observation)
        target = torch.tensor(frame.into(truth.future.astype(np.float64)), dtype=torch.float32)
        return Scenes(*(value.to(self.device) for value in vars(scenes).values())), target.to(self.device)

    @staticmethod
    def _draw_styles(train: Sequence[Truth]) -> np.ndarray:
        """Sums [E, D, 2] of ``kept_distances`` over D draws of scenes of each environment."""
        rng = np.random.default_rng(len(train))
        drawn = np.zeros((len(train), DRAWN, 2))
        for number, truth in enumerate(train):
            evidence = kept_distances(truth)
            for draw in range(DRAWN):
                chosen = rng.choice(len(evidence), min(SHOWN, len(evidence)), replace=False)
                drawn[number, draw] = evidence[chosen].sum(0)
        if (drawn[..., 0] < TRUST).any():
            raise PredictorError(
                "In some training environment no agents keep a distance from each other, so there is no style to read: "
                "train `ego_erm`."
            )
        return drawn

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        inputs = {
            "plain": torch.cat([self.scenes.before, self.scenes.during], dim=-1).cpu(),
            "manoeuvre": self.scenes.before.cpu(),
        }
        return ego_network.initial(self.networks, inputs, self.distances.mean().cpu(), seed)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch, in a random order per model; metres."""
        total = len(self.target)
        order = torch.stack([torch.randperm(total, generator=g, device=self.device) for g in generators])
        size = min(self.agents, total)
        for first in range(0, total - size + 1, size):
            index = order[:, first : first + size]
            scenes, target = self.scenes.take(index), self.target[index]
            loss = ego_network.distance_error(ego_network.without_style(scenes, weights), target)
            if STYLED in self.networks:
                loss = loss + self._styled_loss(scenes, target, self.environment[index], weights, generators)
            yield loss

    def _styled_loss(
        self,
        scenes: Scenes,
        target: Tensor,
        environment: Tensor,
        weights: Weights,
        generators: Sequence[torch.Generator],
    ) -> Tensor:
        """Loss [M] of the manoeuvre at the read distances, plus that of the correction at disturbed distances."""

        def normal() -> Tensor:
            return torch.stack([torch.randn(environment.shape[1], generator=g, device=g.device) for g in generators])

        draw = torch.stack(
            [torch.randint(DRAWN, environment.shape[1:], generator=g, device=g.device) for g in generators]
        )
        distance = self.distances[environment, draw]
        path = torch.cat([scenes.deviation[..., 2 * FREE :], target], dim=-1)
        offsets, _ = ego_network.in_style(scenes, distance, weights)
        disturbed = distance * torch.exp(NOISE * normal() * (normal() < 0))
        _, corrected = ego_network.in_style(scenes, disturbed, weights)
        return ego_network.distance_error(offsets, path) + ego_network.distance_error(corrected, target)

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M], metres, mean over the agent-windows of all environments, with styles of 64 training scenes."""
        models = len(generators)
        total, count = torch.zeros(models, device=self.device), 0
        for style, (scenes, target) in zip(self.styles, self.validation, strict=True):
            for first in range(0, len(target), AT_ONCE):
                part = slice(first, first + AT_ONCE)
                offsets = forecast(scenes.take(part).for_models(models), style, weights)
                total += ego_network.distance_error(offsets, target[part]) * len(target[part])
            count += len(target)
        return total / count


def forecast(scenes: Scenes, state: np.ndarray, weights: Weights) -> Tensor:
    """Offsets [M, A, 24] for scenes [M, A, ...], given the sums [2] of ``kept_distances`` over the observed scenes."""
    plain = ego_network.without_style(scenes, weights)
    if f"{STYLED}.bias1" not in weights:
        return plain
    distance, trust = (float(value) for value in distance_and_trust(state))
    farthest = FARTHEST * weights["inputs.distance"]
    kept = torch.minimum(torch.full_like(farthest, distance), farthest).expand(scenes.miss.shape[:2])
    return trust * ego_network.in_style(scenes, kept, weights)[1] + (1 - trust) * plain
