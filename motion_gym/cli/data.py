"""The command for data sets."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.markup import escape

from motion_gym.cli.output import console, say
from motion_gym.contract import DataError, SpecError
from motion_gym.data import datasets
from motion_gym.data.storage import data_folder


def data(
    action: tyro.conf.Positional[Literal["ls", "add", "fetch", "verify"]],
    name: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="NAME")] = None,
    source: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None,
) -> None:
    """List, add, download or verify data sets.

    Args:
        action: ls: list known and installed data sets; add: check each file in a folder, and copy it; fetch: download
            missing files; verify: check every file against its checksum.
        name: Name of the data set, as eth_ucy.
        source: For add: the folder that holds the files, at any depth.
    """
    if action == "ls":
        for entry, states in datasets.listing():
            here = sum(state.state == "ok" for state in states)
            console.print(f"[bold]{entry.name}[/bold]  {here} of {len(states)} files here", highlight=False)
            for label, text in (
                ("title", entry.title),
                ("folder", str(data_folder() / entry.name)),
                ("source", entry.source),
                ("terms", entry.terms),
                ("cite", entry.citation),
            ):
                say(f"  {label + ':':8}{text}")
        return
    if name is None:
        raise SpecError(f"Which data set? motion-gym data {action} NAME; known: {', '.join(datasets.DATASETS)}.")
    if action == "add":
        if source is None:
            raise SpecError(f"Where are the files? motion-gym data add {name} --from DIR")
        states = datasets.add(name, source)
    else:
        states = datasets.fetch(name) if action == "fetch" else datasets.verify(name)
    in_parts = datasets.dataset(name).in_parts
    listed = [state for state in states if state.state != "missing" or not in_parts]
    for state in listed:
        color = "green" if state.state == "ok" else "red"
        console.print(
            f"  [{color}]{state.state:8}[/{color}] {escape(str(state.path))}", highlight=False, soft_wrap=True
        )
    say(f"terms: {datasets.dataset(name).terms}")
    bad = [state for state in listed if state.state != "ok"]
    if bad or not listed:
        raise DataError(
            f"{len(bad) or len(states)} of {len(states)} files of {name} are missing or damaged: "
            + ("" if in_parts else f"`motion-gym data fetch {name}`, or ")
            + f"`motion-gym data add {name} --from DIR`."
        )
    some = f"{len(listed)} of {len(states)} files are here and whole; each form can be used without the other"
    say(f"{name}: {some if len(listed) < len(states) else f'all {len(states)} files are here and whole'}.")
