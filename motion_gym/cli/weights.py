"""The command for weights that do not come with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from motion_gym.cli.output import say
from motion_gym.contract import SpecError
from motion_gym.training import added_weights


def weights(
    action: tyro.conf.Positional[Literal["ls", "add"]],
    source: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None,
) -> None:
    """List or add weights that do not come with the package because of the terms of their training data.

    Args:
        action: ls: list these weights, and whether they are here; add: check each file against its checksum, and copy
            it into the data folder, where weights=auto finds it.
        source: For add: the folder that holds the files, at any depth.
    """
    if action == "ls":
        for name in added_weights.left_out():
            path = added_weights.added_folder() / name
            say(f"{'here' if path.is_file() else 'missing':8}{path}")
        return
    if source is None:
        raise SpecError("Where are the weights? motion-gym weights add --from DIR")
    for path in added_weights.add(source):
        say(f"Written: {path}")
        for terms in added_weights.terms_of(path):
            say(f"  terms of the training data: {terms}")
