"""Verification by order: predictors that use later scenes of the batch are refused, and honest ones accepted."""

import gc
import os
import sys

import numpy as np
import pytest

from motion_gym import catalog
from motion_gym.contract import Forecast, Observation, PredictorError
from motion_gym.scoring.cards import is_shipped
from motion_gym.scoring.evaluation import evaluate
from tests.street import Street

PLACE = Street(frames=400)
LARGE = Street(frames=800)


def walk(observation, samples=1):
    xy = observation.xy
    ahead = np.arange(1, 13, dtype=np.float32)[:, None]
    return np.repeat((xy[:, -1, None] + ahead * (xy[:, -1] - xy[:, -2])[:, None])[:, None], samples, axis=1)


class Sampler:
    """Draws the noise of all agents of the batch from one generator."""

    def predict(self, observation, samples=1, seed=0):
        noise = np.random.default_rng(seed).normal(0, 0.1, (len(observation), samples, 12, 2))
        return (walk(observation, samples) + noise).astype(np.float32)


class ReadsLaterWindows:
    """Finds the future of an agent in the histories of later windows of the batch."""

    def __init__(self):
        self._cache = {}

    def memory(self):
        return self._cache

    def predict(self, observation, samples=1, seed=0):
        memory, positions = self.memory(), walk(observation)
        for agent in np.unique(observation.agent):
            rows = np.flatnonzero(observation.agent == agent)
            for row, later in zip(rows, rows[8:], strict=False):
                key = observation.xy[row].tobytes()
                memory[key] = np.array(observation.xy[later])
        for row, history in enumerate(observation.xy):
            if (future := memory.get(history.tobytes())) is not None:
                positions[row, 0, :8] = future
        return positions


class ReadsIntoItsClass(ReadsLaterWindows):
    """Does the same with a store in its class."""

    store: dict = {}  # noqa: RUF012

    def __init__(self):
        pass

    def memory(self):
        return self.store


@pytest.mark.parametrize("k", [1, 5])
def test_noise_that_is_drawn_for_the_batch_is_accepted_and_scored(k):
    assert LARGE.windows("test").observation.scenes > 512
    card = evaluate(Sampler(), LARGE, k=k)
    assert card.verified.startswith("scored as asked scene by scene, in the order of time, in a fresh process")
    exact = evaluate("constant_velocity", LARGE).ade.mean
    assert card.samples == k and exact < card.ade.mean < exact + 0.2


@pytest.mark.parametrize("kind", [ReadsLaterWindows, ReadsIntoItsClass])
def test_whoever_reads_later_windows_of_the_batch_is_found(kind):
    predictor = kind()
    assert evaluate(predictor, PLACE, verify=False).ade.mean < 0.8 * evaluate("constant_velocity", PLACE).ade.mean
    for _ in range(2):  # also when it remembers, in its class, what an earlier evaluation showed
        with pytest.raises(PredictorError, match="asked for that scene alone, in the order of time"):
            evaluate(predictor, PLACE)
    if kind is ReadsIntoItsClass:  # it remembers, also when it is asked one window at a time
        with pytest.raises(PredictorError, match="asked for that scene alone, in the order of time"):
            evaluate(kind(), PLACE, through="environment")
    else:
        assert "in a fresh process" in evaluate(kind(), PLACE, through="environment").verified


def test_the_predictor_of_the_caller_is_not_asked():
    predictor = ReadsLaterWindows()
    evaluate(predictor, PLACE, verify=False)
    assert predictor._cache == {}


class Plain:
    """Deterministic and honest."""

    def predict(self, observation, samples=1, seed=0):
        return Forecast(walk(observation))


def test_an_honest_predictor_is_verified():
    card = evaluate(Plain(), PLACE)
    assert card.verified == "32 scenes asked again one by one, in the order of time, in a fresh process"
    assert card.ade == evaluate("constant_velocity", PLACE).ade
    assert "verify=False" in evaluate(Plain(), PLACE, verify=False).verified
    assert "shipped" in evaluate("constant_velocity", PLACE).verified


class FailsAlone(Plain):
    """Fails in any other process than this one, to be asked again here."""

    home = os.getpid()

    def __init__(self):
        self.at = self.home

    def predict(self, observation, samples=1, seed=0):
        if os.getpid() != self.at:
            raise RuntimeError("no licence here")
        return super().predict(observation)


class EndsAlone(FailsAlone):
    """Ends any other process."""

    def predict(self, observation, samples=1, seed=0):
        if os.getpid() != self.at:
            os._exit(0)
        return super().predict(observation)


@pytest.mark.parametrize(("kind", "why"), [(FailsAlone, "no licence here"), (EndsAlone, "the process ended")])
def test_whoever_fails_in_the_fresh_process_is_refused(kind, why):
    with pytest.raises(PredictorError, match=rf"in a fresh process, one scene at a time: .*{why}.*verify=False"):
        evaluate(kind(), PLACE)


class SearchesMemory(Plain):
    """Looks for scenes that are later than one of those it is asked for."""

    def predict(self, observation, samples=1, seed=0):
        seen = [o for o in gc.get_objects() if type(o) is Observation and o.time is not None and len(o.time)]
        later = any(o.time.max() > observation.time.min() for o in seen)
        return Forecast(walk(observation) + np.float32(later))


def test_the_fresh_process_holds_no_later_scene():
    with pytest.raises(PredictorError, match="asked for that scene alone"):
        evaluate(SearchesMemory(), PLACE)


def test_a_predictor_may_print(capfd):
    class Prints(Plain):
        def predict(self, observation, samples=1, seed=0):
            print("hello")
            return super().predict(observation)

    assert "in a fresh process" in evaluate(Prints(), PLACE).verified


def test_a_class_with_the_name_of_a_shipped_module_is_verified():
    disguised = type("Linear", (Plain,), {"__module__": "motion_gym.predictors.linear"})
    assert not is_shipped(disguised())
    assert is_shipped(catalog.predictor("linear"))


class Stays(Plain):
    """Cannot be pickled."""

    def __reduce__(self):
        raise TypeError("has an open file")

    def __deepcopy__(self, memo):
        return Stays()


class StaysSampler(Sampler, Stays):
    """Cannot be pickled, and draws."""

    predict = Sampler.predict

    def __deepcopy__(self, memo):
        return StaysSampler()


@pytest.mark.parametrize("kind", [Stays, StaysSampler])
def test_whoever_cannot_travel_is_asked_here_and_the_card_says_so(kind):
    verified = evaluate(kind(), PLACE).verified
    assert (
        "in this process, where it may remember scenes, since the predictor cannot travel" in verified
        and "has an open file" in verified
    )


def test_a_predictor_of_a_script_travels(tmp_path, monkeypatch):
    (tmp_path / "helper.py").write_text("SCALE = 1\n")
    (tmp_path / "mine.py").write_text(
        "import helper, numpy as np\n"
        "class Mine:\n"
        "    def predict(self, observation, samples=1, seed=0):\n"
        "        return np.repeat(observation.xy[:, None, -1:] * helper.SCALE, 12, axis=2)\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    try:
        assert "in a fresh process" in evaluate("mine:Mine", PLACE).verified
    finally:
        for name in ("mine", "helper"):
            sys.modules.pop(name, None)


def test_a_module_that_evaluates_when_it_is_imported_starts_no_chain_of_processes(tmp_path, monkeypatch):
    (tmp_path / "at_import.py").write_text(
        "import motion_gym, numpy as np\n"
        "class Mine:\n"
        "    def predict(self, observation, samples=1, seed=0):\n"
        "        return np.repeat(observation.xy[:, None, -1:], 12, axis=2)\n"
        "motion_gym.evaluate(Mine(), 'orca:d=0.6,scenes=20')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    try:
        with pytest.raises(PredictorError, match='put what the module runs under `if __name__ == "__main__":`'):
            evaluate("at_import:Mine", PLACE)
    finally:
        sys.modules.pop("at_import", None)
