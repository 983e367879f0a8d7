"""Downloads of single files with known checksums."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Any

from motion_gym.contract import DataError, MotionGymError
from motion_gym.data.known_datasets import DataFile
from motion_gym.data.storage import StorageError, digest


def download(file: DataFile, remedy: str) -> bytes:
    """The content of a file from its address. A broken connection is tried once more.

    Args:
        file: The file, with its address and checksum.
        remedy: Sentence for messages: how to get the file without a download.

    Raises:
        DataError: The file could not be downloaded, or is not the expected one.
        StorageError: The temporary folder cannot be written to.
    """
    import pooch  # takes a quarter of a second, and only downloads need it
    import requests

    def checked(url: str, path: str, shelf: Any) -> None:
        pooch.HTTPDownloader(timeout=30)(url, path, shelf)
        content = Path(path).read_bytes()
        if digest(content) != file.sha256:  # before pooch, so that the message says how the file differs
            raise DataError(f"{file.address} is not the expected {file.name}: {difference(file, content)}. {remedy}")

    pooch.get_logger().setLevel("WARNING")  # pooch would report the temporary folder
    try:
        # Into a temporary folder: pooch writes files that no other user can read, which breaks shared data folders.
        with tempfile.TemporaryDirectory() as folder:
            registry, urls = {"content": f"sha256:{file.sha256}"}, {"content": file.address}
            shelf = pooch.create(folder, base_url="", registry=registry, urls=urls, retry_if_failed=1)
            return Path(shelf.fetch("content", downloader=checked)).read_bytes()
    except MotionGymError:
        raise
    except requests.HTTPError as error:
        status = str(error).partition(" for url")[0]
        raise DataError(f"{file.name} could not be downloaded: {file.address} answered {status}. {remedy}") from None
    except (requests.RequestException, ValueError) as error:
        # The system's own words ("Connection refused") are the last thing in a chain of wrapped messages. A ValueError
        # is about the address.
        system = re.search(r"\[Errno -?\d+\] ([\w ,']+)", str(error))
        raise DataError(
            f"{file.name} could not be downloaded: {file.address}: the network or the server was not reachable "
            f"({system[1] if system else type(error).__name__}). {remedy}"
        ) from None
    except OSError as error:
        raise StorageError(
            f"{file.name} could not be written to {tempfile.gettempdir()}: {error.strerror or error}. "
            "Free space there, or set TMPDIR to another folder."
        ) from None


def difference(file: DataFile, content: bytes) -> str:
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
    size = f"{file.size} bytes with " if file.size else ""
    return (
        f"expected {size}sha256 {file.sha256}, found {len(content)} bytes with sha256 {digest(content)}; "
        f"probably {cause}"
    )
