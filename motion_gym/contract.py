"""The contract: the data that domains, predictors and the harness exchange.

Arrays are float32 numpy. The agents of all scenes are stacked, and scenes are delimited as in CSR matrices: the
agents of scene ``s`` are ``scene[s]:scene[s + 1]``. Positions are in the unit of the domain (metres, unless its card
says otherwise), in the frame of the recording: axes as in the source, relative to ``Recording.origin``.
"""

from __future__ import annotations

import os
import sysconfig
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np

if TYPE_CHECKING:
    from motion_gym.data.scene_images import SceneImage

HISTORY = 8
"""Number of observed steps."""
FUTURE = 12
"""Number of forecast steps."""
MOST_SAMPLES = 10_000
"""Largest number of samples K."""
EXACT = 2**53
"""float64 represents all whole numbers below this."""
ORIGIN_GRID = 1000.0
"""The origin of a recording is a multiple of this, in the unit of its positions."""
WINDOW = HISTORY + FUTURE
"""Number of steps of a window: 8 of history and 12 of future."""


class MotionGymError(Exception):
    """Base class of the errors that motion-gym raises on purpose."""


class DataError(MotionGymError, ValueError):
    """A recording or a data file is missing, damaged or not valid."""


class SpecError(MotionGymError, ValueError):
    """A name or a parameter is not known, or a value is not allowed."""


class ParameterError(SpecError, TypeError):
    """A keyword is not a parameter; also a TypeError, as for any Python function."""


class PredictorError(MotionGymError, ValueError):
    """A predictor broke its contract."""


class ActionError(MotionGymError, ValueError):
    """An action is not a valid forecast for the environment."""


_LIBRARIES = tuple(
    f"{folder}{os.sep}"
    for folder in (Path(__file__).parent, *(sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")))
)

_GENERATED = ("<frozen", "<string>", "<__")
"""Beginnings of the names of code that has no file: of Python, of dataclasses, of compilers."""


def raised_at(error: BaseException) -> str:
    """File and line of users' code that raised an exception, or that called the library which did.

    Returns:
        `` (file.py, line 3)``; empty if only this package raised, as where it called a method with other arguments.
    """
    frames = traceback.extract_tb(error.__traceback__)
    last = next((f for f in reversed(frames) if not f.filename.startswith((*_LIBRARIES, *_GENERATED))), frames[-1])
    ours = last.filename.startswith((_LIBRARIES[0], *_GENERATED))
    return "" if ours else f" ({Path(last.filename).name}, line {last.lineno})"


@dataclass(frozen=True, eq=False)
class Recording:
    """Tracks of one place, as columns of equal length, sorted by frame and agent.

    Columns are converted: frames and ids of any integer type, or of whole floating-point numbers, become int64, and
    positions float64. ``motion_gym.data.recordings.check_recording`` checks the values.

    Attributes:
        frame: [R] int64, frame number as in the source, which counts time unless ``listed``.
        agent: [R] int64, id of the agent in this recording.
        xy: [R, 2] float64, positions in the frame and the unit of the source.
        dt: Seconds per step.
        name: Name for messages.
        origin: [2] float64, subtracted from ``xy`` in float64 before positions become float32. Observations, ground
            truth and forecasts are relative to the origin: add it to get positions in the frame of the source. The
            default is the first row rounded to 1,000, so zero near the zero of the source. A part made by
            ``dataclasses.replace`` keeps the origin of the whole. Recordings of one domain may have different origins.
        listed: How frame numbers become steps (``motion_gym.data.windows.step_numbers``). False: frame numbers count
            time. A step is the most common distance of an agent's consecutive frames, and a frame number that is
            missing is a step at which nobody was seen, so that a gap ends a window. True: two frames that follow each
            other in ``numpy.unique(frame)`` are one step apart, as in the published use of ETH-UCY.

    Raises:
        DataError: A column has the wrong shape or type, or holds numbers that do not fit int64.
    """

    frame: np.ndarray
    agent: np.ndarray
    xy: np.ndarray
    dt: float
    name: str = "recording"
    origin: np.ndarray = None  # type: ignore[assignment]  # computed below where it is not given
    listed: bool = False

    def __post_init__(self) -> None:
        frame, agent = self._whole_numbers("frame"), self._whole_numbers("agent")
        xy = self._numbers("xy").astype(np.float64, copy=False)
        if not frame.shape == agent.shape == xy.shape[:1] or xy.shape[1:] != (2,):
            raise DataError(
                f"recording {self.name}: frame, agent and xy have shapes {frame.shape}, {agent.shape} and {xy.shape}; "
                "expected [R], [R] and [R, 2], with the same number of rows R."
            )
        if self.origin is None:
            first = xy[:1].sum(axis=0)
            origin = np.round(first / ORIGIN_GRID) * ORIGIN_GRID + 0.0 if np.isfinite(first).all() else np.zeros(2)
        else:
            origin = self._numbers("origin").astype(np.float64)
        if origin.shape != (2,) or not np.isfinite(origin).all():
            raise DataError(
                f"recording {self.name}: origin is {self.origin}; give two finite numbers, or leave it out."
            )
        for column, values in (("frame", frame), ("agent", agent), ("xy", xy), ("origin", origin)):
            object.__setattr__(self, column, values)

    def _numbers(self, column: str) -> np.ndarray:
        values = np.asarray(getattr(self, column))
        if values.dtype.kind not in "iuf":
            raise DataError(f"recording {self.name}: {column} holds {values.dtype}; convert it to numbers.")
        return values

    def _whole_numbers(self, column: str) -> np.ndarray:
        values = self._numbers(column)
        if values.dtype.kind == "f":
            fits = (values == np.rint(values)) & (np.abs(values) < EXACT)
        else:
            fits = values <= np.iinfo(np.int64).max
        if not fits.all():
            row = int(np.argmin(fits.reshape(-1)))
            limit = "2**53" if values.dtype.kind == "f" else "2**63"
            raise DataError(
                f"recording {self.name}, row {row}: {column} is {values.reshape(-1)[row]}, not a whole number below "
                f"{limit}. Correct or leave out the row, or renumber the column."
            )
        return values.astype(np.int64, copy=False)


@dataclass(frozen=True, eq=False)
class Observation:
    """The input of a predictor.

    Attributes:
        history: [A, 8, F] float32; x, y and, in some domains, further features per step, oldest first. Positions are
            relative to the origin of the recording.
        scene: [S + 1] int64; agents of scene ``s`` are ``scene[s]:scene[s + 1]``.
        agent: [A] int64; stable id of each agent within its domain and split.
        dt: Seconds per step.
        time: [S] int64, last observed listed frame of each scene, counted over all recordings of the split or stream.
            Time and ``agent`` together identify a scene, even if two scenes look alike. None if not known.
        images: [S] image of the ground of each scene; scenes of one recording share one. None if the domain does not
            give every scene an image.
    """

    history: np.ndarray
    scene: np.ndarray
    agent: np.ndarray
    dt: float
    time: np.ndarray | None = None
    images: tuple[SceneImage, ...] | None = None

    def __len__(self) -> int:
        """Number of agents, all scenes together."""
        return len(self.history)

    @property
    def scenes(self) -> int:
        """Number of scenes."""
        return len(self.scene) - 1

    @property
    def xy(self) -> np.ndarray:
        """[A, 8, 2] positions without further features."""
        return self.history[..., :2]

    @property
    def scene_index(self) -> np.ndarray:
        """[A] int64, the scene of each agent."""
        return np.repeat(np.arange(self.scenes), np.diff(self.scene))


@dataclass(frozen=True, eq=False)
class Truth:
    """The ground truth that follows an observation.

    Attributes:
        future: [A, 12, 2] float32, positions in the frame of the observation; zero where not known.
        known: [A, 12] bool; False for steps after the agent left, and for steps that are not yet revealed.
        observation: The Observation before this future.
    """

    future: np.ndarray
    known: np.ndarray
    observation: Observation


@dataclass(frozen=True, eq=False)
class Forecast:
    """Positions of each agent at the 12 future steps, K samples.

    Attributes:
        positions: [A, K, 12, 2] float32, in the frame of the observation. The samples of a scene's agents belong
            together: sample k of the scene is sample k of each of its agents.
        weights: [A, K] float32 or None, likelihood of each sample; None if all are equally likely.
    """

    positions: np.ndarray
    weights: np.ndarray | None = None

    def most_likely(self) -> np.ndarray:
        """[A, 12, 2], the sample of highest weight of each agent; the first sample if there are no weights."""
        if self.weights is None:
            return self.positions[:, 0]
        return self.positions[np.arange(len(self.positions)), self.weights.argmax(axis=1)]

    def take(self, index: np.ndarray) -> Forecast:
        """The forecasts of some agents."""
        return Forecast(self.positions[index], None if self.weights is None else self.weights[index])

    @staticmethod
    def join(parts: Sequence[Forecast]) -> Forecast:
        """Join forecasts of different agents; weights are kept if all parts have them."""
        # Parts without agents may have any K.
        parts = [p for p in parts if len(p.positions)] or list(parts[:1])
        weights = [p.weights for p in parts if p.weights is not None]
        return Forecast(
            np.concatenate([p.positions for p in parts]),
            np.concatenate(weights) if len(weights) == len(parts) else None,
        )


@dataclass(frozen=True)
class Card:
    """Description of a domain, for tables and result files.

    Attributes:
        name: Name in the table of domains.
        parameters: Every parameter with its value.
        dt: Seconds per step.
        unit: Unit of positions.
        features: Names of the features of a history, in order.
        side_channels: Names of the features that read the future (oracle side channels).
        counts: For each split read so far: ``scenes`` (windows), ``agent_windows`` and ``agents`` that are scored, and
            ``recorded_agent_windows`` and ``recorded_agents`` of the recordings.
        source: Source of the data.
        terms: Terms of use of the data.
        files: sha256 of each data file.
        oracle: Name of the oracle predictor of this domain, if there is one.
    """

    name: str
    parameters: Mapping[str, Any]
    dt: float
    unit: str = "m"
    features: tuple[str, ...] = ("x", "y")
    side_channels: tuple[str, ...] = ()
    counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    source: str = ""
    terms: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    oracle: str | None = None


@runtime_checkable
class Predictor(Protocol):
    """Turns observations into forecasts; no base class is needed.

    Optional methods:
        ``observe(truth)``: observe revealed truth, or reference scenes, after they were scored; may change state.
        ``reset()``: forget everything observed since construction; called at the start of every stream and domain.
        ``tune(scenes, validation)``: learn from a few complete scenes of the scored domain, a Truth, and select by the
            scenes of ``validation``, a Truth or None.
        ``fit(train, validation, seed)``: learn from two sequences of Truth, one Truth per environment; returns self.
        ``save(path)`` and ``load(path)``: write and read weights.
        ``fit`` with ``checkpoint``, ``resume``, ``every``, ``report``, ``device`` and ``names`` as in
        ``predictors/weighted.py``: the predictor can be trained by ``motion-gym train``, and needs ``name`` and
        ``card``.
        ``know(domain)``: oracles only; receives the domain. A predictor with this method is labelled *oracle*.

    Optional attributes: ``fitted`` (bool), for predictors with ``fit``; ``fit_on_demand`` (bool), False if ``fit`` is
    too slow for an evaluation; ``selection`` (str), how the weights were selected, stated in every result;
    ``fingerprint`` (str), a digest of the weights, part of the identity of a result; ``trained_on``, names of the
    domains whose windows the weights were trained on.
    """

    def predict(self, observation: Observation, samples: int = 1, seed: int = 0) -> Forecast | np.ndarray:
        """Forecast every agent of an observation.

        Pure: the same state, input and seed give the same answer; the method learns nothing and does not change its
        input. A stochastic predictor draws only from ``seed`` and the scene: scenes are also asked one by one, each
        with the same seed, and the seed alone would give them all the same noise. A deterministic predictor may return
        one sample, which stands for all samples.

        Args:
            observation: A agents in S scenes.
            samples: K, the number of samples.
            seed: Seed of all randomness.

        Returns:
            Forecast, or its positions alone: [A, K, 12, 2] float32, in the frame of the observation.
        """


@runtime_checkable
class Domain(Protocol):
    """A source of recordings. Subclass ``motion_gym.RecordedDomain``, which derives all but ``recordings``."""

    @property
    def card(self) -> Card:
        """Description of the domain."""

    @property
    def world(self) -> str:
        """Key that is equal for domains whose frames show the same people at the same time."""

    def recordings(self, split: str) -> Sequence[Recording]:
        """Recordings of a split; the stream clock replays them, and all windows are cut from them."""

    def windows(self, split: str) -> Truth:
        """Every window of a split with its Observation, stacked."""

    def reference(self) -> Truth:
        """Reference scenes, disjoint from ``windows("test")``; may be empty."""
