"""Weights on disk: a safetensors file with all seeds and a JSON card beside it; those that ship are found by name."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors.torch import load as load_safetensors
from safetensors.torch import save as save_safetensors
from torch import Tensor

from motion_gym.catalog import suggest
from motion_gym.contract import PredictorError
from motion_gym.storage import write_atomic

SHIPPED = Path(__file__).parent / "weights"
"""Folder of the weights that come with the package: a folder for each benchmark, a file for each of its rows."""


def locate(weights: str, row: str) -> Path:
    """File of weights that were asked for by name or by path.

    Args:
        weights: Path of a ``.safetensors`` file, or name of a benchmark whose weights are shipped (``spurious``).
        row: Predictor with its settings, as ``invariant:penalty=1``.

    Raises:
        PredictorError: there is no such file.
    """
    if weights.endswith(".safetensors"):
        path = Path(weights).expanduser()
        if not path.is_file():
            raise PredictorError(f"There is no file {path}: weights are a .safetensors and a .json.")
        return path
    folder = SHIPPED / weights
    path = folder / file_name(row)
    if not path.is_file():
        names = sorted(p.parent.relative_to(SHIPPED).as_posix() for p in SHIPPED.rglob("*.safetensors"))
        if weights not in names:
            raise PredictorError(
                f"There are no weights `{weights}`: give a file that ends in .safetensors, or a name."
                f"{suggest(weights, set(names))}"
            )
        rows = sorted(p.stem.replace("-", ":", 1) for p in folder.glob("*.safetensors"))
        raise PredictorError(
            f"The weights `{weights}` have no `{row}`.{suggest(row, rows)} Train it: motion-gym train {row} "
            f"--benchmark {weights}."
        )
    return path


def file_name(row: str) -> str:
    """How the file of a predictor with its settings is called."""
    return f"{row.replace(':', '-', 1)}.safetensors"


def read(path: Path) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Tensors, as float32, and card.

    Raises:
        PredictorError: a file is missing or damaged.
    """
    try:
        content = path.read_bytes()
        tensors = {name: value.float() for name, value in load_safetensors(content).items()}
        card = json.loads(path.with_suffix(".json").read_text())
    except FileNotFoundError as error:
        raise PredictorError(f"There is no file {error.filename}: weights are a .safetensors and a .json.") from None
    except Exception as error:  # a damaged archive raises types of the library's own
        raise PredictorError(f"{path} cannot be read, it is damaged or no safetensors file: {error}.") from None
    if not isinstance(card, dict):
        raise PredictorError(f"{path.with_suffix('.json')} is no card of weights: it must hold a JSON object.")
    if card.get("sha256") != hashlib.sha256(content).hexdigest():
        raise PredictorError(f"{path} and its card, .json, do not belong together: copy or train both again.")
    return tensors, card


def write(path: Path, tensors: Mapping[str, Tensor], card: Mapping[str, Any]) -> None:
    """Write both files; tensors whose values half precision holds exactly are stored so.

    Raises:
        StorageError: a file could not be written; neither is then half written.
    """
    stored = {
        name: value.half() if bool((value.half().float() == value).all()) else value for name, value in tensors.items()
    }
    content = save_safetensors({name: value.contiguous() for name, value in stored.items()})
    card = {**card, "sha256": hashlib.sha256(content).hexdigest()}
    write_atomic(path, content)
    write_atomic(path.with_suffix(".json"), (json.dumps(card, indent=1, allow_nan=False) + "\n").encode())
