"""What predictors make of sigma, the noise feature."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import Observation, SpecError


def check_sigma(sigma: object, name: str) -> None:
    """Raise SpecError unless a predictor's ``sigma`` is True, False or ``"relative"``."""
    if not isinstance(sigma, bool) and sigma != "relative":
        raise SpecError(f"`sigma={sigma}` of {name} must be true, false or relative.")


def relative_to_scene(observation: Observation) -> np.ndarray:
    """[A, 8] the third feature divided by its mean over the agents and steps of the scene, where that is not zero."""
    feature = observation.history[:, :, 2].astype(np.float64)
    sizes = np.diff(observation.scene)
    mean = np.bincount(observation.scene_index, feature.mean(axis=1), observation.scenes) / np.maximum(sizes, 1)
    return feature / np.repeat(np.where(mean == 0, 1, mean), sizes)[:, None]
