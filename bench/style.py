"""Seconds to train, score and refine the predictors for style shifts."""

import time
from collections.abc import Callable
from functools import partial

import torch
from machine import machine

import motion_gym
from motion_gym.benchmarks.definitions import styles
from motion_gym.predictors.adapters.refine import Refine
from motion_gym.predictors.ego import EgoModular
from motion_gym.predictors.modular import Modular, StyleErm
from motion_gym.training import plans as training_plans

EPOCHS = 3
"""Epochs of each stage that are timed, the first of each left out."""


def epochs(kind: Callable[[], StyleErm | EgoModular], whole: tuple[int, ...]) -> list[float]:
    """Best seconds of an epoch of each stage, five seeds."""
    seen: list[tuple[int, float]] = []
    short = tuple(EPOCHS for _ in whole)
    kind().fit(*DATA, range(5), epochs=short, report=lambda p: seen.append((p.epoch, p.seconds)))
    spent = [after[1] - before[1] for before, after in zip([(0, 0.0), *seen], seen, strict=False)]
    return [min(spent[stage * EPOCHS + 1 : (stage + 1) * EPOCHS]) for stage in range(len(whole))]


def timed(job: Callable[[], object]) -> float:
    began = time.perf_counter()
    job()
    return time.perf_counter() - began


if __name__ == "__main__":
    DATA = training_plans.training("style").data()
    print(f"Style shifts, 3 x 9000 scenes. {machine()}; torch {torch.__version__}, {torch.get_num_threads()} threads")
    for kind, whole, released in (
        (StyleErm, StyleErm.epochs, "230 s for one seed"),
        (partial(Modular, penalty=1), Modular.epochs, "20 minutes for one seed"),
        (EgoModular, (15,), "not in it"),
    ):
        each = epochs(kind, whole)
        total = sum(count * seconds for count, seconds in zip(whole, each, strict=True))
        per = ", ".join(f"{seconds:.2f}" for seconds in each)
        print(
            f"{kind().name}, five seeds: {per} s per epoch of each stage, so {total:.0f} s for "
            f"{'/'.join(map(str, whole))} epochs (released program: {released})"
        )
    places = [motion_gym.domain(f"orca:d={d}") for d in styles.STYLES]
    for place in places:
        place.windows("test"), place.reference()
    row = "ego_modular:weights=style"
    spent = timed(lambda: [motion_gym.evaluate(row, place, references=styles.REFERENCES) for place in places])
    print(f"scoring one seed of ego_modular on {len(places)} styles of about 4900 scenes: {spent:.2f} s")
    made = Modular(penalty=1).fit(*DATA, 0, epochs=(1, 1, 1, 1))
    refined = Refine(made, steps=3)
    refined.observe(places[0].reference())
    truth = places[0].windows("test")
    spent = timed(lambda: refined.predict(truth.observation))
    print(f"refining {truth.observation.scenes} scenes by 3 steps: {spent:.2f} s")
