"""What the benchmark of style shifts shows besides its tables."""

import hypothesis.extra.numpy as arrays
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import stats

from motion_gym.benchmarks import style_report
from motion_gym.benchmarks.shipped import Part


@given(arrays.arrays(float, st.integers(2, 12), elements=st.floats(-1, 1)))
def test_p_values_are_those_of_students_test(off):
    assume(off.std() > 1e-3)
    assert style_report.paired_p(off) == pytest.approx(stats.ttest_1samp(off, 0).pvalue, abs=1e-6)


def test_p_values_are_corrected_for_their_number():
    assert style_report.holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert style_report.holm([0.9, 0.8]) == [1, 1]


def result(row, seed, column, error):
    return {
        "predictor": f"{row}:weights=style,seed={seed}",
        "identity": {"domain": DOMAINS[column], "shots": 0},
        "metrics": {"ADE": {"mean": error}},
    }


DOMAINS = {"0.1": "orca:d=0.1,agents=2,radius=5.0,horizon=2.0,speed=1.0,seed=0,scenes=none"}


def part(protocol):
    return Part("x", {"0.1": "orca:d=0.1"}, (), ("style_erm", "modular"), "style", protocol)


def test_claims_are_tested_under_the_honest_protocol_alone(monkeypatch):
    monkeypatch.setattr("motion_gym.benchmarks.results.domain_key", lambda domain: DOMAINS["0.1"])
    found = []
    for protocol, gain in (("honest", 0.1), ("paper", 0.4)):
        errors = [("style_erm", 0.5), ("modular", 0.5 - gain)]
        results = [result(row, seed, "0.1", error + seed / 100) for row, error in errors for seed in range(3)]
        found.append((part(protocol), results))
    lines = [line for line in style_report.claims(found, style_report.CLAIMS).splitlines() if "a style lowers" in line]
    assert len(lines) == 1 and "| -.100" in lines[0] and "3 of 3" in lines[0]
