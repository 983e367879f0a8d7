"""A forecaster that draws heat maps of goals and paths on a crop of the ground around each agent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Forecast, Observation, Truth
from motion_gym.data.windows import pick_scenes_of
from motion_gym.predictors.networks import goal_samples, unet
from motion_gym.predictors.networks.ego_crops import Crops, crops_of, mean_place
from motion_gym.predictors.networks.last_layer import LastLayer, with_bias_input
from motion_gym.predictors.networks.scene_noise import agent_keys
from motion_gym.predictors.training.heatmap_training import PARTS, HeatmapProgram, HeatmapTransfer
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.program import Weights

SCENES_AT_ONCE = 64
"""Scenes of one forward pass, to bound memory."""


@dataclass(eq=False, repr=False)
class Heatmap(Weighted):
    """A U-Net from maps of the history and of the ground to maps of the goal and of the future steps (Y-Net).

    The maps cover a square around the agent whose half width is 15.6 observed steps: 12 future steps at 1.3 times the
    observed speed. Forecasts are equivariant to translations, rotations and the unit of positions where there are no
    images. Agents are independent of each other. An agent that never moved stands still.

    The label map of the ground is an input where observations have images with labels, and unknown elsewhere; the photo
    is not read. A cell of the goal map is 1/32 of the half width, so that the center of the nearest cell is .38 cells
    away in the mean. Forecasts do not have this error: they are mean places of the maps, plus an offset for each future
    step that a linear last layer computes.

    The first sample goes towards the mean place of the goal map. Further samples go towards goals that are spread over
    the goal map by weighted k-means, from random first goals (test-time sampling).

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
    """

    kind: ClassVar[str] = "heatmap"
    sets: ClassVar[tuple[str, ...]] = ("sdd",)
    program: ClassVar[type[HeatmapProgram]] = HeatmapProgram
    transfer: ClassVar[type[HeatmapTransfer]] = HeatmapTransfer
    """Training program of the predictor ``transfer``."""
    parts: ClassVar[Mapping[str, tuple[str, ...]]] = PARTS
    """Tunable weights, by prefixes of their names; see ``last_layer.Tunable``."""

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        return unet.shapes()

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, K, 12, 2], in the unit of the observation.

        Raises:
            PredictorError: there are no weights, or the observation has another time step than the training data.
        """
        weights = self._ready(observation)
        parts = [np.zeros((0, samples, FUTURE, 2), np.float32)]
        for first in range(0, observation.scenes, SCENES_AT_ONCE):
            part = pick_scenes_of(observation, slice(first, first + SCENES_AT_ONCE))
            crops, history, labels = _inputs(part)
            with torch.no_grad():
                features = unet.encode(history, labels, weights)
                goals = unet.goal_map(features, weights)
                added = unet.offsets(unet.summary(features, history, weights), weights)
                towards = [mean_place(goals)]
                if samples > 1:
                    _, keys = agent_keys(part, samples - 1, seed)
                    spread = goal_samples.spread_goals(goals[:, 0].double().numpy(), keys.T)
                    towards += [torch.from_numpy(goal)[:, None].float() for goal in spread.swapaxes(0, 1)]
                paths = [mean_place(unet.path_maps(features, goal, weights)) + added for goal in towards]
            places = torch.cat(paths, dim=1).double().numpy()
            positions = crops.outside(places.reshape(len(places), -1, 2))
            parts.append(positions.reshape(-1, samples, FUTURE, 2).astype(np.float32))
        return Forecast(np.concatenate(parts))

    def goal_maps(self, observation: Observation) -> tuple[np.ndarray, Crops]:
        """Probability [A, 64, 64] of each cell to hold the position at the last future step, and the crops.

        Raises:
            PredictorError: see ``predict``.
        """
        weights = self._ready(observation)
        crops, history, labels = _inputs(observation)
        with torch.no_grad():
            logits = unet.goal_map(unet.encode(history, labels, weights), weights)[:, 0]
        return logits.flatten(1).softmax(dim=1).view(logits.shape).numpy(), crops

    def offsets(self, observation: Observation, weights: Weights, seed: int = 0, shown: Truth | None = None) -> Tensor:
        """Offsets [M, A, 12, 2] of the first sample from the last position; see ``last_layer.Tunable``."""
        self._ready(observation)
        crops, history, labels = _inputs(observation)
        maps, hidden = unet.places(history, labels, weights)
        places = (maps + unet.offsets(hidden, weights)).transpose(0, 1)
        half, turn = (torch.from_numpy(values).float() for values in (crops.half, crops.turn))
        return (places * half[:, None, None]) @ turn.transpose(1, 2)

    def last_layer(self, observation: Observation, seed: int = 0) -> LastLayer:
        """The last layer, from each agent to what it adds to the places of the maps; see ``last_layer.LastLayer``.

        Its vectors are in half widths of the crops, so that agents of all speeds count the same.
        """
        weights = self._ready(observation)
        crops, history, labels = _inputs(observation)
        with torch.no_grad():
            maps, hidden = unet.places(history, labels, weights)
        weight = np.concatenate([weights["offset.weight1"][0].numpy(), weights["offset.bias1"].numpy()])
        last = crops.outside(maps[:, 0].double().numpy())
        inputs = with_bias_input(hidden[0].double().numpy())
        return LastLayer(inputs, weight.astype(np.float64), last, crops.turn, moves=False, scale=crops.half)


def _inputs(observation: Observation) -> tuple[Crops, Tensor, Tensor]:
    """Crops, and observed positions and labels of the ground in them."""
    crops = crops_of(observation)
    return crops, torch.from_numpy(crops.inside(observation.xy)), torch.from_numpy(crops.labels)
