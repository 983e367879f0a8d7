"""Scenes that a predictor observes before it is scored: shots of the training split, and reference scenes."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from motion_gym.contract import Domain, SpecError, Truth
from motion_gym.data.overlap import shared_people
from motion_gym.data.windows import pick_scenes
from motion_gym.stepping.harness import name_of, tell, tune, windows_of_domain

OPTIONS = {"reference": "references", "train": "shots"}
"""Splits that a predictor observes, with the option that gives the number of scenes."""


def show_shots(predictor: Any, domain: Domain, split: str, shots: int, protocol: str) -> None:
    """Tune the predictor on the first scenes of the training split, and let it observe them under ``honest``.

    Under ``paper``, ``tune`` also gets the validation split, to select by.

    Raises:
        SpecError: The training split has scored people, or fewer scenes.
    """
    if getattr(type(domain), "tests_on_train", False):
        raise SpecError(
            f"`shots={shots}`: the training split of {domain.card.name} is cut from the scored recording, so "
            "it holds the future. Use `references`, or a domain whose splits are apart, as orca."
        )
    few = first_scenes(domain, "train", shots)
    refuse_shared(predictor, domain, "train", split)
    if hasattr(predictor, "tune"):
        validation = None
        if protocol == "paper":
            refuse_shared(predictor, domain, "val", split)
            validation = windows_of_domain(domain, "val")
        tune(predictor, few, validation)
    if protocol == "honest":
        tell(predictor, few)


def show_references(
    predictor: Any, domain: Domain, split: str, references: int | None, draws: int
) -> tuple[list[Any], int]:
    """Let copies of the predictor observe reference scenes, one copy for each draw.

    The first draw is the first scenes of the domain. If all scenes are observed, there is one draw.

    Returns:
        The predictors, and the number of scenes that each has observed.
    """
    refuse_shared(predictor, domain, "reference", split)
    windows = windows_of_domain(domain, "reference")
    number = windows.observation.scenes if references is None else references
    chosen = [first_scenes(domain, "reference", number)]
    if 0 < number < windows.observation.scenes:
        rng = np.random.default_rng(0)
        others = (np.sort(rng.choice(windows.observation.scenes, number, replace=False)) for _ in range(draws - 1))
        chosen += [pick_scenes(windows, scenes) for scenes in others]
    predictors = [predictor, *(copy.deepcopy(predictor) for _ in chosen[1:])]
    for each, scenes in zip(predictors, chosen, strict=True):
        tell(each, scenes)
    return predictors, number


def first_scenes(domain: Domain, split: str, most: int) -> Truth:
    """The first scenes of a split; SpecError if it has fewer."""
    windows = windows_of_domain(domain, split)
    if most > windows.observation.scenes:
        kind = "training" if split == "train" else split
        raise SpecError(
            f"`{OPTIONS[split]}={most}`: {domain.card.name} has {windows.observation.scenes} {kind} scenes. Ask for at "
            "most as many."
        )
    return pick_scenes(windows, slice(0, most))


def refuse_shared(predictor: Any, domain: Any, shown: str, scored: str) -> None:
    """Raise SpecError if an observed split has people of the scored split at the same time."""
    people = domain.kept(
        f"people of {shown} in {scored}", lambda: shared_people(domain.recordings(shown), domain.recordings(scored))
    )
    if people:
        raise SpecError(
            f"{name_of(predictor)} is shown scenes of split `{shown}`, and {people} of their people are in split "
            f"`{scored}` at the same time: observed scenes cannot be scored. Score another split, or "
            "cut the recordings of the two splits from other frames."
        )
