"""The rules of predict: good predictors are accepted, and the report names the rule of every planted fault."""

import itertools
import random
import zlib

import numpy as np
import pytest

from motion_gym.checks import checker as checks
from motion_gym.contract import Forecast, PredictorError


def walk(observation, samples=1):
    """Constant velocity, a new array [A, samples, 12, 2]."""
    xy = observation.xy
    ahead = np.arange(1, 13, dtype=np.float32)[:, None]
    one = xy[:, -1, None] + ahead * (xy[:, -1] - xy[:, -2])[:, None]
    return np.repeat(one[:, None], samples, axis=1)


def noisy(observation, samples, rng):
    return walk(observation, samples) + rng.normal(0, 0.1, (len(observation), samples, 12, 2)).astype(np.float32)


class Good:
    """Deterministic, nothing optional."""

    def predict(self, observation, samples=1, seed=0):
        return walk(observation)


class GoodNoise:
    """Stochastic, with other noise for each seed and each scene."""

    def predict(self, observation, samples=1, seed=0):
        paths = walk(observation, samples)
        for first, last in itertools.pairwise(observation.scene):
            rng = np.random.default_rng([seed, zlib.crc32(observation.xy[first:last].tobytes())])
            paths[first:last] += rng.normal(0, 0.1, (last - first, samples, 12, 2))
        return Forecast(paths)


class GoodModes:
    """Fixed modes, with weights."""

    def predict(self, observation, samples=1, seed=0):
        spread = np.linspace(-1, 1, samples, dtype=np.float32)[:, None, None] if samples > 1 else 0
        return Forecast(walk(observation, samples) + spread, np.ones((len(observation), samples)))


class GoodPairs(Good):
    """Takes scenes of two agents with a third feature."""

    def predict(self, observation, samples=1, seed=0):
        if (np.diff(observation.scene) != 2).any() or observation.history.shape[2] != 3:
            raise PredictorError("needs pairs with sigma")
        return walk(observation)


class GoodCache(Good):
    """Caches answers without changing them."""

    def __init__(self):
        self.cache, self.shape = {}, None

    def predict(self, observation, samples=1, seed=0):
        self.shape = self.shape or 12
        key = observation.history.tobytes()
        self.cache.setdefault(key, walk(observation))
        return self.cache[key].copy()


GOOD = [Good, GoodNoise, GoodModes, GoodPairs, GoodCache]
BAD: dict[str, list[type]] = {}


def breaks(rule):
    def add(kind):
        BAD.setdefault(rule, []).append(kind)
        return kind

    return add


@breaks("predict")
class Narrow:
    def predict(self, observation):
        return walk(observation)


@breaks("predict")
class NoMethod:
    pass


@breaks("predict")
class Crash:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation)[observation.scene]


@breaks("predict")
class OneSampleOnly:
    def predict(self, observation, samples=1, seed=0):
        if samples > 1:
            raise NotImplementedError
        return walk(observation)


@breaks("predict")
class NoCrowds:
    def predict(self, observation, samples=1, seed=0):
        raise PredictorError("needs a map")


@breaks("forecast")
class NoSampleAxis:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation)[:, 0]


@breaks("forecast")
class WholeNumbers:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation).astype(int)


@breaks("forecast")
class WrongSamples:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation, 3)


@breaks("forecast")
class NaNWhereStill:
    def predict(self, observation, samples=1, seed=0):
        step = observation.xy[:, -1] - observation.xy[:, -2]
        with np.errstate(invalid="ignore"):
            return walk(observation) + 0 * (step / np.hypot(*step.T)[:, None])[:, None, None]


@breaks("pure")
class Entropy:
    def predict(self, observation, samples=1, seed=0):
        return noisy(observation, samples, np.random.default_rng())


@breaks("pure")
class Learns:
    def __init__(self):
        self.style = np.zeros(2, np.float32)

    def predict(self, observation, samples=1, seed=0):
        answer = walk(observation) + self.style
        self.style = self.style + 1
        return answer


@breaks("pure")
class RemembersTheLastScenes:
    last = 0

    def predict(self, observation, samples=1, seed=0):
        answer = walk(observation) + np.float32(self.last)
        self.last = observation.history[0, 0, 0] if len(observation) else 5
        return answer


@breaks("state")
class Counts(Good):
    def __init__(self):
        self.calls = 0

    def predict(self, observation, samples=1, seed=0):
        self.calls += 1
        return walk(observation)


@breaks("state")
class StoresTheInput:
    def __init__(self):
        self.buffer = np.zeros(3)

    def predict(self, observation, samples=1, seed=0):
        self.buffer[0] += len(observation)
        return walk(observation)


@breaks("input")
class Centres:
    def predict(self, observation, samples=1, seed=0):
        last = observation.xy[:, -1:].copy()
        observation.history[..., :2] -= last
        return walk(observation) + last[:, None]


@breaks("buffer")
class OneBuffer:
    def __init__(self):
        self._buffers = {}

    def predict(self, observation, samples=1, seed=0):
        buffer = self._buffers.setdefault(len(observation), np.zeros((len(observation), 1, 12, 2), np.float32))
        buffer[:] = walk(observation) + seed
        return buffer

    def __getstate__(self):
        return {"_buffers": {}}


@breaks("randomness")
class GlobalNumpy:
    def predict(self, observation, samples=1, seed=0):
        return noisy(observation, samples, np.random)


@breaks("randomness")
class SeedsNumpy:
    def predict(self, observation, samples=1, seed=0):
        np.random.seed(seed)  # noqa: NPY002
        return noisy(observation, samples, np.random)


@breaks("randomness")
class GlobalRandom:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + np.float32(random.random())


@breaks("seed")
class IgnoresTheSeed:
    def predict(self, observation, samples=1, seed=0):
        return noisy(observation, samples, np.random.default_rng(0))


@breaks("noise")
class SameNoiseForEveryScene:
    def predict(self, observation, samples=1, seed=0):
        return noisy(observation, samples, np.random.default_rng(seed))


@breaks("noise")
class SameNoiseBySpeed:
    """Each agent's noise grows with its speed."""

    def predict(self, observation, samples=1, seed=0):
        mean = walk(observation, samples)
        speed = np.linalg.norm(observation.xy[:, -1] - observation.xy[:, 0], axis=-1)[:, None, None, None]
        return mean + (0.1 + speed) * (noisy(observation, samples, np.random.default_rng(seed)) - mean)


@breaks("place")
class ForgetsTheCentre:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) - observation.xy[:, None, -1:]


@breaks("scenes")
class Pools:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + np.tanh(observation.xy.mean()) / 100


@breaks("scenes")
class PoolsAndDraws:
    def predict(self, observation, samples=1, seed=0):
        return GoodNoise().predict(observation, samples, seed).positions + np.tanh(observation.xy.mean()) / 100


@breaks("scenes")
class CountsTheBatch:
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + np.float32(len(observation))


@breaks("attributes")
class Attributes(Good):
    selection = 3


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("instance", [False, True])
def test_good_predictors_are_accepted(kind, instance):
    checks.check_predictor(kind() if instance else kind)


@pytest.mark.parametrize(("rule", "kind"), [(rule, kind) for rule, kinds in BAD.items() for kind in kinds])
def test_a_broken_rule_is_named_and_no_other(rule, kind):
    assert [problem.rule for problem in checks.run_checks(kind, "predictor").problems] == [rule]


def test_every_rule_of_predict_has_a_planted_fault():
    rules = {"predict", "forecast", "pure", "state", "input", "buffer", "randomness", "seed", "noise", "place"}
    assert set(BAD) == rules | {"scenes", "attributes"}


def test_global_generators_are_left_as_they_were():
    before = random.getstate(), repr(np.random.get_state())  # noqa: NPY002
    for kind in (GlobalNumpy, GlobalRandom, SeedsNumpy):
        checks.run_checks(kind, "predictor")
    assert (random.getstate(), repr(np.random.get_state())) == before  # noqa: NPY002
