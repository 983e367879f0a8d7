"""Errors during the last training stage of ``modular``, with and without pre-training of the style encoder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym import catalog
from motion_gym.benchmarks.studies.network_studies import REFERENCES
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import Pairs
from motion_gym.predictors.training.style_training import StyleProgram
from motion_gym.training import loop as training
from motion_gym.training import plans as training_plans
from motion_gym.training.program import Weights

VARIANTS = {"pre-trained": (100, 50, 20, 100), "not pre-trained": (100, 0, 20, 100)}
"""Epochs of the stages; the second stage pre-trains the style encoder."""
WATCHED = ("orca:d=0.1", "orca:d=0.7")
"""Domains whose validation windows are scored after each epoch, without model selection."""
SEEDS = (0, 1, 2, 3, 4)


class Watched(StyleProgram):
    """The training program of ``modular``, which also scores the watched domains after each epoch of the last stage."""

    def __init__(self, epochs: Sequence[int]):
        plan = training_plans.training("style")
        super().__init__(Modular(), *plan.data(), device=torch.device("cpu"), epochs=epochs)
        domains = [catalog.domain(spec) for spec in WATCHED]
        self.references = [Pairs.of(pick_scenes(domain.reference(), slice(0, REFERENCES))) for domain in domains]
        self.watched = [Pairs.of(domain.windows("val")) for domain in domains]
        self.errors: list[list[list[float]]] = []
        """[epochs][domains][seeds] ADE."""

    def validate(self, weights: Weights, generators: Sequence[torch.Generator]) -> Tensor:
        """ADE [M] on the validation windows of the sources; stores the ADE on each watched domain."""
        row = []
        for references, pairs in zip(self.references, self.watched, strict=True):
            code = pair_network.code(references.path, weights).mean(dim=1, keepdim=True)
            row.append(pairs.errors(pair_network.forecast(pairs.history, code, weights)).mean(dim=(1, 2)).tolist())
        self.errors.append(row)
        return super().validate(weights, generators)


def curves(report: Callable[[int, int, str], None] = lambda done, total, stage: None) -> dict[str, Any]:
    """Train both variants, and return their errors on the watched domains after each epoch of the last stage.

    Args:
        report: Called after each epoch with the number of completed epochs, the total, and the current stage.

    Returns:
        ``ade``: watched domain -> variant -> [epochs][seeds] mean ADE; ``seeds``; ``references``: number of reference
        scenes to read the style from; ``unit`` and ``dt``.
    """
    ade: dict[str, dict[str, list[list[float]]]] = {domain: {} for domain in WATCHED}
    total = sum(map(sum, VARIANTS.values()))
    done = 0
    for name, epochs in VARIANTS.items():
        program = Watched(epochs)

        def report_epoch(state: training.Progress, name: str = name, done: int = done) -> None:
            report(done + state.epoch, total, f"{name}: {state.stage}")

        training.train(program, SEEDS, report=report_epoch)
        done += sum(epochs)
        for domain, errors in zip(WATCHED, np.array(program.errors).swapaxes(0, 1), strict=True):
            ade[domain][name] = errors.tolist()
    card = catalog.domain(WATCHED[0]).card
    return {"ade": ade, "seeds": list(SEEDS), "references": REFERENCES, "unit": card.unit, "dt": card.dt}
