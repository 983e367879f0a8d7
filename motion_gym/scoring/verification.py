"""Verification by order: a predictor is asked again in a fresh process, one scene at a time, in the order of time.

Windows overlap: the history of a later window holds the future of an earlier window, and one batch holds all windows. A
predictor may have used the batch and may remember it. In the fresh process the predictor has the state that it had
before its first forecast. The process receives one scene after another, each after the forecast of the one before, so
that it holds no later scene. A predictor that remembers scenes in files is not found.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from typing import Any

import cloudpickle
import numpy as np

from motion_gym.contract import Forecast, Observation, PredictorError
from motion_gym.data.windows import pick_scenes_of, rows_of
from motion_gym.stepping.harness import ask, copied, name_of

ASKED_AGAIN = 32
"""Number of scenes for which a deterministic predictor is asked again."""
TOLERANCE = 1e-4
"""Metres between the forecasts of a scene in a batch and alone, beyond the rounding of float32: a processor may choose
another order of operations for a batch."""
ANSWER = "import sys; sys.path[:] = {}; from motion_gym.scoring.verification import answer; answer()"
"""Code of the fresh process."""


_answering: list[bool] = []
"""Not empty in a fresh process, which must not start another one."""


def keep(predictor: Any) -> tuple[Any, str]:
    """The current state of a predictor, and why it cannot be pickled; this is empty if it can.

    The state is the predictor pickled by cloudpickle, which includes the classes of a script with their class
    attributes; classes of importable modules are imported anew. If pickling fails, the state is a deep copy.

    Raises:
        PredictorError: The predictor can be neither pickled nor copied.
    """
    try:
        return cloudpickle.dumps(predictor), ""
    except Exception as error:  # a class of a user may raise anything
        return copied(predictor), f"{type(error).__name__}: {error}"


def verify_order(
    predictor: Any, kept: tuple[Any, str], observation: Observation, forecast: Forecast, samples: int, seed: int
) -> tuple[Forecast, str]:
    """Ask a predictor again, in the order of time.

    A deterministic predictor is asked again for some scenes, and must forecast them as in the batch. A stochastic
    predictor may draw its noise for the whole batch, so that its forecasts cannot be compared: it is asked again for
    every scene, and these forecasts are scored.

    Args:
        predictor: The predictor that forecast the batch.
        kept: Its state before that, from ``keep``.
        observation: The batch.
        forecast: Its forecast of the batch.
        samples: K.
        seed: Seed of the samples.

    Returns:
        The forecast to score, and how it was verified.

    Raises:
        PredictorError: Forecasts in the order of time differ from those of the batch.
    """
    time = np.arange(observation.scenes) if observation.time is None else observation.time
    in_order = np.argsort(time, kind="stable")
    # Without a seed, so that no predictor can know which scenes are compared.
    chosen = np.random.default_rng().choice(len(in_order), min(ASKED_AGAIN, len(in_order)), replace=False)
    some = in_order[np.sort(chosen)]
    few = pick_scenes_of(observation, some)
    one, other = (ask(predictor, few, samples, s) for s in (seed, seed + 1 if seed < 2**62 else 0))
    stochastic = one.positions.shape != other.positions.shape or not np.allclose(
        one.positions, other.positions, rtol=0, atol=TOLERANCE
    )
    asked = in_order if stochastic else some
    forecasts, reason = _asked_in_order(
        predictor, kept, [pick_scenes_of(observation, [s]) for s in asked], samples, seed
    )
    joined = Forecast.join(forecasts)
    where = (
        f"in this process, where it may remember scenes, since the predictor cannot travel ({reason})"
        if reason
        else "in a fresh process"
    )
    rows = rows_of(observation, asked)
    if stochastic:
        return joined.take(np.argsort(rows)), f"scored as asked scene by scene, in the order of time, {where}"
    batch = forecast.take(rows)
    limit = TOLERANCE + 4 * np.finfo(np.float32).eps * np.abs(observation.xy[rows]).max(axis=(1, 2))
    same = batch.positions.shape == joined.positions.shape
    off = np.abs(batch.positions - joined.positions).max(axis=(1, 2, 3)) if same else np.full(len(rows), np.inf)
    if (off > limit).any():
        raise PredictorError(
            f"{name_of(predictor)} forecasts a scene differently if it is asked for that scene alone, in the order of "
            f"time (by up to {off.max():.3f} m). The batch holds overlapping windows, and with them the future: "
            "forecast every scene from its own history, or score with through='environment'."
        )
    return forecast, f"{len(asked)} scenes asked again one by one, in the order of time, {where}"


def _asked_in_order(
    predictor: Any, kept: tuple[Any, str], scenes: Sequence[Observation], samples: int, seed: int
) -> tuple[list[Forecast], str]:
    """Forecasts of scenes one by one, in a fresh process; or in this process, if the predictor cannot travel, and why.

    Raises:
        PredictorError: the predictor fails in the fresh process.
    """
    if _answering:
        raise PredictorError(
            f"{name_of(predictor)} is scored while its module is imported anew, to verify it: put what the module runs "
            'under `if __name__ == "__main__":`.'
        )
    state, reason = kept
    if isinstance(state, bytes):
        with tempfile.TemporaryFile() as said:
            command = [sys.executable, "-c", ANSWER.format(sys.path)]
            with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said) as process:
                try:
                    reason = _told(process, (state, samples, seed))
                    if not reason:
                        return [_told(process, scene) for scene in scenes], ""
                except (OSError, EOFError, pickle.UnpicklingError, PredictorError) as error:
                    process.kill()
                    process.wait()
                    said.seek(0)
                    last = said.read().decode(errors="replace").strip().rpartition("\n")[2]
                    why = str(error) if isinstance(error, PredictorError) else last[:200] or "the process ended"
                    raise PredictorError(
                        f"{name_of(predictor)} fails when it is asked again in a fresh process, one scene at a time: "
                        f"{why.rstrip('.')}. Let it need nothing but its own state; verify=False scores it without "
                        "this check, and the score says so."
                    ) from None
    copied = pickle.loads(state) if isinstance(state, bytes) else state
    return [ask(copied, scene, samples, seed) for scene in scenes], reason


def _told(process: subprocess.Popen[bytes], message: Any) -> Any:
    """The answer of the fresh process to a message; an exception that it answers is raised."""
    assert process.stdin is not None and process.stdout is not None
    pickle.dump(message, process.stdin)
    process.stdin.flush()
    reply = pickle.load(process.stdout)
    if isinstance(reply, Exception):
        raise reply
    return reply


def answer() -> None:
    """Run in the fresh process: unpickle a predictor, and forecast each scene that arrives before the next arrives.

    The first message holds the predictor, K and the seed; the reply is why the predictor cannot be unpickled, or empty.
    """
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what the predictor prints is no reply
    state, samples, seed = pickle.load(sys.stdin.buffer)
    _answering.append(True)
    predictor: Any = None
    reply: Any = ""
    try:
        predictor = pickle.loads(state)
    except PredictorError as error:
        reply = PredictorError(str(error))
    except Exception as error:  # a class of a user may raise anything
        reply = f"{type(error).__name__}: {error}"[:200]
    while True:
        pickle.dump(reply, replies)
        replies.flush()
        try:
            scene = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            reply = ask(predictor, scene, samples, seed)
        except PredictorError as error:
            reply = PredictorError(str(error))
