"""The checkers accept shipped predictors and domains, and report all broken rules at once."""

import pytest

from motion_gym import catalog
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
    assert report.ok and "- not checked: predict: an oracle" in str(report)


def test_rules_can_be_called_as_functions():
    from motion_gym.checks.predictor_rules import attributes
    from motion_gym.checks.predictor_trials import PredictorTrial
    from motion_gym.checks.report import CheckError

    with pytest.raises(CheckError, match="name is 3: make it of type str"):
        attributes(PredictorTrial(Several))
