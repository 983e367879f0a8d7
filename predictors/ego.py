"""Predictors in the frame of each agent: without a style, and with the distance that agents keep as the style."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import torch

from motion_gym.contract import FUTURE, Forecast, Observation, Truth
from motion_gym.data.windows import check_truth, pick_scenes_of
from motion_gym.predictors.networks import ego_network
from motion_gym.predictors.networks.ego_features import kept_distances, scenes_of
from motion_gym.predictors.training.ego_training import EgoProgram, forecast
from motion_gym.predictors.weighted import Weighted

AGENTS_AT_ONCE = 4000
"""Approximate number of agents of one forward pass, to bound memory."""


class EgoErm(Weighted):
    """A network in each agent's own frame: a linear gain, initialised to constant velocity, and a sum over neighbours.

    Equivariant to rotations, translations and the order of agents. Takes any number of neighbours, including none.
    Trained on the mean Euclidean distance. Deterministic.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
    """

    kind: ClassVar[str] = "ego_erm"
    sets: ClassVar[tuple[str, ...]] = ("style", "style/crowd", "vehicles")
    networks: ClassVar[tuple[str, ...]] = ("plain",)
    program: ClassVar[type[EgoProgram]] = EgoProgram

    observed: np.ndarray = np.zeros(2)
    """[2] sum of ``kept_distances`` over the observed scenes; zero for a predictor without a style."""

    @property
    def expected(self) -> dict[str, tuple[int, ...]]:
        """Shape of every weight, without the model axis."""
        return ego_network.shapes(self.networks)

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast:
        """Forecast [A, 1, 12, 2], metres.

        Raises:
            PredictorError: there are no weights.
        """
        weights = self._ready(observation)
        parts = [np.zeros((0, FUTURE, 2))]
        per_scene = max(len(observation) // max(observation.scenes, 1), 1)
        at_once = max(AGENTS_AT_ONCE // per_scene, 1)
        for first in range(0, observation.scenes, at_once):
            scenes, frame = scenes_of(pick_scenes_of(observation, slice(first, first + at_once)))
            with torch.no_grad():
                offsets = forecast(scenes.for_models(1), self.observed, weights)[0]
            parts.append(frame.out_of(offsets.double().numpy()))
        return Forecast(np.concatenate(parts)[:, None].astype(np.float32))


class EgoModular(EgoErm):
    """``EgoErm`` with a style: the distance, in metres, that agents keep from each other.

    The distance is a running weighted mean over pairs of agents in scenes that are observed over all 20 steps. The
    forecast describes how agents who keep this distance leave their undisturbed courses, and is a polynomial in the
    distance; before any scene is observed, the forecast is that of a network without a style. The model assumes that
    styles are distances, that the first observed steps are undisturbed, and that the effects of neighbours add up. In
    crowds, where they do not, it is worse than ``ego_erm`` and constant velocity. A distance above three times the mean
    of training is taken for this bound.

    Args:
        weights: See ``Weighted``.
        seed: See ``Weighted``.
    """

    kind: ClassVar[str] = "ego_modular"
    networks: ClassVar[tuple[str, ...]] = ("plain", "manoeuvre")
    scenes: int = 0

    def observe(self, truth: Truth) -> None:
        """Read the style from pairs of agents whose 20 steps are all known.

        Raises:
            DataError: the ground truth is not valid.
            PredictorError: there are no weights, or the scenes have another time step than the training data.
        """
        self._ready(check_truth(truth, "The observed truth").observation)
        self.observed = self.observed + kept_distances(truth).sum(axis=0)
        self.scenes += truth.observation.scenes

    def reset(self) -> None:
        """Forget all observed scenes."""
        self.observed, self.scenes = np.zeros(2), 0
