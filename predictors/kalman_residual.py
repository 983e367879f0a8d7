"""Kalman filters with a residual network: a forecaster for places whose annotation noise is not known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from motion_gym.contract import FUTURE, Forecast, Observation
from motion_gym.predictors.networks import residual_network
from motion_gym.predictors.networks.filter_features import Inputs, inputs_of, mirrored, nearest_neighbours
from motion_gym.predictors.networks.scene_noise import agent_keys, normals
from motion_gym.predictors.settings import boolean, setting
from motion_gym.predictors.training.residual_training import ResidualProgram
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.plans import OTHER_PLACES


@dataclass(eq=False, repr=False)
class KalmanResidual(Weighted):
    """The mixture of ``kalman_velocity``, and a small network that corrects it.

    The network is given the observed steps, how the filters are weighted, and the six nearest neighbours, all in the
    frame of the agent. It is trained on histories that are disturbed by noise of a random strength, so that it learns
    how far to trust an observation from the weights of the filters. The forecast is the mean of those of the scene and
    of its mirror image, hence equivariant to rotations, translations, mirroring and the order of agents.

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
    sets: ClassVar[tuple[str, ...]] = ("original/all", *OTHER_PLACES)
    program: ClassVar[type[ResidualProgram]] = ResidualProgram

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
        last = observation.xy[:, -1:].astype(np.float64)
        inputs = self.inputs(
            observation.xy.astype(np.float64), observation.dt, nearest_neighbours(last[:, 0], observation.scene)
        )
        flip = np.array([1.0, -1.0])
        offsets, spread = np.zeros((2, len(last), FUTURE, 2))
        for each, sign in ((inputs, 1.0), (mirrored(inputs), flip)):
            own, others, there = (torch.from_numpy(values) for values in (each.own, each.others, each.there))
            with torch.no_grad():
                off, log = residual_network.residual(own, others, there, weights)
            offsets, spread = offsets + sign * off[0].double().numpy() / 2, spread + log[0].double().numpy() / 2
        drawn = np.zeros((len(last), samples, FUTURE, 2))
        if samples > 1:
            _, keys = agent_keys(observation, samples - 1, seed)
            noise = normals(keys, 2 * FUTURE).reshape(samples - 1, len(last), 2, FUTURE)
            factor = weights["correlation.factor"][0].double().numpy()
            drawn[:, 1:] = np.einsum("cts,kacs->aktc", factor, noise) * np.exp(spread)[:, None]
        offsets = (offsets[:, None] + drawn) @ inputs.turn.transpose(0, 2, 1)[:, None]
        return Forecast((last[:, None] + inputs.straight[:, None] + offsets).astype(np.float32))
