"""The leak probe finds every planted leak of a predictor."""

import numpy as np

from motion_gym.checks.leaks import leak_probe
from motion_gym.contract import FUTURE, Forecast
from motion_gym.predictors.constant_velocity import ConstantVelocity
from tests.probed import Recalls, Street, assert_nothing_leaks, clocks, only_leak


@clocks
def test_an_honest_learner_passes(clock):
    report = leak_probe(Recalls(), Street(), clock=clock)
    assert_nothing_leaks(report)
    assert (report.checked["states"] > len(report.cuts)) == (clock == "stream")


class Peeks(ConstantVelocity):
    """Adds the last x of the whole split, which it reads from the domain that it holds."""

    def __init__(self, domain=None):
        super().__init__()
        self.domain = domain

    def predict(self, observation, samples=1, seed=0):
        last = self.domain.windows("test").future[-1, -1, 0]
        return Forecast(super().predict(observation).positions + last)


class Foresees(Peeks):
    def know(self, domain):
        self.domain = domain


@clocks
def test_a_predictor_that_looks_into_the_domain_is_found(clock):
    street = Street()
    assert "forecasts" in only_leak(leak_probe(Peeks(street), street, clock=clock))


@clocks
def test_an_oracle_may_look_into_the_domain(clock):
    report = leak_probe(Foresees(), Street(), clock=clock)
    assert_nothing_leaks(report)
    assert any("forecasts" in sentence for sentence in report.oracles)


def test_weights_from_the_future_are_found():
    class Weighs(Peeks):
        def predict(self, observation, samples=1, seed=0):
            positions = np.repeat(ConstantVelocity.predict(self, observation).positions, samples, axis=1)
            weights = np.ones(positions.shape[:2])
            weights[:, 0] += abs(self.domain.windows("test").future[-1, -1, 0])
            return Forecast(positions, weights)

    street = Street()
    assert "weights" in only_leak(leak_probe(Weighs(street), street))


def test_learning_from_the_domain_is_found():
    class Learns(Peeks, Recalls):
        def predict(self, observation, samples=1, seed=0):
            return ConstantVelocity.predict(self, observation)

        def observe(self, truth):
            self.errors = [self.domain.windows("test").future.mean()]

    street, learner = Street(), Learns()
    learner.domain = street
    learner.reset()
    leak = only_leak(leak_probe(learner, street))
    assert "what the predictor holds (errors[0])" in leak and "not shown" in leak


def test_keeping_truth_over_a_reset_is_found():
    class Remembers(Recalls):
        def reset(self):
            self.errors = getattr(self, "errors", [0.0, 0.0])[-2:]

    report = leak_probe(Remembers(), Street())
    assert any("reset() does not forget" in leak for leak in report.leaks), str(report)
    assert any("forecasts" in leak for leak in report.leaks), str(report)


@clocks
def test_hidden_randomness_is_found_and_the_programs_is_left_alone(clock):
    class Wavers(ConstantVelocity):
        def predict(self, observation, samples=1, seed=0):
            noise = np.random.normal(size=(len(observation), samples, FUTURE, 2))  # noqa: NPY002
            return Forecast((super().predict(observation).positions + noise).astype(np.float32))

    before = np.random.get_state()[1].copy()  # noqa: NPY002
    leaks = leak_probe(Wavers(), Street(), clock=clock).leaks
    assert any("asked twice" in leak for leak in leaks) and any("forecasts" in leak for leak in leaks)
    np.testing.assert_array_equal(np.random.get_state()[1], before)  # noqa: NPY002


def test_a_predictor_that_draws_from_its_seed_passes():
    class Samples(ConstantVelocity):
        def predict(self, observation, samples=1, seed=0):
            noise = np.random.default_rng(seed).normal(size=(len(observation), samples, FUTURE, 2))
            return Forecast((super().predict(observation).positions + noise).astype(np.float32))

    assert_nothing_leaks(leak_probe(Samples(), Street()))


def test_learning_in_predict_is_found():
    class Counts(ConstantVelocity):
        def reset(self):
            self.asked = 0

        def predict(self, observation, samples=1, seed=0):
            self.asked += 1
            return super().predict(observation)

    assert "changed what it holds: asked" in leak_probe(Counts(), Street()).leaks[0]
