"""A base class that turns recordings into a whole domain; using it is a convenience, not a duty."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, TypeVar

import numpy as np

from motion_gym.catalog import format_spec, suggest
from motion_gym.contract import HISTORY, Card, Domain, Recording, SpecError, Truth
from motion_gym.data.windows import counts, empty_truth, windows_of

Kept = TypeVar("Kept")

TrainingSet = tuple[list[Truth], list[Truth]]
"""Training and validation truths, one of each per environment."""


class RecordedDomain:
    """A domain made of recordings: a subclass gives ``recordings(split)``, everything else follows.

    A subclass may add features to the history in two ways. ``features`` receives the 8 observed steps alone, so it
    cannot read the future. ``side_channels`` receives all 20 steps and is named on the card, in every result and by
    the leak probe.
    """

    name: ClassVar[str] = "recorded"
    splits: ClassVar[tuple[str, ...]] = ("train", "val", "test", "reference")
    unit: ClassVar[str] = "m"
    source: ClassVar[str] = ""
    terms: ClassVar[str] = ""
    oracle: ClassVar[str | None] = None
    headline: ClassVar[tuple[str, ...]] = ()
    """Parameters that tables show even at their defaults, unless these are None."""
    tests_on_train: ClassVar[bool] = False
    """Whether the windows of ``test`` include those of ``train``: trained here, a predictor must not be tested here."""
    dt: float = 0.4
    min_agents: int = 1
    stride: int = 1
    feature_names: tuple[str, ...] = ()
    side_channel_names: tuple[str, ...] = ()

    def recordings(self, split: str) -> Sequence[Recording]:
        """Recordings of a split."""
        raise NotImplementedError(f"{type(self).__name__} must define recordings(split).")

    def features(self, history: np.ndarray) -> np.ndarray:
        """Further features from the observed steps: [A, 8, 2] float64 -> [A, 8, len(feature_names)]."""
        return np.zeros((*history.shape[:2], 0))

    def side_channels(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Features that read the future: [A, 20, 2] float64, [A, 20] bool -> [A, 8, len(side_channel_names)]."""
        return np.zeros((len(positions), HISTORY, 0))

    def history(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """What a predictor sees: [A, 8, F] with x, y, the features, then the side channels."""
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
        """Reference scenes, disjoint from those of the test split."""
        return self.windows("reference")

    def sources(self) -> list[RecordedDomain]:
        """The domains that a predictor is trained on before it is tested on this one; empty if there are none."""
        return []

    @property
    def parameters(self) -> dict[str, Any]:
        """The constructor's arguments with their values."""
        names = inspect.signature(type(self)).parameters
        return {name: getattr(self, name) for name in names}

    def replace(self, **changes: Any) -> RecordedDomain:
        """The same domain with some parameters changed."""
        return type(self)(**{**self.parameters, **changes})

    @property
    def files(self) -> Mapping[str, str]:
        """sha256 of each data file that this domain reads."""
        return {}

    @property
    def card(self) -> Card:
        """What this domain is; windows are counted for the splits read so far."""
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

    def kept(self, what: str, make: Callable[[], Kept]) -> Kept:
        """What ``make`` gives, made once; it stays with this object and is not pickled."""
        store = self.__dict__.setdefault("_made_once", {})
        if what not in store:
            store[what] = make()
        return store[what]

    def _windows(self, split: str) -> Truth:
        recordings = self.recordings(split)
        if not recordings:
            return freeze(empty_truth(2 + len(self.feature_names) + len(self.side_channel_names), self.dt))
        return freeze(windows_of(recordings, self.history, self.min_agents, self.stride))

    def _counts(self) -> dict[str, dict[str, int]]:
        read = self.__dict__.get("_made_once", {})
        there = [(split, read[key]) for split in self.splits if (key := f"windows of {split}") in read]
        return {split: dict(self.kept(f"counts of {split}", partial(counts, truth))) for split, truth in there}

    def __getstate__(self) -> dict[str, Any]:
        return {key: value for key, value in vars(self).items() if key != "_made_once"}

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{k}={v!r}' for k, v in self.parameters.items())})"


def spec_of(domain: Domain) -> str:
    """Shortest spec of a domain: without parameters at their defaults, except those its class calls ``headline``."""
    card = domain.card
    defaults = {name: p.default for name, p in inspect.signature(type(domain)).parameters.items()}
    shown = getattr(type(domain), "headline", ())
    changed = {k: v for k, v in card.parameters.items() if (k in shown and v is not None) or defaults.get(k) != v}
    if isinstance(domain, RecordedDomain):
        for key in [k for k in changed if k not in shown]:
            fewer = {k: v for k, v in changed.items() if k != key}
            if _makes(type(domain), fewer, domain.parameters):
                changed = fewer
    return format_spec(card.name, changed)


def _makes(kind: type[RecordedDomain], given: Mapping[str, Any], all_of_them: Mapping[str, Any]) -> bool:
    """Whether a domain made with the given parameters has all of them."""
    try:
        return kind(**given).parameters == all_of_them
    except Exception:  # a class of somebody else, made in a way that it was not meant for, may raise anything
        return False


def freeze(truth: Truth) -> Truth:
    """Make every array of a truth read-only, so that nobody who is given it can change it for others."""
    observation = truth.observation
    arrays = (truth.future, truth.known, observation.history, observation.scene, observation.agent, observation.time)
    for array in arrays:
        if array is not None:
            array.flags.writeable = False
    return truth


def training_set(domain: Any, **options: Any) -> TrainingSet:
    """What a predictor is fitted on before it meets a domain: the ``train`` and ``val`` windows of its sources.

    Args:
        domain: The domain to be met.
        **options: Of the domain's ``sources``, as ``design="crossed"``.

    Raises:
        SpecError: the domain names no sources.
    """
    sources = domain.sources(**options) if hasattr(domain, "sources") else []
    if not sources:
        raise SpecError(
            f"Domain `{domain.card.name}` names no domains to train on: define `sources()` in its class, or fit the "
            "predictor yourself, `predictor.fit(train, validation, seed)`, and pass the fitted object."
        )
    return [s.windows("train") for s in sources], [s.windows("val") for s in sources]
