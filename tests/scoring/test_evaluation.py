from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import motion_gym
from motion_gym.catalog import PREDICTORS
from motion_gym.contract import Forecast, PredictorError, SpecError
from motion_gym.metrics.errors import error_by_horizon, metric_rows
from motion_gym.scoring.evaluation import PAPER_BATCH, Scorecard, compare, evaluate
from motion_gym.stepping.harness import ask
from tests.crowd_with_sigma import CrowdWithSigma

make: Any = motion_gym.domain

ROUNDING = 1e-4
"""Metres. Arrays ask for all windows in one matrix product, the environment for one window at a time, and a processor
chooses the order of additions by the shape. float32 of some metres keeps 1e-6; 20 recurrent steps make 3e-5 of it."""
CROWD = CrowdWithSigma(d=0.6, agents=3, scenes=12)
PAIRS = make("orca", d=0.6, scenes=150)


class Noisy:
    """Draws around the last position; every agent from its own numbers, so that batches do not matter."""

    selection = "no weights"

    def predict(self, observation, samples=1, seed=0):
        last = observation.xy[:, None, -1:]
        noise = [np.random.default_rng([seed, int(a)]).normal(size=(samples, 12, 2)) for a in observation.agent]
        return (last + np.array(noise)).astype(np.float32)


class Weighted(Noisy):
    """The most likely sample is not the first."""

    def predict(self, observation, samples=1, seed=0):
        positions = super().predict(observation, samples, seed)
        weights = np.tile(np.arange(1, samples + 1, dtype=np.float32), (len(positions), 1))
        return Forecast(positions, weights)


class Log:
    """What was done to a predictor; its copies write into the same log."""

    def __init__(self):
        self.scenes, self.resets = [], 0

    def __deepcopy__(self, memo):
        return self


class Counts:
    """Remembers what it was shown, and forecasts it where it can."""

    def __init__(self, log=None):
        self.log = log or Log()
        self.future = []

    def reset(self):
        self.log.resets += 1
        self.future = []

    def observe(self, truth):
        self.log.scenes.append(truth.observation.scenes)
        self.future.append(truth.future)

    def predict(self, observation, samples=1, seed=0):
        if self.future and len(self.future[-1]) == len(observation):
            return self.future[-1][:, None]  # what a leak is good for
        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)


@pytest.mark.parametrize(
    ("name", "k"), [("noisy", 1), ("linear", 1), *((name, 3) for name in (*PREDICTORS, "noisy", "weighted"))]
)
def test_stepping_the_environment_gives_the_same_scores(name, k):
    made = {"noisy": Noisy, "weighted": Weighted}.get(name, name)
    pairs = name in ("refine", "transfer") or name.startswith(("style_", "modular"))
    place = PAIRS if pairs else CROWD
    one, other = (evaluate(made, place, k=k, seed=3, through=through) for through in ("arrays", "environment"))
    assert list(one.metrics) == list(other.metrics) == [row.name for row in metric_rows(k)]
    for metric in one.metrics:
        # A log density of a few samples divides squared distances by the square of the kernel's width, 0.01 m or so.
        off = 1000 * ROUNDING if metric.startswith("KDE") else ROUNDING
        np.testing.assert_allclose(one.values[metric], other.values[metric], rtol=ROUNDING, atol=off, err_msg=metric)
    for a, b in zip(vars(one.metrics["ADE"]).values(), vars(other.metrics["ADE"]).values(), strict=True):
        assert a == pytest.approx(b, abs=ROUNDING)
    np.testing.assert_allclose(one.horizon, other.horizon, atol=ROUNDING)


def test_stepping_gives_the_same_scores_on_real_windows(eth_ucy):
    one, other = (
        evaluate("constant_velocity", "eth:alpha=8", through=through) for through in ("arrays", "environment")
    )
    assert one.metrics == other.metrics  # constant velocity works on each agent alone, in one order of operations


def test_scorecard_says_what_was_done():
    card = evaluate("constant_velocity", PAIRS)
    truth = PAIRS.windows("test")
    assert isinstance(card, Scorecard)
    assert (card.predictor, card.split, card.protocol, card.k, card.seed) == (
        "constant_velocity",
        "test",
        "honest",
        1,
        0,
    )
    assert card.domain.parameters["d"] == 0.6
    people = {"scenes": truth.observation.scenes, "agent_windows": len(truth.future), "agents": len(truth.future)}
    recorded = {"recorded_agents": 298, "recorded_agent_windows": people["agent_windows"]}
    assert dict(card.domain.counts) == {"test": {**people, **recorded}}
    ade = card.metrics["ADE"]
    assert (ade.agent_windows, ade.agents, ade.scenes) == (people["agent_windows"], people["agents"], people["scenes"])
    assert ade.low < ade.mean < ade.high
    forecast = ask(motion_gym.predictor("constant_velocity"), truth.observation)
    error = np.linalg.norm(forecast.positions[:, 0].astype(float) - truth.future, axis=-1)
    assert ade.mean == pytest.approx(error.mean()) and card.metrics["FDE"].mean == pytest.approx(error[:, -1].mean())
    assert card.horizon == pytest.approx(error_by_horizon(forecast, truth).mean(axis=0).tolist())
    assert card.selection == "no weights" and card.reference_scenes == 0
    assert 0 < card.seconds < 10 and 10e6 < card.peak_memory < 64e9
    assert card.scored.startswith("agents complete over all 20 steps, at least 2 in every window: ")
    assert card.ade == ade and card.fde == card.metrics["FDE"] and card.horizon_seconds == 4.8
    plain = card.as_dict()
    assert (plain["dt"], plain["unit"], plain["horizon_seconds"]) == (0.4, "m", 4.8)
    assert card.weights_seed is None and card.reference_draws == 1
    assert card.oracle is False and card.leaks == ()
    assert card.versus_baseline["ADE"].mean == 0


def test_scorecard_in_a_line():
    line = str(evaluate("constant_velocity", PAIRS))
    for part in ("constant_velocity on orca:d=0.6", "ADE .", "[", "k = 1", "protocol honest", "agent-windows of"):
        assert part.replace(" .", " 0.") in line


def test_difference_from_constant_velocity():
    cards = {name: evaluate(name, PAIRS) for name in ("constant_velocity", "stand_still", "orca_oracle")}
    worse, best = cards["stand_still"].versus_baseline["ADE"], cards["orca_oracle"].versus_baseline["ADE"]
    assert worse.low > 1 and best.high < 0
    means = {name: card.metrics["ADE"].mean for name, card in cards.items()}
    assert worse.mean == pytest.approx(means["stand_still"] - means["constant_velocity"])
    assert compare(cards["stand_still"], cards["constant_velocity"]) == worse


def test_compare_is_signed_and_paired():
    a, b = evaluate("stand_still", PAIRS), evaluate("constant_velocity", PAIRS)
    there, back = compare(a, b, "FDE"), compare(b, a, "FDE")
    assert there.mean == pytest.approx(-back.mean) and there.low == pytest.approx(-back.high)
    assert there.n == len(PAIRS.windows("test").future)


def test_compare_refuses_what_cannot_be_compared():
    a, b = evaluate("stand_still", PAIRS), evaluate("stand_still", CROWD)
    with pytest.raises(SpecError, match="different windows"):
        compare(a, b)
    with pytest.raises(SpecError, match=r"no `minADE_5`.*Known: .*ADE"):
        compare(a, a, "minADE_5")


def test_interval_of_constant_velocity_on_eth(eth_ucy):
    ade = evaluate("constant_velocity", "eth").metrics["ADE"]
    assert (ade.agent_windows, ade.agents, ade.scenes) == (181, 36, 70)
    assert ade.low == pytest.approx(0.67, abs=0.05) and ade.high == pytest.approx(1.42, abs=0.05)


def test_samples_by_protocol():
    assert (evaluate(Noisy(), PAIRS).k, evaluate(Noisy(), PAIRS, protocol="paper").k) == (1, 20)
    assert "minADE_20" in evaluate(Noisy(), PAIRS, protocol="paper").metrics
    assert "minADE_20" not in evaluate(Noisy(), PAIRS).metrics


def test_more_samples_are_never_worse():
    means = {k: evaluate(Noisy(), CROWD, k=k).metrics for k in (2, 8)}
    assert means[8]["minADE_8"].mean < means[2]["minADE_2"].mean
    assert means[8]["minADE_8"].mean < means[8]["JADE_8"].mean < means[8]["ADE"].mean


def test_weights_choose_the_sample_that_ade_is_of():
    # Sample 3 of Weighted is the likely one; asked for one sample, only the first is there.
    likely = evaluate(Weighted(), PAIRS, k=3)
    positions = Noisy().predict(PAIRS.windows("test").observation, 3)
    error = np.linalg.norm(positions[:, 2].astype(float) - PAIRS.windows("test").future, axis=-1)
    assert likely.values["ADE"] == pytest.approx(error.mean(axis=1))


def test_weights_survive_the_leaking_batches():
    class Observing(Weighted):
        def observe(self, truth):
            pass

    plain, paper = evaluate(Weighted(), PAIRS, k=3), evaluate(Observing(), PAIRS, k=3, protocol="paper")
    assert np.array_equal(plain.values["ADE"], paper.values["ADE"])
    assert np.array_equal(plain.values["KDE_NLL_3"], paper.values["KDE_NLL_3"])


def test_seed_is_what_samples_depend_on():
    first, second, again = (evaluate(Noisy(), PAIRS, seed=seed).values["ADE"] for seed in (0, 1, 0))
    assert np.array_equal(first, again) and not np.array_equal(first, second)


def test_honest_protocol_shows_the_reference_scenes():
    predictor = Counts()
    card = evaluate(predictor, PAIRS)
    scenes = PAIRS.reference().observation.scenes
    assert predictor.log.scenes == [scenes] and predictor.log.resets == 1 and card.reference_scenes == scenes
    assert card.leaks == ()
    assert card.metrics["ADE"].mean > 1


def test_paper_protocol_shows_the_scored_batches_and_says_so():
    predictor = Counts()
    card = evaluate(predictor, PAIRS, protocol="paper", k=1)
    scenes = PAIRS.windows("test").observation.scenes
    assert predictor.log.scenes == [PAPER_BATCH] * (scenes // PAPER_BATCH) + [scenes % PAPER_BATCH]
    assert predictor.log.resets >= len(predictor.log.scenes)
    assert card.metrics["ADE"].mean == 0  # it was given the answers
    assert card.leaks == ("leak of the paper protocol: the style is read from the scored scenes' own future",)
    assert card.reference_scenes == 0


def test_honest_protocol_does_not_score_the_reference_scenes_it_has_shown():
    with pytest.raises(SpecError, match=r"Counts.* is shown scenes of split `reference`.*Score another split"):
        evaluate(Counts(), PAIRS, split="reference")
    assert evaluate("constant_velocity", PAIRS, split="reference").split == "reference"


def test_a_predictor_is_shown_as_many_reference_scenes_as_asked_for():
    there = PAIRS.reference().observation.scenes
    for asked, seen, draws in ((None, there, 1), (5, 5, 5), (0, 0, 1), (there, there, 1)):
        counting = Counts()
        card = evaluate(counting, PAIRS, references=asked)
        assert (card.reference_scenes, card.reference_draws) == (seen, draws)
        assert counting.log.scenes == [seen] * draws * (seen > 0)
    with pytest.raises(SpecError, match=rf"`references={there + 1}`.*has {there} reference scenes"):
        evaluate(Counts(), PAIRS, references=there + 1)
    for wrong in (-1, 2.5, "x"):
        with pytest.raises(SpecError, match=r"`references=.*must be a whole number"):
            evaluate("constant_velocity", PAIRS, references=wrong)


def test_honest_protocol_does_not_score_a_split_that_holds_reference_scenes(eth_ucy):
    domain = make("zara1", reference_share=0.2)
    with pytest.raises(SpecError, match="of their people are in split `train` at the same time"):
        evaluate(Counts(), domain, split="train")
    assert evaluate(Counts(), domain).reference_scenes == domain.reference().observation.scenes > 50


def test_paper_protocol_has_no_environment():
    with pytest.raises(SpecError, match="use through='arrays'"):
        evaluate(Counts(), PAIRS, protocol="paper", through="environment")


def test_oracle_is_labelled():
    assert evaluate("orca_oracle", PAIRS).oracle is True


@pytest.mark.parametrize(
    ("spec", "leaks"),
    [
        ("eth:alpha=8", ("oracle side channel: sigma reads the future",)),
        ("eth:alpha=8,sigma=past", ()),
        ("eth", ()),
    ],
)
def test_side_channel_is_named_as_a_leak(eth_ucy, spec, leaks):
    assert evaluate("constant_velocity", spec).leaks == leaks


@pytest.mark.parametrize(
    ("spec", "scored"),
    [
        ("eth", "agents complete over all 20 steps, at least 2 in every window: 181 of the "),
        ("eth:min_agents=1", "agents complete over all 20 steps: 364 of the 364 agent-windows"),
    ],
)
def test_who_was_scored_is_said(eth_ucy, spec, scored):
    assert evaluate("constant_velocity", spec).scored.startswith(scored)


def test_predictor_given_by_name_is_fitted_and_one_given_as_an_object_is_not():
    assert evaluate("linear", PAIRS).metrics["ADE"].mean < 0.3
    with pytest.raises(PredictorError, match="linear is not fitted"):
        evaluate(motion_gym.predictor("linear"), PAIRS)


def test_predictor_without_a_selection_is_said_to_have_none():
    class Plain:
        def predict(self, observation, samples=1, seed=0):
            return np.repeat(observation.xy[:, None, -1:], 12, axis=2)

    assert "does not say how its weights were selected" in evaluate(Plain(), PAIRS).selection


def test_domain_parameters_may_be_keywords():
    card = evaluate("stand_still", "orca", d=0.1, scenes=20)
    assert card.domain.parameters["d"] == 0.1 and card.domain.parameters["scenes"] == 20


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"protocol": "hones"}, "no protocol `hones`. Did you mean `honest`"),
        ({"through": "array"}, "`through=array` is not known. Did you mean `arrays`"),
        ({"k": 0}, "`k=0` must be a whole number, 1 or more"),
        ({"k": -1}, "`k=-1`"),
        ({"k": 2.5}, "`k=2.5`"),
        ({"k": True}, "`k=True`"),
        ({"seed": -1}, "`seed=-1` must be a whole number, 0 or more"),
        ({"seed": 0.5}, "`seed=0.5`"),
        ({"split": "tset"}, "no split `tset`. Did you mean `test`"),
        ({"alpha": 3}, "already a domain"),
    ],
)
def test_bad_options(wrong, message):
    with pytest.raises(SpecError, match=message):
        evaluate("constant_velocity", PAIRS, **wrong)


@pytest.mark.parametrize(
    ("predictor", "domain", "message"),
    [
        ("constant_velocty", "orca", "no predictor `constant_velocty`. Did you mean `constant_velocity`"),
        ("constant_velocity", "ocra", "no domain `ocra`. Did you mean `orca`"),
        ("constant_velocity:velocity=lst", "orca:scenes=5", "Did you mean `last`"),
        ("constant_velocity", 3, "int cannot be used as domain"),
        (3, "orca:scenes=5", "int cannot be used as predictor"),
    ],
)
def test_bad_names(predictor, domain, message):
    with pytest.raises(SpecError, match=message):
        evaluate(predictor, domain)


def broken(answer):
    class Broken:
        def predict(self, observation, samples=1, seed=0):
            return answer(observation, samples)

    return Broken()


def change_input(observation, samples):
    observation.history[:] = 0
    return observation.xy[:, None, -1:]


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (lambda o, k: 1 / 0, "Broken.predict raised ZeroDivisionError: division by zero"),
        (lambda o, k: None, "returned NoneType; return a Forecast or a numpy array"),
        (lambda o, k: o.xy.tolist(), "returned list"),
        (lambda o, k: np.zeros((len(o), 12, 2), np.float32), r"use positions\[:, None\]"),
        (lambda o, k: np.zeros((1, k, 12, 2), np.float32), r"shape \(1, 2, 12, 2\) for \d+ agents, expected"),
        (lambda o, k: np.zeros((len(o), k, 11, 2), np.float32), "expected .* agents, samples, future steps, x and y"),
        (lambda o, k: np.zeros((len(o), 5, 12, 2), np.float32), "returned 5 samples and 2 were asked for"),
        (lambda o, k: np.zeros((len(o), k, 12, 2), int), "dtype int64: positions are float32"),
        (lambda o, k: np.full((len(o), k, 12, 2), math.nan, np.float32), "NaN or infinite .* row 0 .* must be finite"),
        (lambda o, k: np.full((len(o), k, 12, 2), math.inf, np.float32), "every position must be finite"),
        (lambda o, k: Forecast(np.zeros((len(o), k, 12, 2)), -np.ones((len(o), k))), "weights .* not negative"),
        (change_input, r"may not change its input: work on a copy, as observation.history.copy\(\)"),
    ],
)
def test_broken_predictor_is_named_with_a_remedy(answer, message):
    with pytest.raises(PredictorError, match=message):
        evaluate(broken(answer), PAIRS, k=2)


def test_wrong_signature_is_explained():
    class Old:
        def predict(self, observation):
            return observation.xy

    with pytest.raises(PredictorError, match=r"signature is predict\(self, observation, samples=1, seed=0\)"):
        evaluate(Old(), PAIRS)  # type: ignore[arg-type]


def test_failing_observe_and_fit_are_named():
    class Observes(Counts):
        def observe(self, truth):
            truth.future[:] = 0

    class Fits(Counts):
        def fit(self, train, validation, seed):
            raise RuntimeError("no convergence")

    with pytest.raises(PredictorError, match=r"Observes.observe raised .*work on a copy"):
        evaluate(Observes(), PAIRS)
    with pytest.raises(PredictorError, match=r"Fits.fit raised RuntimeError: no convergence"):
        evaluate(Fits, PAIRS)  # type: ignore[arg-type]


def test_evaluation_changes_nothing():
    before = PAIRS.windows("test").future.copy()
    evaluate("linear", PAIRS)
    assert np.array_equal(PAIRS.windows("test").future, before)
