"""The leak probe: nothing in the tables leaks, and every planted leak is found where it arises."""

import copy
import dataclasses

import numpy as np
import pytest

from motion_gym import catalog
from motion_gym.checks.leaks import leak_probe
from motion_gym.contract import FUTURE, Forecast, Recording, SpecError
from motion_gym.data.domains import RecordedDomain
from motion_gym.envs.orca import Orca
from motion_gym.predictors.constant_velocity import ConstantVelocity
from motion_gym.predictors.linear import Linear
from motion_gym.stepping.pettingzoo_env import CLOCKS
from motion_gym.stepping.stream_clock import StreamClock
from tests.crowd_with_sigma import CrowdWithSigma

SMALL = {"orca": {"scenes": 40}}
ORACLES = [name for name, entry in catalog.PREDICTORS.items() if entry.summary.startswith("oracle")]
PLAIN = "constant_velocity"
clocks = pytest.mark.parametrize("clock", CLOCKS)


@pytest.fixture
def data(request):
    """Skip a place whose recordings are not on this computer."""
    if not request.node.callspec.params["domain"].startswith("orca"):
        request.getfixturevalue("eth_ucy")


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
    """The one leak of a report, and that the report says it."""
    assert len(report.leaks) == 1, str(report)
    assert not report.ok and f"LEAK: {report.leaks[0]}" in str(report)
    return report.leaks[0]


# What is in the tables.


@clocks
@pytest.mark.parametrize("domain", catalog.DOMAINS)
def test_no_domain_leaks(domain, clock, data):
    report = leak_probe(PLAIN, domain, clock=clock, cuts=2, **SMALL.get(domain, {}))
    assert_nothing_leaks(report)
    assert not report.side_channels and len(report.cuts) == 2
    assert bool(report.selections) == (clock == "windows")


@clocks
@pytest.mark.parametrize("predictor", [name for name in catalog.PREDICTORS if name not in ORACLES])
def test_no_predictor_leaks(predictor, clock):
    report = leak_probe(predictor, CrowdWithSigma(scenes=40 if clock == "windows" else 12), clock=clock)
    assert_nothing_leaks(report)
    assert not report.oracles


@pytest.mark.parametrize("predictor", ORACLES)
def test_an_oracle_is_named_and_does_not_look_ahead(predictor):
    report = leak_probe(predictor, "orca", clock="windows", cuts=1, scenes=10)
    assert_nothing_leaks(report)
    assert len(report.oracles) == 1 and "is told" in report.oracles[0]


@clocks
@pytest.mark.parametrize("domain", ["eth"])
@pytest.mark.parametrize("sigma", ["paper", "past"])
def test_sigma_reads_the_future_only_where_declared(domain, sigma, clock, data):
    place = catalog.domain(domain, alpha=8, sigma=sigma)
    predictor = Linear(sigma=True).fit([place.windows("train")])
    report = leak_probe(predictor, place, clock=clock)
    assert_nothing_leaks(report)
    assert list(report.side_channels) == (["sigma"] if sigma == "paper" else [])
    assert ("side channel: sigma" in str(report)) == (sigma == "paper")


@pytest.mark.parametrize("domain", ["eth:reference_share=0.3", "univ:reference_share=0.5"])
def test_no_leak_where_reference_scenes_are_cut_off(domain, data):
    assert_nothing_leaks(leak_probe(Recalls(), domain, clock="windows", cuts=1))


# Leaks of a domain.


class Declared(Street):
    side_channel_names = ("hint",)

    def side_channels(self, positions, known):
        return np.repeat(positions[:, -1:, :1] * known[:, -1:, None], 8, axis=1)


class Undeclared(Declared):
    @property
    def card(self):
        return dataclasses.replace(super().card, side_channels=())


class Stored(Street):
    """Its feature is read from a store of its own, by the order of agents or by the nearest position."""

    feature_names = ("speed",)

    def __init__(self, by="order"):
        self.by = by

    def features(self, history):
        track = Street.recordings(self, "test")[0].xy
        if self.by == "order":
            rows = np.arange(len(history)) % len(track)
        else:
            rows = np.abs(track[None] - history[:, -1:]).sum(axis=2).argmin(axis=1)
        return np.repeat(track[(rows + 12) % len(track), :1][:, None], 8, axis=1)


@clocks
def test_a_declared_side_channel_is_listed(clock):
    report = leak_probe(PLAIN, Declared(), clock=clock)
    assert_nothing_leaks(report)
    assert list(report.side_channels) == ["hint"] and report.side_channels["hint"] > 0.1


@clocks
def test_an_undeclared_feature_from_the_future_is_found(clock):
    leak = only_leak(leak_probe(PLAIN, Undeclared(), clock=clock))
    assert "histories" in leak and "feature hint" in leak


@pytest.mark.parametrize("by", ["order", "nearest"])
def test_features_from_a_store_of_the_domain_are_found(by):
    assert "features(history)" in only_leak(leak_probe(PLAIN, Stored(by), cuts=1))


def test_features_from_the_observed_steps_pass():
    class Speed(Stored):
        def features(self, history):
            speed = np.zeros(history.shape[:2])
            speed[:, 1:] = np.linalg.norm(np.diff(history, axis=1), axis=2)
            return speed[..., None]

    class Constant(Stored):
        def features(self, history):
            return np.ones((*history.shape[:2], 1))

    for domain in (Speed(), Constant()):
        assert_nothing_leaks(leak_probe(PLAIN, domain, cuts=1))


def test_numbers_that_count_those_to_come_are_found(monkeypatch):
    make = StreamClock.__init__

    def by_id(self, *arguments):
        make(self, *arguments)
        rows = np.flatnonzero(self._identity >= 0)
        self._identity[rows] = np.unique(self.tracks.track[rows], return_inverse=True)[1]

    monkeypatch.setattr(StreamClock, "__init__", by_id)
    assert "who is observed" in only_leak(leak_probe(PLAIN, Street()))


# Leaks of a clock.


def test_a_reward_from_the_future_is_found(monkeypatch):
    step = StreamClock.step

    def early(self, forecast):
        rows = self._rows[self.time]
        ahead = np.where(self.tracks.left[rows] >= 3, self.tracks.xy[(rows + 3) % len(self.tracks.xy), 0], 0)
        revealed = step(self, forecast)
        return dataclasses.replace(revealed, reward=revealed.reward + ahead)

    monkeypatch.setattr(StreamClock, "step", early)
    assert "rewards" in only_leak(leak_probe(PLAIN, Street()))


def test_truth_before_its_time_is_found(monkeypatch):
    settle = StreamClock._settle
    monkeypatch.setattr(StreamClock, "_settle", lambda self, after: settle(self, after + 3))
    assert any("revealed truths" in leak for leak in leak_probe(PLAIN, Street()).leaks)


# Leaks of a predictor.


class Recalls(ConstantVelocity):
    """Honest: adds the mean last error of those it has seen."""

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


# The probe itself.


def test_a_domain_that_keeps_its_recordings_is_probed_and_stays_as_it_was():
    class Keeps(Undeclared):
        def __init__(self):
            self._store = {}

        def recordings(self, split):
            return self._store.setdefault(split, super().recordings(split))

        @property
        def parameters(self):
            return {}

    keeps = Keeps()
    before, held = keeps.windows("test"), keeps.recordings("test")
    report = leak_probe(PLAIN, keeps)
    assert report.changed == "Keeps.recordings" and "histories" in only_leak(report)
    assert keeps.windows("test") is before and keeps.recordings("test") is held


def test_the_order_of_earlier_versions_works_and_warns():
    street = Street()
    new = leak_probe(Recalls(), street)
    for arguments in ((street, Recalls()), (street,)):
        with pytest.warns(DeprecationWarning, match=r"leak_probe\(predictor, domain\)"):
            old = leak_probe(*arguments)
        assert old.domain == new.domain and old.ok
    assert leak_probe(predictor=Recalls(), domain=street) == new
    with pytest.raises(SpecError, match="needs a domain"):
        leak_probe("linear")


def test_nothing_that_is_given_is_changed():
    domain, predictor = Orca(scenes=20), Recalls()
    predictor.errors = [1.0]
    domain.windows("test")
    held, cached = copy.deepcopy(predictor.errors), domain.windows("test")
    leak_probe(predictor, domain)
    assert type(domain) is Orca and domain.windows("test") is cached
    assert predictor.errors == held


def test_the_same_seed_gives_the_same_report():
    assert leak_probe(PLAIN, Undeclared(), seed=4) == leak_probe(PLAIN, Undeclared(), seed=4)
    assert leak_probe(PLAIN, Undeclared(), seed=4).cuts != leak_probe(PLAIN, Undeclared(), seed=5).cuts


@pytest.mark.parametrize(
    ("arguments", "message"),
    [({"clock": "steam"}, "Did you mean `stream`"), ({"cuts": 0}, "cuts=0"), ({"split": "tset"}, "`test`")],
)
def test_misspelt_options_are_explained(arguments, message):
    with pytest.raises(SpecError, match=message):
        leak_probe(PLAIN, Street(), **arguments)
