"""A small domain of groups, and episodes of its Gymnasium environments."""

from __future__ import annotations

import pickle

import numpy as np
from gymnasium.utils.env_checker import data_equivalence

from motion_gym.contract import Recording
from motion_gym.data.domains import RecordedDomain


class Groups(RecordedDomain):
    """Eleven windows of one to three agents."""

    name = "groups"

    def recordings(self, split):
        if split != "test":
            return []
        spells = {0: range(0, 30), 1: range(4, 26), 2: range(5, 27)}
        rows = sorted((f, a) for a, frames in spells.items() for f in frames)
        frame, agent = np.array(rows).T
        xy = np.random.default_rng(0).normal(size=(len(rows), 2)).cumsum(axis=0)
        return [Recording(frame, agent, xy, self.dt)]


WINDOWS, AGENTS = 11, 3


def actions_for(windows, samples: int = 1, agents: int = AGENTS) -> np.ndarray:
    """[..., agents, K, 12, 2] forecasts of the given windows, random but the same each time."""
    drawn = [np.random.default_rng(int(w)).normal(0, 5, (agents, samples, 12, 2)) for w in np.ravel(windows)]
    return np.array(drawn, np.float32).reshape(*np.shape(windows), agents, samples, 12, 2)


def episode(env, spoil: bool = False) -> list[tuple]:
    """Copies of all return values of an episode; with ``spoil``, originals and actions are overwritten."""
    tape, outcome, ended, window = [], env.reset(), False, 0
    while True:
        tape.append(pickle.loads(pickle.dumps(outcome)))
        if spoil:
            for part in (outcome[0], outcome[-1]):
                for value in part.values():
                    if isinstance(value, np.ndarray):
                        value[...] = 1
        if ended:
            return tape
        action = actions_for(window)
        outcome = env.step(action)
        if spoil:
            action[...] = np.nan
        ended, window = outcome[2], window + 1


def assert_same(one, other) -> None:
    assert data_equivalence(one, other, exact=True)


good = np.zeros((AGENTS, 2, 12, 2), np.float32)
BAD = {
    "one step too few": (good[:, :, :11], r"shape \(3, 2, 11, 2\)"),
    "one sample": (good[:, :1], r"shape \(3, 1, 12, 2\)"),
    "one agent too few": (good[:2], r"shape \(2, 2, 12, 2\)"),
    "float16": (good.astype(np.float16), "dtype float16, not a float32"),
    "int": (good.astype(np.int64), "dtype int64"),
    "list": (good.tolist(), "type list"),
    "None": (None, "type NoneType"),
    "NaN": (
        np.where(np.arange(good.size).reshape(good.shape) == 1, np.nan, good).astype(np.float32),
        "row 0 of window 0",
    ),
    "inf": (
        np.where(np.arange(good.size).reshape(good.shape) == 2, np.inf, good).astype(np.float32),
        "row 0 of window 0",
    ),
}
