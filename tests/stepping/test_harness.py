"""The harness passes copies to a predictor, checks its answers, and names every fault."""

import copy
import sys

import numpy as np
import pytest

from motion_gym.checks import predictor_trials as trials
from motion_gym.contract import Card, Forecast, PredictorError, SpecError
from motion_gym.data.domains import freeze
from motion_gym.data.validation import check_forecast
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.linear import Linear
from motion_gym.stepping.harness import ask, frozen, guarded, name_of, ready, tell

TRUTH = freeze(trials.synthetic((1, 2, 5), 2, seed=0))
HERE = TRUTH.observation


class Answers:
    """Gives the same answer to every observation."""

    def __init__(self, answer):
        self.answer = answer

    def predict(self, observation, samples=1, seed=0):
        return self.answer(observation, samples) if callable(self.answer) else self.answer


class Logbook:
    """Has every method, and records its calls."""

    name = "logbook"

    def __init__(self):
        self.calls, self.fitted = [], False

    def predict(self, observation, samples=1, seed=0):
        self.calls.append(("predict", samples, seed))
        return np.zeros((len(observation), samples, 12, 2), np.float32)

    def fit(self, train, validation, seed):
        self.calls.append(("fit", len(train), len(validation), seed))
        self.fitted = True

    def know(self, domain):
        self.calls.append(("know", domain))

    def reset(self):
        self.calls.append(("reset",))

    def observe(self, truth):
        self.calls.append(("observe", truth))


class Place:
    """A domain of one environment."""

    card = Card("place", {}, 0.4)

    def windows(self, split):
        return TRUTH

    def sources(self):
        return [self, self]


def forecast(observation, samples, dtype=np.float32):
    return np.ones((len(observation), samples, 12, 2), dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.float16])
@pytest.mark.parametrize("samples", [1, 20])
@pytest.mark.parametrize("wrap", [Forecast, lambda positions: positions])
def test_ask_gives_a_float32_forecast(dtype, samples, wrap):
    answer = ask(Answers(lambda o, k: wrap(forecast(o, k, dtype))), HERE, samples)
    assert answer.positions.dtype == np.float32
    assert answer.positions.shape == (len(HERE), samples, 12, 2)
    assert answer.weights is None


def test_a_deterministic_predictor_may_give_one_sample():
    assert ask(Answers(lambda o, k: forecast(o, 1)), HERE, 20).positions.shape[1] == 1


def test_samples_and_seed_are_handed_on():
    predictor = Logbook()
    ask(predictor, HERE, 7, 3)
    assert predictor.calls == [("predict", 7, 3)]


def test_nobody_is_answered_without_the_predictor():
    empty = pick_scenes(TRUTH, []).observation
    assert ask(Answers(None), empty, 5).positions.shape == (0, 5, 12, 2)


BAD = {
    "returned NoneType; return a Forecast": None,
    "returned list": [[0.0]],
    r"returned shape \(8, 12, 2\).*For one sample use positions\[:, None\]": np.zeros((8, 12, 2), np.float32),
    r"returned shape \(7, 4, 12, 2\) for 8 agents, expected \(8, 4, 12, 2\)": np.zeros((7, 4, 12, 2), np.float32),
    r"returned shape \(8, 4, 8, 2\)": np.zeros((8, 4, 8, 2), np.float32),
    r"returned shape \(8, 4, 12, 3\)": np.zeros((8, 4, 12, 3), np.float32),
    "returned 3 samples and 4 were asked for": np.zeros((8, 3, 12, 2), np.float32),
    "returned dtype int64": np.zeros((8, 4, 12, 2), np.int64),
    "returned dtype object": np.zeros((8, 4, 12, 2), object),
    "returned NaN or infinite positions for 8 of 8 agents": np.full((8, 1, 12, 2), np.nan),
    "for 8 of 8 agents, the first": np.full((8, 1, 12, 2), 1e300),
    "weights that are no numbers": Forecast(np.zeros((8, 1, 12, 2)), "many"),
    r"weights of shape \(8,\): expected \(8, 1\)": Forecast(np.zeros((8, 1, 12, 2)), np.ones(8)),
    r"weights of shape \(8, 1\): .*not negative": Forecast(np.zeros((8, 1, 12, 2)), -np.ones((8, 1))),
    r"weights of shape \(8, 1\): expected .*finite": Forecast(np.zeros((8, 1, 12, 2)), np.full((8, 1), np.inf)),
}


@pytest.mark.parametrize("message", BAD)
def test_bad_answers_are_named(message):
    pattern = rf"^Answers(\(.*\))?\.predict returned.*{message.removeprefix('returned ')}"
    with pytest.raises(PredictorError, match=pattern):
        ask(Answers(BAD[message]), HERE, 4)


def test_the_first_bad_agent_is_named():
    positions = forecast(HERE, 1)
    positions[3, 0, 5, 1] = np.inf
    with pytest.raises(PredictorError, match=r"for 1 of 8 agents, the first in row 3 \(agent 3\)"):
        ask(Answers(positions), HERE)


def test_weights_are_handed_on_as_float32():
    answer = check_forecast(Forecast(forecast(HERE, 2), [[1, 3]] * len(HERE)), HERE, 2, "x")
    np.testing.assert_array_equal(answer.weights, np.full((len(HERE), 2), [1, 3], np.float32))
    assert answer.weights.dtype == np.float32


def test_a_stored_forecast_cannot_be_changed_later():
    kept = Forecast(forecast(HERE, 1), np.ones((len(HERE), 1), np.float32))
    answer = ask(Answers(kept), HERE)
    kept.positions[:] = 7
    kept.weights[:] = 7
    assert (answer.positions == 1).all()
    assert (answer.weights == 1).all()


@pytest.mark.parametrize("column", ["history", "scene", "agent"])
def test_the_input_cannot_be_written_to(column):
    def spoil(observation, samples):
        getattr(observation, column)[...] = 0

    observation = copy.deepcopy(HERE)
    with pytest.raises(PredictorError, match="A predictor may not change its input: work on a copy"):
        ask(Answers(spoil), observation)
    np.testing.assert_array_equal(getattr(observation, column), getattr(HERE, column))


def test_frozen_is_a_copy():
    observation = copy.deepcopy(HERE)
    kept = frozen(observation)
    observation.history[:] = 0
    np.testing.assert_array_equal(kept.history, HERE.history)
    assert kept.dt == HERE.dt


def test_what_a_predictor_raises_names_it():
    def fail(observation, samples):
        return {}["key"]

    with pytest.raises(PredictorError, match=r"Answers.predict raised KeyError: 'key'") as error:
        ask(Answers(fail), HERE)
    assert isinstance(error.value.__cause__, KeyError)


def test_a_wrong_signature_is_told_the_right_one():
    class Narrow:
        def predict(self, observation):
            return forecast(observation, 1)

        def observe(self, observation, future):
            pass

    with pytest.raises(PredictorError, match=r"The signature is predict\(self, observation, samples=1, seed=0\)"):
        ask(Narrow(), HERE)
    with pytest.raises(PredictorError, match=r"observe raised TypeError.*The signature is observe\(self, truth\)\."):
        guarded(Narrow(), "observe", HERE)


def test_arithmetic_with_a_forecast_is_told_where_its_positions_are():
    class Shifts:
        def predict(self, observation, samples=1, seed=0):
            return Forecast(forecast(observation, 1)) - 0.5

    with pytest.raises(PredictorError, match="The positions of a Forecast are its array `positions`"):
        ask(Shifts(), HERE)


def test_own_errors_pass_unchanged():
    error = SpecError("as it was")

    def refuse(observation, samples):
        raise error

    with pytest.raises(SpecError) as caught:
        guarded(Answers(refuse), "predict", HERE, samples=1, seed=0)
    assert caught.value is error


def test_interrupts_pass():
    def interrupt(observation, samples):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        ask(Answers(interrupt), HERE)


def test_name():
    assert name_of(Logbook()) == "logbook"
    assert name_of(Answers(np.zeros(3))) == "Answers"
    assert name_of(Linear()) == "Linear"
    assert name_of(Linear(sigma=True, ridge=2.0)) == "Linear(sigma=True, ridge=2.0)"


def test_tell_shows_a_copy_that_cannot_be_written_to():
    predictor, truth = Logbook(), copy.deepcopy(TRUTH)
    tell(predictor, truth)
    ((_, shown),) = predictor.calls
    truth.future[:] = 0
    np.testing.assert_array_equal(shown.future, TRUTH.future)
    arrays = (shown.future, shown.known, shown.observation.history, shown.observation.agent)
    assert not any(array.flags.writeable for array in arrays)


def test_tell_nothing_to_whom_cannot_observe_or_of_nobody():
    tell(Answers(None), TRUTH)
    predictor = Logbook()
    tell(predictor, pick_scenes(TRUTH, []))
    assert predictor.calls == []


@pytest.mark.parametrize("spec", [Logbook, f"{__name__}:Logbook"])
def test_ready_fits_shows_and_resets_what_is_given_by_name(spec, monkeypatch):
    monkeypatch.setitem(sys.modules, __name__, sys.modules[Logbook.__module__])
    place = Place()
    assert ready(spec, place, seed=5).calls == [("fit", 2, 2, 5), ("know", place), ("reset",)]


def test_ready_fits_no_instance():
    place, predictor = Place(), Logbook()
    assert ready(predictor, place) is predictor
    assert predictor.calls == [("know", place), ("reset",)]


def test_ready_names_a_domain_without_sources():
    place = Place()
    place.sources = list
    with pytest.raises(SpecError, match="`place` names no domains to train on"):
        ready("linear", place)


def test_ready_names_unknown_predictors():
    with pytest.raises(SpecError, match="Did you mean `linear`"):
        ready("liner", Place())
