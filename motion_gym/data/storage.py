"""Where files live, and how they are written so that nobody ever sees half of one."""

from __future__ import annotations

import contextlib
import errno
import hashlib
import json
import os
import re
import secrets
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from platformdirs import user_cache_path, user_data_path

from motion_gym.contract import MotionGymError, SpecError


class StorageError(MotionGymError, OSError):
    """A file could not be written; ``errno`` is that of the cause."""


def data_folder() -> Path:
    """Folder of the data sets: ``MOTION_GYM_DATA``, or the user's data folder."""
    chosen = os.environ.get("MOTION_GYM_DATA")
    return Path(chosen).expanduser() if chosen else user_data_path("motion-gym", appauthor=False)


def cache_folder() -> Path:
    """Folder of what can be made again: ``MOTION_GYM_CACHE``, or the user's cache folder."""
    chosen = os.environ.get("MOTION_GYM_CACHE")
    return Path(chosen).expanduser() if chosen else user_cache_path("motion-gym", appauthor=False)


@contextlib.contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a file for writing that takes its name only once it is complete and on disk.

    What was at ``path`` stays there until then. On any error the new file is removed and ``path`` unchanged.

    Args:
        path: Where the file goes. Missing folders are made.

    Yields:
        A binary file, open for writing.

    Raises:
        StorageError: The file could not be written (disk full, no permission, ...).
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise StorageError(
            f"{path} is no regular file and would be replaced: choose another place. Nothing was changed."
        )
    # In the same folder, because a rename is atomic only within one file system. Not mkstemp: it makes files
    # that no other user can read, which breaks shared data folders.
    temporary = path.parent / f".{path.name}.{secrets.token_hex(8)}.tmp"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, MotionGymError):
            failure = StorageError(
                f"{path} could not be written: {error.strerror or error}. Nothing was changed. Free space in "
                f"{path.parent} or make it writable, or choose another folder (data: MOTION_GYM_DATA, cache: "
                "MOTION_GYM_CACHE)."
            )
            failure.errno = error.errno
            raise failure from error
        raise


def check_writable(folder: Path) -> None:
    """Raise StorageError unless files can be written to a folder, or to one that would be made; nothing is left."""
    there = next((place for place in (folder, *folder.absolute().parents) if place.exists()), Path("/"))
    try:
        with tempfile.TemporaryDirectory(dir=there):
            pass
    except OSError as error:
        raise StorageError(
            f"{folder} cannot be written to: {error.strerror or error} ({there}). Choose another folder."
        ) from None


def write_atomic(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a whole file, or nothing; see ``atomic_file``."""
    with atomic_file(path) as file:
        file.write(content)


def cached_arrays(key: Mapping[str, Any], make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Arrays from the cache, or made now and kept there.

    Safe when several processes make one entry at once. A damaged entry is made again. When an entry cannot be
    written, a RuntimeWarning says so and the arrays are returned all the same.

    Args:
        key: All that the arrays depend on, in JSON types: parameters, file hashes, and a version of the code
            that makes them. ``key["name"]``, if there is one, begins the name of the file.
        make: Makes the arrays; called only if they are not in the cache.

    Raises:
        SpecError: The key holds something other than JSON types, or an array holds Python objects.
    """
    path = cache_folder() / _entry_name(key)
    kept = _load(path)
    if kept is not None:
        return kept
    arrays = make()
    objects = [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]
    if objects:
        raise SpecError(f"arrays of Python objects cannot be cached: {', '.join(objects)}; use numbers or strings")
    try:
        with atomic_file(path) as file:
            np.savez(file, **arrays, **{NAMES: np.array(sorted(arrays))})  # type: ignore[arg-type]  # not compressed: loads at the speed of the disk
    except StorageError as error:
        warnings.warn(
            f"Not cached: {error} The result is used all the same, but will be made again next time.",
            RuntimeWarning,
            stacklevel=2,
        )
    return arrays


def _entry_name(key: Mapping[str, Any]) -> str:
    try:
        canonical = json.dumps(dict(key), sort_keys=True, separators=(",", ":"), allow_nan=False)
    except (TypeError, ValueError) as error:
        raise SpecError(
            f"the cache key {dict(key)!r} is not made of JSON types (str, int, finite float, bool, None, "
            f"list, dict): {error}"
        ) from None
    prefix = re.sub(r"[^A-Za-z0-9]+", "-", str(key.get("name", "arrays"))).strip("-")[:60] or "arrays"
    return f"{prefix}-{hashlib.sha256(canonical.encode()).hexdigest()[:32]}.npz"


NAMES = "__names__"
PASSING = (errno.ENOENT, errno.EACCES, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EIO)
"""What keeps an entry from being read without its being damaged."""


def _load(path: Path) -> dict[str, np.ndarray] | None:
    """Arrays of an entry, checked by the checksums of the zip format; a damaged entry is removed."""
    try:
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        # The checksums of the zip format do not cover the names of its members.
        if arrays.pop(NAMES).tolist() != sorted(arrays):
            raise ValueError("the names of the arrays are damaged")
        return arrays
    except MemoryError:
        return None
    except Exception as error:  # a damaged archive raises any of about ten types
        if isinstance(error, OSError) and error.errno in PASSING:
            return None
        with contextlib.suppress(OSError):
            path.unlink()
        return None
