"""The verb that says how a file of tracks or a domain was understood."""

from __future__ import annotations

from typing import Annotated, Any

import tyro

from motion_gym.cli.output import Json, Text, console, print_json, say
from motion_gym.specs import parse_value

Number = Annotated[str | None, tyro.conf.arg(metavar="NUMBER")]
"""Read as in a spec, whose errors say what is allowed."""


def inspect(
    thing: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="FILE_OR_DOMAIN")],
    columns: Text = None,
    fps: Number = None,
    dt: Number = None,
    unit: Text = None,
    scale: Number = None,
    step: Number = None,
    gap: Number = None,
    split: Text = None,
    sources: Annotated[list[str], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="FILE")] = [],  # noqa: B006
    as_json: Json = False,
) -> None:
    """Say how a file of tracks or a domain was understood, measure it, and warn of what is not usual.

    Args:
        thing: A file or a pattern, or a domain: a name, a spec or your own (module:Class).
        columns: Columns of frame (or time), id, x and y: names of the header, or numbers from 0.
        fps: Frames per second of the frame numbers.
        dt: Seconds between consecutive listed frames.
        unit: Unit of the file, m, cm, mm, km, ft, in, yd or px.
        scale: What positions are multiplied by, metres per pixel for px.
        step: Seconds per step that tracks are resampled to.
        gap: Longest time, in seconds, over which a position is extrapolated.
        split: Shares of the time for train, val and test, as "0.6 0.2 0.2".
        sources: Another file to train on; give it once for each.
        as_json: Print JSON in place of the report.
    """
    from motion_gym.checks.inspection import inspect as inspect_domain

    keywords: dict[str, Any] = {"sources": sources or None, "columns": columns, "unit": unit, "split": split}
    numbers = {"fps": fps, "dt": dt, "scale": scale, "step": step, "gap": gap}
    keywords |= {name: parse_value(value) for name, value in numbers.items() if value is not None}
    keywords = {name: value for name, value in keywords.items() if value is not None}
    report = inspect_domain(thing, **keywords)
    if as_json:
        print_json(report.as_dict())
    else:
        say(report.text(console.width))
