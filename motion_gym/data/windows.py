"""Tracks of recordings, and windows of tracks, as array operations."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from motion_gym.catalog import whole_number
from motion_gym.contract import FUTURE, HISTORY, WINDOW, DataError, Observation, Recording, Truth
from motion_gym.data import storage
from motion_gym.data.recordings import check_recording
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.tracks.frame_times import usual_distance

Features = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(positions [A, 20, 2] float64, known [A, 20] bool) -> history [A, 8, F]; positions are zero where not known."""


DECIMALS = 6
"""Decimals of positions relative to an origin other than zero."""


@dataclass(frozen=True, eq=False)
class Tracks:
    """A recording sorted by agent, then time, and cut into unbroken tracks.

    Steps are counted by ``step_numbers``. An agent that is lost and found again begins a new track.

    Attributes:
        tick: [R] int64, number of the row's step.
        track: [R] int64, number of the unbroken track of the row, 0 .. T - 1.
        agent: [R] int64, id of the agent as in the recording, shifted so that none is negative.
        xy: [R, 2] float64, positions relative to the origin of the recording.
        age: [R] int64, rows of the same track before this one.
        left: [R] int64, rows of the same track after this one.
        ticks: Number of steps.
        dt: Seconds per step.
        image: The image of the ground that observations hold, relative to the origin of the recording; None for none.
    """

    tick: np.ndarray
    track: np.ndarray
    agent: np.ndarray
    xy: np.ndarray
    age: np.ndarray
    left: np.ndarray
    ticks: int
    dt: float
    image: SceneImage | None = None

    @classmethod
    def of(cls, recording: Recording, image: SceneImage | None = None) -> Tracks:
        """Sort and cut a recording, after checking it; ``image`` is the one that its observations hold.

        Raises:
            DataError: A column has the wrong shape or type, or a row is bad.
        """
        if len(recording.frame):
            check_recording(recording)
        frames, steps = step_numbers(recording)
        tick = steps[np.searchsorted(frames, recording.frame)]
        order = np.lexsort((tick, recording.agent))
        # Not negative, so that an offset per recording makes ids of several recordings unique.
        tick, agent = tick[order].astype(np.int64), recording.agent[order] - recording.agent.min(initial=0)
        new = np.ones(len(tick), bool)
        new[1:] = (agent[1:] != agent[:-1]) | (tick[1:] != tick[:-1] + 1)
        track = np.cumsum(new) - 1
        start = np.flatnonzero(new)
        length = np.diff(np.append(start, len(tick)))
        age = np.arange(len(tick)) - np.repeat(start, length)
        left = np.repeat(length, length) - 1 - age
        xy = recording.xy[order]
        if recording.origin.any():
            # Rounded, since float64 resolves less far from zero, which would change the last bits of differences.
            xy = np.round(xy - recording.origin, DECIMALS)
        image = None if image is None else image.relative_to(recording.origin)
        return cls(tick, track, agent, xy, age, left, int(steps.max(initial=-1)) + 1, recording.dt, image)

    def complete(self) -> np.ndarray:
        """Rows that are the last observed step of 20 consecutive steps of an agent."""
        return np.flatnonzero((self.age >= HISTORY - 1) & (self.left >= FUTURE))

    def around(self, row: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The 20 steps whose last observed step is ``row``.

        Args:
            row: [A] rows with ``age`` of at least 7.

        Returns:
            positions [A, 20, 2] float64, zero where the track has ended, and known [A, 20] bool.
        """
        known = np.arange(-HISTORY + 1, FUTURE + 1) <= self.left[row, None]
        steps = row[:, None] + np.arange(-HISTORY + 1, FUTURE + 1)
        positions = self.xy[np.where(known, steps, row[:, None])]
        positions[~known] = 0
        return positions, known

    def truth(
        self, row: np.ndarray, scene: np.ndarray, agent: np.ndarray, features: Features, before: int = 0
    ) -> Truth:
        """Observation and truth of the agents at the given rows (their last observed steps).

        ``before`` is the number of listed frames of the recordings that come before this one.
        """
        positions, known = self.around(row)
        history = features(positions, known).astype(np.float32)
        images = None if self.image is None else (self.image,) * (len(scene) - 1)
        observation = Observation(history, scene, agent, self.dt, self.tick[row[scene[:-1]]] + before, images)
        return Truth(positions[:, HISTORY:].astype(np.float32), known[:, HISTORY:], observation)


def step_numbers(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Distinct frames of a recording, in order, and the number of each one's step, from 0.

    Of a ``listed`` recording each listed frame is a step. Else a step is the most common distance of an agent's
    consecutive frames, and missing frame numbers are steps at which nobody was seen; a gap of more than 20 steps, which
    no window spans, counts as 20, so that memory stays bounded.

    Raises:
        DataError: two listed frames are not a whole number of steps apart.
    """
    frames = np.unique(recording.frame)
    if recording.listed or len(frames) < 2:
        return frames, np.arange(len(frames))
    usual = int(usual_distance(recording.frame, recording.agent))
    distance = np.diff(frames)
    off = (distance % usual != 0) & (distance < WINDOW * usual)
    if off.any():
        place = int(off.argmax())
        raise DataError(
            f"recording {recording.name}: frame {frames[place + 1]} comes {distance[place]} after frame "
            f"{frames[place]}, and a step is {usual} frame numbers, the most common distance of an agent's frames. "
            "Leave out or renumber the frame; or read the file by the domain `tracks`, which resamples by time; or "
            "say Recording(listed=True) if each listed frame is one step."
        )
    return frames, np.concatenate([[0], np.cumsum(np.minimum(distance // usual, WINDOW))])


def frames_by_step(recording: Recording) -> np.ndarray:
    """[T] the frame of each step of a recording; where nobody was seen, the frame before."""
    frames, steps = step_numbers(recording)
    return frames[np.searchsorted(steps, np.arange(int(steps.max(initial=-1)) + 1), side="right") - 1]


def positions_only(positions: np.ndarray, known: np.ndarray) -> np.ndarray:
    """The history without further features: [A, 8, 2]."""
    return positions[:, :HISTORY]


def offsets(sizes: np.ndarray) -> np.ndarray:
    """[S + 1] int64, where scenes of the given sizes begin and end."""
    return np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)


def cut_windows(
    places: Sequence[Tracks], features: Features = positions_only, min_agents: int = 1, stride: int = 1
) -> Truth:
    """Cut tracks into windows of 20 consecutive steps.

    An agent counts if it is present in all 20 steps; a window counts if at least ``min_agents`` agents do. Every
    published evaluation makes this choice, which reads the future: complete agents are known only afterwards.

    Args:
        places: Tracks of recordings. Agent ids are shifted so that they differ between recordings.
        features: Gives the history of each agent.
        min_agents: Smallest number of complete agents in a window; 0 means 1.
        stride: Steps from the start of one window to the start of the next, at least 1.

    Returns:
        Truth of all windows, in order of recording, start frame and agent; its scenes are the windows.

    Raises:
        SpecError: ``min_agents`` or ``stride`` is not a whole number in its range.
    """
    min_agents = whole_number("min_agents", min_agents, 0, 1_000_000)
    stride = whole_number("stride", stride, 1, 1_000_000)
    parts, shift, ticks = [], 0, 0
    for tracks in places:
        row = tracks.complete()
        start = tracks.tick[row] - (HISTORY - 1)
        row, start = row[start % stride == 0], start[start % stride == 0]
        count = np.bincount(start, minlength=tracks.ticks)
        enough = count[start] >= min_agents
        row, start = row[enough], start[enough]
        row = row[np.lexsort((tracks.agent[row], start))]
        scene = offsets(count[count >= max(min_agents, 1)])
        parts.append(tracks.truth(row, scene, tracks.agent[row] + shift, features, ticks))
        shift += int(tracks.agent.max(initial=-1)) + 1
        ticks += tracks.ticks
    return stack(parts)


def stack(parts: Sequence[Truth]) -> Truth:
    """Put truths one after another; their scenes stay apart.

    Raises:
        DataError: There is no part, or time steps or features of parts differ.
    """
    if not parts:
        raise DataError("stack needs at least one Truth.")
    kinds = {(p.observation.dt, p.observation.history.shape[2]) for p in parts}
    if len(kinds) > 1:
        raise DataError(f"Cannot stack truths whose (dt, number of features) differ: {sorted(kinds)}.")
    if len(parts) == 1:
        return parts[0]
    observation = stack_observations([part.observation for part in parts])
    return Truth(np.concatenate([p.future for p in parts]), np.concatenate([p.known for p in parts]), observation)


def stack_observations(parts: Sequence[Observation]) -> Observation:
    """Put observations one after another; their scenes stay apart."""
    if len(parts) == 1:
        return parts[0]
    times = [part.time for part in parts if part.time is not None]
    images = [part.images for part in parts if part.images is not None]
    return Observation(
        np.concatenate([part.history for part in parts]),
        offsets(np.concatenate([np.diff(part.scene) for part in parts])),
        np.concatenate([part.agent for part in parts]),
        parts[0].dt,
        np.concatenate(times) if len(times) == len(parts) else None,
        tuple(itertools.chain(*images)) if len(images) == len(parts) else None,
    )


def pick_scenes(truth: Truth, scenes: np.ndarray | list[int] | slice) -> Truth:
    """The given scenes of a truth, in the given order."""
    rows = rows_of(truth.observation, scenes)
    return Truth(truth.future[rows], truth.known[rows], pick_scenes_of(truth.observation, scenes))


def pick_scenes_of(observation: Observation, scenes: np.ndarray | list[int] | slice) -> Observation:
    """The given scenes of an observation, in the given order."""
    rows = rows_of(observation, scenes)
    sizes = observation.scene[1:][scenes] - observation.scene[:-1][scenes]
    scene = offsets(sizes)
    time = None if observation.time is None else observation.time[scenes]
    images = observation.images
    if images is not None:
        images = tuple(images[number] for number in np.arange(observation.scenes)[scenes].tolist())
    return Observation(observation.history[rows], scene, observation.agent[rows], observation.dt, time, images)


def rows_of(observation: Observation, scenes: np.ndarray | list[int] | slice) -> np.ndarray:
    """Rows of the agents of the given scenes, in the given order."""
    start = observation.scene[:-1][scenes]
    sizes = observation.scene[1:][scenes] - start
    return np.arange(sizes.sum()) + np.repeat(start - np.cumsum(sizes) + sizes, sizes)


def whole_scenes(truth: Truth) -> np.ndarray:
    """Numbers of the scenes without an unknown step."""
    unknown = truth.observation.scene_index[~truth.known.all(axis=1)]
    return np.setdiff1d(np.arange(truth.observation.scenes), unknown)


def check_truth(truth: Any, name: str) -> Truth:
    """The truth, if it can be scored.

    Raises:
        DataError: The type, shape or dtype is wrong, the scenes do not fit, a scene is empty or has an agent twice, or
            a value is not finite.
    """
    if not isinstance(truth, Truth) or not isinstance(truth.observation, Observation):
        raise DataError(f"{name} is a {type(truth).__name__}, not a Truth with its Observation.")
    seen = truth.observation
    agents = len(truth.future) if isinstance(truth.future, np.ndarray) else -1
    for field, array, shape, kind in (
        ("future", truth.future, (agents, FUTURE, 2), "float32"),
        ("known", truth.known, (agents, FUTURE), "bool"),
        ("history", seen.history, (agents, HISTORY, -1), "float32"),
        ("agent", seen.agent, (agents,), "int64"),
        ("scene", seen.scene, (-1,), "int64"),
        *([] if seen.time is None else [("time", seen.time, (len(seen.scene) - 1,), "int64")]),
    ):
        right = isinstance(array, np.ndarray) and array.dtype == kind and array.ndim == len(shape)
        if not right or any(n not in (m, -1) for m, n in zip(array.shape, shape, strict=True)):
            got = f"{array.dtype} {array.shape}" if isinstance(array, np.ndarray) else type(array).__name__
            expected = ", ".join("?" if n == -1 else str(n) for n in shape)
            raise DataError(f"{name}: {field} is {got}, expected {kind} ({expected}).")
    sizes = np.diff(seen.scene)
    if not len(seen.scene) or seen.scene[0] != 0 or seen.scene[-1] != agents or (sizes < 1).any():
        raise DataError(
            f"{name}: scene must rise from 0 to the {agents} agents, with at least one agent in each scene."
        )
    if seen.images is not None and (
        len(seen.images) != seen.scenes or not all(isinstance(image, SceneImage) for image in seen.images)
    ):
        raise DataError(
            f"{name}: images must be None or a tuple of {seen.scenes} SceneImage objects, one for each scene."
        )
    order, scene = np.lexsort((seen.agent, seen.scene_index)), seen.scene_index
    if ((np.diff(seen.agent[order]) == 0) & (np.diff(scene[order]) == 0)).any():
        raise DataError(f"{name}: an agent is in one scene twice; give every agent of a scene an id of its own.")
    if seen.history.shape[2] < 2 or not np.isfinite(seen.history).all() or not np.isfinite(truth.future).all():
        raise DataError(f"{name}: history and future must be finite, and 0 where they are not known.")
    return truth


def counts(truth: Truth) -> dict[str, int]:
    """Scenes (windows), agent-windows and distinct agents."""
    observation = truth.observation
    return {
        "scenes": observation.scenes,
        "agent_windows": len(observation),
        "agents": len(np.unique(observation.agent)),
    }


def recorded_counts(places: Sequence[Tracks]) -> dict[str, int]:
    """Number of agents of the recordings, and of their agent-windows for ``min_agents=1`` and ``stride=1``."""
    return {
        "recorded_agent_windows": sum(len(tracks.complete()) for tracks in places),
        "recorded_agents": sum(len(np.unique(tracks.agent)) for tracks in places),
    }


def empty_truth(features: int, dt: float) -> Truth:
    """A truth without scenes."""
    observation = Observation(
        np.zeros((0, HISTORY, features), np.float32),
        np.zeros(1, np.int64),
        np.zeros(0, np.int64),
        dt,
        np.zeros(0, np.int64),
    )
    return Truth(np.zeros((0, FUTURE, 2), np.float32), np.zeros((0, FUTURE), bool), observation)


def digest(truth: Truth) -> dict[str, Any]:
    """Counts of a truth, and sha256 of its histories, scenes and futures."""
    seen = truth.observation
    sha256 = storage.digest(seen.history, seen.scene, truth.future, truth.known)
    return {"scenes": seen.scenes, "agent_windows": len(seen), "sha256": sha256}
