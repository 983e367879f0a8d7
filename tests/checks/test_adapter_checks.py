"""The checker of adapters accepts shipped adapters, and names the rule of every planted fault."""

from __future__ import annotations

import copy
import sys
from pathlib import Path

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.checks.adapter_rules import ADAPTER_RULES
from motion_gym.checks.checker import check_adapter, run_checks
from motion_gym.cli.main import main
from motion_gym.contract import PredictorError, SpecError
from motion_gym.stepping.snapshot import snapshot
from tests.bias import Bias
from tests.street import Street

PLAIN = "constant_velocity"
BAD: dict[str, list[type]] = {}


class Shifted:
    """A predictor with a state, for adapters."""

    def __init__(self):
        self.shift = np.zeros(2, np.float32)

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(observation.xy[:, -1:], 12, axis=1)[:, None] + self.shift


def breaks(rule):
    def add(kind):
        BAD.setdefault(rule, []).append(kind)
        return kind

    return add


@breaks("adapter")
class NeverObserves:
    def __init__(self, of):
        self.inner = copy.deepcopy(of)

    def predict(self, observation, samples=1, seed=0):
        return self.inner.predict(observation, samples, seed)

    def reset(self):
        pass


@breaks("adapter")
class IsToldTheDomain(Bias):
    def know(self, domain):
        self.recordings = domain.recordings("test")


@breaks("given")
class LearnsInWhatItWasGiven(Bias):
    def __init__(self, of):
        super().__init__(of)
        self.inner, self.before = of, of.shift.copy()

    def reset(self):
        super().reset()
        if hasattr(self, "before"):
            self.inner.shift[:] = self.before

    def observe(self, truth):
        super().observe(truth)
        if truth.known.any():
            self.inner.shift += self.bias.mean(axis=0).astype(np.float32)


@breaks("given")
class SharesWhatItWasGiven(Bias):
    def __init__(self, of):
        super().__init__(of)
        self.inner = of


@breaks("learning")
class RemembersWhatItSaid(Bias):
    """Method predict stores its answer for observe."""

    def reset(self):
        super().reset()
        self.said = None

    def predict(self, observation, samples=1, seed=0):
        answer = super().predict(observation, samples, seed)
        if self.updates:
            self.said = answer.copy()
        return answer


@breaks("unknown")
class LooksWhereNothingIsKnown(Bias):
    def observe(self, truth):
        super().observe(truth)
        self.bias = self.bias + truth.future[~truth.known].sum() / 1000


@breaks("unknown")
class LearnsFromNothing(Bias):
    def observe(self, truth):
        super().observe(truth)
        self.bias = 0.9 * self.bias


@breaks("order")
class RemembersInItsClass(Bias):
    """All instances know the observations of each: a later run over the same stream knows its future."""

    memory: dict = {}  # noqa: RUF012

    def predict(self, observation, samples=1, seed=0):
        answer = super().predict(observation, samples, seed)
        if self.updates > 2:
            for row, history in enumerate(observation.history):
                answer[row] = self.memory.get(history.tobytes(), answer[row])
        return answer

    def observe(self, truth):
        super().observe(truth)
        for history, future in zip(truth.observation.history, truth.future, strict=True):
            self.memory[history.tobytes()] = future


@breaks("restart")
class ForgetsHalf(Bias):
    """Momentum outlives a reset."""

    def reset(self):
        step = getattr(self, "step", None)
        super().reset()
        self.step = self.step if step is None else step


@breaks("restart")
class DrawsOnAndOn(Bias):
    """A hidden generator that reset does not restore."""

    def __init__(self, of):
        rng = np.random.default_rng(0)
        self.draw = Draw(rng)
        super().__init__(of)

    def observe(self, truth):
        super().observe(truth)
        if truth.known.any():
            self.bias = self.bias + self.draw() / 100


class Draw:
    __slots__ = ("__rng",)

    def __init__(self, rng):
        self.__rng = rng

    def __call__(self):
        return self.__rng.normal()


@breaks("twins")
class PicklesWithoutMomentum(Bias):
    def __reduce_ex__(self, protocol):
        return _without_momentum, (type(self), self.__dict__)

    def __deepcopy__(self, memo):
        twin = type(self).__new__(type(self))
        twin.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return twin


def _without_momentum(kind, state):
    twin = kind.__new__(kind)
    twin.__dict__.update(copy.deepcopy(state))
    twin.step = np.zeros((12, 2))
    return twin


@breaks("memory")
class KeepsEverything(Bias):
    def reset(self):
        super().reset()
        self.seen = []

    def observe(self, truth):
        super().observe(truth)
        self.seen.append(truth.future.copy())


@breaks("online")
class TakesEachAgentOnce(Bias):
    """Fails if several scenes of the same people are observed together."""

    def observe(self, truth):
        super().observe(truth)
        if len(np.unique(truth.observation.agent)) < len(truth.observation):
            raise KeyError("an agent is there twice")


@pytest.mark.parametrize("name", catalog.ADAPTERS)
def test_adapters_that_ship_are_accepted(name):
    check_adapter(name)


@pytest.mark.parametrize(
    ("adapter", "of", "domain"),
    [
        ("none", PLAIN, None),
        ("kalman", "linear", None),
        ("kalman:memory=0", "erm_no_sigma:weights=original/zara2", None),
        (Bias, PLAIN, Street(frames=160)),
        (Bias, Shifted(), None),
        ("tests.bias:Bias:rate=0.1", "stand_still", None),
    ],
)
def test_adapters_are_accepted_around_other_predictors_and_on_a_domain(adapter, of, domain):
    check_adapter(adapter, of, domain)


def test_an_instance_is_checked_and_not_changed():
    adapter, of = Bias(mg.predictor(PLAIN)), Shifted()
    before = snapshot(adapter), snapshot(of)
    check_adapter(adapter)
    check_adapter(Bias, of)
    assert (snapshot(adapter), snapshot(of)) == before


ALSO = {
    RemembersWhatItSaid: {"online"},
    RemembersInItsClass: {"restart", "twins", "unknown", "learning", "online"},
    DrawsOnAndOn: {"online", "order"},
}
"""Further rules that a fault breaks."""


@pytest.mark.parametrize(("rule", "kind"), [(rule, kind) for rule, kinds in BAD.items() for kind in kinds])
def test_a_broken_rule_is_named_and_no_other(rule, kind):
    RemembersInItsClass.memory.clear()
    broken = [problem.rule for problem in run_checks(kind, "adapter", of=Shifted()).problems]
    assert rule in broken and set(broken) <= {rule} | ALSO.get(kind, set())


def test_every_rule_has_a_planted_fault():
    assert set(BAD) == set(ADAPTER_RULES)


class Several(Bias):
    """Breaks two rules of adapters, and one of predictors."""

    selection = 3

    def reset(self):
        bias = getattr(self, "bias", None)
        super().reset()
        self.seen, self.step = [], self.step if bias is None else bias.copy()

    def observe(self, truth):
        super().observe(truth)
        self.seen.append(truth)


def test_all_broken_rules_are_reported_at_once():
    with pytest.raises(PredictorError) as error:
        check_adapter(Several, PLAIN)
    text = str(error.value)
    assert text.startswith("Several breaks 3 rules of the adapter contract:\n- attributes: ")
    assert "\n- restart: after reset, step is not as at the start: restore" in text
    assert "\n- memory: it holds" in text and "deque(maxlen=64)" in text


class Drifts(Bias):
    def predict(self, observation, samples=1, seed=0):
        self.bias = self.bias + 1
        return super().predict(observation, samples, seed)


def test_broken_rules_of_predictors_are_reported():
    assert [problem.rule for problem in run_checks(Drifts(mg.predictor(PLAIN)), "adapter").problems] == ["pure"]


@pytest.mark.parametrize(
    ("adapter", "of", "domain", "error", "message"),
    [
        ("kalmann", PLAIN, None, SpecError, "no adapter `kalmann`. Did you mean `kalman`"),
        ("kalman", "linaer", None, SpecError, "no predictor `linaer`. Did you mean `linear`"),
        ("none", PLAIN, "orka", SpecError, "no domain `orka`. Did you mean `orca`"),
        ("style", "linear", None, PredictorError, "reads no style"),
        (Shifted, PLAIN, None, PredictorError, "adapter: `Shifted` is no adapter, as its constructor"),
        (
            "none",
            "modular",
            "orca:agents=3,scenes=20",
            PredictorError,
            "modular could not be asked .* exactly 2 agents",
        ),
    ],
)
def test_arguments_that_cannot_be_checked_are_refused(adapter, of, domain, error, message):
    with pytest.raises(error, match=message):
        check_adapter(adapter, of, domain)


EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def test_the_command_line_checks_adapters(capsys, monkeypatch):
    monkeypatch.chdir(EXAMPLES)
    monkeypatch.setattr(sys, "path", list(sys.path))
    main(["check", "own_adapter:Stretch", "--of", PLAIN, "--domain", "orca:scenes=6"])
    out = capsys.readouterr().out
    assert "own_adapter:Stretch around constant_velocity keeps the contract of an adapter" in out
    assert out.count("no leak") == 2
    main(["check", "kalman", "--of", "linear", "--only", "adapter"])
    assert "kalman around linear keeps the contract of an adapter" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["check", "style", "--of", "linear"])
    assert "reads no style" in capsys.readouterr().err
