"""The file of scenes that the player of the results page shows: windows and streams, with stored forecasts."""

from __future__ import annotations

import base64
import io
import json
import lzma
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from motion_gym import catalog
from motion_gym.benchmarks.identity import row_name
from motion_gym.benchmarks.store import SHIPPED, provenance
from motion_gym.contract import DataError, Forecast, MotionGymError, Observation, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.scene_images import SceneImage
from motion_gym.data.storage import write_atomic
from motion_gym.metrics.errors import ade
from motion_gym.online.streams import Stream, stream
from motion_gym.scoring.show import DrawnScene, forecast_scenes
from motion_gym.stepping.harness import ask, copied, ready, tell, windows_of_domain

FILE = "scenes.json.xz"
SCHEMA = 1
SAMPLES = 4
"""Samples of each predictor in a window."""
TRAIL = 50
"""Matured forecasts in the mean error of a stream, as in the tables."""
IMAGE_SIDE = 512
"""Most pixels of a side of an image of the ground."""
Report = Callable[[int, int, str], None]


@dataclass(frozen=True)
class Windows:
    """Scenes of one domain, spread evenly over its test split.

    Attributes:
        group: Heading in the list of scenes.
        domain: Spec of the domain.
        methods: Specs of predictors.
        count: Number of scenes.
    """

    group: str
    domain: str
    methods: Sequence[str]
    count: int = 4


@dataclass(frozen=True)
class Shift:
    """Part of a stream around its shift; methods learn from its beginning on.

    Attributes:
        group: Heading in the list of scenes.
        domains: Specs of the domains, one after the other.
        methods: Specs of predictors and adapters.
        frames: Frames of each domain.
        shown: Most frames before and after the shift that are shown.
    """

    group: str
    domains: tuple[str, str]
    methods: Sequence[str]
    frames: int = 800
    shown: int = 70


_STRAIGHT = ("constant_velocity", "kalman_velocity")
_CROWD = (*_STRAIGHT, "style_erm", "modular_invariant", "ego_modular", "orca_oracle")
_TEN = (*_STRAIGHT, "erm_no_sigma:weights=style/crowd", "modular_stgat:weights=style/crowd")
_TRAFFIC = ("constant_velocity", "constant_turn", "linear", "kalman_residual", "idm_oracle")
_ADAPTED = ("constant_velocity", "modular_invariant", "kalman:of=modular_invariant", "hedge:of=modular_invariant")
SIMULATED: tuple[Windows | Shift, ...] = (
    *(Windows(f"Two agents that keep {d} m apart", f"orca:d={d}", _CROWD, 5) for d in (0.1, 0.3, 0.5, 0.6, 0.8)),
    *(Windows(f"Crowds of ten, {d} m apart", f"orca:d={d},agents=10", _TEN, 5) for d in (0.3, 0.6)),
    *(
        Windows(f"Traffic: {scenario}, {style} drivers", f"highway:style={style},scenario={scenario}", _TRAFFIC, 4)
        for style, scenario in (("calm", "straight"), ("assertive", "straight"), ("normal", "merge"))
    ),
    Windows("Traffic: roundabout, normal drivers", "highway:style=normal,scenario=roundabout", _TRAFFIC, 9),
    *(
        Shift("Streams: crowds of another style, labels arrive later", (f"orca:d={a}", f"orca:d={b}"), _ADAPTED)
        for a, b in ((0.3, 0.6), (0.1, 0.8), (0.5, 0.2), (0.6, 0.3))
    ),
)
"""Simulated scenes, which may be passed on: those of the shipped page."""


def read(folder: Path | None) -> dict[str, Any]:
    """The file of scenes in a folder of results, or else the one that ships.

    Raises:
        DataError: the file is damaged or of another version.
    """
    own = None if folder is None else folder / FILE
    path = own if own is not None and own.is_file() else SHIPPED / FILE
    if not path.is_file():
        return {"schema": SCHEMA, "scenes": []}
    try:
        content = json.loads(lzma.decompress(path.read_bytes()))
        version = content["schema"]
    except (OSError, ValueError, EOFError, lzma.LZMAError, KeyError, TypeError) as error:
        raise DataError(f"{path} is not a file of scenes ({error}): delete it, or write it again (--scenes).") from None
    if version != SCHEMA:
        raise DataError(f"{path} has the schema {version!r}, and {SCHEMA} is read: write it again (--scenes).")
    return content  # type: ignore[no-any-return]


def write(folder: Path, scenes: Mapping[str, Any]) -> Path:
    """Write a file of scenes; returns its path."""
    path = folder / FILE
    text = json.dumps(scenes, allow_nan=False, separators=(",", ":"))
    write_atomic(path, lzma.compress(text.encode(), preset=9 | lzma.PRESET_EXTREME))
    return path


def compute(
    chosen: Sequence[Windows | Shift] = SIMULATED, report: Report = lambda done, total, label: None
) -> dict[str, Any]:
    """Ask predictors for forecasts of scenes, in JSON types.

    Args:
        chosen: What to show.
        report: Called before each domain or stream with the number that are done, the number of all, and a label.

    Raises:
        SpecError: a name is not known, or a predictor does not fit a domain.
    """
    scenes: list[dict[str, Any]] = []
    for done, each in enumerate(chosen):
        report(done, len(chosen), each.group)
        scenes += _windows(each) if isinstance(each, Windows) else [_stream(each)]
    return {"schema": SCHEMA, "scenes": scenes, "provenance": provenance()}


def chosen_by_user(domains: Sequence[str], methods: Sequence[str], count: int) -> list[Windows]:
    """Scenes of domains with the predictors that are named, or with constant velocity and the oracle of each domain."""
    chosen = []
    for spec in domains:
        oracle = catalog.domain(spec).card.oracle
        default = [*_STRAIGHT, *([oracle] if oracle else [])]
        chosen.append(Windows(spec, spec, list(methods) or default, count))
    return chosen


def _windows(chosen: Windows) -> Iterator[dict[str, Any]]:
    place = catalog.domain(chosen.domain)
    total = windows_of_domain(place, "test").observation.scenes
    numbers = sorted({round(place) for place in np.linspace(0, total - 1, chosen.count + 2)[1:-1].tolist()})
    if not total:
        raise SpecError(f"`{chosen.domain}` has no scene in its test split: choose another domain.")
    try:
        drawn = list(forecast_scenes(place, list(chosen.methods), numbers, k=SAMPLES))
    except MotionGymError as error:
        raise SpecError(f"Scenes of `{chosen.domain}` with {', '.join(chosen.methods)}: {error}") from None
    for number, scene in zip(numbers, drawn, strict=True):
        yield _window(scene, f"scene {number} of {spec_of(place)}", chosen.group, place.card.dt)


def _window(drawn: DrawnScene, title: str, group: str, dt: float) -> dict[str, Any]:
    scale = _scale(drawn.unit)
    truth, origin = drawn.truth, drawn.origin
    lines = () if origin is None else drawn.ground
    ground = [[bool(dashed), _flat(points - origin, scale)] for points, dashed in lines]
    return {
        "kind": "windows", "title": title, "group": group, "unit": drawn.unit, "dt": dt, "scale": scale,
        "history": [_flat(path, scale) for path in truth.observation.xy],
        "future": [_flat(path, scale) for path in np.where(truth.known[..., None], truth.future, np.nan)],
        "methods": [row_name(name) for name in drawn.forecasts],
        "forecasts": {
            row_name(name): [[_flat(path, scale) for path in samples] for samples in _likely_first(forecast)]
            for name, forecast in drawn.forecasts.items()
        },
        "ground": ground,
        **_picture(drawn.image),
    }  # fmt: skip


def _likely_first(forecast: Forecast) -> np.ndarray:
    """[A, K, 12, 2], the samples of highest weight first."""
    if forecast.weights is None:
        return forecast.positions
    order = np.argsort(-forecast.weights, axis=1, kind="stable")
    return np.take_along_axis(forecast.positions, order[:, :, None, None], axis=1)


def _stream(chosen: Shift) -> dict[str, Any]:
    played: Stream = stream(chosen.domains, "sudden", chosen.frames)
    unit, shift = played.domains[0].card.unit, int(played.ends[0])
    frames: dict[int, dict[str, Any]] = {}
    lines = {row_name(spec): _play(spec, played, chosen.shown, frames) for spec in chosen.methods}
    labels = [f"{number} {label}" for number, label in zip(("before:", "after:"), played.labels, strict=True)]
    parts = [frame["part"] for frame in frames.values()]
    return {
        "kind": "stream", "title": f"{played.labels[0]}, then {played.labels[1]}", "group": chosen.group,
        "unit": unit, "dt": played.clock.dt, "scale": _scale(unit), "methods": list(lines),
        "frames": list(frames.values()), "labels": labels,
        "marks": [[parts.index(1), labels[1]]],
        "errors": {name: line.curve for name, line in lines.items()},
        "gauges": {name: line.gauges for name, line in lines.items() if line.gauges},
        "means": {
            name: {label: _mean_of(part, line.errors, shift) for part, label in enumerate(labels)}
            for name, line in lines.items()
        },
    }  # fmt: skip


@dataclass
class _Line:
    """One method over a stream: matured errors with the times of their forecasts, and values at the shown frames."""

    errors: list[tuple[int, float]]
    curve: list[float | None]
    gauges: dict[str, list[float]]


def _play(spec: str, played: Stream, shown: int, frames: dict[int, dict[str, Any]]) -> _Line:
    """Play a stream with one method, and add its forecasts to the frames near the shift."""
    name, runner = row_name(spec), ready(copied(spec), played.domains[0], 0, played.domains[1:])
    clock, scale, line = played.clock, _scale(played.domains[0].card.unit), _Line([], [], {})
    step = clock.reset()
    while len(step.observation):
        now, forecast = clock.time, ask(runner, step.observation)
        if abs(now - int(played.ends[0])) <= shown:
            part = int(played.segment_at(now))
            frame = frames.setdefault(now, _frame(now, part, step.observation, step.identity, scale))
            frame["forecasts"][name] = [_flat(path, scale) for path in forecast.most_likely()]
            recent = [error for _, error in line.errors[-TRAIL:]]
            line.curve.append(round(float(np.mean(recent)), 3) if recent else None)
            for gauge, value in _gauges(runner).items():
                line.gauges.setdefault(gauge, []).append(round(float(value), 3))
        step = clock.step(forecast)
        if step.settled is not None:
            matured = step.settled.matured
            errors = ade(step.settled.forecast, step.settled.truth)[matured].tolist()
            line.errors.extend(zip(step.settled.made[matured].tolist(), errors, strict=True))
            if hasattr(runner, "observe"):
                tell(runner, step.settled.truth)
    return line


def _frame(now: int, part: int, observation: Observation, identity: np.ndarray, scale: int) -> dict[str, Any]:
    return {
        "t": now,
        "part": part,
        "agent": identity.tolist(),
        "xy": [_flat(path, scale) for path in observation.xy],
        "forecasts": {},
    }


def _mean_of(part: int, values: Sequence[tuple[int, float]], shift: int) -> float | None:
    chosen = [error for made, error in values if (made >= shift) == bool(part)]
    return round(float(np.mean(chosen)), 4) if chosen else None


def _gauges(runner: Any) -> Mapping[str, float]:
    return runner.gauges() if callable(getattr(runner, "gauges", None)) else {}


def _scale(unit: str) -> int:
    """Stored whole numbers in one unit of length: centimetres, or tenths of a pixel."""
    return 10 if unit == "px" else 100


def _flat(path: np.ndarray, scale: int) -> list[int | None]:
    """[T, 2] as x, y, x, y, ...; None where it is not known."""
    return [None if np.isnan(v) else round(float(v) * scale) for v in np.asarray(path, dtype=float).ravel()]


def _picture(image: SceneImage | None) -> dict[str, Any]:
    """An image of the ground as a data address, with its extent; nothing without one."""
    if image is None:
        return {}
    from PIL import Image

    photo = Image.fromarray(image.photo)
    photo.thumbnail((IMAGE_SIDE, IMAGE_SIDE))
    buffer = io.BytesIO()
    photo.save(buffer, "JPEG", quality=70)
    (left, low), (right, high) = image.extent
    down = bool(image.pixel[1] > 0)
    address = "data:image/jpeg;base64," + base64.b64encode(buffer.getvalue()).decode()
    top = low if down else high
    place = {"left": left, "top": top, "width": right - left, "height": high - low}
    return {"down": down, "image": {"uri": address, **{key: round(float(v), 3) for key, v in place.items()}}}
