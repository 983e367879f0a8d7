"""Regret, backward and forward transfer against their definitions, and the experts of a card."""

import numpy as np
import pytest

import motion_gym as mg
from motion_gym.online.continual import backward_transfer, forward_transfer, regret
from motion_gym.online.scores import TRAIL, curve_of, shifts_of

SOURCE = "modular_invariant:weights=style"


def result(*visits):
    """A result of visits (domain, error of the first 50 forecasts, error of the last 50), one forecast per second."""
    values = np.concatenate([np.repeat([begin, end], TRAIL) for _, begin, end in visits])
    segment = np.repeat(np.arange(len(visits)), 2 * TRAIL)
    starts, labels = np.arange(len(visits)) * 2.0 * TRAIL, [domain for domain, *_ in visits]
    shifts = shifts_of(values, segment, np.arange(len(values)) + 1.0, labels, starts)
    return {
        "segments": [
            {"domain": domain, "start": start, "stop": start + 2 * TRAIL, "ade": {"agent_windows": 2 * TRAIL}}
            for domain, start in zip(labels, starts, strict=True)
        ],
        "shifts": [{"segment": shift.segment, "after": shift.after} for shift in shifts],
        "curve": curve_of(values, np.arange(float(len(values)))),
    }


NONE = result(("a", 1.0, 1.0), ("b", 2.0, 2.0), ("a", 0.5, 0.5))


def test_backward_transfer_compares_a_return_with_the_end_of_the_visit_before():
    """The return is half as hard, and the error is 0.4 / 0.5 = 80 % of the source model's, after 60 % before."""
    forgot = result(("a", 1.0, 0.6), ("b", 2.0, 1.0), ("a", 0.4, 0.3))
    assert backward_transfer(forgot, NONE) == pytest.approx(0.6 - 0.8, abs=0.01)
    assert backward_transfer(NONE, NONE) == 0
    assert backward_transfer(result(("a", 1.0, 0.6), ("b", 2.0, 1.0)), NONE) is None


def test_forward_transfer_is_of_the_beginning_of_new_domains():
    helped = result(("a", 1.0, 0.6), ("b", 1.5, 1.0), ("a", 0.1, 0.1))
    assert forward_transfer(helped, NONE) == pytest.approx(0.25)
    assert forward_transfer(NONE, NONE) == 0
    alone = result(("a", 1.0, 0.6))
    assert forward_transfer(alone, alone) is None


def test_regret_is_of_the_best_expert():
    assert regret({"ade": {"mean": 0.51}, "experts": {"a": 0.9, "b": 0.5}}) == pytest.approx(0.02)
    assert regret({"ade": {"mean": 0.51}, "experts": {}}) is regret({"ade": {"mean": 0.51}}) is None


def test_the_experts_of_a_card_have_the_errors_that_they_have_alone():
    stream = mg.stream(["orca:d=0.3,scenes=12", "orca:d=0.6,scenes=12"], frames=80)
    card = mg.evaluate_online(mg.adapter("hedge", SOURCE), stream)
    alone = {"none": mg.adapter("none", SOURCE)}
    alone |= {name: mg.adapter(name, SOURCE, memory=64) for name in ("style", "kalman")}
    alone |= {name: mg.adapter(name, SOURCE) for name in ("style:memory=16", "kalman:memory=16")}
    alone |= {name: mg.predictor(name) for name in card.experts if name not in alone}
    assert len(alone) == 8
    for name, expert in alone.items():
        assert card.experts[name] == pytest.approx(mg.evaluate_online(expert, stream).ade.mean, rel=1e-5)
    assert mg.evaluate_online(alone["none"], stream).experts == {}
