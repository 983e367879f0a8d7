"""Whether two sets of recordings show the same people at the same time, so that one must not be scored."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_gym.contract import Domain, Recording

SHARED_ROWS = 3
"""Rows of a person that both sets must share; fewer may be chance, as a common starting point or whole pixels."""
SHARED_SAMPLES = 0.5
"""Share of a person's samples in a file that another file must hold; whole pixels of one frame to the next may agree
by chance."""


def shared_people(shown: Sequence[Recording], scored: Sequence[Recording], share: float = 0.0) -> int:
    """Number of people of ``shown`` who are also in ``scored`` at the same time.

    A person is in both sets if at least three rows agree in one of two ways, to the bit: frame, agent and position; or
    two consecutive positions between which the person moves, whatever the frame numbers and ids are. This recognises a
    recording that begins later, is renumbered, or is cut differently, but not a recording that is resampled or moved;
    the ``world`` of its domain identifies the latter.

    Args:
        shown: Recordings whose people are counted.
        scored: Recordings in which these people are searched.
        share: Share of a person's rows that must agree, besides the two rows.
    """
    if not sum(len(recording.frame) for recording in scored) or not shown:
        return 0
    agents = [np.unique(recording.agent, return_inverse=True)[1].reshape(-1) for recording in shown]
    first = np.cumsum([0, *(agent.max(initial=-1) + 1 for agent in agents)])
    person = np.concatenate([agent + number for agent, number in zip(agents, first, strict=False)])
    seen = np.zeros(first[-1], bool)
    for keys in (_row_keys, _step_keys):
        own, others = (np.concatenate([keys(recording) for recording in part]) for part in (shown, scored))
        others.sort()  # np.isin takes three times as long
        shared = (others[np.searchsorted(others, own) % len(others)] == own) & (own != 0)
        rows, equal = (np.bincount(person[which], minlength=len(seen)) for which in (own != 0, shared))
        seen |= equal >= np.maximum(SHARED_ROWS, share * rows)
    return int(seen.sum())


def trained_on_scored(trained: Domain, scored: Domain, split: str) -> bool:
    """Whether the training or validation windows of one domain show people of a split of another domain.

    Domains of one world with different sampling cannot be compared row by row. If such a domain scores its training
    recording (``tests_on_train``), its training windows count as windows of the scored people. If all domains of the
    world draw the people of each split anew (``draws_each_split``), other splits than these two show none of them.
    Two domains that read different files (``samples``) are compared sample by sample, before resampling.
    """
    if trained.world == scored.world:
        if getattr(type(trained), "tests_on_train", False):
            return True
        if getattr(type(trained), "draws_each_split", False) and split not in ("train", "val"):
            return False
    shown: Any = trained
    target: Any = scored
    if trained.world != scored.world and hasattr(trained, "samples") and hasattr(scored, "samples"):
        samples = target.samples(split)
        return any(shared_people(shown.samples(part), samples, SHARED_SAMPLES) > 0 for part in ("train", "val"))
    rows = target.recordings(split)
    return any(shared_people(shown.recordings(part), rows) > 0 for part in ("train", "val"))


def _row_keys(recording: Recording) -> np.ndarray:
    """[R] uint64, one per row: frame, agent and position."""
    return _hashed(np.column_stack([recording.frame, recording.agent, recording.xy]))


def _step_keys(recording: Recording) -> np.ndarray:
    """[R] uint64, one per row: this position and the agent's next one; 0 where there is none or the agent stands."""
    order = np.lexsort((recording.frame, recording.agent))
    agent, xy = recording.agent[order], recording.xy[order]
    moves = (agent[1:] == agent[:-1]) & (xy[1:] != xy[:-1]).any(axis=1)
    keys = np.zeros(len(agent), np.uint64)
    keys[order[:-1]] = np.where(moves, _hashed(np.hstack([xy[:-1], xy[1:]])), np.uint64(0))
    return keys


def _hashed(rows: np.ndarray) -> np.ndarray:
    """[R] uint64, a mixed hash of float64 rows [R, C]; equal rows have equal hashes, minus zero counts as zero."""
    bits = np.ascontiguousarray(rows + 0.0, dtype=np.float64).view(np.uint64)
    key = np.full(len(bits), 0x9E3779B97F4A7C15, np.uint64)
    for column in bits.T:
        key ^= column
        key ^= key >> np.uint64(32)
        key *= np.uint64(0xD6E8FEB86659FD93)
        key ^= key >> np.uint64(29)
    return key
