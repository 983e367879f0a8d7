"""The speed of agents, and the units and rates with which people would walk."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from motion_gym.checks.track_measurements import STANDING, Finding, Steps
from motion_gym.data.tracks.track_files import METRES, Reading

WALKING = (0.5, 2.0)
"""Metres per second: the usual range of the median speed of people who walk."""
WALK = 1.3
"""Metres per second at which people walk most of the time."""
UNITS = ("m", "ft", "in", "cm", "mm")
"""Units that are offered in place of a stated one."""
VIDEO = (8.0, 130.0)
"""Frames per second of cameras and sensors."""
SLOWEST = 1.0
"""Lowest rate that is offered instead of a stated one that is too high: files may list a frame per second."""


def speed(steps: Steps, rate: float, reading: Reading | None = None) -> Iterator[Finding]:
    """Median and 99th percentile of the speed of agents who move, and the median step.

    Args:
        steps: The steps.
        rate: Frame numbers per second, as understood; 0 if the file itself says the time.
        reading: How the files were read; None for a domain without files.
    """
    speeds = steps.moving / steps.dt
    if not len(speeds):
        yield Finding("median speed", None, "nobody moves", _nobody_moves(steps, rate, reading))
        return
    median, high = float(np.median(speeds)), float(np.quantile(speeds, 0.99))
    warning = ""
    if steps.unit == "m" and not WALKING[0] <= median <= WALKING[1]:
        ratio = median / WALK
        said = f"{ratio:.2g} times as fast as" if ratio > 1 else f"{1 / ratio:.2g} times slower than"
        slow = "Most agents may stand or walk slowly." if ratio < 1 else "If they are vehicles, it may be right."
        warning = (
            f"The median speed is {median:.2f} m/s, {said} people walk (1.0 to 1.6 m/s; cyclists 3 to 7, cars 5 to "
            f"35). {_options(steps, rate, reading)}Check {_stated(reading)}. {slow}"
        )
    yield Finding("median speed", round(median, 4), f"{median:.2f} {steps.unit}/s of those who move", warning)
    yield Finding("99th percentile of speed", round(high, 4), f"{high:.2f} {steps.unit}/s")
    step = float(np.median(steps.moving))
    yield Finding("median step", round(step, 5), f"{step:.3f} {steps.unit} in {steps.dt:g} s")


def _nobody_moves(steps: Steps, rate: float, reading: Reading | None) -> str:
    """The warning for tracks without an agent who moves."""
    if steps.unit != "m" or not steps.length.any():
        return "Nobody moves in any step: check which columns are x and y."
    return (
        f"Nobody moves faster than {STANDING:g} m/s; the median speed is {_median(steps):.2g} m/s. "
        f"{_options(steps, rate, reading)}Check {_stated(reading)}, and which columns are x and y."
    )


def _median(steps: Steps, factor: float = 1.0) -> float:
    """Median speed of agents who move, with positions multiplied by a factor; of all steps if no agent moves."""
    speeds = steps.length * factor / steps.dt
    moving = speeds[speeds > STANDING]
    return float(np.median(moving if len(moving) else speeds[speeds > 0]))


def _options(steps: Steps, rate: float, reading: Reading | None) -> str:
    """The units and rates, other than the stated ones, with which people would walk at a usual speed."""
    read = Reading() if reading is None else reading
    units = {unit: _median(steps, METRES[unit] / read.factor) for unit in UNITS}
    if read.scale is None:
        units.pop(read.unit, None)
    plain = "" if read.scale is None else " without scale"
    options = [
        f"unit={unit}{plain} would give {speed:.2f} m/s"
        for unit, speed in units.items()
        if WALK / 2 <= speed <= WALK * 1.6
    ]
    pairs = {} if options else units
    instead = f" instead of dt={read.dt:g}" if read.dt else ""
    now = _median(steps)
    fps = rate * WALK / now
    if now < WALK and VIDEO[0] <= fps <= VIDEO[1]:
        options.append(f"fps of about {_rounded(fps)}{instead} would give {WALK:g} m/s")
    elif read.fps and now > WALK and SLOWEST <= fps <= VIDEO[1]:
        options.append(f"fps of about {_rounded(fps)} would give {WALK:g} m/s")
    elif read.dt and now > WALK and read.dt * now / WALK <= 1 / SLOWEST:
        options.append(f"dt of about {read.dt * now / WALK:.2g} would give {WALK:g} m/s")
    for unit, speed in pairs.items():
        fps = rate * WALK / speed
        if VIDEO[0] <= fps <= VIDEO[1] and speed < WALK / 2:
            options.append(f"unit={unit}{plain} and fps of about {_rounded(fps)}{instead} would give {WALK:g} m/s")
    return f"{'; or '.join(options[:3])}. " if options else ""


def _rounded(fps: float) -> str:
    return f"{fps:.0f}" if fps >= 10 else f"{fps:.2g}"


def _stated(reading: Reading | None) -> str:
    """The keywords that decide the speed, as they were stated."""
    if reading is None:
        return "dt and the unit"
    rate = next((f"{k}={v:g}" for k in ("fps", "dt") if (v := getattr(reading, k))), "the times of the file")
    scale = "" if reading.scale is None else f", scale={reading.scale:g}"
    return f"{rate}{scale} and unit={reading.unit}"
