"""Ego-centred square crops of the ground, the frame of the ``heatmap`` predictor, and heat maps in them.

The center of the crop of an agent is the last observed position, and its x axis is the direction of the last two steps.
Coordinates in the crop are in half widths of the crop, x ahead and y to the left, so that the crop spans -1 to 1. The
half width is proportional to the observed step length. The coordinates therefore do not change with translations,
rotations and the unit of positions.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from motion_gym.contract import FUTURE, Observation

CELLS = 64
"""Cells along each side of the maps of the history and of the goal."""
COARSE = 32
"""Cells along each side of the maps of the future steps and of the label maps."""
REACH = 1.3 * FUTURE
"""Half width of a crop in observed steps: 12 steps at 1.3 times the observed step length."""
LONGEST = 0.7
"""The step length of an agent is at least this share of its longest step."""
LABELS = 5
"""Classes 1 to 5 of a label map are inputs; class 0, other classes and unknown ground are not."""


@dataclass(frozen=True)
class Crops:
    """Crops of the A agents of an observation.

    Attributes:
        last: [A, 2] float64, last observed positions, the centers, in the frame of the observation.
        turn: [A, 2, 2] float64, matrices that turn row vectors of the observation into the axes of the crop.
        half: [A] float64, half width in the unit of the observation; 0 for an agent that never moved.
        labels: [A, 32, 32] uint8, label of each coarse cell, rows along y; 0 where it is not known.
    """

    last: np.ndarray
    turn: np.ndarray
    half: np.ndarray
    labels: np.ndarray

    def inside(self, positions: np.ndarray) -> np.ndarray:
        """Positions [A, T, 2] in coordinates of the crops, float32."""
        size = np.where(self.half > 0, self.half, 1.0)[:, None, None]
        offsets = (positions.astype(np.float64) - self.last[:, None]) @ self.turn
        return (offsets / size).astype(np.float32)

    def outside(self, places: np.ndarray) -> np.ndarray:
        """Coordinates [A, T, 2] of the crops as positions, float64."""
        return self.last[:, None] + (places * self.half[:, None, None]) @ self.turn.transpose(0, 2, 1)


def crops_of(observation: Observation, angle: np.ndarray | float = 0.0, stretch: np.ndarray | float = 1.0) -> Crops:
    """Crops of the agents of an observation.

    Args:
        observation: A agents; label maps are read where the observation has images with labels.
        angle: [A] or scalar, radians by which crops are turned, for training.
        stretch: [A] or scalar, factor on the half width, for training.
    """
    xy = observation.xy.astype(np.float64)
    steps = np.linalg.norm(np.diff(xy, axis=1), axis=-1)
    half = REACH * np.maximum(steps.mean(axis=1), LONGEST * steps.max(axis=1)) * stretch
    ahead = xy[:, -1] - xy[:, -3]
    ahead = np.where((ahead**2).sum(axis=1, keepdims=True) > 0, ahead, xy[:, -1] - xy[:, 0])
    course = np.arctan2(ahead[:, 1], ahead[:, 0]) + angle
    cos, sin = np.cos(course), np.sin(course)
    turn = np.stack([np.stack([cos, -sin], axis=-1), np.stack([sin, cos], axis=-1)], axis=1)
    crops = Crops(xy[:, -1], turn, half, np.zeros((len(xy), COARSE, COARSE), np.uint8))
    _read_labels(observation, crops)
    return crops


def _read_labels(observation: Observation, crops: Crops) -> None:
    """Write the labels of the ground into the crops."""
    images = observation.images
    if images is None:
        return
    x = _centers(COARSE).numpy().astype(np.float64)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(1, -1, 2)
    numbers = {id(image): number for number, image in enumerate(images)}
    of_scene = np.array([numbers[id(image)] for image in images])[observation.scene_index]
    for number in np.unique(of_scene):
        image, agents = images[number], np.flatnonzero(of_scene == number)
        if image.labels is None:
            continue
        part = Crops(crops.last[agents], crops.turn[agents], crops.half[agents], crops.labels[agents])
        column, row = np.floor((part.outside(grid) - image.corner) / image.pixel).astype(np.int64).transpose(2, 0, 1)
        height, width = image.labels.shape
        known = (row >= 0) & (row < height) & (column >= 0) & (column < width)
        labels = np.where(known, image.labels[np.where(known, row, 0), np.where(known, column, 0)], 0)
        crops.labels[agents] = labels.reshape(-1, COARSE, COARSE)


def gaussians(places: Tensor, cells: int) -> Tensor:
    """Maps [..., cells, cells] of Gaussians around places [..., 2], with a standard deviation of one cell."""
    distance = (_centers(cells, places.device) - places[..., None]) * (cells / 2)
    # Not below exp(-18): numbers near the smallest ones of float32 are slow on CPUs.
    along, across = (-distance.square() / 2).clamp(min=-18).exp().unbind(dim=-2)
    return across[..., :, None] * along[..., None, :]


def mean_place(logits: Tensor) -> Tensor:
    """Soft-argmax: the mean place [..., 2] of the distribution that logits [..., cells, cells] define."""
    shares = logits.flatten(-2).softmax(dim=-1).view(logits.shape)
    centers = _centers(logits.shape[-1], logits.device)
    return torch.stack([shares.sum(dim=-2) @ centers, shares.sum(dim=-1) @ centers], dim=-1)


def one_hot(labels: Tensor) -> Tensor:
    """Maps [A, 5, 32, 32] of the classes of labels [A, 32, 32]."""
    classes = torch.arange(1, LABELS + 1, device=labels.device)
    return (labels[:, None] == classes[:, None, None]).float()


def _centers(cells: int, device: torch.device | str = "cpu") -> Tensor:
    """Coordinates [cells] of the centers of the cells."""
    return (torch.arange(cells, device=device) + 0.5) * (2 / cells) - 1
