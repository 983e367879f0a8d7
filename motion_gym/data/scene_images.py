"""Images of the ground of a place, which pictures and observations show."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.contract import DataError
from motion_gym.data.storage import digest
from motion_gym.data.tracks.file_content import content_of


@dataclass(frozen=True, eq=False)
class SceneImage:
    """An image of the ground of a place, and optionally a label map of it; its arrays are read-only copies.

    The pixel in row r and column c covers the positions from ``corner + pixel * (c, r)`` to
    ``corner + pixel * (c + 1, r + 1)``.

    Attributes:
        photo: [H, W, 3] uint8, red, green and blue.
        corner: [2] float64, position of the outer corner of the first pixel: in the frame of the source where a domain
            gives the image, relative to the origin of the recording in an observation.
        pixel: [2] float64, signed width and height of a pixel along x and y, in the unit of the domain.
        labels: [H, W] uint8, class of the ground at each pixel; None if not known.

    Raises:
        DataError: An array has the wrong shape or type, or ``corner`` or ``pixel`` is not finite, or ``pixel`` is 0.
    """

    photo: np.ndarray
    corner: np.ndarray
    pixel: np.ndarray
    labels: np.ndarray | None = None

    def __post_init__(self) -> None:
        self._fix("photo", self.photo, np.uint8, np.ndim(self.photo) == 3 and np.shape(self.photo)[2] == 3, "[H, W, 3]")
        self._fix("corner", self.corner, np.float64, np.shape(self.corner) == (2,), "[2]")
        self._fix("pixel", self.pixel, np.float64, np.shape(self.pixel) == (2,), "[2]")
        if self.labels is not None:
            shape = self.photo.shape[:2]
            self._fix("labels", self.labels, np.uint8, np.shape(self.labels) == shape, f"{shape}, the size of photo")
        if not self.pixel.all():
            raise DataError("scene image: `pixel`, the width and height of a pixel, must not be 0.")

    def _fix(self, name: str, value: Any, kind: type, shaped: bool, expected: str) -> None:
        array = np.asarray(value)
        typed = array.dtype == kind if kind is np.uint8 else array.dtype.kind in "iuf"
        if not shaped or not array.size or not typed or not np.isfinite(array).all():
            raise DataError(
                f"scene image: {name} is {array.dtype} {array.shape}; expected finite {np.dtype(kind)} {expected}."
            )
        # Backed by bytes, so that no predictor can make it writeable again.
        fixed: np.ndarray = np.frombuffer(np.ascontiguousarray(array, kind).tobytes(), kind).reshape(array.shape)
        object.__setattr__(self, name, fixed)

    def relative_to(self, origin: np.ndarray) -> SceneImage:
        """The same image with positions relative to an origin [2]."""
        return replace(self, corner=self.corner - origin) if np.any(origin) else self

    @property
    def digest(self) -> str:
        """sha256 of the content."""
        parts = (self.photo, self.corner, self.pixel, *(() if self.labels is None else (self.labels,)))
        return digest(*parts)

    @property
    def extent(self) -> np.ndarray:
        """[2, 2], lowest and highest x and y of the image."""
        height, width = self.photo.shape[:2]
        return np.sort(np.stack([self.corner, self.corner + self.pixel * (width, height)]), axis=0)


def read_scene_image(photo: Path, mask: Path | None, scale: float = 1.0, shrink: int = 1) -> SceneImage:
    """The image of the ground of a clip, with its label map if there is one.

    Args:
        photo: The reference image.
        mask: The label map, of the same size; None for none.
        scale: Unit of the domain per pixel of the file.
        shrink: Pixels of the file, along each axis, that become one pixel.

    Raises:
        DataError: A file is no image, or the label map has another size.
    """
    image = _open_image(photo, content_of(photo)).convert("RGB")
    width, height = (length // shrink for length in image.size)
    reduced = image.crop((0, 0, width * shrink, height * shrink)).reduce(shrink)
    labels = None
    if mask is not None:
        ground = _open_image(mask, content_of(mask))
        if ground.size != image.size or ground.mode != "L":
            raise DataError(
                f"{mask} does not match {photo}: it has {ground.size[0]} x {ground.size[1]} pixels of mode "
                f"{ground.mode}, the image {image.size[0]} x {image.size[1]}; expected the same size and mode L. Get "
                "both again."
            )
        labels = np.asarray(ground)[shrink // 2 :: shrink, shrink // 2 :: shrink][:height, :width]
    pixel = np.full(2, scale * shrink)
    return SceneImage(np.asarray(reduced), np.zeros(2), pixel, labels)


def check_image(path: Path, content: bytes) -> None:
    """Raise DataError if the content of a file is no image."""
    _open_image(path, content)


def _open_image(path: Path, content: bytes) -> Any:
    from PIL import Image  # comes with matplotlib

    try:
        image = Image.open(io.BytesIO(content))
        image.load()
    except (OSError, ValueError, SyntaxError) as error:
        raise DataError(f"{path} is not an image that can be read ({error}). Get it again.") from None
    return image
