"""Errors during the last stage of ``modular``, after a pre-training of its style encoder and without."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym import catalog
from motion_gym.benchmarks.studies import REFERENCES
from motion_gym.data.windows import pick_scenes
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.networks import pair_network
from motion_gym.predictors.networks.pair_network import Pairs
from motion_gym.predictors.training.style_training import StyleProgram
from motion_gym.training import loop as training
from motion_gym.training import plans as training_plans
from motion_gym.training.program import Weights

VARIANTS = {"pre-trained": (100, 50, 20, 100), "not pre-trained": (100, 0, 20, 100)}
"""Epochs of the stages; the second one pre-trains the style encoder."""
WATCHED = ("orca:d=0.1", "orca:d=0.7")
"""Domains whose validation windows are watched; nothing is selected by them."""
SEEDS = (0, 1, 2, 3, 4)


class Watched(StyleProgram):
    """The training of ``modular``, watched after each epoch of the last stage."""

    def __init__(self, epochs: Sequence[int]):
        plan = training_plans.training("style")
        super().__init__(Modular(), *plan.data(), device=torch.device("cpu"), epochs=epochs)
        places = [catalog.domain(spec) for spec in WATCHED]
        self.shown = [Pairs.of(pick_scenes(place.reference(), slice(0, REFERENCES))) for place in places]
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


def curves(report: Callable[[int, int, str], None] = lambda done, of, what: None) -> dict[str, Any]:
    """Train both variants, and return their errors on the watched domains after each epoch of the last stage.

    Args:
        report: Called after each epoch with the number of epochs done, of all, and what is trained.

    Returns:
        ``ade``: watched domain -> variant -> [epochs][seeds] mean ADE; ``seeds``; ``references``: reference scenes that
        the style is read from; ``unit`` and ``dt``.
    """
    ade: dict[str, dict[str, list[list[float]]]] = {domain: {} for domain in WATCHED}
    total = sum(map(sum, VARIANTS.values()))
    done = 0
    for name, epochs in VARIANTS.items():
        program = Watched(epochs)

        def tell(state: training.Progress, name: str = name, done: int = done) -> None:
            report(done + state.epoch, total, f"{name}: {state.stage}")

        training.train(program, SEEDS, report=tell)
        done += sum(epochs)
        for domain, errors in zip(WATCHED, np.array(program.seen).swapaxes(0, 1), strict=True):
            ade[domain][name] = errors.tolist()
    card = catalog.domain(WATCHED[0]).card
    return {"ade": ade, "seeds": list(SEEDS), "references": REFERENCES, "unit": card.unit, "dt": card.dt}
