"""Online runs as files: found again if they are there, as those of ``results``."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.benchmarks import results
from motion_gym.contract import Predictor
from motion_gym.data.storage import check_writable
from motion_gym.online.evaluation import Report, evaluate_online
from motion_gym.online.streams import Stream
from motion_gym.stepping.harness import name_of
from motion_gym.training.provenance import versions

SCHEMA = "online-1"


def run(
    row: str,
    predictor: Predictor,
    of: str,
    on: Stream,
    folder: Path | None = None,
    report: Report = lambda done, of, what: None,
    **options: Any,
) -> dict[str, Any]:
    """Evaluate on a stream, or read the result of the same run from ``folder`` if it is there.

    While it runs, a checkpoint lies beside the file, from which a run that was stopped goes on.

    Args:
        row: What is done to the predictor: spec of an adapter, or another name for the row of a table.
        predictor: Who runs.
        of: Spec of the predictor that is adapted.
        on: The stream.
        folder: For one JSON file per run.
        report: As for ``evaluate_online``.
        **options: Of ``evaluate_online``.

    Returns:
        The result as in the file: ``OnlineCard.as_dict`` and where it comes from.
    """
    identity = {
        "row": row,
        "of": of,
        "predictor": name_of(predictor),
        "weights": getattr(predictor, "fingerprint", None),
        "code": results.code_of(predictor),
        "stream": on.name,
        "segments": [[label, s.start, s.stop] for label, s in zip(on.labels, on.segments, strict=True)],
        "data": _digest(on),
        "options": {key: value for key, value in sorted(options.items())},
        "motion_gym": versions()["motion-gym"],
        "motion_gym_code": results.package_code(),
    }

    def make(path: Path | None) -> dict[str, Any]:
        checkpoint = None if path is None else path.with_suffix(".checkpoint")
        if checkpoint is not None:
            check_writable(checkpoint.parent)
        card = evaluate_online(predictor, on, checkpoint=checkpoint, report=report, **options)
        return {"row": row, "of": of, **card.as_dict()}

    return results.found_or_made(folder, f"{row}--{on.name}--{of}", identity, SCHEMA, make)


def read_folder(folder: Path) -> dict[tuple[str, str, str], dict[str, Any]]:
    """Results of a folder by row, predictor and stream; of several, the one made last.

    Raises:
        DataError: one cannot be read.
    """
    found: dict[tuple[str, str, str], dict[str, Any]] = {}
    for path in sorted(folder.glob("*.json")):
        result = results.read(path, SCHEMA)
        key = result["row"], result["of"], result["stream"]
        if key not in found or found[key]["finished"] <= result["finished"]:
            found[key] = result
    return found


def _digest(on: Stream) -> str:
    """sha256 of all positions that are played."""
    digest = hashlib.sha256()
    tracks = on.clock.tracks
    for array in (tracks.tick, tracks.agent, tracks.xy):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()
