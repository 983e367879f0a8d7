"""RecordedDomain: the class that every domain subclasses. A domain gives recordings; the library cuts windows."""

from __future__ import annotations

import functools
import inspect
import math
import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import numpy as np

from motion_gym.catalog import format_spec, suggest
from motion_gym.contract import HISTORY, Card, DataError, Domain, Recording, SpecError, Truth
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.windows import Tracks, counts, cut_windows, empty_truth, recorded_counts

Kept = TypeVar("Kept")
Source = TypeVar("Source")

TrainingSet = tuple[list[Truth], list[Truth]]
"""Training and validation truths, one of each per environment."""

LIBRARY_METHODS = {
    "windows": "give recordings(split), and the library cuts all windows; min_agents and stride choose among them",
    "reference": 'give the reference scenes as recordings("reference"), without people of the scored scenes',
    "history": "give features(history), which receives the observed steps alone, or declare side_channels",
}
"""Methods that a subclass of RecordedDomain must not define, and what to define instead."""

NO_SOURCES = (
    "names no domains to train on: define `sources()` in its class; `return [self]` trains on its own splits `train` "
    "and `val`. Or fit the predictor yourself, `predictor.fit(train, validation, seed)`, and pass the fitted object."
)
"""What is said of a domain without sources."""
SPECIAL = '"$`\\!'
"""Characters that a shell changes within double quotes."""


class RecordedDomain:
    """A domain: a subclass gives ``recordings(split)``, and the library derives everything else.

    The library alone cuts windows, so a window contains nothing but the recordings of its split. A subclass may add
    columns to the history in two ways. ``features`` receives the 8 observed steps alone, so it cannot read the future.
    ``side_channels`` receives all 20 steps and is named on the card and in every result.

    Observations, ground truth and the arguments of ``features`` and ``side_channels`` are positions relative to
    ``Recording.origin``; add it to get positions in the frame of the source.

    Raises:
        SpecError: A subclass defines ``windows``, ``reference`` or ``history``.
    """

    name: ClassVar[str] = "recorded"
    splits: ClassVar[tuple[str, ...]] = ("train", "val", "test", "reference")
    unit: ClassVar[str] = "m"
    source: ClassVar[str] = ""
    terms: ClassVar[str] = ""
    oracle: ClassVar[str | None] = None
    headline: ClassVar[tuple[str, ...]] = ()
    """Parameters that tables show even at their defaults, unless they are None."""
    tests_on_train: ClassVar[bool] = False
    """Whether the windows of ``test`` include those of ``train``; a predictor trained here cannot be tested here."""
    draws_each_split: ClassVar[bool] = False
    """Whether all domains of the world draw the people of each split anew, so that splits never share people."""
    place: ClassVar[str] = ""
    """First part of ``world``, for domains that show the same people; by default the name."""
    same_world: ClassVar[tuple[str, ...]] = ()
    """Parameters that do not change the people in the frames; ``world`` omits them."""
    dt: float = 0.4
    min_agents: int = 1
    stride: int = 1
    feature_names: tuple[str, ...] = ()
    side_channel_names: tuple[str, ...] = ()

    def __init_subclass__(cls, **keywords: Any):
        super().__init_subclass__(**keywords)
        for method, remedy in LIBRARY_METHODS.items():
            if method in vars(cls):
                raise SpecError(f"Domain class {cls.__name__} must not define `{method}`: {remedy}.")

    def recordings(self, split: str) -> Sequence[Recording]:
        """Recordings of a split; the stream clock replays them, and all windows are cut from them."""
        raise NotImplementedError(f"{type(self).__name__} must define recordings(split).")

    def features(self, history: np.ndarray) -> np.ndarray:
        """Further features from the observed steps: [A, 8, 2] float64 -> [A, 8, len(feature_names)]."""
        return np.zeros((*history.shape[:2], 0))

    def side_channels(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Features that read the future: [A, 20, 2] float64, [A, 20] bool -> [A, 8, len(side_channel_names)]."""
        return np.zeros((len(positions), HISTORY, 0))

    def ground_image(self, recording: Recording) -> SceneImage | None:
        """The image of the ground that pictures of a recording show, in the frame of the source; None for none."""
        return self.observed_image(recording)

    def observed_image(self, recording: Recording) -> SceneImage | None:
        """The image of the ground that observations of a recording hold, in the frame of the source; None for none.

        The image must not depend on where people are in the recording, which would show their future.
        """
        return None

    def ground_lines(self) -> Sequence[tuple[np.ndarray, bool]]:
        """Lines on the ground, as of lanes, that pictures show: points [P, 2] as in the source, and whether dashed."""
        return ()

    def history(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """The history of an observation: [A, 8, F] with x, y, the features, then the side channels."""
        observed = positions[:, :HISTORY]
        columns = [observed]
        if self.feature_names:
            columns.append(self.features(observed.copy()))
        if self.side_channel_names:
            columns.append(self.side_channels(positions, known))
        return np.concatenate(columns, axis=2)

    def windows(self, split: str) -> Truth:
        """Every window of a split; computed once, and read-only."""
        self.check_split(split)
        return self.kept(f"windows of {split}", lambda: self._windows(split))

    def reference(self) -> Truth:
        """Reference scenes: the windows of the split ``reference``."""
        return self.windows("reference")

    def sources(self) -> list[RecordedDomain]:
        """The domains on which a predictor is trained before a test on this domain; may be empty."""
        return []

    def without_sources(self) -> str:
        """What to do where a predictor must be trained and ``sources()`` is empty."""
        return NO_SOURCES

    @property
    def parameters(self) -> dict[str, Any]:
        """The constructor's arguments with their values."""
        names = inspect.signature(type(self)).parameters
        return {name: getattr(self, name) for name in names}

    def replace(self, **changes: Any) -> RecordedDomain:
        """The same domain with some parameters changed."""
        return type(self)(**{**self.parameters, **changes})

    @property
    def world(self) -> str:
        """Key that is equal for domains whose frames show the same people at the same time.

        It holds the place and all parameters except those in ``same_world``; existing files by their absolute path.
        """
        chosen = {k: _absolute(v) for k, v in self.parameters.items() if k not in self.same_world}
        return format_spec(self.place or self.name, chosen)

    @property
    def files(self) -> Mapping[str, str]:
        """sha256 of each data file that this domain reads."""
        return {}

    @property
    def card(self) -> Card:
        """Description of the domain; windows are counted for the splits read so far."""
        return Card(
            name=self.name,
            parameters=self.parameters,
            dt=self.dt,
            unit=self.unit,
            features=("x", "y", *self.feature_names, *self.side_channel_names),
            side_channels=self.side_channel_names,
            counts=self._counts(),
            source=self.source,
            terms=self.terms,
            files=self.files,
            oracle=self.oracle,
        )

    def check_split(self, split: str) -> None:
        """Raise SpecError for a split that this domain does not have."""
        if split not in self.splits:
            raise SpecError(f"Domain `{self.name}` has no split `{split}`.{suggest(str(split), self.splits)}")

    def kept(self, key: str, make: Callable[[], Kept]) -> Kept:
        """The result of ``make``, computed once per object; it is not pickled."""
        store = self.__dict__.setdefault("_made_once", {})
        if key not in store:
            store[key] = make()
        return store[key]

    def _windows(self, split: str) -> Truth:
        recordings = self.recordings(split)
        for recording in recordings:
            if not math.isclose(recording.dt, self.dt, rel_tol=1e-6):
                raise DataError(
                    f"recording {recording.name} of domain `{self.name}` has steps of {recording.dt:g} s, and the "
                    f"domain steps of {self.dt:g} s (`dt`): make them the same."
                )
        tracks = [Tracks.of(recording, self.observed_image(recording)) for recording in recordings]
        if tracks:
            truth = cut_windows(tracks, self.history, self.min_agents, self.stride)
        else:
            truth = empty_truth(2 + len(self.feature_names) + len(self.side_channel_names), self.dt)
        self.kept(f"counts of {split}", lambda: {**counts(truth), **recorded_counts(tracks)})
        return freeze(truth)

    def _counts(self) -> dict[str, dict[str, int]]:
        read = self.__dict__.get("_made_once", {})
        return {split: dict(read[key]) for split in self.splits if (key := f"counts of {split}") in read}

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_made_once"}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.parameters.items())})"


@functools.lru_cache(maxsize=24)
def shared(kind: type[Source], **parameters: Any) -> Source:
    """A source domain, shared by all domains with the same sources, so that its windows are read once."""
    return kind(**parameters)


def observed_images(domain: Domain, recordings: Sequence[Recording]) -> list[SceneImage | None]:
    """The image of the ground that observations of each recording hold, None for those without."""
    return [getattr(domain, "observed_image", lambda _: None)(recording) for recording in recordings]


def spec_of(domain: Domain) -> str:
    """Shortest spec of a domain: without parameters at their defaults, except those its class calls ``headline``."""
    named = domain if isinstance(domain, RecordedDomain) else domain.card  # the card of files reads the files
    defaults = {name: p.default for name, p in inspect.signature(type(domain)).parameters.items()}
    shown = getattr(type(domain), "headline", ())
    changed = {k: v for k, v in named.parameters.items() if (k in shown and v is not None) or defaults.get(k) != v}
    if isinstance(domain, RecordedDomain):
        for key in [k for k in changed if k not in shown]:
            fewer = {k: v for k, v in changed.items() if k != key}
            if _makes(type(domain), fewer, domain.parameters):
                changed = fewer
    return format_spec(named.name, changed)


def _makes(kind: type[RecordedDomain], arguments: Mapping[str, Any], all_of_them: Mapping[str, Any]) -> bool:
    """Whether a domain made with some parameters has all parameters."""
    try:
        return kind(**arguments).parameters == all_of_them
    except Exception:  # the constructor of a user's class may raise anything
        return False


def _absolute(value: Any) -> Any:
    """A parameter as ``world`` writes it: the absolute path of a file or folder that exists, else the value."""
    if not isinstance(value, (str, Path)):
        return value
    return str(Path(value).resolve()) if Path(value).exists() else str(value)


def freeze(truth: Truth) -> Truth:
    """Make every array of a truth read-only."""
    observation = truth.observation
    arrays = (truth.future, truth.known, observation.history, observation.scene, observation.agent, observation.time)
    for array in arrays:
        if array is not None:
            array.flags.writeable = False
    return truth


def argument_of(domain: Domain) -> str:
    """A domain as an argument of the command line: ``--domain "eth:alpha=64"``."""
    spec = spec_of(domain)
    quoted = shlex.quote(spec) if set(spec) & set(SPECIAL) else f'"{spec}"'
    return f"--domain {quoted}"


def no_sources(domain: Any) -> SpecError:
    """The error for a predictor that must be trained for a domain without sources."""
    reason = domain.without_sources() if hasattr(domain, "without_sources") else NO_SOURCES
    return SpecError(f"Domain `{domain.card.name}` {reason}")


def training_set(domain: Any, **options: Any) -> TrainingSet:
    """The ``train`` and ``val`` windows of the sources of a domain, on which a predictor is fitted.

    Args:
        domain: The domain on which the predictor is tested.
        **options: Options of the domain's ``sources``, as ``design="crossed"``.

    Raises:
        SpecError: The domain names no sources.
    """
    sources = domain.sources(**options) if hasattr(domain, "sources") else []
    if not sources:
        raise no_sources(domain)
    return [s.windows("train") for s in sources], [s.windows("val") for s in sources]
