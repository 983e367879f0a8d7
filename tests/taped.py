"""For tests of online evaluation: a tape of forecasts and observed truths, and comparisons of two runs."""

import copy
import functools
import json

import numpy as np

import motion_gym
from motion_gym.contract import Forecast
from motion_gym.data.windows import pick_scenes


class Tape:
    """Forecasts and observed truths; copies of an adapter write on the same tape."""

    def __init__(self):
        self.forecasts, self.told = [], []

    def __deepcopy__(self, memo):
        return self


class Taped:
    """An adapter that writes its forecasts, and the truths observed before each, on a tape."""

    def __init__(self, inner):
        self.inner, self.tape = inner, Tape()

    def __getattr__(self, name):
        if name.startswith("__") or name in ("inner", "tape"):
            raise AttributeError(name)
        return getattr(self.inner, name)

    def predict(self, observation, samples=1, seed=0):
        forecast = self.inner.predict(observation, samples, seed)
        # The harness may ask twice, to see whether something was learned from being asked.
        if not self.tape.forecasts or not np.array_equal(self.tape.forecasts[-1][0], observation.history):
            positions = np.array(getattr(forecast, "positions", forecast))
            self.tape.forecasts.append((observation.history.copy(), positions))
        return forecast

    def observe(self, truth):
        self.tape.told.append((len(self.tape.forecasts), truth))
        self.inner.observe(truth)


@functools.cache
def fitted_linear():
    """The linear predictor, fitted to a small crowd."""
    scenes = motion_gym.domain("orca:d=0.3,scenes=6").windows("train")
    return motion_gym.predictor("linear").fit([scenes], [scenes], 0)


def scenes_of(clock):
    """Each scene of a stream clock, complete, by the listed frame at which it was observed."""
    clock, scenes = copy.copy(clock), {}
    step = clock.reset()
    while len(step.observation):
        step = clock.step(Forecast(np.zeros((len(step.observation), 1, 12, 2), np.float32)))
        for scene in range(step.settled.truth.observation.scenes if step.settled else 0):
            truth = pick_scenes(step.settled.truth, [scene])
            scenes[int(truth.observation.time[0])] = truth
    return scenes


def alike(card):
    """The values of a card that repeat in an equal run."""
    plain = card.as_dict()
    for key in ("update_seconds", "tick_seconds", "peak_memory"):
        del plain[key]
    return json.dumps(plain), card.values.tobytes(), card.made.tobytes()
