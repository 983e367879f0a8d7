"""Training of ``kalman_residual`` on disturbed, scaled and mirrored copies of the training scenes."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Truth
from motion_gym.predictors.networks import residual_network
from motion_gym.predictors.networks.filter_features import NEAREST, Inputs, nearest_neighbours
from motion_gym.predictors.settings import boolean, optional, positive
from motion_gym.specs import number, whole_number
from motion_gym.training.program import Program, Stage, Weights, check_complete, check_epochs, digests

RATE = 2e-3
DISTURBED = 0.75
"""Share of the scenes whose histories are disturbed by noise."""
BALANCE = 0.5
"""An environment with n agents is drawn in proportion to n to this power."""
FASTEST = 5.0
"""Largest factor of a scene that is enlarged."""
JITTER = 1e-3
"""Added to the diagonal of a correlation matrix before it is factored."""


class ResidualProgram(Program):
    """Training on a set of environments, whose sizes are balanced.

    In each epoch every scene is scaled by a random factor and mirrored with probability 1/2. With probability 3/4 its
    histories are disturbed by white noise of a random standard deviation, so that the network meets places whose
    annotation is noisier than that of the training places. Neighbours of some agents are hidden, so that it meets
    people who walk alone, who are rare in complete windows, and some scenes are enlarged up to five times, so that it
    meets runners and cyclists. The loss is the mean Euclidean distance, in an enlarged scene divided by its factor,
    plus the negative log-likelihood of the remaining error under independent Gaussians, which trains only the spread.

    Args:
        predictor: A ``KalmanResidual``.
        train: Complete windows of each environment.
        validation: Windows for model selection, of the same environments in the same order.
        device: Device of the tensors.
        epochs: Number of epochs, as a sequence of one; the learning rate decays to 0.
        agents: Agents of an epoch, over all environments.
        batch: Agents of a step.
        noise: Largest standard deviation of the noise, metres.
        scale: Largest absolute logarithm of the factor of a scene.
        reach: Distance within which an agent is a neighbour, metres; None for any distance. In training it is measured
            before scenes are scaled.
        fast: Share of scenes that are enlarged.
        hidden: Share of agents who see only their n nearest neighbours, for a random n from 0 to 5.
        squared: Train on the mean squared distance in place of the mean distance.

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
        epochs: Sequence[int] = (30,),
        agents: int = 12_000,
        batch: int = 512,
        noise: float = 0.08,
        scale: float = 0.3,
        reach: float | None = 10.0,
        fast: float = 0.15,
        hidden: float = 0.4,
        squared: bool = False,
    ):
        check_complete(train, validation)
        (count,) = check_epochs(predictor.name, epochs, 1)
        self.batch = whole_number("batch", batch, 1, 10**9)
        self.noise, self.scale = number("noise", noise), number("scale", scale)
        self.reach = optional(positive)("reach", reach)
        self.fast, self.hidden = number("fast", fast, most=1), number("hidden", hidden, most=1)
        self.inputs, self.squared = predictor.inputs, boolean("squared", squared)
        self.device, self.train = device, list(train)
        self.nearest = [nearest_neighbours(t.observation.xy[:, -1], t.observation.scene, self.reach) for t in train]
        shares = np.array([len(truth.observation) for truth in train]) ** BALANCE
        total = whole_number("agents", agents, 1, 10**9)
        self.drawn = [max(1, round(total * share)) for share in shares / shares.sum()]
        """Agents of an epoch, by environment."""
        self.known = [self._tensors(*_plain(truth)) for truth in train]
        self.validation = [self._tensors(*_plain(truth)) for truth in validation]
        self.stages = [
            Stage("forecast", count, {"inputs": 0.0, "correlation": 0.0, "": RATE}, selects=True, decays=True)
        ]
        self.config = {
            "predictor": predictor.name,
            "agents": agents,
            "batch": batch,
            "noise": noise,
            "scale": scale,
            **({} if reach is None else {"reach": reach}),
            **({"fast": fast} if fast else {}),
            **({"hidden": hidden} if hidden else {}),
            **({"squared": True} if squared else {}),
            **digests(train, validation),
        }

    def first(self, seed: int) -> Weights:
        """Initial weights of one model, [1, ...]."""
        return residual_network.initial(torch.cat([own for own, *_ in self.known]).cpu(), seed)

    def losses(
        self, weights: Weights, state: Tensor, stage: int, generators: Sequence[torch.Generator], epoch: int
    ) -> Iterator[Tensor]:
        """Losses [M] of the steps of an epoch; all models see the same copies of the scenes."""
        rng = np.random.default_rng([epoch, len(self.train)])
        parts = [self._copies(number, rng) for number in range(len(self.train))]
        own, others, there, target, share = (torch.cat(values) for values in zip(*parts, strict=True))
        order = torch.from_numpy(rng.permutation(len(target))).to(self.device)
        for index in order.split(self.batch):
            offsets, spread = residual_network.residual(own[index], others[index], there[index], weights)
            off = offsets - target[index]
            distance = off.square().sum(dim=-1).add(1e-10)
            distance = distance if self.squared else distance.sqrt()
            likelihood = (spread + (off.detach() / spread.exp()).square() / 2).sum(dim=-1)
            yield (distance * share[index] + 0.1 * likelihood).mean(dim=(1, 2))

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M], metres, mean over the agent-windows of all environments."""
        total = torch.zeros(len(generators), device=self.device)
        for own, others, there, target in self.validation:
            offsets, _ = residual_network.residual(own, others, there, weights)
            total += (offsets - target).norm(dim=-1).mean(dim=-1).sum(dim=1)
        return total / sum(len(target) for *_, target in self.validation)

    def finished(self, weights: Weights) -> Weights:
        """The weights with the correlation of the errors between steps, measured on the training windows."""
        errors = []
        for part in self.known:
            own, others, there, target = (values.cpu() for values in part)
            with torch.no_grad():
                offsets, spread = residual_network.residual(own, others, there, weights)
            errors.append((target - offsets) / spread.exp())
        z = torch.cat(errors, dim=1).double().clamp(-5, 5)
        z = z / z.square().mean(dim=1, keepdim=True).sqrt()
        correlation = torch.einsum("matc,masc->mcts", z, z) / z.shape[1] + JITTER * torch.eye(FUTURE)
        return {**weights, "correlation.factor": torch.linalg.cholesky(correlation).float()}

    def _copies(self, number: int, rng: np.random.Generator) -> tuple[Tensor, ...]:
        """Inputs, target and share in the loss of random agents of an environment, in changed copies of its scenes."""
        truth, scenes = self.train[number], self.train[number].observation.scenes
        each = truth.observation.scene_index
        factor = np.exp(rng.uniform(-self.scale, self.scale, scenes))
        larger = np.zeros(scenes, bool)
        if self.fast:
            larger = rng.random(scenes) < self.fast
            factor = np.where(larger, FASTEST ** rng.random(scenes), factor)
        mirror = np.where(rng.random(scenes) < 0.5, -1.0, 1.0)
        strength = rng.uniform(0, self.noise, scenes) * (rng.random(scenes) < DISTURBED)
        xy, future = _plain(truth)[:2]
        stretch = np.stack([factor, factor * mirror], axis=-1)[each][:, None]
        xy = xy * stretch + rng.normal(size=xy.shape) * strength[each][:, None, None]
        agents = len(xy)
        chosen = rng.choice(agents, self.drawn[number], replace=self.drawn[number] > agents)
        nearest = self.nearest[number]
        if self.hidden:
            seen = np.where(rng.random(agents) < self.hidden, rng.integers(0, NEAREST, agents), NEAREST)
            nearest = np.where(np.arange(NEAREST) < seen[:, None], nearest, -1)
        inputs = self.inputs(xy, truth.observation.dt, nearest, chosen)
        parts = self._as_tensors(inputs, (future * stretch)[chosen] - xy[chosen, -1:])
        share = torch.tensor(np.where(larger, 1 / factor, 1.0)[each][chosen, None], dtype=torch.float32)
        return (*parts, share.to(self.device))

    def _tensors(self, xy: np.ndarray, future: np.ndarray, scene: np.ndarray, dt: float) -> tuple[Tensor, ...]:
        """Inputs and target of all agents."""
        return self._as_tensors(
            self.inputs(xy, dt, nearest_neighbours(xy[:, -1], scene, self.reach)), future - xy[:, -1:]
        )

    def _as_tensors(self, inputs: Inputs, offsets: np.ndarray) -> tuple[Tensor, ...]:
        """Inputs, and the offsets [A, 12, 2] that the filters leave, in the frame of the agents."""
        left = (offsets - inputs.straight) @ inputs.turn
        arrays = (inputs.own, inputs.others, inputs.there, left)
        return tuple(torch.tensor(values, dtype=torch.float32, device=self.device) for values in arrays)


def _plain(truth: Truth) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """Observed and future positions [A, 8 and 12, 2] around the middle of the place, the scenes, and dt."""
    observation = truth.observation
    middle = observation.xy[:, -1].mean(axis=0, dtype=np.float64)
    return observation.xy - middle, truth.future - middle, observation.scene, observation.dt
