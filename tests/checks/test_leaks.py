"""The leak probe: shipped domains and predictors do not leak, and every planted leak of a domain is found."""

import copy
import dataclasses

import numpy as np
import pytest

from motion_gym import catalog
from motion_gym.checks.leaks import leak_probe
from motion_gym.contract import SpecError
from motion_gym.envs.orca import Orca
from motion_gym.predictors.linear import Linear
from motion_gym.stepping.stream_clock import StreamClock
from tests import traffic
from tests.added_weights import needs_weights
from tests.crowd_with_sigma import CrowdWithSigma
from tests.probed import PLAIN, Recalls, Street, assert_nothing_leaks, clocks, only_leak
from tests.walks import walks_file

SMALL = {
    "orca": {"scenes": 16},
    "walkers": {"scenes": 50},
    "tracks": {"path": walks_file(), "fps": 25},
    "highway": traffic.SMALL,
    "sdd": {"scene": "quad", "form": "clips", "image": True},
}
ORACLES = {"orca_oracle": ("orca", {"scenes": 10}), "idm_oracle": ("highway", traffic.SMALL)}
"""Oracles with the domain that they know, and arguments that keep it small."""


@pytest.fixture
def data(request):
    """Skip a place whose recordings are not on this computer."""
    domain = request.node.callspec.params["domain"]
    if domain == "highway":
        traffic.needs_highway_env()
    elif domain not in ("orca", "walkers"):
        request.getfixturevalue("sdd" if domain == "sdd" else "eth_ucy")


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
    needs_weights(predictor)
    report = leak_probe(predictor, CrowdWithSigma(scenes=16 if clock == "windows" else 5), clock=clock, cuts=2)
    assert_nothing_leaks(report)
    assert not report.oracles


def test_every_oracle_is_probed():
    assert set(ORACLES) == {n for n, entry in catalog.PREDICTORS.items() if entry.summary.startswith("oracle")}


@pytest.mark.parametrize("predictor", ORACLES)
def test_an_oracle_is_named_and_does_not_look_ahead(predictor):
    domain, arguments = ORACLES[predictor]
    if domain == "highway":
        traffic.needs_highway_env()
    report = leak_probe(predictor, domain, clock="windows", cuts=1, **arguments)
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
    """Reads its feature from stored data, by the order of agents or by the nearest position."""

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


def test_ids_that_count_later_agents_are_found(monkeypatch):
    make = StreamClock.__init__

    def by_id(self, *arguments, **keywords):
        make(self, *arguments, **keywords)
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


def test_arguments_are_not_changed():
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
