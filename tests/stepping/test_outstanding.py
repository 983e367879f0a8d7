"""The ledger of forecasts that wait for their ground truth."""

import dataclasses

import numpy as np
import pytest

from motion_gym.contract import DataError, Forecast, Observation, PredictorError, Recording, SpecError
from motion_gym.stepping.outstanding import Outstanding
from motion_gym.stepping.stream_clock import StreamClock
from tests.clock_plays import positions_for


def observation(agents=2, seed=0):
    history = np.random.default_rng(seed).normal(size=(agents, 8, 2)).astype(np.float32)
    return Observation(history, np.array([0, agents]), 10 + np.arange(agents), 0.4)


def forecast(agents=2, seed=1):
    return Forecast(np.random.default_rng(seed).normal(size=(agents, 1, 12, 2)).astype(np.float32))


@pytest.fixture
def waiting():
    ledger = Outstanding()
    for at in (3, 5):
        ledger.store(at, observation(seed=at), forecast(seed=at))
    return ledger


def test_what_was_stored_comes_back_with_its_truth_once(waiting):
    future, known = np.ones((2, 12, 2)), np.arange(12) < [[12], [4]]
    stored, truth = waiting.settle(3, future, known)
    np.testing.assert_array_equal(stored.positions, forecast(seed=3).positions)
    np.testing.assert_array_equal(truth.observation.history, observation(seed=3).history)
    assert truth.future.dtype == np.float32 and truth.known.dtype == bool
    np.testing.assert_array_equal(truth.future, known[..., None] * np.ones(2))
    assert [stored.made for stored in waiting] == [5] and len(waiting) == 1
    with pytest.raises(DataError, match=r"made at 3, but none is stored of that time \(5 to 5\)"):
        waiting.settle(3, future, known)


def test_what_is_known_so_far_leaves_it_waiting(waiting):
    for steps in (1, 7):
        truth = waiting.so_far(5, np.zeros((2, 12, 2)).tolist(), (np.arange(12) < [[steps]] * 2).tolist())
        assert truth.known.sum() == 2 * steps
    assert [stored.made for stored in waiting] == [3, 5]


def test_matured_forecasts_keep_the_time_and_the_step_of_their_scenes():
    waiting = Outstanding(keep=True)
    for at, known in ((3, 12), (5, 4), (6, 12)):
        seen = dataclasses.replace(observation(seed=at), dt=0.5, time=np.array([at]))
        waiting.store(at, seen, forecast(seed=at))
        waiting.settle(at, np.zeros((2, 12, 2)), np.arange(12) < [[known], [12]])
    stored, truth = waiting.matured_only()
    assert truth.observation.dt == 0.5 and truth.observation.time.tolist() == [3, 5, 6]
    assert truth.observation.agent.tolist() == [10, 11, 11, 10, 11] and len(stored.positions) == 5
    assert (waiting.matured, waiting.censored) == (5, 1)


def test_what_was_stored_is_out_of_reach():
    waiting, seen, stored = Outstanding(), observation(), forecast()
    waiting.store(0, seen, stored)
    seen.history[:], stored.positions[:] = 0, 0
    future, known = np.ones((2, 12, 2), np.float32), np.ones((2, 12), bool)
    stored, truth = waiting.settle(0, future, known)
    future[:], known[:] = 7, False
    assert stored.positions.any() and truth.observation.history.any()
    assert (truth.future == 1).all() and truth.known.all()


def test_a_read_only_view_of_what_the_caller_can_write_is_copied():
    waiting, seen = Outstanding(), observation()
    view = dataclasses.replace(seen, history=seen.history[:])
    for array in (view.history, view.scene, view.agent):
        array.flags.writeable = False
    waiting.store(0, view, forecast())
    seen.history[:] = 0
    assert next(iter(waiting)).observation.history.any()


def test_positions_alone_can_be_stored():
    waiting = Outstanding()
    waiting.store(0, observation(), forecast().positions)
    stored, _ = waiting.settle(0, np.zeros((2, 12, 2)), np.ones((2, 12)))
    np.testing.assert_array_equal(stored.most_likely(), forecast().positions[:, 0])


def test_a_time_is_forecast_once(waiting):
    with pytest.raises(PredictorError, match="made at 5 is stored already: a time is forecast once"):
        waiting.store(5, observation(), forecast())


def test_each_agent_is_forecast(waiting):
    with pytest.raises(PredictorError, match=r"shape \(3, 1, 12, 2\) for 2 agents"):
        waiting.store(6, observation(2), forecast(3))


@pytest.mark.parametrize("method", ["settle", "so_far"])
def test_truth_of_a_forecast_that_was_never_made_is_refused(waiting, method):
    with pytest.raises(DataError, match=r"for a forecast made at 4, but none is stored of that time \(3 to 5\)"):
        getattr(waiting, method)(4, np.zeros((2, 12, 2)), np.ones((2, 12), bool))
    with pytest.raises(DataError, match=r"none is stored of that time \(none\)"):
        getattr(Outstanding(), method)(4, np.zeros((2, 12, 2)), np.ones((2, 12), bool))


@pytest.mark.parametrize(
    ("future", "known"),
    [(np.zeros((3, 12, 2)), np.ones((3, 12))), (np.zeros((2, 8, 2)), np.ones((2, 8))), (np.zeros((2, 12)), None)],
)
def test_truth_of_another_shape_is_refused(waiting, future, known):
    with pytest.raises(DataError, match=r"expected \(2, 12, 2\) and \(2, 12\): the 2 agents observed then, 12 steps"):
        waiting.settle(3, future, known)
    assert len(waiting) == 2


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e300])
def test_truth_that_is_not_finite_is_refused_where_it_is_known(waiting, value):
    future, known = np.zeros((2, 12, 2)), np.ones((2, 12), bool)
    future[1, 6, 0] = value
    with pytest.raises(DataError, match="truth of agent 11, forecast at 3, is not finite at step 7: make known False"):
        waiting.settle(3, future, known)
    known[1, 6] = False
    assert np.isfinite(waiting.settle(3, future, known)[1].future).all()


def test_a_ledger_keeps_weights_and_is_empty_at_first():
    ledger = Outstanding(keep=True)
    assert ledger.settled == ledger.matured == ledger.censored == 0
    with pytest.raises(SpecError, match="empty"):
        ledger.read()
    clock = StreamClock([Recording(np.arange(22), np.zeros(22, np.int64), np.zeros((22, 2)), 0.4)])
    step, weights = clock.reset(), np.array([[0.3, 0.7]], np.float32)
    while len(step.observation):
        step = clock.step(Forecast(positions_for(step.identity.tolist(), clock.time), weights))
    ledger = clock.ledger
    assert (ledger.matured, ledger.censored) == (3, 12)
    forecast, _ = ledger.read()
    np.testing.assert_array_equal(forecast.weights, np.repeat(weights, 15, axis=0))
    assert len(ledger.matured_only()[0].weights) == 3
