"""One color for each method, the same in all figures and on the results page; dashes tell apart rows of one color.

The colors can be told apart with the common forms of color blindness, and stand out from white and from black. Methods
that are shown together have different colors, or dashes.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterable

from motion_gym.benchmarks.identity import row_name

GRAY, BLUE, VERMILION, GREEN, PURPLE, OCHRE, CYAN, RED = PALETTE = (
    "#7a7f87", "#2a78c8", "#d55e00", "#0f9268", "#b0579c", "#a67c00", "#1f93a8", "#c0405a",
)  # fmt: skip
"""After Okabe and Ito, "Color universal design" (2008), darkened or lightened to stand out from both backgrounds."""
DASHES: tuple[tuple[float, ...], ...] = ((), (5, 2), (1.5, 1.5), (7, 2, 1.5, 2), (2, 1, 2, 3), (9, 3))
"""Lengths of dashes and gaps; the first is a full line."""
COLORS = {
    name: color
    for color, names in {
        GRAY: "constant_velocity stand_still none",
        BLUE: "kalman_velocity constant_acceleration",
        CYAN: "linear hedge",
        OCHRE: "erm erm_no_sigma style_erm style_invariant style",
        VERMILION: "kalman_residual invariant modular modular_invariant modular_stgat finetune",
        GREEN: "modular_factors counterfactual constant_turn ego_erm refine heatmap",
        PURPLE: "vrex ego_modular kalman transfer",
        RED: "group_dro orca_oracle idm_oracle oracle ema_anchor ekf",
    }.items()
    for name in names.split()
}


def color_of(row: str) -> str:
    """Color of a row of a table: that of its name, whatever its parameters. A user's method has a color too."""
    name = row_name(row).partition(":")[0].partition(",")[0]
    return COLORS.get(name) or PALETTE[zlib.crc32(row.encode()) % len(PALETTE)]


def styles_of(rows: Iterable[str]) -> dict[str, tuple[str, tuple[float, ...]]]:
    """Color and dashes of the rows of one figure, no two alike up to six rows of one color."""
    used: Counter[str] = Counter()
    styles = {}
    for row in rows:
        color = color_of(row)
        styles[row] = color, DASHES[used[color] % len(DASHES)]
        used[color] += 1
    return styles
