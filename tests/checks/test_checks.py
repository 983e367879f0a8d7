"""The checkers accept shipped predictors and domains, and report all broken rules at once."""

import re

import numpy as np
import pytest

from motion_gym import RecordedDomain, catalog
from motion_gym.checks import checker as checks
from motion_gym.contract import DataError, PredictorError, SpecError
from tests import traffic
from tests.added_weights import needs_weights
from tests.walks import walks_file


@pytest.mark.parametrize("spec", [*catalog.PREDICTORS, "linear:sigma=true", "constant_velocity:velocity=mean"])
def test_shipped_predictors_are_accepted(spec):
    needs_weights(spec)
    checks.check_predictor(spec)


@pytest.mark.parametrize("spec", ["orca_oracle", "linear", "constant_velocity"])
def test_predictors_are_accepted_on_a_domain(spec):
    checks.check_predictor(spec, "orca:scenes=16")


@pytest.mark.parametrize(
    "spec", [*catalog.DOMAINS, "eth:alpha=64", "eth:alpha=8,sigma=past,reference_share=0.2,stride=3"]
)
def test_shipped_domains_are_accepted(spec):
    if spec == "highway":
        traffic.needs_highway_env()
    small = {
        "orca": "orca:scenes=16",
        "tracks": f"tracks:path={walks_file()},fps=25",
        "highway": traffic.SPEC,
        "sdd": "sdd:scene=quad,form=clips",
    }
    spec = small.get(spec, spec)
    try:
        catalog.domain(spec).windows("test")
    except DataError as error:
        pytest.skip(f"no data: {error}")
    checks.check_domain(spec)


def test_missing_data_is_no_finding(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path))
    with pytest.raises(DataError):
        checks.run_checks("eth", "domain")


def test_unknown_names_are_no_findings():
    with pytest.raises(SpecError, match="Did you mean `linear`"):
        checks.check_predictor("liner")
    with pytest.raises(SpecError, match="Did you mean `orca`"):
        checks.check_domain("orka")


class Several:
    """Breaks seven rules; it changes its input, so the forecast of a scene depends on its place in the batch."""

    name = 3

    def __init__(self):
        self.calls, self.hook = 0, lambda: None

    def predict(self, observation, samples=1, seed=0):
        self.calls += 1
        observation.history[0] = 0
        return observation.xy[:, None, -1:].repeat(12, axis=2)

    def observe(self, truth):
        pass


def test_all_broken_rules_are_reported_at_once():
    with pytest.raises(PredictorError) as error:
        checks.check_predictor(Several)
    text = str(error.value)
    assert text.startswith("Several breaks 7 rules of the predictor contract:\n- ")
    for rule in ("attributes", "state", "input", "place", "scenes", "reset", "pickle"):
        assert f"\n- {rule}: " in text


@pytest.mark.parametrize("kind", ["predictor", "adapter", "domain"])
def test_rules_are_listed_with_a_description(kind):
    listed = checks.rules(kind)
    assert len(listed) == {"predictor": 19, "adapter": 28, "domain": 12}[kind]
    assert all(len(description) > 15 for description in listed.values())
    with pytest.raises(SpecError, match="Did you mean `domain`"):
        checks.rules("domains")


def test_a_rule_is_run_by_itself_or_skipped_with_a_reason():
    report = checks.run_checks(Several, "predictor", only=["pickle"])
    assert [outcome.rule for outcome in report.outcomes] == ["pickle"] and not report.ok
    reasons = {"pickle": "holds a hook", "reset": "learns once", "state": "counts calls"}
    report = checks.run_checks(Several, "predictor", skip=reasons)
    assert {problem.rule for problem in report.problems} == {"attributes", "input", "place", "scenes"}
    assert "- skipped: pickle: holds a hook" in str(report)
    checks.check_predictor("constant_velocity", skip={"scenes": "sees all"}, only=["scenes", "pure"])
    with pytest.raises(SpecError, match=r"no rule `pickel`. Did you mean `pickle`"):
        checks.check_predictor(Several, skip={"pickel": "holds a hook"})
    with pytest.raises(SpecError, match="skipped without a reason"):
        checks.check_predictor(Several, skip={"pickle": " "})


def test_unchecked_rules_are_reported():
    report = checks.run_checks("orca_oracle", "predictor")
    assert report.ok
    reason = "because an oracle forecasts nothing without a domain (argument `domain`)"
    assert re.search(rf"^- \d+ rules not checked, {re.escape(reason)}: predict, forecast, ", str(report), re.MULTILINE)


class Longer:
    """Forecasts 20 steps in place of 12."""

    def predict(self, observation, samples=1, seed=0):
        return np.zeros((len(observation), samples, 20, 2), np.float32)


class LongerAdapter(Longer):
    def __init__(self, of):
        self.of = of

    def observe(self, truth):
        pass

    def reset(self):
        pass


class NoTable(RecordedDomain):
    def recordings(self, split):
        self.check_split(split)
        return [3]


class Unteachable(Longer):
    def fit(self, train, validation, seed=0):
        raise RuntimeError("no GPU")


@pytest.mark.parametrize(
    ("thing", "kind", "line"),
    [
        (Longer, "predictor", "8 further rules not checked, because predict gives no valid forecast: pure, state, "),
        (LongerAdapter, "adapter", "18 further rules not checked, because predict gives no valid forecast: pure, "),
        (NoTable, "domain", "10 further rules not checked, because recordings cannot be used: card, splits, dt, "),
        (Unteachable, "predictor", "11 further rules not checked, because the predictor cannot be fitted: predict, "),
    ],
)
def test_rules_that_are_not_checked_for_the_same_reason_share_a_line(thing, kind, line):
    lines = str(checks.run_checks(thing, kind, of="constant_velocity")).splitlines()
    assert [each for each in lines if "not checked" in each] == [lines[-1]]
    assert lines[-1].startswith(f"- {line}") and len(lines[-1]) < 250


def test_the_error_is_said_where_no_broken_rule_reports_it():
    report = str(checks.run_checks(Longer, "predictor", only=["state"]))
    assert "- 1 rule not checked, because predict gives no valid forecast (Longer.predict returned shape" in report


def test_the_predictor_to_adapt_is_said_to_have_raised():
    with pytest.raises(PredictorError, match=r"could not be asked .*: Unteachable.fit raised RuntimeError: no GPU"):
        checks.check_adapter(LongerAdapter, Unteachable)


def test_whole_numbers_are_to_be_converted():
    class Whole(Longer):
        def predict(self, observation, samples=1, seed=0):
            return np.zeros((len(observation), samples, 12, 2), np.int64)

    with pytest.raises(PredictorError, match=r"returned dtype int64: .*return positions.astype\(np.float32\)\."):
        checks.check_predictor(Whole)


def test_rules_can_be_called_as_functions():
    from motion_gym.checks.predictor_rules import attributes
    from motion_gym.checks.predictor_trials import PredictorTrial
    from motion_gym.checks.report import CheckError

    with pytest.raises(CheckError, match="name is 3: make it of type str"):
        attributes(PredictorTrial(Several))
