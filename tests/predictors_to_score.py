"""Domains and predictors for tests of scores."""

from __future__ import annotations

from typing import Any

import numpy as np

import motion_gym
from motion_gym.contract import Forecast
from tests.crowd_with_sigma import CrowdWithSigma

make: Any = motion_gym.domain

ROUNDING = 1e-4
"""Metres. Arrays ask for all windows in one matrix product, the environment for one window at a time, and a processor
chooses the order of additions by the shape. float32 of some metres keeps 1e-6; 20 recurrent steps make 3e-5 of it."""
CROWD = CrowdWithSigma(d=0.6, agents=3, scenes=12)
PAIRS = make("orca", d=0.6, scenes=150)


class Noisy:
    """Draws around the last position, for every agent from its history, independently of the batch."""

    selection = "no weights"

    def predict(self, observation, samples=1, seed=0):
        last = observation.xy[:, None, -1:]
        noise = [np.random.default_rng([seed, int(a)]).normal(size=(samples, 12, 2)) for a in observation.agent]
        return (last + np.array(noise)).astype(np.float32)


class Weighted(Noisy):
    """The most likely sample is not the first."""

    def predict(self, observation, samples=1, seed=0):
        positions = super().predict(observation, samples, seed)
        weights = np.tile(np.arange(1, samples + 1, dtype=np.float32), (len(positions), 1))
        return Forecast(positions, weights)


class Log:
    """Calls of a predictor; its copies write into the same log."""

    def __init__(self):
        self.scenes, self.resets = [], 0

    def __deepcopy__(self, memo):
        return self


class Counts:
    """Stores observed futures, and forecasts them."""

    def __init__(self, log=None):
        self.log = log or Log()
        self.future = []

    def reset(self):
        self.log.resets += 1
        self.future = []

    def observe(self, truth):
        self.log.scenes.append(truth.observation.scenes)
        self.future.append(truth.future)

    def predict(self, observation, samples=1, seed=0):
        if self.future and len(self.future[-1]) == len(observation):
            return self.future[-1][:, None]  # what a leak is good for
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)
