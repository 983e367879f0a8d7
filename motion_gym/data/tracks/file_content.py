"""What a file holds: its bytes, decompressed, as text."""

from __future__ import annotations

import bz2
import codecs
import gzip
import lzma
import re
import zlib
from collections.abc import Callable
from pathlib import Path

from motion_gym.contract import DataError
from motion_gym.specs import closest

CONTROL = re.compile(r"[\x00-\x08\x0e-\x1f\x7f]")
BYTE_ORDER_MARKS = {
    codecs.BOM_UTF8: "utf-8-sig",
    codecs.BOM_UTF32_LE: "utf-32",
    codecs.BOM_UTF32_BE: "utf-32",
    codecs.BOM_UTF16_LE: "utf-16",
    codecs.BOM_UTF16_BE: "utf-16",
}
COMPRESSED: dict[bytes, tuple[str, Callable[[bytes], bytes]]] = {
    b"\x1f\x8b": ("gzip", gzip.decompress),
    b"BZh": ("bzip2", bz2.decompress),
    b"\xfd7zXZ\x00": ("xz", lzma.decompress),
}


def content_of(path: Path) -> bytes:
    """The bytes of a file; DataError if it is missing, a folder or not readable."""
    try:
        if path.is_file():
            return path.read_bytes()
        folder, there = path.is_dir(), path.exists()
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path} cannot be read: {getattr(error, 'strerror', None) or error}. Give a file that can be read."
        ) from None
    if folder:
        raise DataError(f"{path} is a folder. Give a file, or a pattern as '{path}/*.txt'.")
    if there:
        raise DataError(f"{path} is not a file. Give a file of tracks.")
    raise missing_file(path)


def missing_file(path: Path) -> DataError:
    """The error for a file that is not there, with the file of the most similar name in its folder."""
    try:
        close = closest(path.name, [other.name for other in path.parent.iterdir() if other.is_file()])
    except (OSError, ValueError):
        close = None
    remedy = f"Did you mean `{path.parent / close}`?" if close else "Check the name and the folder."
    return DataError(f"there is no file {path}. {remedy}")


def decompressed(path: Path, content: bytes) -> tuple[bytes, str]:
    """The content of a file, and how it was compressed, found by its first bytes; DataError if it is damaged."""
    for magic, (name, decompress) in COMPRESSED.items():
        if content.startswith(magic):
            try:
                return decompress(content), name
            except (OSError, EOFError, ValueError, zlib.error, lzma.LZMAError) as error:
                raise DataError(
                    f"{path} is a {name} file that is damaged or incomplete ({error}). Get it again."
                ) from None
    return content, ""


def decoded(path: Path, content: bytes) -> tuple[str, str]:
    """The text of a file, and its encoding."""
    mark = next((mark for mark in BYTE_ORDER_MARKS if content.startswith(mark)), None)
    try:
        encoding = BYTE_ORDER_MARKS[mark] if mark else "utf-8"
        text = content.decode(encoding)
    except UnicodeDecodeError as error:
        if mark:
            raise DataError(f"{path} begins as {encoding} and is damaged ({error.reason}). Get it again.") from None
        encoding = "latin-1"
        text = content.decode(encoding)
    if not text.strip("\ufeff \t\r\n\f\v"):
        raise DataError(f"{path} is empty. Expected a row for each person and frame: frame id x y.")
    if CONTROL.search(text):
        archive = " It is a zip archive: unpack it." if content.startswith(b"PK\x03\x04") else ""
        if str(path).lower().endswith((".xlsx", ".xlsm", ".xls", ".ods")):
            archive = " It is a spreadsheet: export it as csv."
        wide = " If it is UTF-16 text, save it with a byte order mark, or as UTF-8." if b"\x00" in content else ""
        raise DataError(
            f"{path} is binary, not text.{archive or wide} Give a text file, as csv, or a Parquet file: a row for each "
            "person and frame, frame id x y."
        )
    return text, encoding.removesuffix("-sig")
