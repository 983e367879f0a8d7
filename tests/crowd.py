"""A small domain of a crowd, and random actions."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from motion_gym.contract import Recording
from motion_gym.data.domains import RecordedDomain
from motion_gym.stepping.pettingzoo_env import ForecastEnv

SPELLS = {2: [(0, 45)], 5: [(3, 24), (28, 40)], 7: [(5, 12)], 9: [(0, 20), (21, 45)], 4: [(30, 38)]}
"""Frames from .. to of each agent: one stays, two are lost and found again, one leaves too soon, one enters late."""


class Crowd(RecordedDomain):
    """A small crowd with all events of a stream."""

    name = "crowd"

    def recordings(self, split):
        if split != "test":
            return []
        rows = sorted((f, a) for a, spells in SPELLS.items() for begin, end in spells for f in range(begin, end))
        frame, agent = np.array(rows).T
        xy = np.random.default_rng(0).normal(size=(len(rows), 2)).cumsum(axis=0)
        return [Recording(frame, agent, xy, self.dt)]


CLOCKS = ("windows", "stream")
clocks = pytest.mark.parametrize("clock", CLOCKS)


def random_actions(env: ForecastEnv, rng: np.random.Generator) -> dict[str, np.ndarray]:
    return {name: rng.normal(0, 5, (env.samples, 12, 2)).astype(np.float32) for name in env.agents}


def episode(env: ForecastEnv, seed: int = 0, spoil=None) -> list[tuple]:
    """Copies of all return values of an episode of random actions; ``spoil`` gets the originals."""
    rng, outcome, actions, tape = np.random.default_rng(seed), env.reset(), {}, []
    while True:
        tape.append(pickle.loads(pickle.dumps(outcome)) if spoil else outcome)
        if spoil:
            spoil((*outcome, actions))
        if not env.agents:
            return tape
        actions = random_actions(env, rng)
        outcome = env.step(actions)


def assert_same(one, other) -> None:
    assert data_equivalence(one, other, exact=True)
