"""Provenance of results: the commit of the checkout and the versions of the libraries."""

from __future__ import annotations

import functools
import importlib.metadata
import platform
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym.contract import Truth

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


def sources_of(
    train: Sequence[Truth], names: Sequence[str] = (), used: Sequence[Mapping[str, Any]] = ()
) -> list[dict[str, Any]]:
    """What a training saw, for the card of its weights: one entry for each environment.

    Args:
        train: Windows of each environment.
        names: Specs of the environments, where they are known.
        used: ``scenes`` and ``agent_windows`` of each environment that were used, where these are not all.

    Returns:
        ``domain``, ``dt`` (s), ``noise`` (see ``measurement_noise``), ``scenes`` and ``agent_windows``.
    """
    labels = names if len(names) == len(train) else [None] * len(train)
    everything = [{"scenes": truth.observation.scenes, "agent_windows": len(truth.observation)} for truth in train]
    counts = used if len(used) == len(train) else everything
    return [
        {
            "domain": name,
            "dt": round(float(truth.observation.dt), 6),
            "noise": measurement_noise(truth),
            "scenes": count["scenes"],
            "agent_windows": count["agent_windows"],
        }
        for name, truth, count in zip(labels, train, counts, strict=True)
    ]


def measurement_noise(truth: Truth) -> float | None:
    """Standard deviation of the noise of a coordinate, from third differences, in the unit of the positions.

    White noise of deviation s has third differences of deviation sqrt(20) s; the median of their size is robust to
    jumps. Changes of acceleration count as noise, so that this is an upper bound. None without a complete window.
    """
    complete = truth.known.all(axis=1)
    if not complete.any():
        return None
    path = np.concatenate([truth.observation.xy[complete], truth.future[complete]], axis=1).astype(np.float64)
    deviation = np.median(np.abs(np.diff(path, 3, axis=1))) / 0.6745 / np.sqrt(20)
    return float(f"{deviation:.3g}")


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
