"""Loops that numba compiles at their first call. The machine code is kept on the disk, if there is room for it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from numba import njit
from numba.core.caching import FunctionCache


class _Kept(FunctionCache):
    """A cache of machine code without which everything works, only later by the seconds that compiling takes.

    That of numba raises where a file is damaged or cannot be written, as on a full disk.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # whatever a damaged file makes of the reader
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        with contextlib.suppress(OSError):
            super().save_overload(sig, data)


def compiled(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a function that numba compiles: without Python objects, and without the global lock.

    Args:
        options: Further options of ``numba.njit``.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(nogil=True, error_model="numpy", **options)(function)
        with contextlib.suppress(RuntimeError):  # no folder for a cache can be written
            dispatcher._cache = _Kept(function)
        return dispatcher

    return decorate
