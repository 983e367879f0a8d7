"""A running average of style codes, which predictors with a style forecast by."""

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
    """A predictor whose weights hold ``prior.code``, the mean style code of the training scenes.

    The style of a domain is read from scenes that are observed over all 20 steps: a running average of their codes. It
    begins at the mean code of the training scenes, which counts for one scene. ``reset`` goes back there.
    """

    observed: np.ndarray = np.zeros(CODE)
    """[8] float64, sum of the codes of the observed scenes."""
    scenes: int = 0
    """Number of these scenes."""

    def observe(self, truth: Truth) -> None:
        """Read the style from those scenes whose 20 steps are all known.

        Raises:
            DataError: it is no proper Truth.
            PredictorError: there are no weights, or the scenes have another time step than they were trained on.
        """
        weights = self._ready(check_truth(truth, "The observed truth").observation)
        whole = self.whole_scenes(truth)
        if whole is None:
            return
        with torch.no_grad():
            codes = self.scene_codes(whole, weights)[0]
        self.observed = self.observed + codes.double().sum(dim=0).numpy()
        self.scenes += len(codes)

    def reset(self) -> None:
        """Forget all that was observed."""
        self.observed, self.scenes = np.zeros(CODE), 0

    def scene_codes(self, truth: Truth, weights: Weights) -> Tensor:
        """Style codes [M, S, 8] of scenes as ``whole_scenes`` gives them."""
        raise NotImplementedError

    @staticmethod
    def whole_scenes(truth: Truth) -> Truth | None:
        """The scenes of two agents or more whose 20 steps are all known; None if there are none."""
        whole = whole_scenes(truth)
        shown = whole[np.diff(truth.observation.scene)[whole] > 1]
        return pick_scenes(truth, shown) if len(shown) else None

    def _codes(self, weights: Weights, shown: Truth | None = None) -> Tensor:
        """The running average, [1, 1, 8]; or the mean code [M, 1, 8] of scenes, to tune the style encoder through."""
        if shown is not None:
            return self.scene_codes(shown, weights).mean(dim=1, keepdim=True)
        average = (weights["prior.code"][:1] + torch.from_numpy(self.observed).to(weights["prior.code"])) / (
            1 + self.scenes
        )
        return average[:, None]
