"""Files of every kind that is read, with bytes that are changed at random."""

from __future__ import annotations

import bz2
import contextlib
import gzip
import io
import json
import lzma
import os
import random
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

import motion_gym
from motion_gym.benchmarks import store
from motion_gym.benchmarks.page import scenes
from motion_gym.contract import MotionGymError
from motion_gym.data.scene_images import check_image
from motion_gym.data.sdd_files import read_annotations
from motion_gym.data.storage import cached_arrays
from motion_gym.specs import parse_spec
from motion_gym.training import weight_files
from tests.hostile import run_named
from tests.walks import walk_rows

ROWS = walk_rows(people=3, frames=300, every=10)
CSV = "frame,id,x,y\n" + "\n".join(",".join(map(str, row)) for row in ROWS)
TEXT = "\n".join(f"{f}\t{i}\t{x:.3f}\t{y:.3f}" for f, i, x, y in ROWS)
NDJSON = "\n".join(json.dumps(dict(zip(("frame", "id", "x", "y"), row, strict=True))) for row in ROWS)
SDD = "\n".join(f'{i} 10 20 30 40 {f} 0 0 0 "Pedestrian"' for f, i, _, _ in ROWS)
ARRAYS = {"positions": np.arange(60.0).reshape(5, 12)}


def _image() -> bytes:
    out = io.BytesIO()
    Image.fromarray(np.arange(300, dtype=np.uint8).reshape(10, 10, 3)).save(out, "png")
    return out.getvalue()


def _tracks(path: Path) -> None:
    recording = motion_gym.read_recording(path, dt=0.4)
    assert np.isfinite(recording.xy).all()


def _runs(path: Path) -> None:
    assert all(store.problem_of(run) == "" for run in store.read_folder(path.parent))


def _cache(path: Path) -> None:
    """An entry is used or made again, and holds the right values in any case."""
    with contextlib.ExitStack() as stack:
        patch = stack.enter_context(_environment(path.parent))
        cached_arrays({"name": "fuzz"}, lambda: ARRAYS)
        (entry,) = patch.glob("fuzz-*.npz")
        entry.write_bytes(mutated(entry.read_bytes(), random.Random(path.read_bytes())))
        assert np.array_equal(cached_arrays({"name": "fuzz"}, lambda: ARRAYS)["positions"], ARRAYS["positions"])


@contextlib.contextmanager
def _environment(folder: Path):
    before = os.environ.get("MOTION_GYM_CACHE")
    os.environ["MOTION_GYM_CACHE"] = str(folder / "cache")
    try:
        yield folder / "cache"
    finally:
        os.environ.pop("MOTION_GYM_CACHE")
        if before is not None:
            os.environ["MOTION_GYM_CACHE"] = before


def _weights(path: Path) -> Any:
    card = {"seeds": [0], "trained_on": ["eth"], "predictor": "linear"}
    if path.suffix == ".json":
        content = path.read_bytes()
        weight_files.write(path.with_suffix(".safetensors"), {"a": torch.ones(2, 3)}, card)
        path.write_bytes(content)
    else:
        weight_files.write(path.with_name("b.safetensors"), {"a": torch.ones(2, 3)}, card)
        path.with_suffix(".json").write_bytes(path.with_name("b.json").read_bytes())
    weight_files.read(path.with_suffix(".safetensors"))


def _packed_runs(path: Path) -> None:
    store.Store(path.name.partition(".")[0], None, shipped=path.parent)


RUN = json.dumps(run_named("own:Mine"))
KINDS: Mapping[str, tuple[str, bytes, Callable[[Path], Any]]] = {
    "tracks, csv": ("a.csv", CSV.encode(), _tracks),
    "tracks, text": ("a.txt", TEXT.encode(), _tracks),
    "tracks, ndjson": ("a.ndjson", NDJSON.encode(), _tracks),
    "tracks, csv.gz": ("a.csv.gz", gzip.compress(CSV.encode()), _tracks),
    "tracks, csv.bz2": ("a.csv.bz2", bz2.compress(CSV.encode()), _tracks),
    "annotations of SDD": ("annotations.txt", SDD.encode(), lambda path: read_annotations(path, path.read_bytes())),
    "image of a scene": ("a.png", _image(), lambda path: check_image(path, path.read_bytes())),
    "result": ("a.json", RUN.encode(), _runs),
    "packed results": ("fuzz.jsonl.xz", lzma.compress(f"{RUN}\n{RUN}\n".encode()), _packed_runs),
    "scenes of the page": (
        scenes.FILE, lzma.compress(b'{"schema": 1, "scenes": []}'), lambda path: scenes.read(path.parent)
    ),
    "weights": ("a.safetensors", b"", _weights),
    "card of weights": ("a.json", b'{"seeds": [0], "trained_on": ["eth"], "predictor": "linear"}', _weights),
    "entry of the cache": ("a", b"", _cache),
    "spec": ("a", b"tracks:path='a,b.csv',fps=25,columns=(0, 1, 2)", lambda path: parse_spec(path.read_text("latin1"))),
}  # fmt: skip
"""Name of a file, its content, and what reads it."""


def mutated(content: bytes, chance: random.Random) -> bytes:
    """Content of which some bytes are changed, left out, doubled, moved or cut off."""
    changed = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 8, 40))):
        at, length = chance.randrange(len(changed) + 1), chance.choice((1, 1, 4, 30))
        part = changed[at : at + length]
        new = (
            b"", part * 2, bytes(chance.randrange(256) for _ in part), chance.choice(
                (b"\n", b"\0", b"nan", b"1e400", b"-", b'"', b"\xff\xfe", b",", b"{", b"99999999999999999999")
            ),
        )  # fmt: skip
        changed[at : at + length] = chance.choice(new)
    return bytes(changed[: chance.randrange(len(changed) + 1)] if chance.random() < 0.1 else changed)


def read_changed(kind: str, folder: Path, seed: int) -> None:
    """Read a changed file: it is read or refused by an error of motion-gym; other errors are raised."""
    chance = random.Random(seed)
    name, content, read = KINDS[kind]
    if kind == "weights":
        weight_files.write(folder / "whole.safetensors", {"a": torch.ones(2, 3)}, {"seeds": [0]})
        content = (folder / "whole.safetensors").read_bytes()
    if kind == "entry of the cache":
        content = bytes(chance.randrange(256) for _ in range(9))
    path = folder / name
    path.write_bytes(mutated(content, chance))
    with warnings.catch_warnings(), contextlib.suppress(MotionGymError):
        warnings.simplefilter("ignore")
        read(path)
