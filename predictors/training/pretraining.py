"""Errors during the last stage of ``modular``, after a pre-training of its style encoder and without."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym import catalog
from motion_gym.benchmarks import shipped as benchmarks
from motion_gym.benchmarks.results import package_code, versions
from motion_gym.data.storage import write_atomic
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import Pairs
from motion_gym.predictors.training.style_training import Schedule, StyleProgram
from motion_gym.predictors.weighted import Weights
from motion_gym.training import loop as training
from motion_gym.training import plans as training_plans

VARIANTS = {"pre-trained": (100, 50, 20, 100), "not pre-trained": (100, 0, 20, 100)}
"""Epochs of the stages; the second one pre-trains the style encoder."""
WATCHED = ("orca:d=0.1", "orca:d=0.7")
"""Domains whose validation windows are watched; nothing is selected by them."""
SEEDS = (0, 1, 2, 3, 4)


class Watched(StyleProgram):
    """The training of ``modular``, watched after each epoch of the last stage."""

    def __init__(self, epochs: Sequence[int]):
        plan = training_plans.training("style")
        made = Modular()
        super().__init__(*plan.data(), made.objective, Schedule(tuple(epochs)), torch.device("cpu"), {})
        places = [catalog.domain(spec) for spec in WATCHED]
        self.shown = [Pairs.of(pick_scenes(place.reference(), slice(0, benchmarks.REFERENCES))) for place in places]
        self.watched = [Pairs.of(place.windows("val")) for place in places]
        self.seen: list[list[list[float]]] = []

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] on the validation windows of the sources; that on each watched domain is kept."""
        row = []
        for shown, pairs in zip(self.shown, self.watched, strict=True):
            code = pair_network.code(shown.path, weights).mean(dim=1, keepdim=True)
            row.append(pairs.errors(pair_network.forecast(pairs.history, code, weights)).mean(dim=(1, 2)).tolist())
        self.seen.append(row)
        return super().validate(weights, generators)


def curves(folder: Path, report: Callable[[int, int, str], None]) -> dict[str, dict[str, np.ndarray]]:
    """ADE [epochs, seeds] by watched domain and variant, metres; trained anew unless ``folder`` has it.

    Args:
        folder: For one JSON file per variant; one that the same code and data made is read.
        report: Called after each epoch with the number of epochs done, of all, and what is trained.
    """
    found: dict[str, dict[str, np.ndarray]] = {domain: {} for domain in WATCHED}
    total = sum(map(sum, VARIANTS.values()))
    done = 0
    for name, epochs in VARIANTS.items():
        path = folder / f"{name.replace(' ', '_')}.json"
        program = Watched(epochs)
        made = {
            "epochs": list(epochs),
            "seeds": list(SEEDS),
            "watched": list(WATCHED),
            "training": json.loads(json.dumps(program.config)),
            "versions": versions(),
            "motion_gym_code": package_code(),
        }
        kept = _kept(path)
        if {**kept, "ADE": None} != {**made, "ADE": None}:

            def tell(state: training.Progress, name: str = name, done: int = done) -> None:
                report(done + state.epoch, total, f"{name}: {state.stage}")

            training.train(program, SEEDS, report=tell)
            kept = {**made, "ADE": program.seen}
            write_atomic(path, (json.dumps(kept) + "\n").encode())
        done += sum(epochs)
        for domain, errors in zip(WATCHED, np.array(kept["ADE"]).swapaxes(0, 1), strict=True):
            found[domain][name] = errors
    return found


def _kept(path: Path) -> dict[str, Any]:
    """What a file holds; nothing if it is not there, or damaged."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and "ADE" in found else {}
