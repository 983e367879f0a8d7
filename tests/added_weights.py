"""Weights that do not come with the package."""

import pytest

from motion_gym import catalog
from motion_gym.training import added_weights


def needs_weights(name: str) -> None:
    """Skip a test of a predictor whose weights must be added and were not."""
    added = any(file.endswith(f"/{name}.safetensors") for file in added_weights.left_out())
    if added and not catalog.predictor(name).fitted:  # type: ignore[attr-defined]
        pytest.skip(f"the weights of {name} are not here: motion-gym weights add --from DIR")
