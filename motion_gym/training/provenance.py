"""Provenance of results: the commit of the checkout and the versions of the libraries."""

from __future__ import annotations

import functools
import importlib.metadata
import platform
import subprocess
from pathlib import Path

PACKAGES = ("motion-gym", "numpy", "gymnasium", "pettingzoo", "torch", "numba")
"""Packages that results may depend on."""


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of ``PACKAGES``."""
    installed = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            installed[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            installed[package] = "not installed"
    return installed


@functools.cache
def commit() -> str | None:
    """Commit of the motion-gym checkout, with ``+`` appended if a file has changed; None outside a checkout."""
    root = Path(__file__).resolve().parent.parent.parent

    def git(*arguments: str) -> str:
        return subprocess.run(
            ["git", "-C", str(root), *arguments], capture_output=True, text=True, timeout=10, check=True
        ).stdout.strip()

    try:
        if Path(git("rev-parse", "--show-toplevel")).resolve() != root:
            return None
        changed = git("status", "--porcelain", "--", "*.py")
        return git("rev-parse", "HEAD") + ("+" if changed else "")
    except (OSError, subprocess.SubprocessError):
        return None
