"""A picture or an animation of one scene: history, ground truth and forecasts."""

from __future__ import annotations

import io
import itertools
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib
import numpy as np
from matplotlib import animation
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from motion_gym import catalog
from motion_gym.contract import HISTORY, MOST_SAMPLES, WINDOW, Domain, Forecast, Predictor, SpecError, Truth
from motion_gym.data.domains import RecordedDomain, spec_of
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.storage import write_atomic
from motion_gym.data.windows import pick_scenes
from motion_gym.metrics.errors import ade, min_ade
from motion_gym.scoring.shown import show_references
from motion_gym.specs import number, whole_number
from motion_gym.stepping.harness import ask, copied, name_of, ready, windows_of_domain
from motion_gym.stepping.render import Places, draw_ground

FORMATS = (".png", ".svg", ".pdf", ".gif", ".mp4")
"""Endings of the files that ``show`` writes."""
SIZE = (7.2, 5.4)
"""Width and height of a picture, inches."""
FRAMES_PER_SECOND = 5
"""Speed of an animation; it holds its last frame for two seconds."""
HISTORY_COLOR, TRUTH_COLOR = "0.55", "black"
REFERENCES = 64
"""Most reference scenes that a predictor with a style observes before it is drawn."""
BAR_SHARE = 0.25
"""Largest share of the width of a picture that its scale bar takes."""


class Picture(Figure):
    """A figure that a notebook displays, also where no backend of matplotlib was chosen."""

    def _repr_png_(self) -> bytes:
        return _as_bytes(self, "png")


@dataclass(frozen=True, eq=False)
class DrawnScene:
    """What is drawn of a scene.

    Attributes:
        truth: The scene, with its history.
        forecasts: Forecasts by name; the most likely sample is drawn solid, the others faint.
        title: Heading.
        unit: Unit of positions.
        origin: [2] float64, added to the coordinates that the axes show.
        ground: ``ground_lines`` of the domain, drawn if there is an origin.
        image: Image of the ground, in the frame of the observation.
    """

    truth: Truth
    forecasts: Mapping[str, Forecast]
    title: str = ""
    unit: str = "m"
    origin: np.ndarray | None = None
    ground: Sequence[tuple[np.ndarray, bool]] = ()
    image: SceneImage | None = None


def show(
    domain: str | Domain,
    predictors: str | Predictor | Iterable[str | Predictor] = (),
    *,
    scene: int | None = None,
    time: float | None = None,
    split: str = "test",
    k: int = 1,
    seed: int = 0,
    references: int | None = None,
    out: str | os.PathLike[str] | None = None,
) -> Figure:
    """Draw one scene: its history, its ground truth, and what predictors forecast.

    Predictors are asked as ``evaluate`` asks them: they are fitted to the sources of the domain where they need it, and
    those with a style observe the reference scenes of the domain first. The legend gives each one's ADE in this scene.

    Args:
        domain: Name, spec or object.
        predictors: Names, specs or objects: one, or several.
        scene: Number of the scene in the split; by default the first.
        time: Seconds since the beginning of the split, in place of ``scene``: the first scene whose last observed step
            is then or later.
        split: Split of the domain.
        k: Samples of each predictor; more than one are drawn faint around the most likely one.
        seed: Seed of the samples.
        references: Reference scenes that a predictor with a style observes; at most 64 by default.
        out: File to write: a picture (.png, .svg, .pdf), or an animation (.gif, .mp4) of the 20 steps.

    Returns:
        The picture, which a notebook displays.

    Raises:
        SpecError: a name, the scene, the time or the ending of the file is not allowed.
        StorageError: the file cannot be written.
    """
    path = None if out is None else _checked_path(Path(out))
    k = whole_number("k", k, 1, MOST_SAMPLES)
    place = catalog.domain(domain)
    windows = windows_of_domain(place, split)
    index = _scene_number(windows, scene, time, f"Split `{split}` of `{spec_of(place)}`")
    one = isinstance(predictors, str) or not isinstance(predictors, Iterable)
    several: Sequence[str | Predictor] = [predictors] if one else list(predictors)  # type: ignore[list-item,arg-type]
    drawn = next(forecast_scenes(place, several, [index], split, k, seed, references))
    forecasts = drawn.forecasts
    picture = Picture(figsize=SIZE, dpi=150, layout="constrained")
    axes = picture.add_subplot()
    draw_scene(axes, drawn, colors_of(forecasts))
    picture.legend(*_legend(axes), loc="outside lower center", ncols=2, fontsize=8, frameon=False)
    if path is not None:
        animated = path.suffix in (".gif", ".mp4")
        write_atomic(path, _animation(drawn, path.suffix) if animated else _as_bytes(picture, path.suffix[1:]))
    return picture


def forecast_scenes(
    place: Domain,
    predictors: Sequence[str | Predictor],
    scenes: Sequence[int],
    split: str = "test",
    k: int = 1,
    seed: int = 0,
    references: int | None = None,
) -> Iterator[DrawnScene]:
    """Scenes of a domain with forecasts of predictors, which are made ready once; see ``show`` for the arguments."""
    windows = windows_of_domain(place, split)
    instances: dict[str, Any] = {}
    for predictor in predictors:
        instance = ready(copied(predictor), place, seed)
        if hasattr(instance, "observe"):
            there = windows_of_domain(place, "reference").observation.scenes
            show_references(instance, place, split, min(REFERENCES, there) if references is None else references, 1)
        name = predictor if isinstance(predictor, str) else name_of(instance)
        instances[f"{name} ({len(instances) + 1})" if name in instances else name] = instance
    recordings = place.recordings(split)
    origins = np.unique([recording.origin for recording in recordings], axis=0)
    origin = origins[0] if len(origins) == 1 else None
    lines = place.ground_lines() if isinstance(place, RecordedDomain) else ()
    for index in scenes:
        truth = pick_scenes(windows, [index])
        forecasts = {name: ask(instance, truth.observation, k, seed) for name, instance in instances.items()}
        title = f"{spec_of(place)}, {split}, scene {index}"
        image = Places(place, recordings).image_of(truth.observation)
        yield DrawnScene(truth, forecasts, title, place.card.unit, origin, lines, image)


def draw_scene(
    axes: Axes, drawn: DrawnScene, colors: Mapping[str, Any], step: int = WINDOW, *, errors: bool = True
) -> None:
    """Draw a scene up to a step, with a scale bar.

    Args:
        axes: Where to draw.
        drawn: The scene.
        colors: Color of each forecast, by its name.
        step: Steps that have happened, 1 to 20. Forecasts are drawn from the last observed step on.
        errors: Whether labels give the errors of the forecasts.
    """
    truth, observation = drawn.truth, drawn.truth.observation
    observed = observation.xy[:, :step]
    last = observation.xy[:, -1:]
    future = np.where(truth.known[..., None], truth.future, np.nan)
    for name, forecast in drawn.forecasts.items() if step >= HISTORY else ():
        start = np.broadcast_to(last[:, None], (*forecast.positions.shape[:2], 1, 2))
        samples = np.concatenate([start, forecast.positions], axis=2)
        if samples.shape[1] > 1:
            faint = max(0.12, 0.6 / np.sqrt(samples.shape[1]))
            draw_paths(axes, samples.reshape(-1, *samples.shape[2:]), None, color=colors[name], alpha=faint, lw=0.8)
        likely = np.concatenate([last, forecast.most_likely()], axis=1)
        draw_paths(axes, likely, _label(name, drawn, errors), color=colors[name], lw=1.6)
    draw_paths(axes, observed, "history", color=HISTORY_COLOR, lw=2.2)
    so_far = np.concatenate([last, future[:, : max(step - HISTORY, 0)]], axis=1)
    draw_paths(axes, so_far, "ground truth", color=TRUTH_COLOR, lw=1.8, ls=(0, (2, 1)))
    axes.plot(*observed[:, -1].T, "o", color=HISTORY_COLOR, ms=4)
    _frame(axes, drawn)
    origin = drawn.origin
    draw_ground(axes, () if origin is None else drawn.ground, np.zeros(2) if origin is None else origin, drawn.image)


def draw_paths(axes: Axes, paths: np.ndarray, label: str | None, **style: Any) -> None:
    """One line for each path [A, T, 2]; the first one carries the label."""
    for number_, path in enumerate(paths):
        axes.plot(*path.T, label=None if number_ else label, solid_capstyle="round", **style)


def colors_of(names: Iterable[str]) -> dict[str, Any]:
    """A color for each name."""
    palette = matplotlib.colormaps["tab10"].colors  # type: ignore[attr-defined]
    return dict(zip(names, itertools.cycle(palette), strict=False))


def _scene_number(windows: Truth, scene: int | None, time: float | None, owner: str) -> int:
    count = windows.observation.scenes
    if not count:
        raise SpecError(f"{owner} has no scene to show: no agent is seen over all 20 steps.")
    if scene is not None and time is not None:
        raise SpecError(f"`scene={scene}` and `time={time}` both choose a scene: give one of them.")
    if time is None:
        return whole_number("scene", 0 if scene is None else scene, 0, count - 1)
    observation = windows.observation
    if observation.time is None:
        raise SpecError(f"{owner} does not know its times: choose by `scene`, 0 to {count - 1}.")
    seconds = observation.time * observation.dt
    asked = number("time", time, 0, float(seconds.max()), owner=f"{owner} (seconds)")
    return int(np.argmax(seconds >= asked - 1e-6))


def _checked_path(path: Path) -> Path:
    if path.suffix not in FORMATS:
        raise SpecError(f"`{path}` must end in one of {', '.join(FORMATS)}.")
    if path.suffix == ".mp4" and not _ffmpeg():
        raise SpecError(f"`{path}` needs ffmpeg: pip install 'motion-gym[video]'. Or write a .gif.")
    return path


def _ffmpeg() -> str:
    """Path of the program ffmpeg, or of the one that comes with imageio-ffmpeg; empty if neither is installed."""
    if animation.FFMpegWriter.isAvailable():
        return str(matplotlib.rcParams["animation.ffmpeg_path"])
    try:
        import imageio_ffmpeg
    except ImportError:
        return ""
    return str(imageio_ffmpeg.get_ffmpeg_exe())


def _label(name: str, drawn: DrawnScene, errors: bool) -> str:
    forecast = drawn.forecasts[name]
    if not errors or not drawn.truth.known.any():
        return name
    best, samples = "", forecast.positions.shape[1]
    if samples > 1:
        best = f", best of {samples} {np.nanmean(min_ade(forecast, drawn.truth, samples)):.2f}"
    return f"{name}: ADE {np.nanmean(ade(forecast, drawn.truth)):.2f} {drawn.unit}{best}"


def _frame(axes: Axes, drawn: DrawnScene) -> None:
    """Limits, axes and scale bar, the same for every step of an animation."""
    truth = drawn.truth
    points = [truth.observation.xy.reshape(-1, 2), truth.future[truth.known]]
    points += [forecast.most_likely().reshape(-1, 2) for forecast in drawn.forecasts.values()]
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    # A scene of people who stand still, or walk along one axis, is not blown up.
    size = np.maximum(high - low, 0.4 * float((high - low).max()) + 1e-6) * 1.12
    center = (low + high) / 2
    (left, bottom), (right, top) = center - size / 2, center + size / 2
    axes.set(xlim=(left, right), ylim=(bottom, top), title=drawn.title)
    axes.set_xlabel(f"x, {drawn.unit}")
    axes.set_ylabel(f"y, {drawn.unit}")
    axes.title.set_fontsize(10)
    axes.set_aspect("equal", adjustable="box")
    axes.grid(color="0.92", lw=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    if drawn.origin is not None and drawn.origin.any():
        for axis, shift in zip((axes.xaxis, axes.yaxis), drawn.origin.tolist(), strict=True):
            axis.set_major_formatter(partial(_shifted, shift))
    length = _round_length(BAR_SHARE * (right - left))
    downwards = drawn.image is not None and drawn.image.pixel[1] > 0
    x, y = left + 0.03 * (right - left), top - 0.04 * (top - bottom) if downwards else bottom + 0.04 * (top - bottom)
    axes.plot([x, x + length], [y, y], color="0.2", lw=3, solid_capstyle="butt")
    axes.annotate(f"{length:g} {drawn.unit}", (x + length / 2, y), (0, 4), textcoords="offset points", ha="center")


def _legend(axes: Axes) -> tuple[list[Any], list[str]]:
    """Handles and labels, history and ground truth first."""
    handles, labels = axes.get_legend_handles_labels()
    order = sorted(range(len(labels)), key=lambda i: labels[i] not in ("history", "ground truth"))
    return [handles[i] for i in order], [labels[i] for i in order]


def _round_length(most: float) -> float:
    """The largest of 1, 2 and 5 times a power of ten that is not above ``most``."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(power * max(factor for factor in (1, 2, 5) if factor * power <= most * (1 + 1e-9)))


def _shifted(shift: float, value: float, _: Any) -> str:
    return f"{value + shift:.10g}"


def _as_bytes(figure: Figure, kind: str) -> bytes:
    buffer = io.BytesIO()
    # Without the date and with fixed ids, so that the same scene gives the same file.
    with matplotlib.rc_context({"svg.hashsalt": "motion_gym"}):
        figure.savefig(buffer, format=kind, metadata={"Date": None} if kind == "svg" else None)
    return buffer.getvalue()


def _animation(drawn: DrawnScene, suffix: str) -> bytes:
    """The 20 steps one after another; the last frame stays."""
    figure = Figure(figsize=SIZE, dpi=100)
    axes = figure.add_axes((0.1, 0.2, 0.87, 0.72))
    colors = colors_of(drawn.forecasts)

    def draw(step: int) -> Sequence[Any]:
        axes.clear()
        for legend in list(figure.legends):
            legend.remove()
        draw_scene(axes, drawn, colors, step)
        figure.legend(*_legend(axes), loc="lower center", ncols=2, fontsize=8, frameon=False)
        return ()

    steps = [*range(1, WINDOW + 1), *[WINDOW] * (2 * FRAMES_PER_SECOND)]
    movie = animation.FuncAnimation(figure, draw, frames=steps, init_func=lambda: (), cache_frame_data=False)
    writer, program = ("pillow", "") if suffix == ".gif" else ("ffmpeg", _ffmpeg())
    with TemporaryDirectory() as folder, matplotlib.rc_context({"animation.ffmpeg_path": program}):
        path = Path(folder) / f"scene{suffix}"
        movie.save(path, writer=writer, fps=FRAMES_PER_SECOND)
        return path.read_bytes()
