"""Weights that do not come with the installed package: their size, or the terms of their training data, forbid it.

Their cards are in the package.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from pathlib import Path

from motion_gym import catalog
from motion_gym.contract import PredictorError
from motion_gym.data.downloads import download
from motion_gym.data.known_datasets import DataFile
from motion_gym.data.storage import data_folder, digest, write_atomic
from motion_gym.training.plans import WEIGHTS

ADDRESS = "MOTION_GYM_WEIGHTS_URL"
"""Environment variable: URL of a folder that holds weights under their names, such as ``sdd/heatmap.safetensors``."""
ADD = "`motion-gym weights add --from DIR`"


def added_folder() -> Path:
    """Where ``add`` writes weights: a folder beside the data sets."""
    return data_folder() / "weights"


def left_out() -> dict[str, Path]:
    """Cards in the package whose weights are not: path of the card by the name of the weights' file, ``sdd/ROW...``."""
    cards = sorted(WEIGHTS.rglob("*.json"))
    without = [card for card in cards if not card.with_suffix(".safetensors").exists()]
    return {card.with_suffix(".safetensors").relative_to(WEIGHTS).as_posix(): card for card in without}


def add(source: Path) -> list[Path]:
    """Copy weights into the folder of added weights, from anywhere below a source folder.

    Files are found by the end of their path, such as ``sdd/heatmap.safetensors``, and must have the checksum of their
    card in the package. If a file differs, nothing is copied.

    Returns:
        The written files.

    Raises:
        PredictorError: the source is not a folder, has none of the files, or a file differs or cannot be read.
        StorageError: a file could not be written.
    """
    source = source.expanduser().absolute()
    if not source.is_dir():
        raise PredictorError(f"{source} is not a folder. Give the folder that holds the weights.")
    cards, files, wrong = left_out(), {}, []
    for path in sorted(source.rglob("*.safetensors")):
        name = next((name for name in cards if path.as_posix().endswith(f"/{name}")), None)
        if name is None or name in files:
            continue
        try:
            content = path.read_bytes()
        except OSError as error:
            raise PredictorError(f"{path} cannot be read: {error.strerror or error}. Make it readable.") from None
        expected = json.loads(cards[name].read_bytes())["sha256"]
        if digest(content) == expected:
            files[name] = content
        else:
            wrong.append(f"{path} has sha256 {digest(content)}, expected {expected}")
    if wrong:
        raise PredictorError(
            f"Nothing was copied, because {len(wrong)} of the files in {source} are damaged or of another version:\n  "
            + "\n  ".join(wrong)
            + "\nGet the weights of this version of motion-gym."
        )
    if not files:
        raise PredictorError(f"None of the weights is in {source} or below. Looked for: {', '.join(cards)}.")
    return [_write(name, cards[name], content) for name, content in files.items()]


def fetch() -> list[Path]:
    """Download the weights that are missing or of another version, from the address in ``MOTION_GYM_WEIGHTS_URL``.

    Returns:
        The written files.

    Raises:
        PredictorError: no address is set.
        DataError: a file could not be downloaded, or has not the checksum of its card. Earlier files are kept.
        StorageError: a file could not be written.
    """
    base = os.environ.get(ADDRESS, "").rstrip("/")
    if not base:
        raise PredictorError(
            f"No address of weights is known: set {ADDRESS} to the URL of a folder that holds them, or run {ADD}."
        )
    written = []
    for name, card in left_out().items():
        if not _is_here(name, card):
            file = DataFile(name, json.loads(card.read_bytes())["sha256"], 0, f"{base}/{name}")
            written.append(_write(name, card, download(file, f"If you have the weights in a folder, run {ADD}.")))
    return written


def _write(name: str, card: Path, content: bytes) -> Path:
    path = added_folder() / name
    write_atomic(path.with_suffix(".json"), card.read_bytes())
    write_atomic(path, content)
    return path


def _is_here(name: str, card: Path) -> bool:
    """Whether weights were added, and are those of a card in the package."""
    path = added_folder() / name
    return path.is_file() and digest(path.read_bytes()) == json.loads(card.read_bytes())["sha256"]


def path_of_added(name: str, row: str, weights: str) -> Path:
    """File of added weights, by the name of the file, such as ``sdd/heatmap.safetensors``.

    Args:
        name: Name of the file.
        row: Predictor, for messages.
        weights: Name of the weights, for messages.

    Raises:
        PredictorError: the file was not added, or belongs to another version of the package.
    """
    path = added_folder() / name
    if not path.is_file():
        limits = [terms.rstrip(".") for terms in terms_of([WEIGHTS / name]) if "no commercial use" in terms]
        source = "the folder motion_gym/weights of the repository"
        own = ""
        if limits:
            source = f"whoever trained them; the repository may not hold them ({limits[0]})"
            own = f" Or train your own, motion-gym train {row} --benchmark {weights}, and name the file: weights=FILE."
        raise PredictorError(
            f"The weights `{weights}` of {row} do not come with the package: get them from {source}. Then run {ADD}, "
            f"or `motion-gym weights fetch` where {ADDRESS} names an address.{own} ({path} is missing.)"
        )
    if path.with_suffix(".json").read_bytes() != (WEIGHTS / name).with_suffix(".json").read_bytes():
        raise PredictorError(
            f"{path} are weights of another version of motion-gym: get those of this version, then run {ADD} again."
        )
    return path


def terms_of(paths: Iterable[Path]) -> list[str]:
    """Terms of the data sets that weights were trained on, from their cards."""
    cards = [json.loads(path.with_suffix(".json").read_bytes()) for path in paths]
    specs = dict.fromkeys(spec for card in cards for spec in card["trained_on"])
    return list(dict.fromkeys(catalog.domain(spec).card.terms for spec in specs))
