"""Verification by order: a predictor is asked again in a fresh process, one scene at a time, in the order of time.

Windows overlap: the history of a later window holds the future of an earlier window, and one batch holds all windows. A
predictor may have used the batch and may remember it. In the fresh process the predictor has the state that it had
before its first forecast, and has not seen any later scene.
"""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cloudpickle
import numpy as np

from motion_gym.contract import Forecast, Observation, PredictorError
from motion_gym.data.windows import pick_scenes_of, rows_of
from motion_gym.stepping.harness import ask, name_of

ASKED_AGAIN = 32
"""Number of scenes for which a deterministic predictor is asked again."""
TOLERANCE = 1e-4
"""Metres between the forecasts of a scene in a batch and alone, beyond the rounding of float32: a processor may choose
another order of operations for a batch."""
ANSWER = "import sys; sys.path[:] = {}; from motion_gym.scoring.verification import answer; answer(*{})"
"""Code of the fresh process."""


def keep(predictor: Any) -> tuple[Any, str]:
    """The current state of a predictor, and why it cannot be pickled; this is empty if it can.

    The state is the predictor pickled by cloudpickle, which includes the classes of a script with their class
    attributes; classes of importable modules are imported anew. If pickling fails, the state is a deep copy.
    """
    try:
        return cloudpickle.dumps(predictor), ""
    except Exception as error:  # a class of a user may raise anything
        return copy.deepcopy(predictor), f"{type(error).__name__}: {error}"


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
    forecasts, reason = _asked_in_order(kept, [pick_scenes_of(observation, [s]) for s in asked], samples, seed)
    joined = Forecast.join(forecasts)
    where = f"in this process, since the predictor cannot travel ({reason})" if reason else "in a fresh process"
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
    kept: tuple[Any, str], scenes: Sequence[Observation], samples: int, seed: int
) -> tuple[list[Forecast], str]:
    """Forecasts of scenes one by one, in a fresh process; or in this process, with the reason."""
    state, reason = kept
    if isinstance(state, bytes):
        with tempfile.TemporaryDirectory() as folder:
            questions, answers = Path(folder) / "questions", Path(folder) / "answers"
            questions.write_bytes(pickle.dumps((state, scenes, samples, seed)))
            code = ANSWER.format(sys.path, [str(questions), str(answers)])
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                return pickle.loads(answers.read_bytes()), ""
        reason = done.stderr.strip().rpartition("\n")[2][:200] or f"it ended with status {done.returncode}"
    predictor = pickle.loads(state) if isinstance(state, bytes) else state
    return [ask(predictor, scene, samples, seed) for scene in scenes], reason


def answer(questions: str, answers: str) -> None:
    """Run in the fresh process: unpickle a predictor, forecast one scene after another, and write the forecasts."""
    pickled, scenes, samples, seed = pickle.loads(Path(questions).read_bytes())
    predictor = pickle.loads(pickled)
    Path(answers).write_bytes(pickle.dumps([ask(predictor, scene, samples, seed) for scene in scenes]))
