"""Tracks at another rate, computed from samples at or before each point in time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from motion_gym.contract import WINDOW, SpecError
from motion_gym.data.tracks.frame_times import Clock

WHOLE = 0.005
"""A step is a whole number of frames if it is one but for this share, as 12 frames of 29.97 a second are 0.4 s."""
MEASURED = 0.02
"""The same share for a rate that was measured from timestamps."""
ENOUGH = 0.5
"""Share of the steps within the tracks that listed frames must serve; else points are extrapolated."""
NEAR = 0.1
"""Samples of an agent nearer in time than this share of the usual interval are one sample, sent twice."""
PHASES = 16
"""Places of the points, within a step, that are tried on irregular timestamps."""


@dataclass(frozen=True, eq=False)
class Resampled:
    """Tracks at a fixed step.

    Attributes:
        step: [N] int64, number of the step.
        row: [N] int64, row of the sample that the position was taken from, the last one at or before the step.
        xy: [N, 2] float64, positions.
        seconds: [N] float64, when each step was, since the first row.
        irregular: [U] int64, rows that are not on the file's own regular frames, and are not used.
        how: What was done, in words.
    """

    step: np.ndarray
    row: np.ndarray
    xy: np.ndarray
    seconds: np.ndarray
    irregular: np.ndarray
    how: str


def default_gap(step: float, interval: float) -> float:
    """Longest time, in seconds, between two samples that is bridged: half a step, or the usual time between samples."""
    return max(step / 2, 1.1 * interval)


def resample(clock: Clock, agent: np.ndarray, xy: np.ndarray, step: float, gap: float | None, title: str) -> Resampled:
    """Resample tracks to a step; no position depends on a later sample.

    Where a step is a whole number of frames, positions are those of listed frames: every n-th one, beginning with the
    frame that serves most rows (chosen anew after each gap of 20 steps). Else each position is extrapolated linearly
    from the last two samples at or before the point. Two samples more than ``gap`` seconds apart are not bridged:
    there are points for half a step after the first of them, as after the last sample of a track. If ``gap`` is stated,
    points are extrapolated in both cases, which are those of listed frames where a frame is listed.

    Args:
        clock: When each row was observed.
        agent: [R] ids.
        xy: [R, 2] float64 positions.
        step: Seconds.
        gap: Longest time, in seconds, between two samples that is bridged; None for ``default_gap``.
        title: What the file is, for messages.

    Raises:
        SpecError: the step is finer than the file, or the gap is longer than a window.
    """
    if gap is not None and gap > WINDOW * step:
        raise SpecError(
            f"{title}: gap={gap:g} s is longer than a window of {WINDOW} steps: give at most {WINDOW * step:g} s, so "
            "that no window is filled without a sample."
        )
    tolerance = MEASURED if clock.measured else WHOLE
    if clock.interval > step * (1 + tolerance):
        raise SpecError(
            f"{title}: step={step:g} s is finer than the file: rows of an agent are {clock.interval:.4g} s apart. "
            f"Give step={clock.interval:.4g} (or more), or correct fps or dt if the file is not so slow. Predictors "
            "with weights of another step refuse such a domain."
        )
    seconds = clock.seconds
    if clock.ticks is not None:
        stride = round(step / clock.tick)
        if stride >= 1 and abs(step / clock.tick - stride) <= tolerance * stride:
            thinned = _thinned(clock, clock.ticks, agent, xy, stride, step)
            if thinned is not None and gap is None:
                return thinned
            if thinned is not None:
                seconds = clock.ticks * (step / stride)
    return _extrapolated(
        seconds, agent, xy, step, default_gap(step, clock.interval) if gap is None else gap, clock.interval
    )


def _thinned(
    clock: Clock, ticks: np.ndarray, agent: np.ndarray, xy: np.ndarray, stride: int, step: float
) -> Resampled | None:
    """Every ``stride``-th frame; None if tracks are seldom listed there."""
    usual = max(1, round(clock.interval / clock.tick))
    if stride % usual:
        return None
    listed, index = np.unique(ticks, return_inverse=True)
    # After a gap that no window spans, the frames may begin anew.
    part = np.concatenate([[0], np.cumsum(np.diff(listed) > WINDOW * stride)])[index.reshape(-1)]
    phase = ticks % stride
    kinds, rows = np.unique(part * stride + phase, return_counts=True)
    order = np.lexsort((-rows, kinds // stride))
    best = order[np.unique((kinds // stride)[order], return_index=True)[1]]
    chosen = (kinds % stride)[best][part]
    row = np.flatnonzero(phase == chosen)
    if len(row) < ENOUGH * _steps_within(ticks, agent, stride):
        return None
    row, number = _last_of_each(row, (ticks[row] - chosen[row]) // stride, agent)
    off = np.flatnonzero((phase - chosen) % usual != 0)
    seconds = clock.tick * stride
    taken = "" if abs(seconds - step) < 1e-4 * step else f" ({seconds:.5g} s, taken as {step:g} s)"
    how = f"every {_ordinal(stride)} frame number{taken}" if stride > 1 else f"every frame{taken}"
    return Resampled(number, row, xy[row], clock.seconds[row], off, how)


def _steps_within(ticks: np.ndarray, agent: np.ndarray, stride: int) -> float:
    """Number of steps within the tracks; longer absences than a window are not counted."""
    order = np.lexsort((ticks, agent))
    apart = np.diff(ticks[order])[np.diff(agent[order]) == 0]
    return float(apart[apart <= WINDOW * stride].sum() / stride)


def _extrapolated(
    seconds: np.ndarray, agent: np.ndarray, xy: np.ndarray, step: float, gap: float, interval: float
) -> Resampled:
    """Points in time, each from the last two samples of the agent at or before it."""
    order = np.lexsort((seconds, agent))
    near = (np.diff(agent[order]) == 0) & (np.diff(seconds[order]) < NEAR * interval)
    order = order[np.append(True, ~near)] if len(order) else order
    time, who, where = seconds[order], agent[order], xy[order]
    same = np.diff(who) == 0
    slack = 1e-6 * step
    after = np.append(np.where(same, time[1:], np.inf), np.inf)
    bridged = after <= time + gap + slack
    until = np.where(bridged, after, time + min(gap, step / 2))

    def points(phase: float) -> tuple[np.ndarray, np.ndarray]:
        """First point at or after each sample, and how many there are before the next sample or the gap."""
        first = np.ceil((time - phase - slack) / step)
        # A point on the next sample is that sample's; one at the end of the gap still counts.
        last = np.floor((until - phase + slack) / step) + 1
        end = np.where(bridged, np.ceil((until - phase - slack) / step), last)
        return first, np.maximum(end - first, 0)

    def score(phase: float) -> tuple[int, float]:
        first, count = points(phase)
        one = count > 0
        return int(one.sum()), -float((first * step + phase - time)[one].sum())

    candidates = np.arange(PHASES) * step / PHASES + float(time.min(initial=0.0))
    phase = max(candidates, key=score)
    first, count = points(phase)
    count = count.astype(np.int64)
    row = np.repeat(np.arange(len(time)), count)
    number = first[row] + np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    ahead = np.maximum(number * step + phase - time[row], 0.0)
    before = np.concatenate([[np.inf], np.where(same, np.diff(time), np.inf)]) if len(time) else time
    velocity = np.zeros_like(where)
    moving = before <= max(gap, interval) + slack
    velocity[moving] = (where[moving] - where[np.flatnonzero(moving) - 1]) / before[moving, None]
    # The velocity of a track's first sample is not known: it gives a point only where it is.
    known = moving[row] | (ahead <= slack)
    row, number, ahead = row[known], number[known], ahead[known]
    number = number - number.min(initial=0)
    how = (
        f"points {step:g} s apart, each extrapolated linearly from the agent's last two samples at or before it; "
        f"samples more than {gap:.3g} s apart are not bridged"
    )
    if near.any():
        how += (
            f"; {int(near.sum())} rows less than {NEAR * interval:.3g} s after the agent's previous row were left out"
        )
    positions = where[row] + ahead[:, None] * velocity[row]
    seconds = time[row] + ahead
    return Resampled(number.astype(np.int64), order[row], positions, seconds, np.zeros(0, np.int64), how)


def _last_of_each(row: np.ndarray, step: np.ndarray, agent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One row for each agent and step, the last one: timestamps may fall on one step."""
    order = np.lexsort((row, step, agent[row]))
    same = (np.diff(agent[row][order]) == 0) & (np.diff(step[order]) == 0)
    keep = np.sort(order[np.append(~same, True)]) if len(order) else order
    return row[keep], step[keep]


def _ordinal(number: int) -> str:
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
