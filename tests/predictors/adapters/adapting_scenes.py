"""Predictors and scenes for the tests of adapters."""

from __future__ import annotations

import numpy as np

from motion_gym.data.windows import pick_scenes

PAIR, STGAT = "modular_invariant", "erm_no_sigma:weights=original/zara2"
TUNED = ("finetune", "ema_anchor", "ekf")


def scenes_of(truth, scenes):
    return [pick_scenes(truth, [scene]) for scene in scenes]


def learn(adapter, scenes):
    """Let an adapter learn from scenes; return its forecast of each scene before."""
    answers = []
    for scene in scenes:
        answers.append(adapter.predict(scene.observation).positions)
        adapter.observe(scene)
    return answers


def error(adapter, truth):
    off = adapter.predict(truth.observation).positions[:, 0].astype(float) - truth.future
    return np.linalg.norm(off, axis=-1)[truth.known].mean()
