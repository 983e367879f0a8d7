"""The second world of the leak probe: a copy of a domain whose data is another one after a given time."""

from __future__ import annotations

import copy
import dataclasses
import types
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from motion_gym.contract import FUTURE, HISTORY, Domain, Recording, SpecError, Truth
from motion_gym.domains import RecordedDomain
from motion_gym.windows import Tracks, windows_of

METRES = 5.0
"""Standard deviation of the noise put on each coordinate."""
NEWCOMERS, NEW_FRAMES = 3, 16
LEAVE, LOSE = 0.3, 0.5
"""Shares of the people who leave for good, and of the others, who are lost for two frames and found again."""
SKIP = 0.1
"""Share of the frames that disappear."""

Change = Callable[[Sequence[Recording]], Sequence[Recording]]


class Stage:
    """A copy of a domain whose data can be changed under its feet; whoever holds the copy sees the change.

    What is changed is the answer of the lowest method ``recordings`` in the domain's class and its bases that is still
    in step with the recordings played, so that all that subclasses make of it, and windows and histories, follow from
    the change. Where windows do not follow from recordings, they are changed themselves, and time is their number.

    Args:
        domain: The domain; it is not changed.
        clock: ``stream`` or ``windows``.
        split: The split that is played, the only one that is changed.
        seed: Source of the changes.

    Attributes:
        domain: The copy.
        seam: The method whose answer is changed.
        unprobed: What cannot be probed, and why.
        selections: Ways in which it depends on the future who is observed.

    Raises:
        SpecError: the domain has nothing to play, or nothing that could be changed.
    """

    def __init__(self, domain: Domain, clock: str, split: str, seed: int):
        self.clock, self.split, self.seed = clock, split, seed
        self._original = domain
        self.domain: Any = copy.deepcopy(domain)
        self._given: Sequence[Recording] = ()
        self._definer: type | None = None
        self._times: np.ndarray | None = None
        self._base: Truth | None = None
        self.seam = ""
        self.unprobed: list[str] = []
        self.selections: tuple[str, ...] = ()
        name = type(domain).__name__
        if clock == "windows":
            self._base = self.domain.windows(split)
            least = domain.card.parameters.get("min_agents", 1)
            self.selections = (
                "the windows clock shows who is complete over all 20 steps, in windows with at least "
                f"{least} of them: known only afterwards, so presence was not changed",
            )
        # From the top of the bases down, so that `kind` ends as the lowest class through which a change arrives.
        for kind in type(domain).__mro__:
            if "recordings" in vars(kind) and kind not in (RecordedDomain, Domain) and not self._arrives(kind):
                break
        if self._definer is not None:
            self.seam = f"{self._definer.__name__}.recordings"
        elif clock == "stream":
            raise SpecError(f"{name} cannot be probed on the stream clock: its class has no recordings to change.")
        else:
            self.seam = f"{name}.windows"
            self.unprobed.append(
                f"{name}.windows does not follow from recordings: how it makes observations was not probed"
            )
        self.restore()

    def restore(self) -> None:
        """Give the copy the data of the original again."""
        vars(self.domain).clear()
        vars(self.domain).update(vars(copy.deepcopy(self._original)))
        object.__setattr__(self.domain, "__class__", type(self._original))
        self._times = None if self._definer is None else self._window_times()
