"""The rules of domains: the report names the rule of every planted fault, and no other rule."""

import copy
import dataclasses
import sys
import types

import numpy as np
import pytest

from motion_gym.checks import checker as checks
from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import DataError, Recording, SpecError
from motion_gym.data.domains import RecordedDomain


def street(seed, agents=6, steps=30):
    """Recording of people who walk together for a while."""
    rng = np.random.default_rng(seed)
    frame = np.repeat(np.arange(steps), agents)
    xy = rng.uniform(-5, 5, (1, agents, 2)) + np.cumsum(rng.normal(0.3, 0.1, (steps, agents, 2)), axis=0)
    return Recording(frame, np.tile(np.arange(agents), steps), xy.reshape(-1, 2), 0.4, f"street {seed}")


class Street(RecordedDomain):
    """A good domain."""

    name = "street"
    seeds = types.MappingProxyType({"train": 1, "val": 2, "test": 3, "reference": 4})

    def __init__(self, seed: int = 0):
        self.seed = seed

    def recordings(self, split):
        self.check_split(split)
        return [street(10 * self.seed + self.seeds[split])]


def with_card(**changes):
    return property(lambda self: dataclasses.replace(Street.card.fget(self), **changes))


class NoDomain:
    card = None


class ProtocolOnly:
    """Has the members of a domain, but cuts its own windows."""

    card, recordings, world, windows = Street().card, Street().recordings, "own", Street().windows


class OpenFile(Street):
    def __init__(self, seed: int = 0):
        super().__init__(seed)
        self.hook = lambda: None


class HiddenParameter(Street):
    def __init__(self, seed: int = 0, more: int = 0):
        super().__init__(seed + more)
        self.more = more

    parameters = property(lambda self: {"seed": self.seed, "more": 1})


class Thawed(Street):
    """Returns its own arrays."""

    def recordings(self, split):
        self.check_split(split)
        return self.kept(split, lambda: [street(self.seeds[split])])


class Dice(Street):
    def recordings(self, split):
        self.check_split(split)
        return [street(int(np.random.default_rng().integers(1 << 30)))] if split == "val" else super().recordings(split)


class Featured(Street):
    feature_names = ("speed",)

    def features(self, history):
        return np.linalg.norm(np.gradient(history, axis=1), axis=2)[..., None]


def kind(base=Street, **members):
    """A subclass with changed members, which pickle can import."""
    name = f"Planted{len(vars(sys.modules[__name__]))}"
    domain_class = type(name, (base,), {"__module__": __name__, **members})
    globals()[name] = domain_class
    return domain_class


def cut(change, splits=("reference",)):
    """Method ``recordings`` that returns the changed test recording for some splits."""

    def recordings(self, split):
        recording = Street.recordings(self, "test" if split in splits else split)[0]
        return [change(recording) if split in splits else recording]

    return recordings


def a_frame_later(recording):
    keep = recording.frame > 0
    return dataclasses.replace(
        recording, frame=recording.frame[keep], agent=recording.agent[keep], xy=recording.xy[keep]
    )


def renumbered(recording):
    return dataclasses.replace(recording, frame=recording.frame * 10 + 7, agent=recording.agent + 1000)


def open_to_all(self, split):
    return Street.recordings(self, split if split in self.splits else "test")


def bad_recording(self, split):
    self.check_split(split)
    recording = street(1)
    return [dataclasses.replace(recording, frame=recording.frame[::-1])]


def slow(self, split):
    self.check_split(split)
    return [dataclasses.replace(street(self.seeds[split]), dt=0.5)]


def no_val(self, split):
    if split == "val":
        raise RuntimeError("not there")
    return Street.recordings(self, split)


def stored(self, history):
    return np.repeat(np.arange(len(history), dtype=float)[:, None, None], 8, axis=1)


BAD_DOMAINS = {
    "members": [NoDomain, NoDomain(), ProtocolOnly(), kind(recordings=3), kind(card="street")],
    "card": [
        kind(card=with_card(name="")),
        kind(card=with_card(side_channels=("sigma",))),
        kind(card=with_card(oracle="nobody")),
        kind(card=with_card(counts={"test": {"scenes": 1}})),
    ],
    "splits": [
        kind(recordings=no_val),
        kind(recordings=open_to_all),
        kind(recordings=lambda self, s: [] if s == "test" else Street.recordings(self, s)),
    ],
    "recordings": [
        kind(recordings=bad_recording),
        kind(recordings=lambda self, split: 3 if split == "val" else Street.recordings(self, split)),
    ],
    "dt": [kind(recordings=slow, dt=0.4)],
    "windows": [
        kind(base=Featured, card=with_card(features=("x", "y"))),
        kind(base=Featured, features=lambda self, history: np.full((*history.shape[:2], 1), np.nan)),
        kind(base=Featured, features=lambda self, history: history[:, 1:, :1]),
    ],
    "features": [kind(base=Featured, features=stored)],
    "deterministic": [Dice],
    "read-only": [Thawed],
    "reference": [kind(recordings=cut(c)) for c in (copy.copy, a_frame_later, renumbered)],
    "parameters": [HiddenParameter],
    "pickle": [OpenFile],
}


@pytest.mark.parametrize(("rule", "domain"), [(rule, d) for rule, domains in BAD_DOMAINS.items() for d in domains])
def test_a_broken_rule_of_domains_is_named_and_no_other(rule, domain):
    assert [problem.rule for problem in checks.run_checks(domain, "domain").problems] == [rule]


@pytest.mark.parametrize("domain", [Street, Street(3), Featured])
def test_good_domains_are_accepted(domain):
    checks.check_domain(domain)


def test_a_missing_domain_file_is_no_finding():
    class Missing(Street):
        def recordings(self, split):
            raise DataError("walks.txt is missing")

    with pytest.raises(DataError, match=r"walks.txt is missing"):
        checks.check_domain(Missing())


def test_all_broken_rules_of_a_domain_are_reported_at_once():
    domain = kind(card=with_card(name="", parameters={"sed": 0}), recordings=cut(a_frame_later))
    with pytest.raises(SpecError, match=r"(?s)breaks 3 rules of the domain contract:.*- card: .*- reference: .*- p"):
        checks.check_domain(domain)


def test_every_rule_has_a_planted_fault():
    assert set(BAD_DOMAINS) == set(checks.rules("domain"))


def test_a_domain_without_test_windows_is_no_trial():
    empty = kind(recordings=lambda self, split: [])
    with pytest.raises(SpecError, match="no test window"):
        trials.domain_scenes(empty())
