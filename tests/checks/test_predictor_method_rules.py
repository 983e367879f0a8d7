"""The rules of optional methods, copies and oracles, each with predictors that break only this rule."""

import copy
import random

import numpy as np
import pytest

from motion_gym.checks import checker as checks
from motion_gym.contract import PredictorError
from motion_gym.stepping.snapshot import snapshot


def walk(observation, samples=1):
    """Constant velocity, a new array [A, samples, 12, 2]."""
    xy = observation.xy
    ahead = np.arange(1, 13, dtype=np.float32)[:, None]
    one = xy[:, -1, None] + ahead * (xy[:, -1] - xy[:, -2])[:, None]
    return np.repeat(one[:, None], samples, axis=1)


class Good:
    """Deterministic, nothing optional."""

    def predict(self, observation, samples=1, seed=0):
        return walk(observation)


class GoodAll:
    """Is fitted, observes, resets, saves and loads."""

    name, selection = "good", "none"
    noise = 0.0

    def __init__(self):
        self.weight, self.style = None, np.zeros(2, np.float32)

    @property
    def fitted(self):
        return self.weight is not None

    def fit(self, train, validation=(), seed=0):
        drift = [np.diff(t.future, axis=1).mean() for t in train]
        self.weight = np.float32(np.mean(drift) + 0.1 * np.random.default_rng(seed).random())
        return self

    def predict(self, observation, samples=1, seed=0):
        if not self.fitted:
            raise PredictorError("not fitted: call fit")
        return walk(observation) + self.weight + self.style

    def observe(self, truth):
        self.style = self.style + truth.future[truth.known].mean(axis=0)

    def reset(self):
        self.style = np.zeros(2, np.float32)

    def save(self, path):
        with open(path, "wb") as file:
            np.save(file, self.weight)

    def load(self, path):
        self.weight = np.load(path)


class GoodOracle(Good):
    """Forecasts nothing before it knows the domain."""

    domain = None

    def know(self, domain):
        self.domain = domain

    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + np.float32(self.domain.card.dt)


GOOD = [GoodAll, GoodOracle]
BAD: dict[str, list[type]] = {}


def breaks(rule):
    def add(kind):
        BAD.setdefault(rule, []).append(kind)
        return kind

    return add


@breaks("input")
class SpoilsTruth(GoodAll):
    def observe(self, truth):
        super().observe(truth)
        truth.future[:] = 0


@breaks("input")
class SpoilsTraining(GoodAll):
    def fit(self, train, validation=(), seed=0):
        super().fit(train, validation, seed)
        train[1].observation.history[:] = 0
        return self


@breaks("observe")
class AllKnownOnly(GoodAll):
    def observe(self, truth):
        if not truth.known.all():
            raise ValueError("incomplete")


@breaks("observe")
class ObservesTwoThings(GoodAll):
    def observe(self, truth, place):
        pass


@breaks("pure")
class DriftsAfterObserving(GoodAll):
    seen = 0

    def observe(self, truth):
        self.seen = 1

    def reset(self):
        self.seen = 0

    def predict(self, observation, samples=1, seed=0):
        answer = super().predict(observation) + np.float32(self.seen)
        self.seen *= 2
        return answer


@breaks("reset")
class NoReset(Good):
    def observe(self, truth):
        pass


@breaks("reset")
class Forgetful(GoodAll):
    def reset(self):
        pass


@breaks("reset")
class CannotReset(GoodAll):
    def reset(self):
        raise RuntimeError("no")


@breaks("fit")
class FitsAtRandom(GoodAll):
    def fit(self, train, validation=(), seed=0):
        self.weight = np.float32(random.random())


@breaks("fit")
class FitsOn(GoodAll):
    def fit(self, train, validation=(), seed=0):
        self.weight = np.float32(1) if self.weight is None else self.weight + 1


@breaks("fit")
class FitsAnother(GoodAll):
    def fit(self, train, validation=(), seed=0):
        super().fit(train)
        return copy.deepcopy(self)


@breaks("fit")
class StaysUnfitted(GoodAll):
    fitted = False

    def predict(self, observation, samples=1, seed=0):
        if self.weight is None:
            raise PredictorError("not fitted")
        return walk(observation) + self.weight + self.style


@breaks("fit")
class CannotFit(GoodAll):
    def fit(self, train, validation=(), seed=0):
        raise KeyError("x")


@breaks("unfitted")
class Nonsense(GoodAll):
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + (self.weight or np.float32(0)) + self.style


@breaks("unfitted")
class NumpySaysSo(GoodAll):
    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + self.weight + self.style


@breaks("save")
class SavesOnly(Good):
    def save(self, path):
        pass


@breaks("save")
class SavesHalf(GoodAll):
    def load(self, path):
        self.weight = np.float32(0)


@breaks("save")
class CannotLoad(GoodAll):
    def load(self, path):
        raise OSError("lost")


@breaks("pickle")
class NotPickled(Good):
    def __reduce__(self):
        raise TypeError("cannot pickle this")

    def __deepcopy__(self, memo):
        return NotPickled()


@breaks("pickle")
class PicklesHalf(Good):
    def __init__(self, weight=1.0):
        self.weight = np.float32(weight)

    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + self.weight

    def __reduce__(self):
        return PicklesHalf, (2.0,)

    def __deepcopy__(self, memo):
        return PicklesHalf(self.weight)


@breaks("copy")
class SharesWeights(Good):
    def __init__(self, weight=None):
        self.weight = np.ones(2, np.float32) if weight is None else weight

    def __deepcopy__(self, memo):
        return SharesWeights(self.weight)


@breaks("copy")
class NotCopied(Good):
    def __deepcopy__(self, memo):
        raise TypeError("only one of me")

    def __reduce__(self):
        return NotCopied, ()


@breaks("copy")
class SharesAStyle:
    """A copy shares a dict with the original, so observations of one change the other."""

    def __init__(self, style=None):
        self.style = {"code": 0.0} if style is None else style

    def predict(self, observation, samples=1, seed=0):
        return walk(observation) + np.float32(self.style["code"])

    def observe(self, truth):
        self.style["code"] = 1.0

    def reset(self):
        self.style["code"] = 0.0

    def __deepcopy__(self, memo):
        return SharesAStyle(self.style)


@pytest.mark.parametrize("kind", GOOD)
@pytest.mark.parametrize("instance", [False, True])
def test_good_predictors_are_accepted(kind, instance):
    checks.check_predictor(kind() if instance else kind)


@pytest.mark.parametrize(("rule", "kind"), [(rule, kind) for rule, kinds in BAD.items() for kind in kinds])
def test_a_broken_rule_is_named_and_no_other(rule, kind):
    assert [problem.rule for problem in checks.run_checks(kind, "predictor").problems] == [rule]


def test_every_rule_beyond_predict_has_a_planted_fault():
    rules = set(checks.PREDICTOR_RULES) - {"predict", "forecast", "state", "buffer", "randomness", "seed", "noise"}
    assert set(BAD) == rules - {"attributes", "place", "scenes"}


@pytest.mark.parametrize("kind", [GoodAll, FitsOn, Forgetful])
def test_an_instance_is_not_changed(kind):
    predictor = kind()
    before = snapshot(predictor)
    checks.run_checks(predictor, "predictor")
    assert snapshot(predictor) == before


def test_a_fitted_instance_is_not_fitted_again():
    predictor = FitsOn()
    predictor.fit([])
    checks.check_predictor(predictor)


def test_an_oracle_is_held_to_the_rules_on_its_domain():
    class Drifts(GoodOracle):
        def predict(self, observation, samples=1, seed=0):
            return super().predict(observation) + np.random.default_rng().random()

    rules = [problem.rule for problem in checks.run_checks(Drifts, "predictor", domain="orca:scenes=16").problems]
    assert "pure" in rules
    assert "pure" not in [problem.rule for problem in checks.run_checks(Drifts, "predictor").problems]
