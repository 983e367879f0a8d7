"""Measurements of recordings that show whether a file was read rightly, each with what is usual and what to do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, WINDOW, Recording
from motion_gym.data.windows import Tracks, step_numbers

STANDING = 0.1
"""Metres per second below which an agent stands."""
MOSTLY_STANDING = 0.7
"""Share of steps standing above which it is asked whether the recording is of people who walk."""
JUMP = 10.0
"""A step this many times as long as the agent's shorter neighbouring step, plus the median step, is a jump."""
JUMP_SPEED = 8.0
"""Metres per second below which no step is a jump."""
ABSENT = 60.0
"""Seconds after which an id that comes back may be another agent."""
STRAIGHT = 0.1
"""Median error of constant velocity after 12 steps, as a share of the path; that of walkers at 0.4 s is above."""
COARSE = 0.25
"""Share of the median step above which the resolution or the noise of coordinates matters."""
MOST_WINDOWS = 20_000
"""Windows of a recording that are measured."""
WIDE = 5000.0
"""Metres: wider than what a recording of people from one place shows."""


@dataclass(frozen=True)
class Finding:
    """One measurement.

    Attributes:
        name: What was measured.
        value: The value, in JSON types.
        text: The value in words, with its unit.
        warning: What is usual and what to do, where the value is not usual; else empty.
    """

    name: str
    value: Any
    text: str
    warning: str = ""


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of all unbroken tracks of several recordings.

    Attributes:
        tracks: The recordings, cut into tracks.
        length: [N] distance of each step from one row to the next.
        dt: Seconds per step.
        unit: Unit of lengths.
    """

    tracks: Sequence[Tracks]
    length: np.ndarray
    dt: float
    unit: str

    @classmethod
    def of(cls, recordings: Sequence[Recording], unit: str) -> Steps:
        """Measure recordings."""
        tracks = [Tracks.of(recording) for recording in recordings if len(recording.frame)]
        dt = recordings[0].dt if recordings else 0.4
        lengths = [np.hypot(*np.diff(part.xy, axis=0)[np.diff(part.track) == 0].T) for part in tracks]
        return cls(tracks, np.concatenate([np.zeros(0), *lengths]), dt, unit)

    @property
    def moving(self) -> np.ndarray:
        """Lengths of the steps of agents who move; of all steps where the unit is not metres."""
        return self.length[self.length > STANDING * self.dt] if self.unit == "m" else self.length[self.length > 0]


def straightness(steps: Steps, stated: str) -> Finding | None:
    """How far constant velocity is off after 12 steps: little, if rows are nearer in time than was said."""
    if steps.unit != "m":
        return None
    parts = [np.zeros((0, WINDOW, 2))]
    for tracks in steps.tracks:
        rows = tracks.complete()
        parts.append(tracks.around(rows[:: max(1, len(rows) // MOST_WINDOWS)])[0])
    window = np.concatenate(parts)
    now = HISTORY - 1
    path = np.hypot(*np.diff(window[:, now:], axis=1).transpose(2, 0, 1)).sum(axis=1)
    window, path = window[path > FUTURE * 3 * STANDING * steps.dt], path[path > FUTURE * 3 * STANDING * steps.dt]
    if len(path) < 50:
        return None
    forecast = window[:, now] + FUTURE * (window[:, now] - window[:, now - 2]) / 2
    share = float(np.median(np.hypot(*(window[:, -1] - forecast).T) / path))
    warning = ""
    if share < STRAIGHT:
        warning = (
            f"Constant velocity is off by {share:.1%} of the path after 12 steps; of walkers in steps of 0.4 s it "
            f"is off by 14 to 45 %. Are rows really {steps.dt:g} s apart? If every frame of a video or a sensor is "
            f"listed, give fps (as fps=10, fps=25){f' instead of {stated}' if stated else ''}. Simulated, smoothed and "
            "guided motion is as straight as that, too."
        )
    return Finding("constant velocity is off by", round(share, 4), f"{share:.1%} of the path after 12 steps", warning)


def standing(steps: Steps) -> Finding:
    """Share of the steps in which an agent stands."""
    still = STANDING * steps.dt if steps.unit == "m" else 0.0
    share = float((steps.length <= still).mean()) if len(steps.length) else 0.0
    warning = ""
    if share > MOSTLY_STANDING:
        warning = (
            f"{share:.0%} of the steps are of agents who stand: a predictor that stands still scores well. Leave out "
            "parked vehicles and people who sit, or check unit and scale."
        )
    limit = f" (below {STANDING:g} m/s)" if steps.unit == "m" else ""
    return Finding("share standing", round(share, 4), f"{share:.0%}{limit}", warning)


def jumps(steps: Steps, recordings: Sequence[Recording]) -> Finding:
    """Steps that are far longer than those before and after them."""
    middle = float(np.median(steps.moving)) if len(steps.moving) else 0.0
    count, first = 0, ""
    recordings = [recording for recording in recordings if len(recording.frame)]
    for part, recording in zip(steps.tracks, recordings, strict=True):
        same = np.diff(part.track) == 0
        length = np.where(same, np.hypot(*np.diff(part.xy, axis=0).T), np.nan)
        padded = np.concatenate([[np.nan], length, [np.nan]])
        neighbour = np.fmin(padded[:-2], padded[2:])
        with np.errstate(invalid="ignore"):
            jump = length > JUMP * (neighbour + middle)
            if steps.unit == "m":
                jump &= length > JUMP_SPEED * steps.dt
        count += int(jump.sum())
        if jump.any() and not first:
            row = int(jump.argmax())
            order = np.lexsort((recording.frame, recording.agent))
            agent, frame = recording.agent[order][row], recording.frame[order][row + 1]
            first = f"agent {agent} moves {length[row]:.1f} {steps.unit} up to frame {frame} of {recording.name}"
    warning = ""
    if count:
        warning = (
            f"{count} {'steps are jumps' if count > 1 else 'step is a jump'}, more than {JUMP:g} times as long as the "
            f"neighbouring steps: {first}. Two agents may share an id, or a position may be wrong: correct the rows, "
            "or give the agent a new id after the jump."
        )
    return Finding("jumps", count, str(count), warning)


def absences(recordings: Sequence[Recording]) -> Finding:
    """Ids that are absent for longer than a window and come back."""
    count, longest, who = 0, 0.0, ""
    for recording in recordings:
        frames, steps = step_numbers(recording)
        usual = np.diff(frames).min(initial=np.iinfo(np.int64).max) if len(frames) > 1 else 1
        order = np.lexsort((recording.frame, recording.agent))
        apart = np.diff(recording.frame[order]) // usual if not recording.listed else np.diff(
            steps[np.searchsorted(frames, recording.frame[order])]
        )  # fmt: skip
        gone = np.where(np.diff(recording.agent[order]) == 0, apart, 0)
        count += int((gone > WINDOW).sum())
        if len(gone) and gone.max() * recording.dt > longest:
            longest = float(gone.max() * recording.dt)
            row = int(gone.argmax())
            who = f"agent {recording.agent[order][row]} comes back at frame {recording.frame[order][row + 1]}"
    warning = ""
    if longest > ABSENT:
        warning = (
            f"Ids come back after a long absence ({count} after more than {WINDOW} steps; "
            f"{who}, {longest:.0f} s later). If the tracker uses ids again for other people, give each person an id of "
            "its own: counts and intervals take one id for one person. Windows are not affected: a gap ends them."
        )
    return Finding(
        "ids that come back", count, f"{count} after more than {WINDOW} steps, longest {longest:.0f} s", warning
    )


def gaps(recordings: Sequence[Recording], dt: float) -> Finding:
    """Times at which nobody was seen."""
    count, longest = 0, 0.0
    for recording in recordings:
        frames = np.unique(recording.frame)
        if len(frames) > 1:
            apart = np.diff(frames) / np.diff(frames).min()
            count += int((apart > 1).sum())
            longest = max(longest, float(apart.max() - 1) * dt)
    listed = any(recording.listed for recording in recordings)
    note = "; listed frames count as consecutive, as published" if listed and count else ""
    return Finding("gaps with nobody", count, f"{count}, longest {longest:.1f} s{note}" if count else "none")


def extent(recordings: Sequence[Recording], unit: str) -> Finding:
    """Width and height of all positions."""
    xy = np.concatenate([np.zeros((0, 2)), *(recording.xy for recording in recordings)])
    width, height = (np.ptp(xy, axis=0) if len(xy) else np.zeros(2)).tolist()
    warning = ""
    if len(xy) and min(width, height) == 0:
        flat = "x" if width == 0 else "y"
        warning = (
            f"{flat} is {xy[0, int(width != 0)]:g} in every row. If another column holds the ground position (as z, or "
            "y behind a height), say so with columns='FRAME ID X Y'."
        )
    elif unit == "m" and max(width, height) > WIDE:
        warning = (
            f"Positions span {width:.0f} x {height:.0f} m, and people in view of one sensor span less than {WIDE:g} m: "
            "check unit and scale, or look for a wrong position."
        )
    return Finding("extent", [round(width, 4), round(height, 4)], f"{width:.1f} x {height:.1f} {unit}", warning)


def people(recordings: Sequence[Recording]) -> Finding:
    """Agents per frame."""
    counts = np.concatenate(
        [np.zeros(0, int), *(np.unique(recording.frame, return_counts=True)[1] for recording in recordings)]
    )
    middle, most = (int(np.median(counts)), int(counts.max())) if len(counts) else (0, 0)
    return Finding("people per frame", {"median": middle, "most": most}, f"median {middle}, most {most}")


def resolution(xy: np.ndarray, unit: str, step: float, file_unit: float = 1.0) -> Finding:
    """The grid that coordinates lie on.

    Args:
        xy: [R, 2] positions in the unit of the domain.
        unit: Unit of the domain.
        step: Median step of those who move.
        file_unit: Length of the file's unit, in which coordinates were rounded.
    """
    values = xy / file_unit
    largest = max(1.0, float(np.abs(values).max(initial=0)))
    decimals = next(
        (d for d in range(9) if np.abs(np.round(values, d) - values).max(initial=0) < 1e-12 * largest), None
    )
    grid = 0.0 if decimals is None else 10.0**-decimals * file_unit
    for column in xy.T:
        distinct = np.diff(np.unique(column))
        distinct = distinct[distinct > 1e-9 * largest]
        if len(distinct) > 5:
            nearest = float(np.quantile(distinct, 0.05))  # tiny, unless positions lie on a grid
            off = distinct / nearest - np.rint(distinct / nearest)
            if np.median(np.abs(off)) < 0.05:  # few rows are far apart without a grid
                grid = max(grid, nearest)
    warning = ""
    if step and grid > COARSE * step:
        warning = (
            f"Coordinates lie on a grid of {grid:.3g} {unit}, and a step is {step:.3g} {unit}: the path of an agent is "
            "a staircase. Use coordinates before they were rounded, or state errors below the grid as not resolved."
        )
    return Finding("resolution", grid or None, f"{grid:.3g} {unit}" if grid else "finer than 1e-8", warning)


def noise(time: np.ndarray, agent: np.ndarray, xy: np.ndarray, interval: float, unit: str, step: float) -> Finding:
    """Standard deviation of the measurement noise of a coordinate, from third differences.

    White noise of deviation s has third differences of deviation sqrt(20) s; the median of their size is robust to
    jumps. Changes of acceleration count as noise, so that this is an upper bound.
    """
    order = np.lexsort((time, agent))
    apart = np.diff(time[order])
    near = (np.diff(agent[order]) == 0) & (apart < 1.5 * interval)
    whole = near[2:] & near[1:-1] & near[:-2]
    third = np.abs(np.diff(xy[order], 3, axis=0)[whole])
    if len(third) < 20:
        return Finding("measurement noise", None, "too few rows to tell")
    deviation = float(np.median(third) / 0.6745 / np.sqrt(20))
    warning = ""
    if step and deviation > COARSE * step:
        warning = (
            f"Measurement noise is up to {deviation:.3g} {unit} (third differences), and a step is {step:.3g} "
            f"{unit}: no forecast can be better than the noise. Smooth with a filter that uses past samples only, or "
            "give a larger step."
        )
    return Finding(
        "measurement noise", round(deviation, 6), f"up to {deviation:.3g} {unit} (third differences)", warning
    )
