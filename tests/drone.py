"""Annotations of drone videos that are written by the tests, in the official format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

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


def write_images(folder: Path, clip: str, size=(400, 300), mask_size=None) -> None:
    """Write ``reference/CLIP.jpg``, and ``masks/CLIP.png`` with one class to the left and another to the right."""
    from PIL import Image

    for name in ("reference", "masks"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, (40, 160, 60)).save(folder / "reference" / f"{clip}.jpg")
    width, height = mask_size or size
    labels = np.ones((height, width), np.uint8)
    labels[:, width // 2 :] = 3
    Image.fromarray(labels).save(folder / "masks" / f"{clip}.png")
