"""Whether the columns of frame and id seem to be swapped."""

from __future__ import annotations

import numpy as np

from motion_gym.contract import WINDOW

FASTER = 3.0
"""An id whose steps are this many times as long as the distance between neighbours in a frame is no id."""


def swap_evidence(time: np.ndarray, agent: np.ndarray, xy: np.ndarray) -> str:
    """Why frame and id seem to be swapped; empty if nothing speaks for it.

    Two things are compared with what they would be if the columns were swapped: how many rows the longest track has
    (a window needs 20), and how far an agent moves from one row to the next.

    Args:
        time: [R] frames or times.
        agent: [R] ids.
        xy: [R, 2] positions.
    """
    longest, other = (int(np.unique(column, return_counts=True)[1].max(initial=0)) for column in (agent, time))
    step, across = _median_step(time, agent, xy), _median_step(agent, time, xy)
    short = longest < WINDOW <= other and (step is None or across is None or across < step)
    far = step is not None and across is not None and across > 0 and step > FASTER * across
    if not short and not far:
        return ""
    moves = "" if step is None or across is None else (
        f", and an agent moves {step:.3g} from row to row, where rows of one frame are {across:.3g} apart"
    )  # fmt: skip
    return f"the longest track has {longest} rows, and the fullest frame {other}{moves}"


def _median_step(time: np.ndarray, agent: np.ndarray, xy: np.ndarray) -> float | None:
    order = np.lexsort((time, agent))
    same = np.diff(agent[order]) == 0
    steps = np.hypot(*np.diff(xy[order], axis=0)[same].T)
    return float(np.median(steps)) if len(steps) else None
