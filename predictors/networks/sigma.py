"""The noise feature sigma as an input of predictors."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import Observation, SpecError


def check_sigma(name: str, value: object) -> bool | str:
    """The value if it is True, False or ``"relative"``; SpecError otherwise."""
    if not isinstance(value, bool) and value != "relative":
        raise SpecError(f"`{name}={value}` must be true, false or relative.")
    return value  # type: ignore[return-value]


def relative_to_scene(observation: Observation) -> np.ndarray:
    """[A, 8] sigma divided by its mean over the agents and steps of the scene; unchanged if the mean is zero."""
    feature = observation.history[:, :, 2].astype(np.float64)
    sizes = np.diff(observation.scene)
    mean = np.bincount(observation.scene_index, feature.mean(axis=1), observation.scenes) / np.maximum(sizes, 1)
    return feature / np.repeat(np.where(mean == 0, 1, mean), sizes)[:, None]
