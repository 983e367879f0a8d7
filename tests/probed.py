"""A domain and a predictor for the leak probe, and assertions about its reports."""

import numpy as np
import pytest

from motion_gym.contract import Forecast, Recording
from motion_gym.data.domains import RecordedDomain
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.stepping.pettingzoo_env import CLOCKS

PLAIN = "constant_velocity"
clocks = pytest.mark.parametrize("clock", CLOCKS)


class Street(RecordedDomain):
    """People who come and go along a street, turning as they like; ids in no order of time."""

    name = "street"
    splits = ("test", "reference")

    def recordings(self, split):
        self.check_split(split)
        rng = np.random.default_rng(self.splits.index(split))
        rows = []
        for agent, start in zip(rng.permutation(30), np.sort(rng.integers(0, 90, 30)), strict=True):
            length = rng.integers(12, 40)
            xy = rng.normal(0, 5, 2) + np.cumsum(rng.normal(0.3, 0.3, (length, 2)), axis=0)
            frame = 10 * (start + np.arange(length))
            rows.append(np.column_stack([frame, np.full(length, 2 * agent + 1), xy]))
        rows = np.concatenate(rows)
        rows = rows[np.lexsort((rows[:, 1], rows[:, 0]))]
        return [Recording(rows[:, 0].astype(int), rows[:, 1].astype(int), rows[:, 2:], self.dt, split)]


def assert_nothing_leaks(report):
    assert report.ok, str(report)
    assert not report.unprobed, str(report)
    assert min(report.checked[kind] for kind in ("histories", "forecasts", "rewards", "revealed truths", "states")) > 0


def only_leak(report):
    """The only leak of a report, which ``str`` of the report names."""
    assert len(report.leaks) == 1, str(report)
    assert not report.ok and f"LEAK: {report.leaks[0]}" in str(report)
    return report.leaks[0]


# Leaks of a predictor.


class Recalls(ConstantVelocity):
    """Honest: adds the mean error of the observed truths."""

    def __init__(self):
        super().__init__()
        self.reset()

    def reset(self):
        self.errors = []

    def observe(self, truth):
        self.errors.append(float((truth.future - truth.observation.xy[:, -1:])[truth.known].mean()))

    def predict(self, observation, samples=1, seed=0):
        shift = np.mean(self.errors) if self.errors else 0.0
        return Forecast((super().predict(observation).positions + shift).astype(np.float32))
