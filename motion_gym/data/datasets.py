"""Data sets as files with checksums: where to get the files, whether they are complete, and their paths."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from motion_gym.catalog import suggest
from motion_gym.contract import DataError, SpecError
from motion_gym.data.downloads import difference, download
from motion_gym.data.known_datasets import DATASETS, DataFile, DataSet
from motion_gym.data.storage import StorageError, data_folder, digest, write_atomic


@dataclass(frozen=True)
class FileState:
    """A file of a data set on this computer; ``state`` is ``ok``, ``missing`` or ``damaged``."""

    file: str
    state: str
    size: int
    sha256: str
    path: Path


def dataset(name: str) -> DataSet:
    """The data set of that name.

    Raises:
        SpecError: There is no such data set; the message suggests a similar name.
    """
    if name not in DATASETS:
        raise SpecError(f"There is no data set `{name}`.{suggest(name, DATASETS)}")
    return DATASETS[name]


def verify(name: str) -> list[FileState]:
    """State of each file of a data set, from its bytes."""
    return [_state(name, file) for file in dataset(name).files]


def path_of(name: str, file: str = "") -> Path:
    """Where a file of a data set belongs, whether it is there or not."""
    return data_folder() / dataset(name).name / file


def present(name: str, files: Iterable[str]) -> list[str]:
    """Those of some files of a data set that are there; their bytes are not checked."""
    return [file for file in files if path_of(name, file).exists()]


def listing() -> list[tuple[DataSet, list[FileState]]]:
    """Every data set with the state of each of its files."""
    return [(entry, verify(entry.name)) for entry in DATASETS.values()]


def add(name: str, source_dir: str | os.PathLike[str]) -> list[FileState]:
    """Copy the files of a data set into the data folder, from anywhere below a source folder.

    Files are found by name, or by the end of their path, and must have the expected bytes; a file whose bytes are not
    known must be readable. If a file differs, nothing is copied. The returned rows tell which files are still missing.

    Raises:
        DataError: A file differs or cannot be read, or no file was found.
        StorageError: A file could not be written to the data folder; the message names the files that were written.
    """
    entry, source = dataset(name), Path(source_dir).expanduser()
    if not source.is_dir():
        raise DataError(f"{source} is not a folder. Give the folder that holds the files of {name}.")
    wanted = {alias: file for file in entry.files for alias in (file.name, *file.aliases)}
    right: dict[str, bytes] = {}
    different: dict[str, str] = {}
    for folder, folders, names in os.walk(source):
        folders.sort()
        for path in (Path(folder, each).absolute() for each in sorted(names)):
            ends = ("/".join(path.parts[-length:]) for length in (4, 3, 2, 1))
            end = next((end for end in ends if end in wanted), None)
            if end is None or wanted[end].name in right:
                continue
            file, content = wanted[end], _bytes(path)
            if digest(content) == file.sha256:
                right[file.name] = content
            elif not file.sha256:
                if file.check is not None:
                    file.check(path, content)
                right[file.name] = content
            elif end == file.name or "/" in end:  # a short alias may name unrelated files
                different.setdefault(file.name, f"{path}: {difference(file, content)}")
    wrong = [message for each, message in different.items() if each not in right]
    if wrong:
        raise DataError(
            f"{name}: nothing was copied, because {len(wrong)} of the files found in {source} differ from "
            "the expected ones:\n  " + "\n  ".join(wrong) + f"\nGet them again: {entry.source}."
        )
    if not right:
        shown = entry.files[:12]
        names_wanted = ", ".join(file.name for file in shown) + (", ..." if len(shown) < len(entry.files) else "")
        raise DataError(f"{name}: none of its files is in {source} or below. Looked for: {names_wanted}.")
    for number, (each, content) in enumerate(right.items()):
        _write(name, each, content, list(right)[:number])
    return verify(name)


def fetch(name: str, base: str | None = None) -> list[FileState]:
    """Download the files of a data set that are missing or damaged.

    Args:
        name: Name of the data set.
        base: URL of a folder that holds all files under their own names, in place of the public addresses.

    Raises:
        DataError: A file could not be downloaded, or is not the expected one. Earlier files are kept.
        StorageError: A file could not be written to the data folder; the message names the files that were written.
    """
    missing = {state.file for state in verify(name) if state.state != "ok"}
    files = [file for file in dataset(name).files if file.name in missing]
    if base is None and any(not file.address for file in files):
        raise DataError(
            f"{name} cannot be downloaded by motion-gym. Its terms: {dataset(name).terms} Get it from "
            f"{dataset(name).source}; then run `motion-gym data add {name} --from DIR`."
        )
    remedy = (
        f"Instead, get the files elsewhere ({dataset(name).source}), then run `motion-gym data add {name} --from DIR`."
    )
    for number, file in enumerate(files):
        from_base = replace(file, address=f"{base.rstrip('/')}/{file.name}") if base else file
        _write(name, file.name, download(from_base, remedy), [file.name for file in files[:number]])
    return verify(name)


def locate(name: str, file: str) -> Path:
    """Path of a file of a data set, after a check of its bytes.

    The check reads the file once per process, and again if its size or modification time changes.

    Raises:
        SpecError: There is no such data set, or no such file in it.
        DataError: The file is missing, damaged or not readable; the message says what to do.
    """
    files = {each.name: each for each in dataset(name).files}
    if file not in files:
        raise SpecError(f"Data set `{name}` has no file `{file}`.{suggest(file, files)}")
    row = _state(name, files[file], remember=True)
    if row.state == "ok":
        return row.path
    remedy = (
        f"Run {f'`motion-gym data fetch {name}` to download it, or ' if files[file].address else ''}"
        f"`motion-gym data add {name} --from DIR` if you have the files, or set MOTION_GYM_DATA to the folder that "
        f"holds {name}/."
    )
    if row.state == "missing":
        inside = f" ({data_folder() / file} exists: MOTION_GYM_DATA must name the folder above it.)"
        raise DataError(f"{row.path} is missing.{inside if (data_folder() / file).exists() else ''} {remedy}")
    raise DataError(f"{row.path} is damaged: {difference(files[file], _bytes(row.path))}. {remedy}")


_verified: set[tuple[str, int, int, str]] = set()


def _state(name: str, file: DataFile, remember: bool = False) -> FileState:
    path = data_folder() / name / file.name
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return FileState(file.name, "missing", file.size, file.sha256, path)
    except OSError as error:
        raise _unreadable(path, error) from None
    seen = (str(path.absolute()), status.st_size, status.st_mtime_ns, file.sha256)
    whole = (
        not file.sha256
        or (remember and seen in _verified)
        or (status.st_size == file.size and digest(_bytes(path)) == file.sha256)
    )
    if whole:
        _verified.add(seen)
    return FileState(file.name, "ok" if whole else "damaged", file.size, file.sha256, path)


def _write(name: str, file: str, content: bytes, before: list[str]) -> None:
    """Write a file into the data folder; ``before`` names the files that this command has written already."""
    try:
        write_atomic(data_folder() / name / file, content)
    except StorageError as error:
        written = f"{', '.join(before)} were written and are whole" if before else "no file was written"
        failure = StorageError(f"{error} Of {name}, {written}; then run the same command again.")
        failure.errno = error.errno
        raise failure from error


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> DataError:
    return DataError(
        f"{path} cannot be read: {error.strerror or error}. Make it readable, or set MOTION_GYM_DATA to another folder."
    )
