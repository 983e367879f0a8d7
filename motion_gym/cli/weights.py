"""The command for weights that do not come with the installed package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import tyro

from motion_gym.cli.output import say
from motion_gym.contract import SpecError
from motion_gym.training import added_weights


def weights(
    action: tyro.conf.Positional[Literal["ls", "add", "fetch"]],
    source: Annotated[Path | None, tyro.conf.arg(name="from", metavar="FOLDER")] = None,
) -> None:
    """List or add weights that do not come with the installed package, because of size or terms of training data.

    Args:
        action: ls: list these weights, and whether they are here; add: check each file against its checksum, and copy
            it into the data folder, where weights=auto finds it; fetch: download those that are missing, where the
            environment variable MOTION_GYM_WEIGHTS_URL names the folder that holds them.
        source: For add: the folder that holds the files, at any depth.
    """
    if action == "ls":
        for name in added_weights.left_out():
            path = added_weights.added_folder() / name
            say(f"{'here' if path.is_file() else 'missing':8}{path}")
        return
    if action == "fetch":
        written = added_weights.fetch()
    elif source is None:
        raise SpecError("Where are the weights? motion-gym weights add --from DIR")
    else:
        written = added_weights.add(source)
    for path in written:
        say(f"Written: {path}")
    for terms in added_weights.terms_of(written):
        say(f"  terms of the training data: {terms}")
    if not written:
        say("All weights are here.")
