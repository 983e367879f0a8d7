"""A working folder for each test of the command line, with a user's own classes."""

import sys

import pytest

from motion_gym.cli import output

OWN = '''
import numpy as np
from motion_gym.envs.orca import Orca


class Standing:
    """Nobody moves."""

    selection = "nothing was selected"

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)


class Flat:
    def predict(self, observation, samples=1, seed=0):
        return np.zeros((3, 3))


class Misspelt:
    def predicts(self, observation):
        return None


class Leaky(Orca):
    """Its feature is looked up in all of the recordings, the future included."""

    feature_names = ("later",)

    def features(self, history):
        track = np.concatenate([r.xy for r in Orca.recordings(self, "test")])
        rows = np.abs(track[None] - history[:, -1:]).sum(axis=2).argmin(axis=1)
        return np.repeat(track[(rows + 2) % len(track), :1][:, None], 8, axis=1)


class Broken:
    def windows(self, split):
        return None
'''


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A working folder with a user's own classes; ``main`` puts it on the path."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "own_things.py").write_text(OWN)
    monkeypatch.chdir(work)
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.delitem(sys.modules, "own_things", raising=False)
    return work


@pytest.fixture
def no_data(tmp_path, monkeypatch):
    """An empty data folder."""
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture(autouse=True)
def no_progress_lines(monkeypatch):
    """On a slow machine a command would print its progress, which tests of its output do not expect."""
    monkeypatch.setattr(output, "SECONDS_BETWEEN_LINES", float("inf"))
