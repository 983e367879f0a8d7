from __future__ import annotations

import numpy as np
import pytest

import motion_gym
from motion_gym.catalog import PREDICTORS
from motion_gym.contract import PredictorError, SpecError
from motion_gym.metrics.errors import error_by_horizon, metric_rows
from motion_gym.scoring.evaluation import PAPER_BATCH, Scorecard, compare, evaluate
from motion_gym.stepping.harness import ask
from tests import traffic
from tests.added_weights import needs_weights
from tests.predictors_to_score import CROWD, PAIRS, ROUNDING, Counts, Noisy, Weighted, make


@pytest.mark.parametrize(
    ("name", "k"), [("noisy", 1), ("linear", 1), *((name, 3) for name in (*PREDICTORS, "noisy", "weighted"))]
)
def test_stepping_the_environment_gives_the_same_scores(name, k):
    predictor = {"noisy": Noisy, "weighted": Weighted}.get(name, name)
    needs_weights(name)
    pairs = name in ("refine", "transfer") or name.startswith(("style_", "modular"))
    if name == "idm_oracle":
        traffic.needs_highway_env()
    place = PAIRS if pairs else traffic.FEW if name == "idm_oracle" else CROWD
    one, other = (evaluate(predictor, place, k=k, seed=3, through=through) for through in ("arrays", "environment"))
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
