"""Claims: what is compared, how it is tested, and what the page says of it."""

import hypothesis.extra.numpy as arrays
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from motion_gym.benchmarks.claims.claims_page import short, verdict_table
from motion_gym.benchmarks.claims.panels import (
    FAILS,
    HOLDS,
    UNTESTED,
    Panel,
    claims_table,
    compare,
    pretraining_panel,
    reference_panel,
    verdict,
)
from motion_gym.benchmarks.claims.sentences import CLAIMS
from motion_gym.benchmarks.objects import NOT_EVERYWHERE, NOWHERE, Claim
from motion_gym.benchmarks.reports.significance import holm, paired_p
from motion_gym.contract import SpecError


@given(arrays.arrays(float, st.integers(2, 12), elements=st.floats(-1, 1)))
def test_p_values_are_those_of_students_test(off):
    assume(off.std() > 1e-3)
    t = off.mean() / (off.std(ddof=1) / np.sqrt(len(off)))
    assert paired_p(off) == pytest.approx(2 * stats.t.sf(abs(t), len(off) - 1), abs=1e-9)


def test_differences_without_a_spread_have_a_p_value():
    assert paired_p(np.zeros(5)) == 1.0 and paired_p(np.full(5, 0.5)) == 0.0


def test_p_values_are_corrected_for_their_number():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.9, 0.8]) == [1, 1]
    assert holm([]) == []


NOISE = np.array([-0.02, 0.01, 0.0, -0.01, 0.02])
PANEL = Panel(
    "0",
    {
        ("plain", "a"): 0.5 + NOISE,
        ("plain", "b"): 0.5 + NOISE,
        ("style", "a"): 0.4 + NOISE[::-1],
        ("style", "b"): 0.49 - NOISE,
        ("noisy", "a"): 0.49 + 10 * NOISE[::-1],
        ("none", "a"): np.array([0.6]),
        ("other", "a"): np.array([0.7]),
    },
    ("a", "b"),
    "A part",
)


def test_a_comparison_holds_the_values_and_the_test():
    (first, second) = compare([Claim("lower", ["style"], ["plain"])], [PANEL])
    off = PANEL.errors["style", "a"] - PANEL.errors["plain", "a"]
    assert (first["row"], first["than"], first["column"]) == ("style", "plain", "a")
    assert first["differences"] == pytest.approx(off) and first["ratio"] == pytest.approx(0.8)
    assert first["p"] == pytest.approx(stats.ttest_rel(first["values"], first["than_values"]).pvalue)
    assert [first["p_corrected"], second["p_corrected"]] == pytest.approx(holm([first["p"], second["p"]]))
    assert first["so"] and not second["so"]  # lower in both columns, significantly in one


VERDICTS = [
    (Claim("s", ["style"], ["plain"]), FAILS),
    (Claim("s", ["style"], ["plain"], ["a"]), HOLDS),
    (Claim("s", ["style"], ["plain"], significant=False), HOLDS),
    (Claim("s", ["style"], ["plain"], where=NOT_EVERYWHERE), HOLDS),
    (Claim("s", ["style"], ["plain"], where=NOWHERE), FAILS),
    (Claim("s", ["plain"], ["style"], where=NOWHERE), HOLDS),
    (Claim("s", ["noisy"], ["plain"], ["a"], where=NOWHERE), HOLDS),  # lower, but not significantly
    (Claim("s", ["noisy"], ["plain"], ["a"]), FAILS),
    (Claim("s", ["style"], ["plain"], ["a"], ratio=(0.0, 0.8)), HOLDS),
    (Claim("s", ["style"], ["plain"], ["a"], ratio=(0.0, 0.79)), FAILS),
    (Claim("s", ["style"], ["plain"], ["a"], ratio=(0.0, 0.8), each_seed=True), FAILS),
    (Claim("s", ["style"], ["plain"], ["a"], ratio=(0.7, 0.9), each_seed=True), HOLDS),
    (Claim("s", ["none"], ["other"]), HOLDS),  # one run each: nothing to test
    (Claim("s", ["none"], ["plain"], ["a"]), FAILS),
    (Claim("s", ["plain"], columns=["a"], than_column="b", ratio=(0.9, 1.1), significant=False), HOLDS),
    (Claim("s", ["missing"], ["plain"]), UNTESTED),
    (Claim("s", ["style"], ["plain", "missing"], ["a"]), UNTESTED),
    (Claim("s", ["style"], ["plain"], ["missing"]), UNTESTED),
]


@pytest.mark.parametrize(("claim", "expected"), VERDICTS)
def test_verdicts(claim, expected):
    assert verdict(claim, compare([claim], [PANEL])) == expected


def test_a_correction_does_not_help_to_deny_a_difference():
    """p is .02 for one test and above .05 after the correction for many."""
    off = np.array([-0.03, -0.01, -0.02, -0.005, -0.04])
    panel = Panel("0", {**PANEL.errors, ("lower", "a"): PANEL.errors["plain", "a"] + off}, ("a",), "A part")
    others = [Claim("b", ["noisy", "none", "other"], ["plain", "style", "noisy"], ["a"])]
    claim, denial = Claim("c", ["lower"], ["plain"], ["a"]), Claim("d", ["lower"], ["plain"], ["a"], where=NOWHERE)
    comparisons = compare([claim, denial, *others], [panel])
    tested = next(c for c in comparisons if c["claim"] is claim)
    assert tested["p"] < 0.05 < tested["p_corrected"]
    assert verdict(claim, comparisons) == FAILS and verdict(denial, comparisons) == FAILS


def test_the_same_test_is_counted_once():
    claims = [Claim("a", ["style"], ["plain"], ["a"]), Claim("b", ["plain"], ["style"], ["a"])]
    first, second = compare(claims, [PANEL])
    assert first["p"] == first["p_corrected"] == second["p_corrected"]


def test_claims_are_tested_under_the_honest_protocol_unless_they_name_a_panel():
    paper = Panel("1", {key: values - 0.2 for key, values in PANEL.errors.items()}, ("a",), "Paper", "paper")
    unnamed, named = Claim("x", ["style"], ["plain"], ["a"]), Claim("y", ["style"], ["plain"], ["a"], panel="1")
    assert [c["panel"] for c in compare([unnamed, named], [PANEL, paper])] == ["A part", "Paper"]


def test_panels_of_studies_name_their_columns():
    study = {"counts": [0, 4], "ade": {"0.6": {"modular": [[0.2, 0.3], [0.1, 0.2]]}}}
    panel = reference_panel(study, {("style_erm", "0.6"): np.array([0.4, 0.5]), ("style_erm", "0.4"): np.zeros(2)})
    assert panel.columns == ("0.6, 0 references", "0.6, 4 references")
    assert panel.errors["modular", "0.6, 4 references"].tolist() == [0.1, 0.2]
    assert panel.errors["style_erm", "0.6, 4 references"].tolist() == [0.4, 0.5]
    curves = {"ade": {"orca:d=0.1": {"pre-trained": [[0.3, 0.4], [0.1, 0.2]]}}}
    assert pretraining_panel(curves).errors["pre-trained", "orca:d=0.1, 2 epochs"].tolist() == [0.1, 0.2]
    (unnamed,) = [Claim("x", ["style_erm"], ["modular"])]
    assert compare([unnamed], [panel]) == []  # a panel of a study is tested where it is named


def test_a_test_is_told_in_words():
    def test(**options):
        return Claim("x", ["a"], ["b"], **options).test

    assert test() == "lower, paired t-test with corrected p < 0.05; everywhere"
    assert test(ratio=(0, 0.5), significant=False) == "ratio of means at most 0.50; everywhere"
    assert test(ratio=(1.5, float("inf")), significant=False) == "ratio of means 1.50 or more; everywhere"
    assert test(ratio=(0.9, 1.1), each_seed=True, where=NOWHERE) == (
        "ratio of means 0.90 to 1.10 for each seed, paired t-test with p < 0.05; nowhere"
    )


def test_a_claim_that_compares_with_nothing_is_refused():
    with pytest.raises(SpecError, match="compares with nothing: name `than` or `than_column`"):
        Claim("x", ["style"])
    with pytest.raises(SpecError, match=r"`where=somewhere`.*choose `everywhere`, `nowhere` or `not everywhere`"):
        Claim("x", ["style"], ["plain"], where="somewhere")


def test_tables_show_the_comparisons_and_the_verdicts():
    claims = [Claim("lower", ["style"], ["plain"]), Claim("never run", ["missing"], ["plain"])]
    comparisons = compare(claims, [PANEL])
    table = claims_table(comparisons, "d")
    assert table.rows[0][:7] == [
        "lower", "style - plain", "A part", "a", "-.100 ± .014", "-20 %", "5 of 5",
    ]  # fmt: skip
    table = verdict_table("A benchmark", claims, comparisons)
    first, second = table.rows
    assert first[3] == FAILS and first[1].startswith("ratio 0.80 to 0.98; p ")
    assert "but at style / plain, b (0.98" in first[1]
    assert second[1] == "no runs of these rows are stored" and second[3] == UNTESTED
    assert short(table).title == "A benchmark: 0 of 2 claims hold"
    assert short(table).rows == [[FAILS, "lower"], [UNTESTED, "never run"]]


def test_sentences_of_a_benchmark_differ():
    for claims in CLAIMS.values():
        sentences = [claim.sentence for claim in claims]
        assert len(sentences) == len(set(sentences))
