"""A stopped run continues to the same result."""

from __future__ import annotations

import contextlib
import hmac
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.contract import PredictorError, SpecError
from motion_gym.online import checkpoints
from motion_gym.online import evaluation as online
from motion_gym.online.evaluation import evaluate_online
from motion_gym.online.streams import Segment, Stream, stream
from tests.bias import Bias
from tests.street import Street
from tests.taped import alike, fitted_linear

CROWD = "orca:d=0.3,scenes=6"
STREET = Street(frames=140)
SOURCE = "modular_invariant"
PLAIN = "constant_velocity"


class Stopped(Exception):
    pass


@pytest.mark.parametrize(
    ("adapter", "of", "options"),
    [
        ("kalman", None, {"labels": "stepwise"}),
        ("kalman", None, {"scope": "place", "realtime": True, "cost": 1.3}),
        (Bias, PLAIN, {"scope": "agent"}),
        ("finetune", SOURCE, {}),
    ],
)
def test_a_run_that_was_stopped_goes_on_to_the_same_result(tmp_path, monkeypatch, adapter, of, options):
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)
    path, stops, made = tmp_path / "run.checkpoint", [], catalog.adapter(adapter, of or fitted_linear())
    on = CROWD if of == SOURCE else stream([STREET, Street(frames=140, seed=1)], "recurring", 60)

    def stop(done, of, what):
        assert done >= max(stops, default=0)
        if done > max(stops, default=0):
            stops.append(done)
            raise Stopped

    whole, again = evaluate_online(made, on, **options), None
    while again is None:
        with contextlib.suppress(Stopped):
            again = evaluate_online(made, on, checkpoint=path, report=stop, **options)
    assert alike(again) == alike(whole) and not path.exists()
    assert stops == list(range(50, len(times_of(on)), 50))


def times_of(on):
    return (on if isinstance(on, Stream) else stream(on)).clock.times


KILLED = """
import os, signal, sys
from motion_gym import catalog
from motion_gym.online import evaluation as online
online.SAVED_EVERY = 0.0
def report(done, of, what):
    if done:
        os.kill(os.getpid(), signal.SIGKILL)
path, adapter, of, on = sys.argv[1:]
online.evaluate_online(catalog.adapter(adapter, of), on, checkpoint=online.Path(path), report=report)
"""


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL on this system")
def test_a_run_that_was_killed_goes_on_to_the_same_result(tmp_path):
    path = tmp_path / "run.checkpoint"
    names, begun = ("tests.bias:Bias", PLAIN, "tests.street:Street:frames=140"), []
    root = Path(__file__).resolve().parents[2]
    arguments = [sys.executable, "-c", KILLED, str(path), *names]
    done = subprocess.run(arguments, cwd=root, env={**os.environ}, capture_output=True, timeout=100, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr.decode()
    made, on = catalog.adapter(*names[:2]), names[2]
    again = evaluate_online(made, on, checkpoint=path, report=lambda done, *_: begun.append(done))
    assert begun[0] > 0 and alike(again) == alike(evaluate_online(made, on))


def test_a_checkpoint_of_another_run_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)
    path, made = Path(tmp_path / "run.checkpoint"), Bias(mg.predictor(PLAIN))

    def stop(done, of, what):
        if done:
            raise Stopped

    def run(predictor=made, on=None, **options):
        part = stream(STREET) if on is None else on
        evaluate_online(predictor, part, checkpoint=path, report=stop, **options)

    first, second = (Stream([Segment(STREET, start, start + 70)]) for start in (0, 70))
    with pytest.raises(Stopped):
        run(on=first)
    others = [{"on": second}, {"on": first, "labels": "stepwise"}, {"on": first, "realtime": True, "cost": 1.0}]
    for other in [*others, {"on": first, "predictor": Bias(mg.predictor(PLAIN), 0.1)}, {"on": first, "seed": 1}]:
        with pytest.raises(SpecError, match="is the checkpoint of another run: delete it, or choose another file"):
            run(**other)
    path.write_bytes(b"nothing")
    with pytest.raises(SpecError, match=r"is no checkpoint of an online run: delete it"):
        run(on=first)


def stopped(path, monkeypatch, predictor, on=STREET):
    """Start a run, and stop it once its checkpoint exists."""
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)

    def stop(done, of, what):
        if done:
            raise Stopped

    with contextlib.suppress(Stopped):
        evaluate_online(predictor, on, checkpoint=path, report=stop)
    assert path.exists()


class Fixed:
    """Forecasts a stored array, which is no part of its name or settings."""

    name = "fixed"

    def __init__(self, value):
        self.table = {"positions": np.full((1, 1, 12, 2), value, np.float32)}

    def predict(self, observation, samples=1, seed=0):
        return np.repeat(self.table["positions"], len(observation), axis=0)


def test_a_checkpoint_continues_no_predictor_of_another_state(tmp_path, monkeypatch):
    path = tmp_path / "run.checkpoint"
    stopped(path, monkeypatch, Fixed(0.0))
    with pytest.raises(SpecError, match="is the checkpoint of another run"):
        evaluate_online(Fixed(1.0), STREET, checkpoint=path)
    expected = evaluate_online(Fixed(0.0), STREET)
    assert alike(evaluate_online(Fixed(0.0), STREET, checkpoint=path)) == alike(expected)


def test_a_checkpoint_continues_no_stream_of_other_data(tmp_path, monkeypatch):
    path, other = tmp_path / "run.checkpoint", Street(frames=140)
    stopped(path, monkeypatch, PLAIN)
    other.recordings("test")[0].xy[-1] += 1.0
    with pytest.raises(SpecError, match="is the checkpoint of another run"):
        evaluate_online(PLAIN, other, checkpoint=path)


class Planted:
    """Runs code when it is unpickled."""

    def __reduce__(self):
        return os.mkdir, (os.environ["PLANTED"],)


@pytest.mark.parametrize("how", ["pickle", "marked", "signed by another", "changed", "no key"])
def test_nothing_is_unpickled_that_this_user_did_not_write(tmp_path, monkeypatch, how):
    path, made = tmp_path / "run.checkpoint", tmp_path / "made"
    monkeypatch.setenv("PLANTED", str(made))
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "cache"))
    stopped(path, monkeypatch, PLAIN)
    payload, content = pickle.dumps(Planted()), path.read_bytes()
    key = tmp_path / "cache" / "checkpoint.key"
    assert key.stat().st_mode & 0o777 == 0o600 and len(key.read_bytes()) == 32
    mark, signature = content[: len(checkpoints.MARK)], content[len(checkpoints.MARK) : checkpoints.SIGNED]
    planted = {
        "pickle": payload,
        "marked": mark + signature + payload,
        "signed by another": mark + hmac.digest(b"k" * 32, payload, "sha256") + payload,
        "changed": content[:-1] + bytes([content[-1] ^ 1]),
        "no key": mark + hmac.digest(key.read_bytes(), payload, "sha256") + payload,
    }
    path.write_bytes(planted[how])
    if how == "no key":
        key.unlink()
    with pytest.raises(SpecError, match="delete it"):
        evaluate_online(PLAIN, STREET, checkpoint=path)
    assert not made.exists()


def test_a_key_that_others_can_read_is_not_trusted(tmp_path, monkeypatch):
    monkeypatch.setenv("MOTION_GYM_CACHE", str(tmp_path / "cache"))
    path = tmp_path / "run.checkpoint"
    stopped(path, monkeypatch, PLAIN)
    (tmp_path / "cache" / "checkpoint.key").chmod(0o644)
    with pytest.raises(SpecError, match=r"cannot be trusted: .*checkpoint.key must belong to this user"):
        evaluate_online(PLAIN, STREET, checkpoint=path)


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), PermissionError(13, "Permission denied")])
def test_a_checkpoint_that_cannot_be_written_is_warned_about_once_and_the_run_goes_on(tmp_path, monkeypatch, error):
    monkeypatch.setattr(online, "SAVED_EVERY", 0.0)

    def full(*arguments, **keywords):
        raise error

    monkeypatch.setattr("os.fsync", full)
    with pytest.warns(RuntimeWarning, match=f"The run goes on, .*{error.strerror}") as warned:
        card = evaluate_online(PLAIN, STREET, checkpoint=tmp_path / "run.checkpoint")
    assert len(warned) == 1 and alike(card) == alike(evaluate_online(PLAIN, STREET))
    assert not list(tmp_path.iterdir())


class Remembers:
    """Stores the future in its class, and forecasts it in the next run."""

    memory: ClassVar[dict] = {}

    def __init__(self):
        self.updates = 0

    def predict(self, observation, samples=1, seed=0):
        known = [self.memory.get((int(observation.time[0]), int(a))) for a in observation.agent]
        return np.array([np.zeros((1, 12, 2)) if k is None else k[None] for k in known], np.float32)

    def observe(self, truth):
        seen, self.updates = truth.observation, self.updates + 1
        for agent, time, future in zip(seen.agent, seen.time[seen.scene_index], truth.future, strict=True):
            type(self).memory[int(time), int(agent)] = future

    def reset(self):
        pass


class RemembersElsewhere(Remembers):
    """Stores the future in a new attribute of the class of an object that it holds."""

    class Store:
        pass

    def __init__(self):
        super().__init__()
        self.store = self.Store()

    @property
    def memory(self):
        return getattr(self.Store, "late", {})

    def observe(self, truth):
        self.updates += 1
        seen = truth.observation
        keys = zip(seen.time[seen.scene_index].tolist(), seen.agent.tolist(), strict=True)
        self.Store.late = {**self.memory, **dict(zip(keys, truth.future, strict=True))}


@pytest.mark.parametrize("kind", [Remembers, RemembersElsewhere])
def test_memory_in_a_class_is_refused_each_time_and_does_not_outlive_the_run(kind):
    for _ in range(2):
        with pytest.raises(PredictorError, match=r"remembers in its class: \w+\.(memory|late) changed .*in the object"):
            evaluate_online(kind(), STREET)
        assert not kind().memory
