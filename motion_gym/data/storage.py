"""Folders of data and caches, and atomic writes."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import functools
import hashlib
import json
import os
import re
import secrets
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import IO, Any

import numpy as np
from platformdirs import user_cache_path, user_data_path

from motion_gym.contract import MotionGymError, SpecError


class StorageError(MotionGymError, OSError):
    """A file could not be written; ``errno`` is that of the cause."""


LEFTOVER = re.compile(r"\..+\.[0-9a-f]{16}\.tmp")
"""Pattern of the temporary names of ``atomic_file``."""
LEFTOVER_AGE = 3600.0
"""Seconds after which a temporary file is a leftover of a killed process."""


def data_folder() -> Path:
    """Folder of the data sets: ``MOTION_GYM_DATA``, or the user's data folder."""
    return _folder("MOTION_GYM_DATA", user_data_path)


def cache_folder() -> Path:
    """Folder of the cache: ``MOTION_GYM_CACHE``, or the user's cache folder."""
    return _folder("MOTION_GYM_CACHE", user_cache_path)


def _folder(variable: str, default: Callable[..., Path]) -> Path:
    chosen = os.environ.get(variable)
    try:
        return (Path(chosen) if chosen else default("motion-gym", appauthor=False)).expanduser()
    except RuntimeError:
        raise StorageError(
            f"This user has no home folder (HOME is not set): set {variable} to a folder that can be written to."
        ) from None


def digest(*parts: str | bytes | np.ndarray) -> str:
    """sha256, in hexadecimal, of bytes, texts and the values of arrays, one after another."""
    sha = hashlib.sha256()
    for part in parts:
        sha.update(part.encode() if isinstance(part, str) else part if isinstance(part, bytes) else part.tobytes())
    return sha.hexdigest()


@contextlib.contextmanager
def atomic_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """Open a file for writing that replaces ``path`` once it is complete and on disk.

    On an error the new file is removed and ``path`` does not change. Temporary files in the same folder that are older
    than an hour are removed, at the first write of a process to that folder.

    Args:
        path: Path of the file. Missing folders are made.

    Yields:
        A binary file, open for writing.

    Raises:
        StorageError: The file could not be written (disk full, no permission, ...).
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise StorageError(f"{path} is no regular file and would be replaced: choose another place.")
    # In the same folder, because a rename is atomic only within one file system. Not mkstemp: it makes files
    # that no other user can read, which breaks shared data folders.
    temporary = path.parent / f".{path.name}.{secrets.token_hex(8)}.tmp"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _remove_leftovers(path.parent)
        with open(temporary, "xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException as error:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and not isinstance(error, MotionGymError):
            in_the_way = next((folder for folder in path.parents if folder.exists() and not folder.is_dir()), None)
            reason = f"{in_the_way} is a file, not a folder" if in_the_way else error.strerror or error
            remedy = "Choose" if in_the_way else f"Free space in {path.parent} or make it writable, or choose"
            failure = StorageError(
                f"{path} could not be written: {reason}. It is as it was. {remedy} another folder (data: "
                "MOTION_GYM_DATA, cache: MOTION_GYM_CACHE)."
            )
            failure.errno = error.errno
            raise failure from error
        raise


@functools.cache
def _remove_leftovers(folder: Path) -> None:
    """Remove old temporary files; once in a process, since a folder of results may hold many thousands of files."""
    for old in folder.glob(".*.tmp"):
        with contextlib.suppress(OSError):  # another process may remove it first
            if LEFTOVER.fullmatch(old.name) and time.time() - old.stat().st_mtime > LEFTOVER_AGE:
                old.unlink()


@contextlib.contextmanager
def exclusive(folder: Path) -> Iterator[None]:
    """Wait until no other process holds a folder, and hold it: for changes that begin with what a file holds.

    The system lets go of it when a process ends. Nothing is held on a file system without locks.
    """
    handle = os.open(folder, os.O_RDONLY)
    try:
        with contextlib.suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


def check_writable(folder: Path) -> None:
    """Raise StorageError unless files can be written to a folder, which need not exist yet."""
    there = next((place for place in (folder, *folder.absolute().parents) if place.exists()), Path("/"))
    try:
        with tempfile.TemporaryDirectory(dir=there):
            pass
    except OSError as error:
        raise StorageError(
            f"{folder} cannot be written to: {error.strerror or error} ({there}). Choose another folder."
        ) from None


def write_atomic(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a complete file, or nothing; see ``atomic_file``."""
    with atomic_file(path) as file:
        file.write(content)


def cached_arrays(key: Mapping[str, Any], make: Callable[[], dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    """Load arrays from the cache, or make and store them.

    Several processes may make one entry at the same time. A damaged entry is made again. If an entry cannot be written,
    a RuntimeWarning says so and the arrays are returned.

    Args:
        key: Everything that determines the arrays, in JSON types: parameters, file hashes, and a version of the code.
            ``key["name"]``, if there is one, begins the name of the file.
        make: Makes the arrays; called only if they are not in the cache.

    Raises:
        SpecError: The key holds something other than JSON types, or an array holds Python objects.
    """
    entry = _entry_name(key)
    kept = _load(entry)
    if kept is not None:
        return kept
    arrays = make()
    objects = [name for name, array in arrays.items() if np.asarray(array).dtype.hasobject]
    if objects:
        raise SpecError(f"arrays of Python objects cannot be cached: {', '.join(objects)}; use numbers or strings")
    checksum: Any = {CHECKSUM: np.array(_checksum(entry, arrays))}
    try:
        with atomic_file(cache_folder() / entry) as file:
            # Not compressed, so that an entry loads at the speed of the disk.
            np.savez(file, **arrays, **checksum)  # type: ignore[arg-type]
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
    return f"{prefix}-{digest(canonical)[:32]}.npz"


CHECKSUM = "__sha256__"
PASSING = (errno.ENOENT, errno.EACCES, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.EIO)
"""Errors of reading that do not mean that an entry is damaged."""


def _checksum(entry: str, arrays: Mapping[str, np.ndarray]) -> str:
    """Digest of the name of an entry and of its arrays: names, types, shapes and values."""
    plain = [(name, np.asarray(arrays[name])) for name in sorted(arrays)]
    return digest(entry, *(part for name, a in plain for part in (repr((name, a.dtype.str, a.shape)), a)))


def _load(entry: str) -> dict[str, np.ndarray] | None:
    """The arrays of an entry, if its checksum is right; a damaged entry is removed."""
    try:
        path = cache_folder() / entry
        with open(path, "rb") as file, np.load(file, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        if str(arrays.pop(CHECKSUM)) != _checksum(entry, arrays):
            raise ValueError("the checksum is another one")
        return arrays
    except (MemoryError, StorageError):
        return None
    except Exception as error:  # a damaged archive raises any of about ten types
        if not isinstance(error, OSError) or error.errno not in PASSING:
            with contextlib.suppress(OSError):
                path.unlink()
        return None
