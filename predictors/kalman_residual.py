"""Kalman filters with a residual network: a forecaster for places whose annotation noise is not known."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Forecast, Observation, Truth
from motion_gym.predictors.networks import residual_network
from motion_gym.predictors.networks.filter_features import Inputs, inputs_of, mirrored, nearest_neighbours
from motion_gym.predictors.networks.last_layer import LastLayer, with_bias_input
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.settings import boolean, setting
from motion_gym.predictors.training.residual_training import ResidualProgram
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.plans import OTHER_PLACES
from motion_gym.training.program import Weights


@dataclass(eq=False, repr=False)
class KalmanResidual(Weighted):
    """The mixture of ``kalman_velocity``, and a small network that corrects it.

    The network is given the observed steps, how the filters are weighted, and the six nearest neighbours, all in the
    frame of the agent; with weights of real places, neighbours are those within 10 m. It is trained on histories that
    are disturbed by noise of a random strength, so that it learns how far to trust an observation from the weights of
    the filters, and on people who walk alone or fast, who are rare in the training windows. The forecast is the mean of
    those of the scene and of its mirror image, hence equivariant to rotations, translations, mirroring and the order of
    agents.

    The first sample is the forecast. The further samples are drawn around it, for each agent independently, from a
    Gaussian whose standard deviations the network gives and whose correlation between steps was measured in training.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
        bank: False for an ablation: constant velocity at the last step in place of the filters.
        neighbours: False for an ablation: the neighbours are not given to the network.
        heading: False for an ablation: inputs in the axes of the world, which are not invariant to rotations.
    """

    bank: bool = setting(True, boolean)
    neighbours: bool = setting(True, boolean)
    heading: bool = setting(True, boolean)
    kind: ClassVar[str] = "kalman_residual"
    sets: ClassVar[tuple[str, ...]] = ("original/all", *OTHER_PLACES, "style", "style/crowd", "vehicles")
    program: ClassVar[type[ResidualProgram]] = ResidualProgram
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = {
        "all": ("neighbour", "residual"),
        "last_layer": ("residual.weight3", "residual.bias3"),
    }
    """Tunable weights, by prefixes of their names; see ``last_layer.Tunable``."""

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        return residual_network.shapes()

    def inputs(
        self, xy: np.ndarray, dt: float, nearest: np.ndarray, chosen: np.ndarray | slice = slice(None)
    ) -> Inputs:
        """Inputs of some agents; see ``filter_features.inputs_of``."""
        nearest = nearest if self.neighbours else np.full_like(nearest, -1)
        return inputs_of(xy, dt, nearest, chosen, self.bank, self.heading)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], metres.

        Raises:
            PredictorError: there are no weights, or the observation has another time step than the training data.
        """
        weights = self._ready(observation)
        inputs, last = self._inputs_of(observation)
        with torch.no_grad():
            residual, spread = (values[0].double().numpy() for values in _both_sides(inputs, weights))
        drawn = np.zeros((len(last), samples, FUTURE, 2))
        if samples > 1:
            _, keys = agent_keys(observation, samples - 1, seed)
            noise = normals(keys, 2 * FUTURE).reshape(samples - 1, len(last), 2, FUTURE)
            factor = weights["correlation.factor"][0].double().numpy()
            drawn[:, 1:] = np.einsum("cts,kacs->aktc", factor, noise) * np.exp(spread)[:, None]
        offsets = (residual[:, None] + drawn) @ inputs.turn.transpose(0, 2, 1)[:, None]
        return Forecast((last[:, None] + inputs.straight[:, None] + offsets).astype(np.float32))

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Offsets [M, A, 12, 2] of the forecast from the last position, metres; see ``last_layer.Tunable``."""
        inputs, _ = self._inputs_of(observation)
        turn, straight = (torch.from_numpy(values).float() for values in (inputs.turn, inputs.straight))
        return straight + _both_sides(inputs, weights)[0] @ turn.transpose(1, 2)

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer, from each agent to what it adds to the filters; see ``last_layer.LastLayer``.

        The mean over a scene and its mirror image is linear, too: along the course in the mean of the hidden values of
        both, and to the left in half of their difference.
        """
        weights = self._ready(observation)
        inputs, last = self._inputs_of(observation)
        with torch.no_grad():
            one, other = (
                residual_network.hidden(*_tensors(side), weights)[0].double().numpy()
                for side in (inputs, mirrored(inputs))
            )
        matrix, bias = (weights[f"residual.{name}3"][0].double().numpy() for name in ("weight", "bias"))
        along = np.arange(2 * FUTURE) % 2 == 0
        weight = np.concatenate([matrix * along, matrix * ~along, (bias * along)[None]])
        rows = with_bias_input(np.concatenate([(one + other) / 2, (one - other) / 2], axis=1))
        return LastLayer(rows, weight, last + inputs.straight, inputs.turn, moves=False)

    def _inputs_of(self, observation: Observation) -> tuple[Inputs, np.ndarray]:
        """Inputs of all agents, and their last observed positions [A, 1, 2], metres."""
        xy = observation.xy.astype(np.float64)
        reach = self.card.get("training", {}).get("reach")  # as in training
        return self.inputs(xy, observation.dt, nearest_neighbours(xy[:, -1], observation.scene, reach)), xy[:, -1:]


def _tensors(inputs: Inputs) -> tuple[Tensor, Tensor, Tensor]:
    own, others, there = (torch.from_numpy(values) for values in (inputs.own, inputs.others, inputs.there))
    return own, others, there


def _both_sides(inputs: Inputs, weights: Weights) -> tuple[Tensor, Tensor]:
    """Offsets and log standard deviations [M, A, 12, 2], means over the scenes and their mirror images."""
    offsets, spread = residual_network.residual(*_tensors(inputs), weights)
    others, other_spread = residual_network.residual(*_tensors(mirrored(inputs)), weights)
    return (offsets + others * torch.tensor([1.0, -1.0])) / 2, (spread + other_spread) / 2
