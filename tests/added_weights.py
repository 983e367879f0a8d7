"""Weights that do not come with the package."""

import pytest

from motion_gym import catalog
from motion_gym.training import added_weights


def lacks_weights(spec: str) -> bool:
    """Whether a predictor, or the one that it is put around, has weights that must be added and were not."""
    name, parameters = catalog.parse_spec(spec)
    name = parameters.get("of", name)
    added = any(file.endswith(f"/{name}.safetensors") for file in added_weights.left_out())
    return added and not catalog.predictor(name).fitted  # type: ignore[attr-defined]


def needs_weights(name: str) -> None:
    """Skip a test of a predictor whose weights must be added and were not."""
    if lacks_weights(name):
        pytest.skip(f"the weights of {name} are not here: motion-gym weights add --from DIR")
