"""The checkers accept what ships, and say everything that they find at once."""

import pytest

from motion_gym import catalog
from motion_gym.checks import checker as checks
from motion_gym.contract import DataError, PredictorError, SpecError


@pytest.mark.parametrize("spec", [*catalog.PREDICTORS, "linear:sigma=true", "constant_velocity:velocity=mean"])
def test_predictors_that_ship_are_accepted(spec):
    checks.check_predictor(spec)


@pytest.mark.parametrize("spec", ["orca_oracle", "linear", "constant_velocity"])
def test_predictors_are_accepted_on_a_domain(spec):
    checks.check_predictor(spec, "orca:scenes=40")


@pytest.mark.parametrize(
    "spec", [*catalog.DOMAINS, "eth:alpha=64", "eth:alpha=8,sigma=past,reference_share=0.2,stride=3"]
)
def test_domains_that_ship_are_accepted(spec):
    spec = "orca:scenes=40" if spec == "orca" else spec
    try:
        catalog.domain(spec).windows("test")
    except DataError as error:
        pytest.skip(f"no data: {error}")
    checks.check_domain(spec)


def test_missing_data_is_no_finding(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_DATA", str(tmp_path))
    with pytest.raises(DataError):
        checks.domain_problems("eth")


def test_unknown_names_are_no_findings():
    with pytest.raises(SpecError, match="Did you mean `linear`"):
        checks.check_predictor("liner")
    with pytest.raises(SpecError, match="Did you mean `orca`"):
        checks.check_domain("orka")


class Several:
    """Breaks five rules, and by changing its input seems to break another."""

    name = 3

    def __init__(self):
        self.calls, self.hook = 0, lambda: None

    def predict(self, observation, samples=1, seed=0):
        self.calls += 1
        observation.history[0] = 0
        return observation.xy[:, None, -1:].repeat(12, axis=2)

    def observe(self, truth):
        pass


def test_everything_is_said_at_once():
    with pytest.raises(PredictorError) as error:
        checks.check_predictor(Several)
    text = str(error.value)
    assert text.startswith("Several breaks 5 rules of the predictor contract:\n- ")
    for rule in ("attributes", "state", "input", "reset", "pickle"):
        assert f"\n- {rule}: " in text
