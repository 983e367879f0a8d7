"""A run that was stopped goes on to the same result."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import motion_gym as mg
from motion_gym import catalog
from motion_gym.contract import SpecError
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
    with pytest.raises(SpecError, match=r"is no checkpoint of an online run \(.*\): delete it"):
        run(on=first)
