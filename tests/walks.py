"""Files of people who walk, for tests that read tracks."""

import functools
import tempfile
from pathlib import Path

import numpy as np


def walk_rows(people=6, frames=600, every=1, fps=25.0, speed=1.3, seed=0, wobble=0.1):
    """Rows (frame, id, x, y) of people who walk through a place, in metres, at slowly changing velocities.

    Args:
        people: Number of people, who begin one after another.
        frames: Frame numbers.
        every: Frame numbers from one row of a person to the next.
        fps: Frame numbers per second.
        speed: Metres per second.
        seed: Source of all randomness.
        wobble: Standard deviation of the change of the heading in a second, radians.
    """
    rng, rows = np.random.default_rng(seed), []
    for person in range(people):
        number = np.arange(every * int(rng.integers(0, frames // (4 * every))), frames, every)
        turn = rng.normal(0, wobble * np.sqrt(every / fps), len(number)).cumsum() + rng.uniform(0, 2 * np.pi)
        step = speed * every / fps * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        xy = rng.uniform(-5, 5, 2) + step.cumsum(axis=0)
        rows += [(int(f), person, float(x), float(y)) for f, (x, y) in zip(number, xy, strict=True)]
    return sorted(rows)


def write_rows(path, rows, separator=",", header="frame,id,x,y", encoding="utf-8", end="\n"):
    """Write rows as text; returns the path."""
    lines = ([header.replace(",", separator)] if header else []) + [separator.join(map(str, row)) for row in rows]
    Path(path).write_bytes("".join(line + end for line in lines).encode(encoding))
    return Path(path)


@functools.cache
def walks_file():
    """A csv file of walking people at 25 frames a second, made once."""
    return str(write_rows(Path(tempfile.mkdtemp()) / "walks.csv", walk_rows(people=8, frames=4000, every=5)))
