"""Gain, recovery and forgetting as the tables of online adaptation give them, and the oracle beside them."""

import numpy as np
import pytest

import motion_gym
from motion_gym.benchmarks import online_report
from motion_gym.contract import PredictorError, SpecError
from motion_gym.online.scores import EVERY, TRAIL

pytest.importorskip("torch")
from motion_gym.online.target_oracle import TargetOracle


def result(*segments, after=None, first=1):
    """A result of segments (domain, ADE, matured forecasts); ``after`` are trailing means after the first shift."""
    parts = [{"domain": d, "ade": {"mean": ade, "agent_windows": n}} for d, ade, n in segments]
    rows = [[TRAIL + EVERY * i, float(i), ade] for i, ade in enumerate(after or [])]
    shifts = [{"segment": first, "before": segments[first - 1][1], "after": rows}] if after else []
    return {"segments": parts, "shifts": shifts}


def test_gain_is_of_means_over_seeds_after_the_first_segment():
    none = [result(("a", 9.0, 60), ("b", 0.5, 60)), result(("a", 9.0, 60), ("b", 0.3, 60))]
    mine = [result(("a", 1.0, 60), ("b", 0.3, 60)), result(("a", 1.0, 60), ("b", 0.3, 60))]
    oracle = [result(("a", 0.0, 60), ("b", 0.2, 60)), result(("a", 0.0, 60), ("b", 0.2, 60))]
    assert online_report.gain_of(mine, none, oracle) == pytest.approx((0.4 - 0.3) / (0.4 - 0.2))
    assert online_report.gain_of(mine, none, None) is None
    assert online_report.gain_of(mine, oracle, none) is None  # an oracle that is worse is none


def test_recovery_is_against_the_oracle_at_the_same_time():
    mine = result(("a", 0.1, 60), ("b", 0.3, 70), after=[0.40, 0.30, 0.22])
    hard = result(("a", 0.1, 60), ("b", 0.3, 70), after=[0.20, 0.29, 0.10])
    assert online_report.recovered([mine], [hard]).startswith(f"{TRAIL + EVERY} (1 s)")
    assert online_report.recovered([mine], None) == "never"  # above the .1 before


def test_only_the_first_change_of_domain_is_recovered_from():
    """What comes after a segment of few forecasts, or is not the first change, tells nothing of it."""
    few = result(("a", 0.1, TRAIL - 1), ("b", 0.3, 70), after=[0.1])
    later = result(("a", 0.1, 60), ("b", 0.3, 2), ("a", 0.1, 60), after=[0.1], first=2)
    assert online_report.recovered([few], None) == online_report.recovered([later], None) == "-"


def test_forgetting_is_growth_beyond_that_of_the_source_model():
    """Frames that are harder on return are no forgetting, and the second visit of what is adapted to is none either."""
    none = result(("a", 0.2, 60), ("b", 1.0, 60), ("a", 0.4, 60), ("b", 1.0, 60))
    mine = result(("a", 0.2, 60), ("b", 0.9, 60), ("a", 0.5, 60), ("b", 0.3, 60))
    assert online_report.returned([mine], [none]) == "+25.0 %"
    assert online_report.returned([none], [none]) == "+0.0 %"
    still = result(("a", 0.0, 60), ("b", 0.9, 60), ("a", 0.5, 60), ("b", 0.3, 60))
    assert online_report.returned([still], [none]) == "-"


def test_the_oracle_takes_the_predictor_of_the_domain_and_reads_its_style():
    oracle = TargetOracle({"orca:d=0.3": "constant_velocity", "orca:d=0.6": "modular_invariant:weights=style"})
    near, far = (motion_gym.domain(f"orca:d={d}", scenes=80) for d in (0.3, 0.6))
    seen = near.windows("test").observation
    with pytest.raises(SpecError, match=r"no oracle for orca:d=0\.3,scenes=80"):
        oracle.know(near)
    alone = TargetOracle("modular_invariant:weights=style")
    alone.know(far)
    read = alone.predict(seen).positions
    alone.know(near)
    assert not np.array_equal(read, alone.predict(seen).positions)
    assert "orca:d=0.1" in alone.trained_on and "validation windows" in alone.selection
    assert oracle.name == "oracle(constant_velocity, modular_invariant:weights=style)"


def test_who_is_not_trained_is_no_oracle():
    with pytest.raises(PredictorError, match="not trained"):
        TargetOracle("linear")
