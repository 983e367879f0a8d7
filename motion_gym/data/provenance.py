"""Where a result or a set of weights comes from: versions of the packages, commit and machine."""

from __future__ import annotations

import datetime
import functools
import importlib.metadata
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

PACKAGES = ("motion-gym", "numpy", "gymnasium", "pettingzoo", "torch", "numba")
"""Distributions whose versions are recorded."""


@functools.cache
def versions() -> dict[str, str]:
    """Versions of Python and of the packages that a number may depend on."""
    recorded = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            recorded[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            recorded[package] = "not installed"
    return recorded


@functools.cache
def commit() -> str | None:
    """Commit of the checkout that motion-gym runs from, with ``+`` if it was changed since; None outside of one."""
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


def provenance() -> dict[str, Any]:
    """What is recorded beside a result and is no part of its identity, in JSON types."""
    return {
        "versions": versions(),
        "commit": commit(),
        "machine": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "finished": datetime.datetime.now(datetime.timezone.utc).isoformat(timespec="milliseconds"),
        "command": sys.argv[1:],
    }
