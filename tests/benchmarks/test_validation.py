"""Results of others: what is refused, what is computed again, and how two are compared."""

import collections
import copy
import json

import jsonschema
import numpy as np
import pytest

import motion_gym
from motion_gym.benchmarks import comparison, running, validation
from motion_gym.benchmarks.identity import question, windows_identity
from motion_gym.benchmarks.json_schema import json_schema
from motion_gym.benchmarks.store import Store, run_of
from motion_gym.contract import DataError, SpecError

DOMAIN = "orca:d=0.6,scenes=40"


def scored(predictor, domain=DOMAIN):
    place = motion_gym.domain(domain)
    card = motion_gym.evaluate(predictor, place)
    return json.loads(json.dumps(run_of(windows_identity(predictor, place, k=1), card.as_dict())))


@pytest.fixture(scope="module")
def run():
    return scored("constant_velocity")


def verdicts(*runs, **options):
    return {finding.verdict for finding in validation.validate(copy.deepcopy(runs), **options)}


def test_an_honest_run_is_computed_again(run):
    (finding,) = validation.validate([run])
    assert (finding.verdict, finding.reason[:14]) == (validation.FINE, "computed again")


def test_runs_that_several_shipped_benchmarks_hold_are_the_same():
    runs = [run for name in running.BENCHMARKS for run in Store(name).runs.values()]
    by_question = collections.Counter(question(run["identity"]) for run in runs)
    repeated = [run for run in runs if by_question[question(run["identity"])] > 1]
    assert len(repeated) > 100
    assert verdicts(*repeated, recompute=0) == {validation.FINE}


@pytest.mark.parametrize("name", running.BENCHMARKS)
def test_shipped_runs_follow_the_schema(name):
    runs = list(Store(name).runs.values())
    sample = [runs[i] for i in np.linspace(0, len(runs) - 1, min(len(runs), 12)).astype(int)] if runs else []
    found = [f for f in validation.validate(sample, recompute=0) if f.verdict == validation.MISMATCH]
    assert found == []


def test_the_schema_is_one(run):
    jsonschema.Draft202012Validator.check_schema(json_schema())
    jsonschema.validate(run, json_schema())
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate({**run, "seed": "0"}, json_schema())


@pytest.mark.parametrize(
    "edit, reason",
    [
        (lambda run: run["metrics"]["ADE"].update(mean=0.001), "lies outside its interval"),
        (lambda run: run["metrics"]["ADE"].update(mean=-0.1, low=-0.2), "negative"),
        (lambda run: run["metrics"]["ADE"].update(mean="0.1"), "is not of type"),
        (lambda run: run["metrics"].pop("FDE"), "FDE"),
        (lambda run: run["identity"].update(scoring_version=1), "scoring version 1"),
        (lambda run: run["identity"]["versions"].update(constant_velocity=7), "version of constant_velocity"),
        (lambda run: run["identity"].update(predictor="linear"), "`identity.predictor`"),
        (lambda run: run.pop("provenance"), "provenance"),
        (lambda run: run.update(horizon=[0.0] * 12), "by horizon"),
        (lambda run: run["metrics"]["FDE"].update(mean=0.001, low=0.0), "by horizon"),
        (lambda run: run["versus_baseline"]["ADE"].update(mean=-1.0), "outside its interval"),
        (lambda run: run["versus_baseline"]["FDE"].update(p_value=2), "p-value"),
        (lambda run: run["metrics"]["ADE"].update(agent_windows=5000), "its domain has"),
        (lambda run: run["metrics"]["ADE"].update(replicates=1), "replicates"),
        (lambda run: run.update(k=20), "its k is 20"),
        (lambda run: run.update(protocol="paper"), "its protocol is"),
        (lambda run: run.update(unit="cm"), "its unit is"),
        (lambda run: run.update(dt=0.1), "its dt is"),
        (lambda run: run.update(horizon_seconds=1.0), "its horizon is 1.0 s"),
        (lambda run: run.update(seconds=-4), "it took -4 s"),
        (lambda run: run["domain"]["parameters"].update(d=0.3), "other parameters"),
        (lambda run: run.update(spec="orca:d=0.3"), "its spec is"),
        (lambda run: run.update(oracle=True), "its oracle is"),
        (lambda run: run.update(leaks=["x"]), "its leaks is"),
        (lambda run: run.update(selection="the best"), "its selection is"),
    ],
)
def test_an_edited_run_is_wrong(run, edit, reason):
    changed = copy.deepcopy(run)
    edit(changed)
    (finding,) = (f for f in validation.validate([changed]) if f.verdict == validation.MISMATCH)
    assert reason in finding.reason


def test_a_consistent_lie_is_found_by_computing_again(run):
    changed = copy.deepcopy(run)
    for name in ("ADE", "FDE"):
        half = {key: value / 2 for key, value in run["metrics"][name].items() if key in ("mean", "low", "high")}
        changed["metrics"][name].update(half)
    changed["horizon"] = [value / 2 for value in run["horizon"]]
    (finding,) = validation.validate([changed])
    assert finding.verdict == validation.MISMATCH and "here" in finding.reason
    assert verdicts(changed, recompute=0) == {validation.FINE}


def test_no_code_is_run_because_a_result_names_it(run, tmp_path):
    mark = tmp_path / "mark"
    for predictor, domain in ((f"os:system:command='touch {mark}'", DOMAIN), ("constant_velocity", "os:system:a=1")):
        changed = copy.deepcopy(run)
        changed["predictor"] = changed["identity"]["predictor"] = predictor
        changed["identity"]["domain"] = domain
        findings = validation.validate([changed])
        assert [f.verdict for f in findings] == [validation.UNSURE] and "of a user" in findings[0].reason
        comparison.compare_results([changed], [changed])
    assert not mark.exists()


def test_runs_twice_with_other_values_and_contents_that_are_no_runs_are_named(run, tmp_path):
    again = copy.deepcopy(run)
    again["seconds"] += 1.0
    again["provenance"]["finished"] = "2030-01-01T00:00:00+00:00"
    again["domain"]["parameters"]["later"] = None
    again["horizon"] = [value + 1e-5 for value in run["horizon"]]
    assert verdicts(run, again, recompute=0) == {validation.FINE}  # as in the folders of two machines
    again["horizon"][0] *= 2
    assert validation.MISMATCH in verdicts(run, again, recompute=0)
    for content in ({}, [], None, 3, {"identity": {"kind": []}}, {"identity": {"kind": "windows"}}):
        assert verdicts(content) == {validation.MISMATCH}
    damaged = tmp_path / "damaged.json"
    damaged.write_text('{"identity": NaN')
    (finding,) = validation.validate(validation.read(damaged))
    assert "cannot be read" in finding.reason
    damaged.unlink()
    with pytest.raises(DataError, match="has no results"):
        validation.read(tmp_path)


def test_results_of_a_user_are_not_called_checked(run):
    own = copy.deepcopy(run)
    own["identity"]["session"] = "abc"
    assert verdicts(own) == {validation.UNSURE}


def test_predictors_are_compared_in_pairs():
    ade, fde = comparison.compare_predictors("orca_oracle", "constant_velocity", DOMAIN)
    assert (ade.metric, fde.metric, ade.how) == ("ADE", "FDE", comparison.PAIRED)
    assert ade.mean == pytest.approx(ade.mean_a - ade.mean_b, abs=1e-6)
    assert ade.high < 0 and ade.p < 0.01 and ade.effect < -0.5
    (same, _) = comparison.compare_predictors("constant_velocity", "constant_velocity", DOMAIN)
    assert (same.mean, same.effect, same.p) == (0, 0, 1)
    text = comparison.comparison_table([ade, fde]).markdown()
    assert "A: orca_oracle, B: constant_velocity" in text and comparison.PAIRED in text


def test_files_are_compared_in_pairs_where_they_can_be_scored_again(run):
    other = scored("constant_velocity:velocity=4")
    (paired, _) = comparison.compare_results([other], [run])
    assert paired.how == comparison.PAIRED and paired.mean < 0
    own = copy.deepcopy(other)
    own["identity"]["session"] = "abc"
    (apart, _) = comparison.compare_results([own], [run])
    assert apart.how == comparison.FROM_SUMMARIES and apart.effect is None
    assert apart.mean == pytest.approx(paired.mean, abs=1e-3)
    assert apart.high - apart.low > paired.high - paired.low


def test_files_that_share_nothing_are_refused(run):
    with pytest.raises(SpecError, match="no domain, split"):
        comparison.compare_results([run], [scored("constant_velocity", "orca:d=0.3,scenes=40")])
