"""Scores over time, after a shift and on return, against their definitions."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motion_gym.online.scores import (
    BLOCK,
    EVERY,
    PHASE,
    POINTS,
    TRAIL,
    WITHIN,
    after_first,
    curve_of,
    gain,
    recovery,
    returns_of,
    shifts_of,
    summary_of,
    trailing,
)

ERRORS = st.lists(st.floats(0, 10), min_size=1, max_size=200).map(np.array)
SOME = st.floats(0.01, 10)


@given(ERRORS, st.integers(1, 60))
def test_trailing_is_the_mean_of_the_last_values(values, width):
    expected = [values[max(i - width + 1, 0) : i + 1].mean() for i in range(len(values))]
    np.testing.assert_allclose(trailing(values, width), expected, atol=1e-9)


@given(ERRORS)
def test_a_curve_goes_from_the_tenth_forecast_to_the_last(values):
    seconds = np.arange(len(values)) * 0.4
    curve = curve_of(values, seconds)
    assert len(curve) <= POINTS
    mean = trailing(values)
    assert curve[0][0] == pytest.approx(seconds[min(EVERY, len(values)) - 1], abs=0.01)
    assert curve[-1] == (pytest.approx(seconds[-1], abs=0.01), pytest.approx(mean[-1], abs=1e-4))
    assert all(a < b for (a, _), (b, _) in itertools.pairwise(curve))


def test_a_long_curve_is_thinned_out():
    assert len(curve_of(np.ones(10 * POINTS), np.arange(10.0 * POINTS))) == POINTS


def stream_of(*segments):
    """Errors and segments of forecasts, one per second, from (label, number of forecasts, error)."""
    values = np.concatenate([np.full(count, error, float) for _, count, error in segments])
    segment = np.repeat(np.arange(len(segments)), [count for _, count, _ in segments])
    starts = np.concatenate([[0], np.cumsum([count for _, count, _ in segments])[:-1]]).astype(float)
    return values, segment, np.arange(len(values)) + 1.0, [label for label, *_ in segments], starts


def test_shifts_are_changes_of_the_domain_after_which_enough_matured():
    played = stream_of(("a", 60, 0.2), ("b", 70, 0.5), ("b", 60, 0.4), ("a", TRAIL - 1, 0.3), ("c", TRAIL, 0.9))
    shifts = shifts_of(*played)
    assert [(s.segment, s.at, s.before) for s in shifts] == [
        (1, 60.0, pytest.approx(0.2)),
        (4, 190.0 + TRAIL - 1, pytest.approx(0.3)),
    ]
    assert shifts[0].after == [(n, float(n), 0.5) for n in range(TRAIL, 71, EVERY)]
    assert shifts[1].after == [(TRAIL, float(TRAIL), 0.9)]


def test_nothing_before_a_shift_is_no_shift():
    assert shifts_of(*stream_of(("a", 0, 0.0), ("b", 60, 0.5))) == []


def test_after_a_shift_only_what_was_forecast_since_then_counts():
    values, segment, *rest = stream_of(("a", 60, 0.2), ("b", 80, 0.0))
    values[60:] = np.linspace(1.0, 0.2, 80)
    (shift,) = shifts_of(values, segment, *rest)
    expected = [round(values[60:][n - TRAIL : n].mean(), 4) for n in range(TRAIL, 81, EVERY)]
    assert [ade for _, _, ade in shift.after] == pytest.approx(expected)


def test_blocks_of_a_phase_are_means_of_consecutive_forecasts():
    values, segment, *rest = stream_of(("a", 60, 0.2), ("b", 250, 0.0))
    values[60:] = np.linspace(1.0, 0.2, 250)
    (shift,) = shifts_of(values, segment, *rest)
    expected = [(BLOCK, 100.0, values[60:160].mean()), (2 * BLOCK, 200.0, values[160:260].mean())]
    assert shift.blocks == [pytest.approx(row, abs=1e-4) for row in expected]  # the last 50 fill no block


def phase(*errors):
    """A shift with blocks of the given errors, one forecast every two seconds."""
    return {"blocks": [[BLOCK * n, 200.0 * n, ade] for n, ade in enumerate(errors, 1)]}


def test_recovery_must_last_until_the_phase_ends():
    oracle = phase(*[0.1] * 6)
    assert recovery(phase(0.3, 0.11, 0.1, 0.1, 0.11, 0.1), oracle) == (100, 200.0)
    assert recovery(phase(0.1, 0.1, 0.1, 0.3, 0.1, 0.1), oracle) == (400, 800.0)  # the first passage does not count
    assert recovery(phase(*[0.1] * 6), oracle) == (0, 0.0)
    assert recovery(phase(0.1, 0.1, 0.1, 0.1, 0.1, 0.2), oracle) is None


def test_recovery_is_against_the_oracle_at_the_same_time():
    hard_at_last = phase(0.1, 0.1, 0.1, 0.1, 0.1, 0.5)
    assert recovery(phase(0.3, 0.1, 0.1, 0.1, 0.1, 0.54), hard_at_last) == (100, 200.0)


def test_a_short_phase_is_censored():
    short = PHASE // BLOCK - 1
    assert recovery(phase(*[0.1] * short), phase(*[0.1] * short)) is None


@given(st.lists(st.tuples(SOME, SOME), min_size=6, max_size=20))
def test_recovered_means_every_later_block_is_within_ten_percent(errors):
    found = recovery(phase(*[e for e, _ in errors]), phase(*[level for _, level in errors]))
    recovered = [error <= WITHIN * level for error, level in errors]
    starts = [n for n in range(len(errors)) if all(recovered[n:])]
    assert found == ((BLOCK * starts[0], 200.0 * starts[0]) if starts else None)


@given(SOME, SOME, st.floats(-2, 2))
def test_gain_is_the_share_of_the_way_to_the_oracle(none, oracle, share):
    found = gain(none, none + share * (oracle - none), oracle)
    if none > oracle:
        assert found == pytest.approx(share, abs=1e-6 * (1 + none / (none - oracle)))
    else:
        assert np.isnan(found)


def test_returns_are_later_visits_beside_the_first():
    visits = [("a", 0.2, 90), ("b", 0.5, 90), ("a", 0.4, 50), ("a", 9.0, 49), ("b", None, 0), ("a", 0.3, 70)]
    assert returns_of(visits) == [("a", 0.2, 0.4), ("a", 0.2, 0.3)]
    assert returns_of([("a", 9.0, 49), *visits]) == [("a", 0.2, 0.4), ("a", 0.2, 0.3)]


def test_the_mean_after_the_first_segment_is_over_forecasts():
    def part(mean, count):
        return {"ade": {"mean": mean, "agent_windows": count}}

    assert after_first({"segments": [part(9.0, 10), part(1.0, 30), part(2.0, 10), part(None, 0)]}) == 1.25
    assert after_first({"segments": [part(9.0, 10)]}) == 9.0
    assert np.isnan(after_first({"segments": [part(9.0, 10), part(None, 0)]}))


def test_a_summary_counts_forecasts_times_and_people():
    summary = summary_of(np.array([1.0, 2.0, 3.0]), np.array([4, 4, 5]), np.array([7, 8, 8]))
    assert (summary.mean, summary.agent_windows, summary.scenes, summary.agents) == (2.0, 3, 2, 2)
    assert summary.low <= 2 <= summary.high
    nothing = summary_of(np.zeros(0), np.zeros(0, int), np.zeros(0, int))
    assert np.isnan(nothing.mean) and nothing.agent_windows == 0
