"""Data sets as files with checksums: where to get the files, whether they are complete, and their paths."""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motion_gym.catalog import suggest
from motion_gym.contract import DataError, MotionGymError, SpecError
from motion_gym.data.storage import StorageError, data_folder, digest, write_atomic


@dataclass(frozen=True)
class DataFile:
    """One file of a data set.

    Attributes:
        name: Name in the folder of the data set.
        sha256: Checksum in hexadecimal.
        size: Size in bytes.
        address: URL of the file.
        aliases: Other names under which the file is distributed.
    """

    name: str
    sha256: str
    size: int
    address: str
    aliases: tuple[str, ...] = ()


@dataclass(frozen=True)
class DataSet:
    """A data set: its files, their source and their terms of use."""

    name: str
    title: str
    source: str
    terms: str
    citation: str
    files: tuple[DataFile, ...]


@dataclass(frozen=True)
class FileState:
    """A file of a data set on this computer; ``state`` is ``ok``, ``missing`` or ``damaged``."""

    file: str
    state: str
    size: int
    sha256: str
    path: Path


# The folder, in a public repository and at a fixed commit, from which most of the field takes these files.
_TRAJECTRON = (
    "https://raw.githubusercontent.com/StanfordASL/Trajectron-plus-plus/"
    "40dec06e9cfef9e0d5f5ec69da2c4058a556bba9/experiments/pedestrians/raw/raw/all_data/"
)
_OPENTRAJ = (
    "https://raw.githubusercontent.com/crowdbotp/OpenTraj/3000c022dac1ecc2e34b3ff0fa2bb531151bf0b1/datasets/ETH/"
)
_ETH_UCY = (
    ("biwi_eth.txt", "cf8d3fd342a15f409ebc2a1fc76b91a0f06390bd21f1e11410f3859331ab082b", 116970),
    ("biwi_hotel.txt", "9caa771bb9153d6b809dd0916b6f86761b641e6bbb15e766c1de3133fbbb7fcf", 143799),
    ("crowds_zara01.txt", "1147a1962a09abfb86f28c6cddcac862e095a0cf129b3016385b69eacdd09d85", 205711),
    ("crowds_zara02.txt", "8a649d0f8c9ae75c87c4d23a85f892786b0aa30266e996c7be03e69dafff22ff", 392227),
    ("crowds_zara03.txt", "16b3e899932c4baacd07f45013d5b921f90bc5a29eb2b0fe42f4d7c904ac3108", 199834),
    ("students001.txt", "a6d87f278d94136fe39b8be91555487a29ac77259ae403b9dba2d5c18caf7b5b", 879714),
    ("students003.txt", "e25798b660634330aa89f8bb259425de720e84d0873902726c1d1f4ccff21d6c", 724279),
    ("uni_examples.txt", "61f432c0ab3070ed0ef150fbeabcd7baf839cab5495a46e6105bd747f0a092a7", 109307),
)

DATASETS: Mapping[str, DataSet] = {
    "eth_ucy": DataSet(
        name="eth_ucy",
        title="ETH-UCY: BIWI walking pedestrians (ETH) and crowds by example (UCY)",
        source=(
            "the text files first distributed with Social-GAN, in github.com/StanfordASL/Trajectron-plus-plus"
            " under experiments/pedestrians/raw/raw/all_data, and the original annotation of eth, in "
            "github.com/crowdbotp/OpenTraj under datasets/ETH/seq_eth/obsmat.txt"
        ),
        terms="UCY: free for use, as long as the authors give credit. ETH: none stated.",
        citation=(
            "Pellegrini, Ess, Schindler, van Gool: You'll never walk alone: modeling social behavior for "
            "multi-target tracking. ICCV 2009. Lerner, Chrysanthou, Lischinski: Crowds by example. Computer "
            "Graphics Forum 26(3), 2007."
        ),
        files=(
            *(DataFile(name, sha256, size, _TRAJECTRON + name) for name, sha256, size in _ETH_UCY),
            DataFile(
                "biwi_eth_obsmat_6frame.txt",
                "d452ae2185ecb1164c2fdf31e75f6236f4c2ffc02c751a6b2ae921740cbc60d1",
                1158040,
                _OPENTRAJ + "seq_eth/obsmat.txt",
                aliases=("obsmat.txt",),
            ),
        ),
    ),
}


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


def listing() -> list[tuple[DataSet, list[FileState]]]:
    """Every data set with the state of each of its files."""
    return [(entry, verify(entry.name)) for entry in DATASETS.values()]


def add(name: str, source_dir: str | os.PathLike[str]) -> list[FileState]:
    """Copy the files of a data set into the data folder, from anywhere below a source folder.

    Files are found by name and must have the expected bytes; if a file differs, nothing is copied. The returned rows
    tell which files are still missing.

    Raises:
        DataError: A file differs, or no file was found.
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
        for path in (Path(folder, each) for each in sorted(names) if each in wanted):
            file = wanted[path.name]
            content = b"" if file.name in right else _bytes(path)
            if file.name not in right and digest(content) == file.sha256:
                right[file.name] = content
            elif file.name not in right and path.name == file.name:  # an alias may name unrelated files
                different.setdefault(file.name, f"{path}: {_difference(file, content)}")
    wrong = [message for each, message in different.items() if each not in right]
    if wrong:
        raise DataError(
            f"{name}: nothing was copied, because {len(wrong)} of the files found in {source} differ from "
            "the expected ones:\n  " + "\n  ".join(wrong) + f"\nGet them again: {entry.source}."
        )
    if not right:
        names_wanted = ", ".join(file.name for file in entry.files)
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
    import pooch  # takes a quarter of a second, and only downloads need it

    pooch.get_logger().setLevel("WARNING")  # pooch would report the temporary folder below
    missing = {state.file for state in verify(name) if state.state != "ok"}
    files = [file for file in dataset(name).files if file.name in missing]
    address = {file.name: f"{base.rstrip('/')}/{file.name}" if base else file.address for file in files}
    # Into a temporary folder: pooch writes files that no other user can read, which breaks shared data folders.
    with tempfile.TemporaryDirectory() as folder:
        registry = {file.name: f"sha256:{file.sha256}" for file in files}
        shelf = pooch.create(folder, base_url="", registry=registry, urls=address, retry_if_failed=1)
        for number, file in enumerate(files):
            _write(name, file.name, _download(shelf, name, file, address[file.name]), list(registry)[:number])
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
        f"Run `motion-gym data fetch {name}` to download it, or `motion-gym data add {name} --from DIR` if "
        f"you have the files, or set MOTION_GYM_DATA to the folder that holds {name}/."
    )
    if row.state == "missing":
        inside = f" ({data_folder() / file} exists: MOTION_GYM_DATA must name the folder above it.)"
        raise DataError(f"{row.path} is missing.{inside if (data_folder() / file).exists() else ''} {remedy}")
    raise DataError(f"{row.path} is damaged: {_difference(files[file], _bytes(row.path))}. {remedy}")


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
    whole = (remember and seen in _verified) or (status.st_size == file.size and digest(_bytes(path)) == file.sha256)
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


def _download(shelf: Any, name: str, file: DataFile, address: str) -> bytes:
    """The content of a file, downloaded by a Pooch that knows its checksum."""
    import pooch
    import requests

    def download(url: str, path: str, shelf: Any) -> None:
        pooch.HTTPDownloader(timeout=30)(url, path, shelf)
        content = _bytes(Path(path))
        if digest(content) != file.sha256:  # first, so that the message says how the file differs
            raise DataError(f"{address} is not the expected {file.name}: {_difference(file, content)}. {remedy}")

    remedy = (
        f"Instead, get the files elsewhere ({DATASETS[name].source}), then run `motion-gym data add {name} --from DIR`."
    )
    try:
        return _bytes(Path(shelf.fetch(file.name, downloader=download)))
    except requests.HTTPError as error:
        status = str(error).partition(" for url")[0]
        raise DataError(f"{file.name} could not be downloaded: {address} answered {status}. {remedy}") from None
    except requests.RequestException as error:
        # The system's own words ("Connection refused") are the last thing in a chain of wrapped messages.
        system = re.search(r"\[Errno -?\d+\] ([\w ,']+)", str(error))
        raise DataError(
            f"{file.name} could not be downloaded: {address}: the network or the server was not reachable "
            f"({system[1] if system else type(error).__name__}). {remedy}"
        ) from None
    except MotionGymError:
        raise
    except OSError as error:
        raise StorageError(
            f"{file.name} could not be written to {tempfile.gettempdir()}: {error.strerror or error}. "
            "Free space there, or set TMPDIR to another folder."
        ) from None


def _difference(file: DataFile, content: bytes) -> str:
    """Expected and actual size and checksum, and the most likely cause."""
    unix = content.replace(b"\r\n", b"\n")
    if file.sha256 in (digest(unix), digest(unix.replace(b"\n", b"\r\n"))):
        cause = "its line endings were converted (by git or an editor)"
    elif content.startswith(b"version https://git-lfs"):
        cause = "it is a Git LFS pointer, not the file itself"
    elif content.lstrip().startswith(b"<"):
        cause = "it is a web page, saved in place of the file"
    elif len(content) < file.size:
        cause = "it was truncated (an interrupted copy or download)"
    else:
        cause = "it was edited, or is another version"
    return (
        f"expected {file.size} bytes with sha256 {file.sha256}, found {len(content)} bytes with sha256 "
        f"{digest(content)}; probably {cause}"
    )


def _bytes(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from None


def _unreadable(path: Path, error: OSError) -> DataError:
    return DataError(
        f"{path} cannot be read: {error.strerror or error}. Make it readable, or set MOTION_GYM_DATA to another folder."
    )
