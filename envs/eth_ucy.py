"""ETH-UCY: pedestrians at five places, with the noise feature of the paper's spurious-shift experiment."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from motion_gym.contract import HISTORY, Recording, SpecError
from motion_gym.data import datasets
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.recordings import read_recording
from motion_gym.specs import number, one_of, whole_number

PLACES = ("eth", "hotel", "univ", "zara1", "zara2")
LOCATION = {"eth": "eth", "eth6": "eth", "hotel": "hotel", "univ": "univ", "zara1": "zara", "zara2": "zara"}
"""Location of each place. Places with the same location show the same ground: zara1, and zara2 with zara3."""

TRAIN_SHARE = 0.8
SOURCE_ALPHAS = (1.0, 2.0, 4.0, 8.0)


class EthUcy(RecordedDomain):
    """Pedestrians at one place of ETH-UCY.

    ## Description
    Annotated pedestrians, seen from above, with steps of 0.4 s (except ``Eth``), 8 observed and 12 future steps. As in
    all published evaluations each *listed* frame is one step, also where frame numbers are missing. With ``alpha`` each
    observed step has a third value, the *observation-noise* feature sigma; alpha scales how strongly sigma correlates
    with the future. It is the spurious feature of "Towards Robust and Adaptive Motion Forecasting: A Causal
    Representation Perspective" (CVPR 2022), section 4.1.

    ## Observation
    x and y in metres, rounded to 4 decimals as in the released program, and sigma if it is enabled.
    ``sigma="paper"`` reads steps t + 8, which are in the future: it is an *oracle side channel* and labelled as such in
    all results. ``sigma="past"`` is the same function of the observed steps only.

    ## Splits
    ``train`` is the first 80 % of the distinct frames of every recording of the place, ``val`` the rest; ``test`` is
    all frames of the recordings that published evaluations test on. A place is therefore either a source or a target.
    ``reference`` is the first ``reference_share`` of the frames, which are then excluded from ``test``.

    ## Arguments
    Args:
        alpha: Scale of sigma, > 0; None for no sigma.
        sigma: ``"none"``, ``"paper"`` or ``"past"``; by default ``"paper"`` if alpha is set, else ``"none"``.
        curvature: ``"norm"`` of the change of velocity (released program) or ``"squared"`` (the paper's Eq. 7).
        min_agents: Smallest number of complete agents in a window; published evaluations use 2.
        stride: Listed frames between the starts of successive windows.
        reference_share: Share of the frames, from the start, to exclude from ``test`` as reference scenes.
        recording: One recording of the place, as ``"students001"``; None for all of them.

    ## Credits
    Pellegrini et al., "You'll never walk alone", ICCV 2009; Lerner et al., "Crowds by example", 2007.
    """

    training_files: tuple[str, ...]
    test_files: tuple[str, ...]
    columns: ClassVar[tuple[int, int, int, int]] = (0, 1, 2, 3)
    headline = ("alpha",)
    same_world = ("alpha", "sigma", "curvature", "min_agents", "stride", "reference_share", "recording")
    tests_on_train = True
    source = "ETH (BIWI walking pedestrians) and UCY (crowds by example)"
    terms = "UCY: free for use with credit; ETH: none stated. Cite Pellegrini et al. 2009 and Lerner et al. 2007."

    def __init__(
        self,
        alpha: float | None = None,
        sigma: str | None = None,
        curvature: str = "norm",
        min_agents: int = 2,
        stride: int = 1,
        reference_share: float = 0.0,
        recording: str | None = None,
    ):
        self.sigma = sigma if sigma is not None else "none" if alpha is None else "paper"
        owner = f"domain `{self.name}`"
        one_of("sigma", self.sigma, ("none", "paper", "past"), owner)
        self.curvature = one_of("curvature", curvature, ("norm", "squared"), owner)
        if alpha is not None and self.sigma == "none":
            raise SpecError(f"`alpha={alpha}` has no effect with `sigma=none`: drop alpha, or use sigma=paper or past.")
        if alpha is None:
            self.alpha = None if self.sigma == "none" else 1.0
        else:
            self.alpha = number("alpha", alpha, 0, 1e6, above=True, owner=owner)
        self.min_agents = whole_number("min_agents", min_agents, 1, 1000)
        self.stride = whole_number("stride", stride, 1, 1_000_000)
        number("reference_share", reference_share, 0, 1, below=True, owner=owner)
        self.reference_share = reference_share
        if recording is not None:
            one_of("recording", recording, [name.removesuffix(".txt") for name in self.training_files], owner)
            self.training_files = (f"{recording}.txt",)
            self.test_files = tuple(name for name in self.test_files if name in self.training_files)
        self.recording = recording
        self.feature_names = ("sigma",) if self.sigma == "past" else ()
        self.side_channel_names = ("sigma",) if self.sigma == "paper" else ()

    @property
    def files(self) -> Mapping[str, str]:
        """sha256 of each data file of the test split."""
        return {f.name: f.sha256 for f in datasets.dataset("eth_ucy").files if f.name in self.test_files}

    def recordings(self, split: str) -> list[Recording]:
        """Recordings of a split, cut by frames and rounded to 4 decimals."""
        self.check_split(split)
        names = self.training_files if split in ("train", "val") else self.test_files
        return [part for name in names if len((part := self._cut(self._read(name), split)).frame)]

    def _read(self, name: str) -> Recording:
        recording = read_recording(datasets.locate("eth_ucy", name), dt=self.dt, columns=self.columns)
        return dataclasses.replace(recording, xy=np.round(recording.xy, 4), listed=True)

    def _cut(self, recording: Recording, split: str) -> Recording:
        frames = np.unique(recording.frame)
        share = TRAIN_SHARE if split in ("train", "val") else self.reference_share
        cut = math.floor(share * len(frames))
        chosen = frames[:cut] if split in ("train", "reference") else frames[cut:]
        keep = np.isin(recording.frame, chosen)
        return dataclasses.replace(
            recording, frame=recording.frame[keep], agent=recording.agent[keep], xy=recording.xy[keep]
        )

    def side_channels(self, positions: np.ndarray, known: np.ndarray) -> np.ndarray:
        """Sigma of the released program, which reads 8 steps ahead: [A, 8, 1].

        If an agent leaves earlier, its last known velocity is used (on the stream clock only).
        """
        velocity = np.zeros_like(positions)
        velocity[:, 1:] = np.round(np.diff(positions, axis=1), 4)
        last = known.sum(axis=1) - 1
        step = np.minimum(np.arange(known.shape[1]), last[:, None])
        velocity = np.take_along_axis(velocity, step[..., None], axis=1)
        return self._noise(velocity[:, HISTORY : 2 * HISTORY] - velocity[:, :HISTORY])

    def features(self, history: np.ndarray) -> np.ndarray:
        """Sigma from the observed steps: the change of velocity from the previous step, 0 without such a step."""
        velocity = np.round(np.diff(history, axis=1), 4)
        change = np.zeros_like(history)
        change[:, 2:] = np.diff(velocity, axis=1)
        return self._noise(change)

    def _noise(self, change: np.ndarray) -> np.ndarray:
        length = np.hypot(change[..., 0], change[..., 1])
        gamma = length if self.curvature == "norm" else length**2
        return (self.alpha or 0.0) * (gamma[..., None] + 1)

    def sources(  # type: ignore[override]
        self,
        design: str = "paper",
        by: str = "place",
        among: Sequence[str] = PLACES,
        alphas: Sequence[float] = SOURCE_ALPHAS,
        each: str = "place",
    ) -> list[EthUcy]:
        """The training domains for a test on this domain: all other places.

        Args:
            design: ``"paper"`` assigns alpha 1, 2, 4 and 8 to the places in order (for ``eth``: hotel 1, univ 2,
                zara1 4, zara2 8); ``"crossed"`` combines every place with every alpha. Without sigma both are the
                places.
            by: ``"place"`` leaves out this place; ``"location"`` leaves out all places with the same location;
                ``"nothing"`` leaves out none, for a forecaster that is used elsewhere.
            among: The places to choose from.
            alphas: The four alphas, in the order of the places.
            each: ``"recording"`` makes each recording of a place a domain of its own, as in the released program.
        """
        owner = f"domain `{self.name}`"
        one_of("design", design, ("paper", "crossed"), owner)
        one_of("by", by, ("place", "location", "nothing"), owner)
        one_of("each", each, ("place", "recording"), owner)
        own = LOCATION[self.name]
        for place in among:
            one_of("among", place, PLACES, owner)
        place = self.place or self.name
        kept = {"place": lambda p: p != place, "location": lambda p: LOCATION[p] != own, "nothing": lambda p: True}
        names = [p for p in among if kept[by](p)]
        common: dict[str, Any] = {"curvature": self.curvature, "min_agents": self.min_agents, "stride": self.stride}
        if self.sigma == "none":
            sources = [(p, common) for p in names]
        else:
            pairs = itertools.product(names, alphas) if design == "crossed" else zip(names, alphas, strict=False)
            sources = [(p, {"alpha": a, "sigma": self.sigma, **common}) for p, a in pairs]
        if each == "recording":
            sources = [
                (p, {**options, "recording": file.removesuffix(".txt")})
                for p, options in sources
                for file in BY_PLACE[p].training_files
            ]
        return [BY_PLACE[p](**options) for p, options in sources]


class Eth(EthUcy):
    """ETH-UCY ``eth``, as used by all published numbers.

    The file is sampled every 10 frames, although 0.4 s are 6 frames of this recording. The true step is 0.667 s, so
    pedestrians appear 1.67 times too fast. ``eth6`` is the same scene at its true rate.
    """

    name = "eth"
    training_files = test_files = ("biwi_eth.txt",)


class Eth6(EthUcy):
    """The ``eth`` scene from its original annotation: every 6 frames, a true step of 0.4 s."""

    name = "eth6"
    training_files = test_files = ("biwi_eth_obsmat_6frame.txt",)
    columns = (0, 1, 2, 4)
    place = "eth"


class Hotel(EthUcy):
    """ETH-UCY ``hotel``."""

    name = "hotel"
    training_files = test_files = ("biwi_hotel.txt",)


class Univ(EthUcy):
    """ETH-UCY ``univ``: two test recordings; a third, ``uni_examples``, is for training only."""

    name = "univ"
    training_files = ("students001.txt", "students003.txt", "uni_examples.txt")
    test_files = ("students001.txt", "students003.txt")


class Zara1(EthUcy):
    """ETH-UCY ``zara1``."""

    name = "zara1"
    training_files = test_files = ("crowds_zara01.txt",)


class Zara2(EthUcy):
    """ETH-UCY ``zara2``; a further recording of the same street, ``zara03``, is for training only."""

    name = "zara2"
    training_files = ("crowds_zara02.txt", "crowds_zara03.txt")
    test_files = ("crowds_zara02.txt",)


BY_PLACE: dict[str, type[EthUcy]] = {c.name: c for c in (Eth, Eth6, Hotel, Univ, Zara1, Zara2)}
