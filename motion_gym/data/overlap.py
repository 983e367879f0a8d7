"""Whether two sets of recordings show the same people at the same time: what is shown must not be what is scored."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from motion_gym.contract import Domain, Recording

SHARED_ROWS = 2
"""Rows that a person of one set must have in the other: one equal row may be chance, as a common starting point."""


def shared_people(shown: Sequence[Recording], scored: Sequence[Recording]) -> int:
    """Number of people of ``shown`` who are also in ``scored`` at the same time.

    A person is in both sets if at least two rows agree in one of two ways, to the bit: frame, agent and position; or
    two consecutive positions between which the person moves, whatever the frame numbers and ids are. A recording that
    begins later, is renumbered, or is cut otherwise is thus recognised; one that is resampled or moved is not, and
    is told by the ``world`` of its domain.
    """
    scored_keys = [
        (keys, np.concatenate([np.zeros(0, np.uint64), *map(keys, scored)])) for keys in (_row_keys, _step_keys)
    ]
    people = 0
    for recording in shown:
        _, person = np.unique(recording.agent, return_inverse=True)
        for keys, others in scored_keys:
            own = keys(recording)
            shared = np.isin(own, others) & (own != 0)
            found = int((np.bincount(person.reshape(-1)[shared]) >= SHARED_ROWS).sum())
            if found:
                people += found
                break
    return people


def trained_on_scored(trained: Domain, scored: Domain, split: str) -> bool:
    """Whether the training or validation windows of one domain show people of a split of another domain.

    Domains of one world that are sampled otherwise cannot be compared row by row. Where such a domain scores what it
    trains on (``tests_on_train``), its training windows are taken to show the people that are scored.
    """
    if trained.world == scored.world and getattr(type(trained), "tests_on_train", False):
        return True
    target = scored.recordings(split)
    return any(shared_people(trained.recordings(part), target) > 0 for part in ("train", "val"))


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
