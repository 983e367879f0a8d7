"""The check that the right version of highway-env is installed."""

from __future__ import annotations

import functools
import importlib.metadata

from motion_gym.contract import SpecError

VERSION = "1.12"
"""Version of highway-env that the engine steps: other versions may move the vehicles differently."""
ENGINE_VERSION = 1
"""Raise this number when results change, so that cached tracks of an older engine are not used."""
INSTALL = 'pip install "motion-gym[highway]" (from a checkout: pip install ".[highway]")'


def check_package() -> None:
    """Raise SpecError unless highway-env is installed in the version that the engine needs."""
    version = installed()
    if version is None:
        raise SpecError(f"Domain `highway` needs highway-env {VERSION}, which is not installed: {INSTALL}.")
    if version != VERSION and not version.startswith(f"{VERSION}."):
        raise SpecError(
            f"Domain `highway` needs highway-env {VERSION}, and {version} is installed, which may simulate other "
            f"tracks: {INSTALL}."
        )


@functools.cache
def installed() -> str | None:
    """Version of highway-env, which is looked up once: that takes 3 ms, and every episode asks."""
    try:
        return importlib.metadata.version("highway-env")
    except importlib.metadata.PackageNotFoundError:
        return None
