"""A running average of style codes, for predictors with a style."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import Truth
from motion_gym.data.windows import check_truth, pick_scenes, whole_scenes
from motion_gym.predictors.networks.pair_network import CODE
from motion_gym.predictors.weighted import Weighted
from motion_gym.training.program import Weights


class StyleMemory(Weighted):
    """A predictor whose weights include ``prior.code``, the mean style code of the training scenes.

    The style of a domain is a running average of the codes of scenes that are observed over all 20 steps. It starts at
    the mean code of the training scenes, which counts as one scene. ``reset`` restores this start.
    """

    observed: np.ndarray = np.zeros(CODE)
    """[8] float64, sum of the codes of the observed scenes."""
    scenes: int = 0
    """Number of observed scenes."""

    def observe(self, truth: Truth) -> None:
        """Read the style from the scenes whose 20 steps are all known.

        Raises:
            DataError: the ground truth is not valid.
            PredictorError: there are no weights, or the scenes have another time step than the training data.
        """
        weights = self._ready(check_truth(truth, "The observed truth").observation)
        scenes = self.whole_scenes(truth)
        if scenes is None:
            return
        with torch.no_grad():
            codes = self.scene_codes(scenes, weights)[0]
        self.observed = self.observed + codes.double().sum(dim=0).numpy()
        self.scenes += len(codes)

    def reset(self) -> None:
        """Forget all observed scenes."""
        self.observed, self.scenes = np.zeros(CODE), 0

    def scene_codes(self, truth: Truth, weights: Weights) -> Tensor:
        """Style codes [M, S, 8] of the scenes that ``whole_scenes`` returns."""
        raise NotImplementedError

    @staticmethod
    def whole_scenes(truth: Truth) -> Truth | None:
        """The scenes of at least two agents whose 20 steps are all known; None if there are none."""
        whole = whole_scenes(truth)
        several = whole[np.diff(truth.observation.scene)[whole] > 1]
        return pick_scenes(truth, several) if len(several) else None

    def _codes(self, weights: Weights, shown: Truth | None = None) -> Tensor:
        """Style code [1, 1, 8] of the running average; or [M, 1, 8] of ``shown``, to tune the style encoder."""
        if shown is not None:
            return self.scene_codes(shown, weights).mean(dim=1, keepdim=True)
        prior = weights["prior.code"][:1]
        scenes = torch.as_tensor(self.scenes_of_values()).to(prior)
        return ((prior + torch.from_numpy(self.observed).to(prior)) / (1 + scenes))[:, None]

    def scenes_of_values(self) -> int | np.ndarray:
        """Number of observed scenes from which the values of the code are read: one for all, or [8]."""
        return self.scenes
