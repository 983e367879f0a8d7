"""Training data for the tests of training."""

import dataclasses

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.contract import Truth
from motion_gym.data.domains import training_set
from motion_gym.data.windows import pick_scenes


@pytest.fixture(scope="session")
def data():
    """Two environments of crossing agents, with a third feature."""

    def with_feature(truth: Truth, scale: float) -> Truth:
        seen = truth.observation
        speed = np.linalg.norm(np.diff(seen.xy, axis=1, prepend=seen.xy[:, :1]), axis=-1, keepdims=True)
        history = np.concatenate([seen.history, scale * (1 + speed)], axis=2).astype(np.float32)
        return dataclasses.replace(truth, observation=dataclasses.replace(seen, history=history))

    train, validation = training_set(mg.domain("orca", scenes=80))
    return [
        [with_feature(pick_scenes(t, slice(0, 70)), i + 1.0) for i, t in enumerate(part)]
        for part in (train, validation)
    ]
