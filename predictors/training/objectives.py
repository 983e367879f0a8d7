"""Training objectives: what to minimise, given the risks of several environments.

All are functions of ``Risks``. Those with a state of their own (the weights of group DRO) keep it in tensors, so that a
checkpoint holds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

RELEASED_SCENES = 64
"""Scenes of a step of the released program, all of one environment."""


@dataclass(frozen=True)
class Risks:
    """Risks of E environments in one step, for M models.

    The risk of a scene is the squared error of its displacements (x and y summed) over (steps * agents); slopes are
    derivatives of it by a scale w = 1 that multiplies the displacements.

    Attributes:
        value: [E, M] sum of the risks of an environment's scenes.
        slope: [2, E, M] sum of the slopes of its even and of its odd scenes.
        scenes: [E] number of its scenes.
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
        weight: [T, A] 1 / (steps * agents of the scene); 0 where the truth is not known.
        scene: [A] int64 scene of each agent.
        environment: [A] int64 environment of each agent, 0 to E - 1.
        count: [E] number of scenes of each environment.
    """
    off = forecast - target[:, None]
    by_agent = torch.einsum("tmac,ta->ma", off * off, weight)
    slopes = torch.einsum("tmac,ta->ma", forecast * off, 2 * weight)
    size, models = len(count), len(by_agent)
    value = by_agent.new_zeros(size, models).index_add(0, environment, by_agent.T)
    halves = by_agent.new_zeros(2 * size, models).index_add(0, environment + size * (scene % 2), slopes.T)
    return Risks(value, halves.unflatten(0, (2, size)), count)


class Objective:
    """Turns risks into what is minimised."""

    joint: ClassVar[bool] = False
    """Whether a step needs several environments at once."""
    compares: ClassVar[bool] = True
    """Whether it means nothing with one environment alone."""

    def start(self, environments: int, models: int, device: torch.device) -> Tensor:
        """State at the beginning of a stage; empty here."""
        return torch.zeros(0, device=device)

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]; may change the state in place."""
        raise NotImplementedError


class Erm(Objective):
    """Sum of all risks (the paper's Eq. 1)."""

    compares = False

    def __call__(self, risks: Risks, state: Tensor) -> Tensor:
        """Losses [M]."""
        return risks.value.sum(dim=0)


@dataclass(frozen=True)
class Irm(Objective):
    """Risks, and for each environment a penalty on the squared slope (the paper's Eq. 3; IRMv1, Arjovsky et al., 2019).

    Attributes:
        penalty: Factor lambda of the penalty, >= 0, for sums over 64 scenes of an environment, as in the released
            program. The penalty grows with their square, the risk with their number: where a step holds fewer scenes,
            the factor is raised in proportion, so that lambda means the same.
        unbiased: Take the product of the slopes of the even and of the odd scenes, as the released program does by
            default, instead of the square of their sum. If the scenes are independent, as in shuffled steps, its mean
            is a quarter of the square of the mean slope, while noise in the slopes, which shrinking forecasts would
            lower, adds nothing to it.
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
    """Mean risk, and a penalty on the variance of the environments' mean risks (Krueger et al., ICML 2021).

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
    """Mean risks weighted by how bad they are (Sagawa et al., ICLR 2020): the worst environment comes to count most.

    Attributes:
        rate: Step of the weights, >= 0: each is multiplied by exp(rate * mean risk) and they are made to sum to 1.
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
