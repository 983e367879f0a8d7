"""What the pre-training of the style encoder is worth: errors during the last stage, with it and without it."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from motion_gym import benchmarks, catalog, figures, training
from motion_gym.predictors import pair_network
from motion_gym.predictors.modular import Modular
from motion_gym.predictors.pair_network import Pairs
from motion_gym.predictors.style_training import Schedule, StyleProgram
from motion_gym.predictors.weighted import Weights
from motion_gym.results import package_code, versions
from motion_gym.seed_tables import spread
from motion_gym.storage import write_atomic
from motion_gym.style_report import p_text, paired_p
from motion_gym.windows import pick_scenes

VARIANTS = {"pre-trained": (100, 50, 20, 100), "not pre-trained": (100, 0, 20, 100)}
"""Epochs of the stages; the second one pre-trains the style encoder."""
WATCHED = ("orca:d=0.1", "orca:d=0.7")
"""Domains whose validation windows are watched; nothing is selected by them."""
EPOCHS = (1, 3, 10, 30, 100)
"""Epochs of the last stage in the table."""
SEEDS = (0, 1, 2, 3, 4)
Report = Callable[[int, int, str], None]


class Watched(StyleProgram):
    """The training of ``modular``, watched after each epoch of the last stage."""

    def __init__(self, epochs: Sequence[int]):
        plan = benchmarks.training("style")
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


def curves(folder: Path, report: Report) -> dict[str, np.ndarray]:
    """ADE [epochs, watched, seeds] of each variant, metres; from ``folder``, if the same code and data made it."""
    found = {}
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
        found[name] = np.array(kept["ADE"])
    return found


def _kept(path: Path) -> dict[str, Any]:
    """What a file holds; nothing if it is not there, or damaged."""
    try:
        found = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) and "ADE" in found else {}


def write(folder: Path, report: Report) -> tuple[str, list[Path]]:
    """Table, and a figure for each watched domain in ``folder``."""
    made = curves(folder, report)
    lines = [
        "### With and without pre-training of the style encoder",
        "",
        "ADE in metres on the validation windows of a domain after so many epochs of the last stage, mean ± standard "
        f"error over {len(SEEDS)} seeds; the style is read from {benchmarks.REFERENCES} reference scenes. Both are "
        "trained with d = 0.1, 0.3 and 0.5 in the same stages, but for the second one. p: two-sided t-test of the "
        "difference in pairs of seeds.",
        "",
        f"| domain | variant | {' | '.join(map(str, EPOCHS))} |",
        f"|---|---|{'---|' * len(EPOCHS)}",
    ]
    paths = []
    for index, domain in enumerate(WATCHED):
        table = {name: values[:, index] for name, values in made.items()}
        for name, values in table.items():
            lines.append(f"| `{domain}` | {name} | {' | '.join(spread(values[e - 1]) for e in EPOCHS)} |")
        first, second = table.values()
        p = [p_text(paired_p(first[e - 1] - second[e - 1])) for e in EPOCHS]
        lines.append(f"| `{domain}` | p | {' | '.join(p)} |")
        name, parameters = catalog.parse_spec(domain)
        paths.append(folder / f"{name}_{parameters['d']}.svg")
        drawn = {name: {float(e): v for e, v in enumerate(values, 1)} for name, values in table.items()}
        figures.curves(drawn, paths[-1], "epoch of the last stage", "ADE, metres", domain, "log", EPOCHS)
    return "\n".join(lines), paths
