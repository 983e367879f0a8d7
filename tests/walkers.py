"""A scene of agents who walk at random velocities."""

import numpy as np

from motion_gym.contract import Observation


def crowd(agents=5, seed=0):
    rng = np.random.default_rng(seed)
    at, velocity = rng.normal(0, 3, (agents, 1, 2)), rng.normal(0, 1, (agents, 1, 2))
    steps = np.arange(8)[:, None] * 0.4
    history = at + velocity * steps + rng.normal(0, 0.01, (agents, 8, 2))
    return Observation(history.astype(np.float32), np.array([0, agents]), np.arange(agents), 0.4)
