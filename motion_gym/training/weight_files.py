"""Weights on disk: a safetensors file with the weights of all seeds, and a JSON card. Shipped weights have names."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors
from torch import Tensor

from motion_gym.contract import PredictorError
from motion_gym.data.storage import StorageError, atomic_file, digest, write_atomic
from motion_gym.specs import suggest
from motion_gym.training import added_weights
from motion_gym.training.plans import WEIGHTS

SHIPPED = WEIGHTS
"""Folder of the shipped weights and their cards: a folder for each benchmark, a file for each of its rows."""


def locate(weights: str, row: str) -> Path:
    """File of weights, by name or path; shipped weights that are not in the package are those that were added.

    Args:
        weights: Path of a ``.safetensors`` file, or name of a benchmark with shipped weights (``spurious``).
        row: Predictor with its settings, such as ``invariant:penalty=1``.

    Raises:
        PredictorError: there is no such file, or it must be added first.
    """
    if weights.endswith(".safetensors"):
        path = Path(os.path.expanduser(weights))
        if not path.is_file():
            raise PredictorError(f"There is no file {path}: weights are a .safetensors and a .json.")
        return path
    path = shipped(weights, row)
    return path if path.is_file() else added_weights.path_of_added(path.relative_to(SHIPPED).as_posix(), row, weights)


def shipped(weights: str, row: str) -> Path:
    """Path of shipped weights in the package. Their card is there, even where the weights must be added.

    Raises:
        PredictorError: no such weights ship.
    """
    names = {p.parent.relative_to(SHIPPED).as_posix() for p in SHIPPED.rglob("*.json")}
    if weights not in names:
        raise PredictorError(
            f"There are no weights `{weights}`: give a file that ends in .safetensors, or a name."
            f"{suggest(weights, names)}"
        )
    path = SHIPPED / weights / file_name(row)
    if not path.with_suffix(".json").is_file():
        rows = [p.stem.replace("-", ":", 1) for p in path.parent.glob("*.json")]
        raise PredictorError(
            f"The weights `{weights}` have no `{row}`.{suggest(row, rows)} Train it: motion-gym train {row} "
            f"--benchmark {weights}."
        )
    return path


def file_name(row: str) -> str:
    """File name of the weights of a predictor with its settings."""
    return f"{row.replace(':', '-', 1)}.safetensors"


def read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """The tensors, as float32, and the card.

    Raises:
        PredictorError: a file is missing or damaged.
    """
    content, card = _content(path), read_card(path)
    try:
        tensors = {name: value.float() for name, value in load_safetensors(content).items()}
    except Exception as error:  # safetensors raises its own types
        raise PredictorError(f"{path} cannot be read, it is damaged or no safetensors file: {error}.") from None
    if card.get("sha256") != digest(content):
        raise PredictorError(f"{path} and its card, .json, do not belong together: copy or train both again.")
    return tensors, card


def read_card(path: Path) -> dict[str, Any]:
    """The card of a file of weights.

    Raises:
        PredictorError: it is missing or damaged.
    """
    return _checked_card(path.with_suffix(".json"), _content(path.with_suffix(".json")))


def _content(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = "There is no file" if isinstance(error, FileNotFoundError) else f"{error.strerror}:"
        raise PredictorError(f"{reason} {error.filename}: weights are a .safetensors and a .json.") from None


def _checked_card(path: Path, text: bytes) -> dict[str, Any]:
    try:
        card = json.loads(text)
    except ValueError as error:
        raise PredictorError(f"{path} cannot be read, it is damaged or no JSON file: {error}.") from None
    if not isinstance(card, dict):
        raise PredictorError(f"{path} is not a card of weights: it must hold a JSON object.")
    seeds, names = card.get("seeds", []), card.get("trained_on", [])
    integers = isinstance(seeds, list) and all(isinstance(seed, int) for seed in seeds)
    if not integers or len(set(seeds)) < len(seeds):
        raise PredictorError(f"{path}: `seeds` is {seeds!r}, and must be a list of different whole numbers.")
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise PredictorError(f"{path}: `trained_on` is {names!r}, and must be a list of names.")
    for key in ("selection", "predictor"):
        if not isinstance(card.get(key, ""), str):
            raise PredictorError(f"{path}: `{key}` is {card[key]!r}, and must be text.")
    return card


def write(path: Path, tensors: Mapping[str, Tensor], card: Mapping[str, Any]) -> None:
    """Write both files. Tensors whose values are exact in half precision are stored in half precision.

    Raises:
        StorageError: a file could not be written; the existing files are unchanged.
    """
    if path.suffix == ".json":
        raise StorageError(f"{path} is where the card goes: let the weights end in .safetensors. Nothing was written.")
    stored = {
        name: value.half() if bool((value.half().float() == value).all()) else value for name, value in tensors.items()
    }
    content = save_safetensors({name: value.contiguous() for name, value in stored.items()})
    try:
        text = json.dumps({**card, "sha256": digest(content)}, indent=1, allow_nan=False)
    except (TypeError, ValueError) as error:
        raise StorageError(f"The card of {path} cannot be written as JSON: {error}. Nothing was written.") from None
    # The weights are replaced only after the card is written.
    with atomic_file(path) as file:
        file.write(content)
        write_atomic(path.with_suffix(".json"), f"{text}\n".encode())


def check_shapes(tensors: Mapping[str, Tensor], expected: Mapping[str, tuple[int, ...]], source: str) -> None:
    """Raise PredictorError unless tensors are finite and have the expected names and shapes.

    Args:
        tensors: Weights [M, ...] of M models.
        expected: Shape of each weight, without the model axis.
        source: Origin of the weights, for messages.
    """
    shapes = {key: tuple(value.shape[1:]) for key, value in tensors.items() if value.ndim}
    if shapes.keys() != expected.keys():
        lacking, unknown = sorted(expected.keys() - shapes.keys()), sorted(shapes.keys() - expected.keys())
        raise PredictorError(
            f"{source} has the weights of another model: it lacks {lacking or 'nothing'}, and has "
            f"{unknown or 'nothing'} in addition."
        )
    models = {len(value) for value in tensors.values()}
    if len(models) != 1 or 0 in models:
        raise PredictorError(
            f"{source}: tensors are of {sorted(models)} models; all must be of the same number, 1 or more."
        )
    for key, shape in expected.items():
        if shapes[key] != shape:
            raise PredictorError(
                f"{source}: {key} has shape {shapes[key]}, expected {shape}: these are weights for other inputs, such "
                "as with or without sigma."
            )
        if not torch.isfinite(tensors[key]).all():
            raise PredictorError(f"{source}: {key} has values that are not finite: the weights are damaged.")
