"""The Stanford Drone Dataset: pedestrians and bikers on a campus, in domains by speed, class, scene and video."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import DataError, Recording, SpecError
from motion_gym.data import datasets
from motion_gym.data.domains import RecordedDomain
from motion_gym.data.scene_images import SceneImage, read_scene_image
from motion_gym.data.sdd_files import (
    CLASSES,
    CLIPS,
    OTHER,
    STEP_FRAMES,
    VIDEOS,
    Positions,
    mean_speeds,
    read_clips,
    read_windows,
    scale_of,
)
from motion_gym.data.storage import digest
from motion_gym.specs import one_of, three_shares, whole_number

SPEEDS = ("0.25-0.75", "1.25-1.75", "2.25-2.75", "3.25-3.75")
"""The four speed domains of the paper, pixels per video frame."""
USUAL = "pedestrian biker"
"""The classes of the paper's experiment."""
SHARES = (0.6, 0.2, 0.2)
SOURCE_SHARES = (0.8, 0.2, 0.0)
TARGET_SHARES = (0.0, 0.0, 1.0)
"""Shares of the time for train, val and test: of all people, of a domain that is trained on, of a selection."""
OBSERVED_PIXELS = 4
"""Pixels of the file, along each axis, that are one pixel of an image in an observation."""
FORMS = ("windows", "clips")
SCALES = "estimated_scales.yaml"
LABEL_COLORS = np.zeros((256, 3), np.uint8)
LABEL_COLORS[1:6] = [(120, 120, 130), (200, 170, 120), (90, 170, 90), (190, 90, 80), (90, 120, 190)]
"""[256, 3] color of each label, 0 to 255; label maps hold 1 to 5."""


class Sdd(RecordedDomain):
    """People on a campus, annotated in videos of a drone: a selection by class, mean speed, scene and video.

    ## Description
    Steps of 0.4 s: every 12th frame of videos of 30 frames per second. A position is the centre of a box; boxes that
    the annotation marks as lost are left out, and a gap ends a window. ``form="windows"`` reads tables of 20-step
    windows, one for each track. ``form="clips"`` reads annotations in the official format, and all windows of their
    tracks. A selection holds only the selected people, so that an observation shows no others.

    The mean speed of a person is the path length over all of the person's steps, divided by their video frames. The
    speed and the class therefore follow from the whole track, as in the published protocol: which domain a person
    belongs to is known only afterwards. It is the same for all predictors.

    ## Observation
    x to the right and y *downwards*, from the upper left corner of the image: in pixels, or in metres with
    ``unit="m"``. Metres are estimates, one scale for each clip (OpenTraj). With ``image=True`` observations hold the
    reference image of their clip, a quarter as wide and high, and its label map if there is one. The reference image
    is one frame of the video and not always the first: it may show where people are *later*. With
    ``background="labels"`` the label map takes its place, which shows no people.

    ## Splits
    Consecutive parts of the time of every clip. A person belongs to the part in which the person is first seen, and is
    not shown outside of it, so that parts share neither people nor frames. A selection by speed, one class or scene is
    a target: all of it is ``test``. ``reference`` is the training part.

    ## Arguments
    Args:
        scene: Scenes, as ``"deathCircle"``, or several separated by spaces; by default all.
        video: Number of the video within its scene; by default all.
        class_: Classes, separated by spaces, or ``"all"``; written ``class`` in a spec, as in ``sdd:class=biker``.
        speed: Range of the mean speed in pixels per video frame, as ``"3.25-3.75"``; by default all.
        unit: ``"px"``, or ``"m"`` by the estimated scales.
        form: ``"windows"`` or ``"clips"``.
        image: Whether observations hold the image of the ground.
        background: ``"photo"``: pictures and observations show the reference image; ``"labels"``: its label map.
        split: Shares of the time for train, val and test; by default 0 0 1 of a selection, else 0.6 0.2 0.2.
        min_agents: Smallest number of complete agents in a window.
        stride: Steps between the starts of two windows.

    ## Credits
    Robicquet et al., "Learning social etiquette", ECCV 2016, CC BY-NC-SA 3.0: no commercial use. Speed domains: Liu et
    al., CVPR 2022, appendix; classes and ``deathCircle``: Kothari et al., "Motion style transfer", CoRL 2022.
    """

    name = "sdd"
    headline = ("scene", "video", "speed")
    same_world = ("unit", "image", "background", "min_agents", "stride")
    terms = datasets.dataset("sdd").terms

    def __init__(
        self,
        scene: Any = None,
        video: int | None = None,
        class_: Any = USUAL,
        speed: Any = None,
        unit: str = "px",
        form: str = "windows",
        image: bool = False,
        background: str = "photo",
        split: Any = None,
        min_agents: int = 1,
        stride: int = 1,
    ):
        owner = "domain `sdd`"
        self.scene = None if scene is None else " ".join(_words("scene", scene, VIDEOS))
        self.video = None if video is None else whole_number("video", video, 0, max(VIDEOS.values()) - 1)
        self.class_ = "all" if class_ == "all" else " ".join(_words("class", class_, (*CLASSES, OTHER)))
        self.speed = None if speed is None else "{:g}-{:g}".format(*_speeds(speed))
        self.unit = one_of("unit", unit, ("px", "m"), owner)  # type: ignore[misc]
        self.form = one_of("form", form, FORMS, owner)
        if not isinstance(image, bool):
            raise SpecError(f"`image={image}` of {owner} must be true or false.")
        self.image = image
        self.background = one_of("background", background, ("photo", "labels"), owner)
        self.split = None if split is None else "{:g} {:g} {:g}".format(*three_shares(split))
        self.min_agents = whole_number("min_agents", min_agents, 1, 1000)
        self.stride = whole_number("stride", stride, 1, 1_000_000)

    @property
    def shifted(self) -> str | None:
        """The parameter in which the sources of this domain differ from it: speed, class or scene; None if none."""
        one_class = self.class_ in ("pedestrian", "biker")
        return "speed" if self.speed else "class_" if one_class else "scene" if self.scene else None

    @property
    def shares(self) -> tuple[float, float, float]:
        """Shares of the time for train, val and test."""
        return three_shares(self.split) if self.split else TARGET_SHARES if self.shifted else SHARES

    @property
    def clips(self) -> tuple[str, ...]:
        """Names of the clips of the scenes and the video."""
        scenes = self.scene.split() if self.scene else list(VIDEOS)
        return tuple(c for c, (s, v) in CLIPS.items() if s in scenes and self.video in (None, v))

    @property
    def files(self) -> Mapping[str, str]:
        """sha256 of each data file that this domain reads; of clips that are not here, of the known ones."""
        known = {file.name: file.sha256 for file in datasets.dataset("sdd").files}
        names = self._names() or [name for name in map(_annotations_name, self.clips) if known[name]]
        names += [SCALES] if self.unit == "m" else []
        if self.image:
            images = [name for clip in self.clips for name in _image_names(clip) if name in known]
            names += [name for name in images if known[name] or datasets.present("sdd", [name])]
        return {name: known[name] or digest(datasets.locate("sdd", name).read_bytes()) for name in names}

    @property
    def source(self) -> str:  # type: ignore[override]
        """The form of the data, the parts of the time, and where metres come from."""
        parts = ", ".join(f"{part} {share:.0%}" for part, share in zip(self.splits, self.shares, strict=False) if share)
        scale = "; metres by estimated scales (OpenTraj), not measured" if self.unit == "m" else ""
        photo = "; observations hold one frame of each video, which may show people at later times"
        image = photo if self.image and self.background == "photo" else ""
        return f"Stanford Drone Dataset, {self.form}: {parts} of the time of each clip{scale}{image}"

    def recordings(self, split: str) -> list[Recording]:
        """The selected people of a split, a recording for each clip, in pixels or metres.

        Raises:
            DataError: A file is missing or bad, nobody is selected, or a clip has no scale.
        """
        self.check_split(split)
        part = "train" if split == "reference" else split
        ends = np.cumsum((0.0, *self.shares)).round(9).tolist()
        low, high = dict(zip(self.splits, itertools.pairwise(ends), strict=False))[part]
        return list(self.kept(f"part {part}", lambda: self._part(low, high)))

    def ground_image(self, recording: Recording) -> SceneImage | None:
        """The reference image of a clip, or its colored label map; None if the files are not in the data folder."""
        photo, labels = _image_names(recording.name)
        needed = [photo, *([labels] if self.background == "labels" else [])]
        return self._scene_image(recording.name, 1) if datasets.present("sdd", needed) == needed else None

    def observed_image(self, recording: Recording) -> SceneImage | None:
        """The reference image of a clip, a quarter as wide and high, if ``image`` is set."""
        return self._scene_image(recording.name, OBSERVED_PIXELS) if self.image else None

    def sources(self, speeds: Sequence[str] = SPEEDS) -> list[Sdd]:  # type: ignore[override]
        """The training domains for a test on this domain.

        A selection by speed is trained on the other speeds, a class on the other of pedestrian and biker, and scenes on
        all other scenes; everything else is the same. They share no people with this domain. Without a selection the
        domain is trained on its own training part.

        Args:
            speeds: Speed domains to choose from; those that overlap with the speed of this domain are left out.
        """
        changes: list[dict[str, Any]]
        if self.shifted == "speed":
            low, high = _speeds(self.speed)
            others = {speed: _speeds(speed) for speed in speeds}
            changes = [{"speed": speed} for speed, (first, last) in others.items() if last < low or high < first]
        elif self.shifted == "class_":
            changes = [{"class_": "pedestrian" if self.class_ == "biker" else "biker"}]
        elif self.shifted == "scene":
            changes = [{"scene": [s for s in VIDEOS if s not in (self.scene or "").split()], "video": None}]
        else:
            return [self] if self.shares[0] else []
        own = {**self.parameters, "split": SOURCE_SHARES}
        return self.kept(f"sources of {speeds}", lambda: [Sdd(**{**own, **change}) for change in changes])

    def _names(self) -> list[str]:
        """Names of the files of positions."""
        if self.form == "windows":
            return ["windows/train.csv", "windows/test.csv", "windows/labels.csv"]
        return datasets.present("sdd", map(_annotations_name, self.clips))

    def _positions(self) -> Positions:
        """The positions of all people of the clips."""
        if self.form == "windows":
            *tables, labels = (datasets.locate("sdd", name) for name in self._names())
            return read_windows(tables, labels)
        names = self._names()
        if not names:
            raise DataError(
                f"{datasets.path_of('sdd', 'raw')} has no annotations of {self._title()}. Run `motion-gym data add sdd "
                "--from DIR` with the official annotation folders (SCENE/videoN/annotations.txt), or read the window "
                "tables with form=windows."
            )
        here = {clip: _annotations_name(clip) for clip in self.clips if _annotations_name(clip) in names}
        return read_clips({clip: datasets.locate("sdd", name) for clip, name in here.items()})

    def _title(self) -> str:
        return f"scene={self.scene or 'all'}, video={'all' if self.video is None else self.video}"

    def _part(self, low: float, high: float) -> list[Recording]:
        rows = self.kept("positions", self._positions)
        steps = rows.frame // STEP_FRAMES
        new = np.concatenate([[True], (np.diff(rows.clip) != 0) | (np.diff(rows.agent) != 0)])
        start, person = np.flatnonzero(new), np.cumsum(new) - 1
        keep = self._selected(rows, start, person)
        recordings = []
        for number, clip in enumerate(rows.clips):
            here = slice(*np.searchsorted(rows.clip, (number, number + 1)))
            if clip not in self.clips or not keep[here].any():
                continue
            first, last = steps[here].min(), steps[here].max() + 1
            edges = first + round(low * (last - first)), first + round(high * (last - first))
            entered = steps[start][person[here]]
            shown = keep[here] & (entered >= edges[0]) & (entered < edges[1]) & (steps[here] < edges[1])
            if shown.any():
                frame, agent, xy = rows.frame[here][shown], rows.agent[here][shown], rows.xy[here][shown]
                order = np.lexsort((agent, frame))
                frame, agent, xy = frame[order], agent[order], xy[order] * self._scale(clip)
                for column in (frame, agent, xy):
                    column.flags.writeable = False
                recordings.append(Recording(frame, agent, xy, self.dt, clip, np.zeros(2)))
        return recordings

    def _selected(self, rows: Positions, start: np.ndarray, person: np.ndarray) -> np.ndarray:
        """[R] bool, the rows of the clips whose person has the class and the speed; DataError if there is none."""
        wanted = np.isin(np.array(rows.clips), self.clips)[rows.clip]
        if not wanted.any():
            raise DataError(
                f"domain `sdd` with {self._title()}: the {self.form} have no such clip. There are "
                f"{', '.join(rows.clips)}. Choose one of them, or add files: `motion-gym data add sdd --from DIR`."
            )
        classed = wanted if self.class_ == "all" else wanted & np.isin(rows.label, self.class_.split())
        keep = classed
        if self.speed:
            low, high = _speeds(self.speed)
            speed = mean_speeds(rows, start, person)[person]
            keep = classed & (speed >= low) & (speed <= high)
        if not keep.any():
            labels, counts = np.unique(rows.label[start][wanted[start]], return_counts=True)
            there = ", ".join(f"{count} {label}" for label, count in zip(labels, counts, strict=True))
            tried = len(np.unique(person[classed]))
            slow = f", none of {tried} of the class with speed={self.speed}" if self.speed else ""
            raise DataError(
                f"domain `sdd` with {self._title()}, class={self.class_}: nobody is selected{slow}. People in these "
                f"{self.form} by class: {there}. Choose another class, speed, scene or form."
            )
        return keep

    def _scale(self, clip: str) -> float:
        """Unit of this domain per pixel; DataError if the clip has no scale."""
        if self.unit == "px":
            return 1.0
        return self.kept(f"scale of {clip}", lambda: scale_of(datasets.locate("sdd", SCALES), clip))

    def _scene_image(self, clip: str, shrink: int) -> SceneImage:
        def read() -> SceneImage:
            photo, mask = _image_names(clip)
            path = datasets.locate("sdd", photo)
            labelled = self.background == "labels" or datasets.present("sdd", [mask])
            labels = datasets.locate("sdd", mask) if labelled else None
            image = read_scene_image(path, labels, self._scale(clip), shrink)
            rows = self.kept("positions", self._positions)
            reach = rows.xy[rows.clip == rows.clips.index(clip)].max(axis=0)
            size = image.extent[1] / self._scale(clip)
            if (reach > size + shrink).any():
                raise DataError(
                    f"{path} does not match its clip: it ends at {size.round().astype(int).tolist()} pixels, and "
                    f"people of {clip} reach {reach.tolist()}. It is the image of another clip or was scaled: get it "
                    "again."
                )
            if self.background == "labels" and image.labels is not None:
                return dataclasses.replace(image, photo=LABEL_COLORS[image.labels])
            return image

        return self.kept(f"image of {clip}, {shrink}", read)


def _annotations_name(clip: str) -> str:
    """Name of the annotations of a clip."""
    scene, video = CLIPS[clip]
    return f"raw/{scene}/video{video}/annotations.txt"


def _image_names(clip: str) -> tuple[str, str]:
    """Names of the reference image and of the label map of a clip."""
    return f"reference/{clip}.jpg", f"masks/{clip}.png"


def _words(name: str, value: Any, known: Any) -> list[str]:
    """The words of a text or a sequence, each of them known."""
    words = value.split() if isinstance(value, str) else value
    if not isinstance(words, (list, tuple)) or not words:
        raise SpecError(f"`{name}={value}` of domain `sdd` must be one or several of {', '.join(known)}.")
    return [one_of(name, word, known, "domain `sdd`") for word in dict.fromkeys(words)]


def _speeds(value: Any) -> tuple[float, float]:
    """Lowest and highest speed from ``"low-high"`` or a pair."""
    try:
        low, high = (float(end) for end in (value.split("-") if isinstance(value, str) else value))
    except (TypeError, ValueError):
        low, high = 1.0, 0.0
    if not 0 <= low < high < 1e6:
        raise SpecError(
            f"`speed={value}` of domain `sdd` must be a range of pixels per video frame, low-high, as speed=3.25-3.75."
        )
    return low, high
