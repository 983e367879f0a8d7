"""Training objectives: losses from the risks of several environments.

All objectives are functions of ``Risks``. The state of an objective, such as the weights of group DRO, is a tensor, so
that checkpoints hold it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

RELEASED_SCENES = 64
"""Scenes per step of the released program, all of one environment."""


@dataclass(frozen=True)
class Risks:
    """Risks of E environments in one step, for M models.

    The risk of a scene is the squared error of its displacements (summed over x and y) divided by (steps * agents). Its
    slope is the derivative with respect to a factor w = 1 on the displacements.

    Attributes:
        value: [E, M] sum of the risks over the scenes of each environment.
        slope: [2, E, M] sums of the slopes over the even and over the odd scenes.
        scenes: [E] number of scenes in a full step; the last step of an environment may hold fewer.
    """

    value: Tensor
    slope: Tensor
    scenes: Tensor


def risks_of(
    forecast: Tensor, target: Tensor, weight: Tensor, scene: Tensor, environment: Tensor, count: Tensor
) -> Risks:
    """Risks of forecast displacements.

    Args:
        forecast: [T, M, A, 2] displacements.
        target: [T, A, 2] true displacements.
        weight: [T, A] 1 / (steps * agents of the scene); 0 where the ground truth is unknown.
        scene: [A] int64 scene of each agent.
        environment: [A] int64 environment of each agent, 0 to E - 1.
        count: [E] number of scenes of each environment in a full step.
    """
    off = forecast - target[:, None]
    by_agent = torch.einsum("tmac,ta->ma", off * off, weight)
    slopes = torch.einsum("tmac,ta->ma", forecast * off, 2 * weight)
    size, models = len(count), len(by_agent)
    value = by_agent.new_zeros(size, models).index_add(0, environment, by_agent.T)
    halves = by_agent.new_zeros(2 * size, models).index_add(0, environment + size * (scene % 2), slopes.T)
    return Risks(value, halves.unflatten(0, (2, size)), count)


class Objective:
    """Computes a loss from risks."""

    joint: ClassVar[bool] = False
    """Whether each step needs several environments."""
    compares: ClassVar[bool] = True
    """Whether the objective needs at least two environments."""

    def start(self, environments: int, models: int, device: torch.device) -> Tensor:
        """Initial state in each stage. The base class has none."""
        return torch.zeros(0, device=device)

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]; may modify the state in place."""
        raise NotImplementedError


class Erm(Objective):
    """Sum of all risks (the paper's Eq. 1)."""

    compares = False

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]."""
        return risks.value.sum(dim=0)


@dataclass(frozen=True)
class Irm(Objective):
    """Risks, plus a penalty on each environment's squared slope (the paper's Eq. 3; IRMv1, Arjovsky et al., 2019).

    Attributes:
        penalty: Factor lambda of the penalty, >= 0, for sums over 64 scenes of an environment, as in the released
            program. The risk grows with the number of scenes, the penalty with its square. If full steps hold fewer
            scenes, the factor is increased in proportion, so that lambda has the same effect.
        unbiased: Use the product of the slopes over even and over odd scenes, an option of the released program,
            instead of the square of their sum, its default. For independent scenes, as in shuffled steps, the
            expectation of the product is a quarter of the square of the mean slope, without a term from noise in the
            slopes, which the training could reduce by shrinking the forecasts.
    """

    penalty: float
    unbiased: bool = True

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]."""
        slope = risks.slope
        squared = slope[0] * slope[1] if self.unbiased else (slope[0] + slope[1]) ** 2
        factor = self.penalty * RELEASED_SCENES / risks.scenes[:, None]
        return (risks.value + factor * squared).sum(dim=0)


@dataclass(frozen=True)
class VRex(Objective):
    """Mean risk, plus a penalty on the variance of the environments' mean risks (Krueger et al., ICML 2021).

    Attributes:
        penalty: Factor beta of the variance, >= 0.
    """

    penalty: float
    joint: ClassVar[bool] = True

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]."""
        mean = risks.value / risks.scenes[:, None]
        return mean.mean(dim=0) + self.penalty * mean.var(dim=0, unbiased=False)


@dataclass(frozen=True)
class GroupDro(Objective):
    """Mean risks with adaptive weights that favour the worst environment (group DRO; Sagawa et al., ICLR 2020).

    Attributes:
        rate: Step size of the weights, >= 0: each step multiplies them by exp(rate * mean risk) and normalises them.
    """

    rate: float
    joint: ClassVar[bool] = True

    def start(self, environments: int, models: int, device: torch.device) -> Tensor:
        """Equal weights [E, M]."""
        return torch.full((environments, models), 1 / environments, device=device)

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]."""
        mean = risks.value / risks.scenes[:, None]
        with torch.no_grad():
            state *= torch.exp(self.rate * mean)
            state /= state.sum(dim=0)
        return (state.clone() * mean).sum(dim=0)
