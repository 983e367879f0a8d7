"""Choosing a setting on the sources alone: fit to all source domains but one, score on the one left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.report import number
from motion_gym.contract import Domain
from motion_gym.data.domains import spec_of, training_set
from motion_gym.metrics.errors import score
from motion_gym.stepping.harness import ask


def left_out(rows: Sequence[str], domain: Domain) -> dict[str, dict[str, float]]:
    """ADE at k = 1 on the validation windows of each source, by predictors fitted to the train windows of the others.

    Nothing of the domain itself is looked at but what its sources are.

    Args:
        rows: Specs of predictors that are fitted in closed form.
        domain: The domain that they are to be tested on later.

    Returns:
        ADE in metres by row, then by the source left out; ``mean`` is that over the sources.
    """
    sources = domain.sources()  # type: ignore[attr-defined]
    train, validation = training_set(domain)
    found: dict[str, dict[str, float]] = {}
    for row in rows:
        errors = {}
        for out, source in enumerate(sources):
            made = catalog.predictor(row)
            others = [[truth for i, truth in enumerate(part) if i != out] for part in (train, validation)]
            made.fit(*others, 0)  # type: ignore[attr-defined]
            held = validation[out]
            errors[spec_of(source)] = float(np.mean(score(ask(made, held.observation), held)["ADE"]))
        found[row] = {**errors, "mean": float(np.mean(list(errors.values())))}
    return found


def markdown(found: dict[str, dict[str, float]]) -> str:
    """A table of it, the chosen row marked."""
    columns = list(next(iter(found.values())))
    best = min(found, key=lambda row: found[row]["mean"])
    lines = [
        "### A setting chosen on the sources alone",
        "",
        "ADE in metres, k = 1, on the validation windows of one source, after fitting to the train windows of the "
        "others (each place comes with its own alpha, so that leaving out a place leaves out an alpha).",
        "",
        f"| setting | {' | '.join(columns)} | |",
        f"|---|{'---|' * len(columns)}---|",
    ]
    for row, errors in found.items():
        cells = " | ".join(number(errors[column]) for column in columns)
        lines.append(f"| `{row}` | {cells} | {'chosen' if row == best else ''} |")
    return "\n".join(lines)
