"""The rules of domains: of a planted fault its rule is named and no other."""

import dataclasses
import sys
import types

import numpy as np
import pytest

from motion_gym.checks import checker as checks
from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import Recording, SpecError, Truth
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.windows import pick_scenes, windows_of


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


def windows(change):
    """Method ``windows`` whose test truth is changed by a function of the truth; always new, writable arrays."""

    def method(self, split):
        self.check_split(split)
        truth = windows_of(self.recordings(split))
        return change(truth) if split == "test" else truth

    return method


def seen(truth, **changes):
    return dataclasses.replace(truth, observation=dataclasses.replace(truth.observation, **changes))


def edited(array, index, value):
    array = array.copy()
    array[index] = value
    return array


def first_unknown(truth):
    return dataclasses.replace(truth, known=edited(truth.known, (0, 11), False))


class NoDomain:
    card = None

    def windows(self, split):
        raise NotImplementedError


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
    def windows(self, split):
        self.check_split(split)
        kept = vars(self).setdefault("kept", {})
        return kept.setdefault(split, windows_of(self.recordings(split)))

    def __getstate__(self):
        return {"seed": self.seed}


class Dice(Street):
    def windows(self, split):
        self.check_split(split)
        if split != "val":
            return super().windows(split)
        return windows_of([street(int(np.random.default_rng().integers(1 << 30)))])

    def recordings(self, split):
        return [] if split == "val" else super().recordings(split)


def kind(base=Street, **members):
    """A class that pickle finds, with some members changed."""
    name = f"Planted{len(vars(sys.modules[__name__]))}"
    made = type(name, (base,), {"__module__": __name__, **members})
    globals()[name] = made
    return made


def leaking_reference(self):
    return pick_scenes(self.windows("test"), [0])


def renamed_reference(self):
    truth = pick_scenes(self.windows("test"), [0])
    return seen(truth, agent=truth.observation.agent + 1000)


def open_to_all(self, split):
    return Street.windows(self, split if split in self.splits else "test")


def bad_recording(self, split):
    recording = street(1)
    return [dataclasses.replace(recording, frame=recording.frame[::-1])]


def slow(self, split):
    self.check_split(split)
    return [dataclasses.replace(street(self.seeds[split]), dt=0.5)]


class LateSplit(Street):
    def windows(self, split):
        if split == "val":
            raise RuntimeError("not there")
        return super().windows(split)


BAD_DOMAINS = {
    "members": [NoDomain, NoDomain(), kind(reference=3), kind(card="street")],
    "card": [
        kind(card=with_card(name="")),
        kind(card=with_card(features=("y", "x"))),
        kind(card=with_card(side_channels=("sigma",))),
        kind(card=with_card(oracle="nobody")),
        kind(card=with_card(counts={"test": {"scenes": 1}})),
    ],
    "splits": [
        LateSplit,
        kind(windows=open_to_all),
        kind(windows=windows(lambda t: pick_scenes(t, []))),
    ],
    "types": [
        kind(windows=windows(lambda t: t.future)),
        kind(windows=windows(lambda t: dataclasses.replace(t, future=t.future.astype(float)))),
        kind(windows=windows(lambda t: dataclasses.replace(t, known=t.known.astype(int)))),
        kind(windows=windows(lambda t: seen(t, agent=t.observation.agent.astype(np.int32)))),
        kind(windows=windows(lambda t: seen(t, history=t.observation.history[:, :, :1]))),
        kind(windows=windows(lambda t: seen(t, history=t.observation.history[:, 1:]))),
    ],
    "scene": [
        kind(windows=windows(lambda t: seen(t, scene=t.observation.scene[:-1]))),
        kind(windows=windows(lambda t: seen(t, scene=np.append(t.observation.scene, len(t.future))))),
    ],
    "values": [
        kind(windows=windows(first_unknown)),
        kind(windows=windows(lambda t: dataclasses.replace(t, future=edited(t.future, (0, 0, 0), np.nan)))),
    ],
    "agents": [kind(windows=windows(lambda t: seen(t, agent=np.zeros_like(t.observation.agent))))],
    "dt": [kind(windows=windows(lambda t: seen(t, dt=0.5))), kind(recordings=slow, dt=0.5, card=with_card(dt=0.4))],
    "deterministic": [Dice],
    "read-only": [Thawed],
    "reference": [kind(reference=leaking_reference), kind(reference=renamed_reference)],
    "recordings": [
        kind(recordings=bad_recording, windows=lambda self, split: Street(self.seed).windows(split)),
        kind(recordings=lambda self, split: 3, windows=lambda self, split: Street(self.seed).windows(split)),
    ],
    "tracks": [
        kind(windows=windows(lambda t: dataclasses.replace(t, future=edited(t.future, (3, 4, 0), 0.01)))),
        kind(recordings=lambda self, split: [street(9)], windows=lambda self, s: Street(self.seed).windows(s)),
    ],
    "parameters": [HiddenParameter, kind(card=with_card(parameters={"sed": 0}))],
    "pickle": [OpenFile],
}


@pytest.mark.parametrize(("rule", "domain"), [(rule, d) for rule, domains in BAD_DOMAINS.items() for d in domains])
def test_a_broken_rule_of_domains_is_named_and_no_other(rule, domain):
    assert [problem.rule for problem in checks.domain_problems(domain)] == [rule]


@pytest.mark.parametrize("domain", [Street, Street(3), kind(windows=windows(lambda t: t))])
def test_good_domains_are_accepted(domain):
    checks.check_domain(domain)


def test_windows_need_not_be_known_to_the_end():
    def half(truth):
        known = edited(truth.known, (slice(None, None, 2), slice(5, None)), False)
        return Truth(np.where(known[..., None], truth.future, np.float32(0)), known, truth.observation)

    checks.check_domain(kind(windows=windows(half)))


def test_rounding_is_not_another_track():
    checks.check_domain(kind(windows=windows(lambda t: dataclasses.replace(t, future=np.round(t.future, 4)))))


def test_findings_of_a_domain_are_said_at_once():
    domain = kind(card=with_card(name="", parameters={"sed": 0}), reference=leaking_reference)
    with pytest.raises(SpecError, match=r"(?s)breaks 3 rules of the domain contract:.*- card: .*- reference: .*- p"):
        checks.check_domain(domain)


def test_every_rule_has_a_planted_fault():
    assert set(BAD_DOMAINS) == set(checks.DOMAIN_RULES)


def test_a_domain_without_test_windows_is_no_trial():
    empty = kind(windows=windows(lambda t: pick_scenes(t, [])))
    with pytest.raises(SpecError, match="no test window"):
        trials.domain_trial(empty())
