"""Annotations of drone videos that are written by the tests, in the official format."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from motion_gym.data import datasets
from motion_gym.data.storage import data_folder

FRAMES = 12 * 40
"""Video frames of a person of ``people``."""


def line(agent=0, frame=0, x=100, y=200, lost=0, label="Pedestrian"):
    """A line of a box of 20 x 40 pixels with its centre at x, y."""
    return f'{agent} {x - 10} {y - 20} {x + 10} {y + 20} {frame} {lost} 0 {int(frame % 12 > 0)} "{label}"'


def people(agents=6, first=0, label="Pedestrian"):
    """Lines of people who walk to the right, one after another, each one pixel per step faster than the one before."""
    return [
        line(agent, 240 * agent + frame, 50 + (agent + 1) * frame // 12, 100 + 30 * agent, label=label)
        for agent in range(first, first + agents)
        for frame in range(FRAMES)
    ]


def write_clip(folder: Path, clip: str, lines) -> Path:
    """Write ``SCENE/videoN/annotations.txt`` below a folder."""
    scene, video = clip.rsplit("_", 1)
    path = folder / scene / f"video{video}" / "annotations.txt"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def write_image(path: Path, size=(480, 480), color=(40, 160, 60)) -> Path:
    """Write an image of one color."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, color).save(path)
    return path


def write_labels(path: Path, size=(480, 480)) -> Path:
    """Write a label map with class 1 to the left and class 3 to the right."""
    labels = np.ones(size[::-1], np.uint8)
    labels[:, size[0] // 2 :] = 3
    Image.fromarray(labels).save(path)
    return path


def add_clips(folder: Path) -> Path:
    """Add two clips of our own, with their images, to the data folder; their bytes are not known to the library.

    ``coupa_2`` has 10 pedestrians and 3 bikers, ``hyang_2`` has 4 pedestrians.

    Returns:
        The folder of the data set.
    """
    official = folder / "stanford_campus_dataset" / "annotations"
    write_clip(official, "coupa_2", [*people(10), *people(3, 10, "Biker")])
    write_clip(official, "hyang_2", people(4))
    write_image(official / "coupa/video2/reference.jpg", (640, 520), (200, 40, 60))
    write_image(official / "hyang/video2/reference.jpg")
    datasets.add("sdd", folder / "stanford_campus_dataset")
    return data_folder() / "sdd"
