"""Short forms of the tests of claims."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

ANY = float("inf")
"""A ratio without an upper limit."""
Test = dict[str, Any]
"""Arguments of ``Claim``, without the sentence."""


def lower(rows: Sequence[str], than: Sequence[str] = (), columns: Sequence[str] = (), **options: Any) -> Test:
    """Rows have a significantly lower error than other rows, in panel ``0`` unless another panel is named."""
    return {"rows": rows, "than": than, "columns": columns, "panel": "0", **options}


def mean(rows: Sequence[str], than: Sequence[str] = (), columns: Sequence[str] = (), **options: Any) -> Test:
    """Rows have a lower mean error than other rows, or a ratio of mean errors in a range."""
    return lower(rows, than, columns, significant=False, **options)
