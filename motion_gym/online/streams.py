"""Streams: one domain after another, frame by frame, so that the domain shifts while a predictor runs."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_gym import catalog
from motion_gym.contract import WINDOW, Domain, Recording, SpecError
from motion_gym.data.domains import observed_images, spec_of
from motion_gym.data.windows import frames_by_step, positions_only
from motion_gym.specs import one_of
from motion_gym.stepping.stream_clock import StreamClock

KINDS = {
    "sudden": "one domain after the other, each once",
    "gradual": "from one domain to the next in blocks, with a growing share of the next",
    "recurring": "one domain after the other, and then all of them again",
    "mixed": "blocks of all domains in random order",
}
BLOCKS = 10
"""Number of blocks of a visit of a domain in gradual and mixed streams."""
MOST_FRAMES = 4000
"""Most frames of a visit if ``frames`` is not given."""
UNIT = WINDOW
"""Visits begin and end at multiples of this number of frames, the length of a simulated scene."""


@dataclass(frozen=True)
class Segment:
    """Consecutive listed frames of a domain.

    Attributes:
        domain: A name, a spec or a domain.
        start: First listed frame, counted over all recordings of the split.
        stop: One more than the last listed frame.
    """

    domain: str | Domain
    start: int
    stop: int


class Stream:
    """Segments of domains, played one after another.

    A person on both sides of a border between segments is two agents, and outstanding forecasts are censored there. No
    frame is played twice, since a predictor could know a future that was shown once.

    Args:
        segments: Segments in the order in which they are played.
        split: Split of all domains.
        name: Name for tables; by default the domains.

    Raises:
        SpecError: There is no segment, a domain is not known, a segment is empty or longer than its domain, two
            segments show the same frames, or the domains differ in their steps or features.
    """

    def __init__(self, segments: Sequence[Segment], split: str = "test", name: str | None = None):
        if not segments:
            raise SpecError("A stream needs at least one segment: Segment(domain, start, stop).")
        wrong = next((s for s in segments if not isinstance(s, Segment)), None)
        if wrong is not None:
            raise SpecError(f"{wrong!r} is no segment: write motion_gym.Segment(domain, start, stop).")
        for segment in segments:
            for edge in ("start", "stop"):
                catalog.whole_number(f"{edge} of a segment", getattr(segment, edge), 0, 10**9)
        named = {s.domain: catalog.domain(s.domain) for s in segments if isinstance(s.domain, str)}
        places = [named[s.domain] if isinstance(s.domain, str) else catalog.domain(s.domain) for s in segments]
        self.split = split
        self.segments = [dataclasses.replace(s, domain=p) for s, p in zip(segments, places, strict=True)]
        self.domains: list[Domain] = list({id(place): place for place in places}.values())
        self.labels = [spec_of(place) for place in places]
        """Specs of the domains of the segments."""
        _check_kinds(self.domains)
        _check_overlap(self.segments)
        cuts = [_cut(place, split, segment) for segment, place in zip(self.segments, places, strict=True)]
        features = [getattr(p, "history", positions_only) for p, cut in zip(places, cuts, strict=True) for _ in cut]
        parts = [recording for cut in cuts for recording in cut]
        self.ends = np.cumsum([sum(len(frames_by_step(recording)) for recording in cut) for cut in cuts])
        """[segments] step of the stream behind each segment."""
        images = [i for p, cut in zip(places, cuts, strict=True) for i in observed_images(p, cut)]
        self.clock = StreamClock(parts, features, images=images)
        self.dt = self.clock.dt
        self.name = name if name is not None else " -> ".join(self.labels)
        if not len(self.clock.times):
            raise SpecError(f"Nobody is observed for 8 frames in {self.name}: give longer segments.")

    def segment_at(self, time: np.ndarray | int) -> np.ndarray:
        """Number of the segment that steps of the stream belong to."""
        return np.searchsorted(self.ends, time, side="right")

    def __repr__(self) -> str:
        return f"Stream({self.name})"


def stream(
    domains: str | Domain | Sequence[str | Domain],
    kind: str = "sudden",
    frames: int | None = None,
    *,
    cycles: int = 2,
    seed: int = 0,
    split: str = "test",
) -> Stream:
    """Make a stream over domains.

    Domains of one place (as ``eth:alpha=1`` and ``eth:alpha=64``, or crowds of different styles, which begin alike)
    share its frames: each visit starts where the last one ended.

    Args:
        domains: One or several names, specs or domains.
        kind: ``sudden``, ``gradual``, ``recurring`` or ``mixed``, see ``KINDS``.
        frames: Listed frames of each visit of a domain, rounded down to a multiple of 20, or of 200 in blocks. By
            default all frames, and at most 4000; a single domain is played whole.
        cycles: Visits of each domain in recurring and mixed streams.
        seed: Seed of the part of a place that is played, if it has more frames, and of the order of blocks.
        split: Split of all domains.

    Raises:
        SpecError: A name, kind or number is not known or not allowed, or there are not enough frames.
    """
    one_of("kind", kind, KINDS)
    seed = catalog.whole_number("seed", seed, 0, 2**31)
    cycles = catalog.whole_number("cycles", cycles, 1, 1000)
    if isinstance(domains, (set, frozenset, dict)):
        raise SpecError("The domains of a stream are played in order: give a list, not a set.")
    places = [catalog.domain(d) for d in (domains if isinstance(domains, (list, tuple)) else [domains])]  # type: ignore[arg-type]
    if not places:
        raise SpecError("A stream needs at least one domain, as orca:d=0.3.")
    if len(places) == 1 and frames is None and kind == "sudden":
        return Stream([Segment(places[0], 0, frames_of(places[0], split))], split)
    visits = list(range(len(places))) * (cycles if kind in ("recurring", "mixed") else 1)
    worlds = [place.world for place in places]
    available = {w: min(frames_of(p, split) for p in places if p.world == w) for w in dict.fromkeys(worlds)}
    number = {world: sum(worlds[visit] == world for visit in visits) for world in available}
    most = min(available[world] // number[world] for world in available) // UNIT * UNIT
    if frames is None:
        frames = max(min(most, MOST_FRAMES), UNIT)
    if catalog.whole_number("frames", frames, UNIT, 10**9) % UNIT:
        warnings.warn(
            f"`frames={frames}`: visits have a multiple of {UNIT} frames, so {frames // UNIT * UNIT} are played.",
            stacklevel=2,
        )
    frames = frames // UNIT * UNIT
    in_blocks = kind in ("gradual", "mixed")
    if in_blocks and frames < BLOCKS * UNIT:
        raise SpecError(
            f"`frames={frames}`: `{kind}` cuts a visit into {BLOCKS} blocks of at least {UNIT} frames, give "
            f"{BLOCKS * UNIT} or more; there are {most} for each."
        )
    if frames > most:
        short = min(available, key=lambda world: available[world] // number[world])
        raise SpecError(
            f"`frames={frames}`: {short} has {available[short]} frames in split `{split}`, for {number[short]} visits "
            f"of at least {UNIT} frames: "
            + (f"ask for at most {most}." if most else "ask for fewer visits (`cycles`), or for other domains.")
        )
    rng = np.random.default_rng([seed, len(places)])
    next_frame = {w: int(rng.integers((available[w] - number[w] * frames) // UNIT + 1)) * UNIT for w in available}
    end = {world: next_frame[world] + number[world] * frames for world in available}
    order = _blocks(kind, visits, len(places), rng) if in_blocks else visits
    length = max(frames // BLOCKS // UNIT, 1) * UNIT if in_blocks else frames
    segments: list[Segment] = []
    for place in (places[index] for index in order):
        start, stop = next_frame[place.world], min(next_frame[place.world] + length, end[place.world])
        if stop <= start:
            continue  # the random order has more blocks of a place than it has frames
        next_frame[place.world] = stop
        if in_blocks and segments and segments[-1].domain is place and segments[-1].stop == start:
            segments[-1] = dataclasses.replace(segments[-1], stop=stop)
        else:
            segments.append(Segment(place, start, stop))
    return Stream(segments, split, stream_name(places, kind, frames, cycles=cycles, seed=seed, split=split))


def stream_name(
    domains: Sequence[str | Domain],
    kind: str,
    frames: int,
    *,
    cycles: int = 2,
    seed: int = 0,
    split: str = "test",
) -> str:
    """Name of the result of ``stream``, computed without data."""
    name = f"{kind}({', '.join(spec_of(catalog.domain(d)) for d in domains)}; frames={frames // UNIT * UNIT}"
    name += f", cycles={cycles}" if kind in ("recurring", "mixed") else ""
    return f"{name}, seed={seed}{'' if split == 'test' else f', {split}'})"


def _blocks(kind: str, visits: Sequence[int], places: int, rng: np.random.Generator) -> list[int]:
    """Number of the place of each block."""
    count = len(visits) * BLOCKS
    if kind == "mixed":
        return [int(v) for v in rng.permutation(np.repeat(visits, BLOCKS))]
    # Half a visit of the first place alone, then ramps, then half a visit of the last one alone.
    along = np.clip((np.arange(count) + 0.5) / BLOCKS - 0.5, 0, places - 1)
    return [int(v) for v in np.floor(along) + (rng.random(count) < along % 1)]


def frames_of(domain: Domain, split: str) -> int:
    """Number of steps of all recordings of a split."""
    return sum(len(frames_by_step(recording)) for recording in domain.recordings(split))


def _cut(domain: Domain, split: str, segment: Segment) -> list[Recording]:
    """The recordings of a segment; SpecError if the domain does not have its frames."""
    recordings = domain.recordings(split)
    frames = [frames_by_step(recording) for recording in recordings]
    most = sum(map(len, frames))
    if not segment.start < segment.stop <= most:
        raise SpecError(
            f"A segment of {spec_of(domain)} has frames {segment.start} to {segment.stop}: it must have at least one "
            f"frame, and end at {most} at most."
        )
    parts, first = [], 0
    for recording, listed in zip(recordings, frames, strict=True):
        before = listed[: max(segment.start - first, 0)]
        chosen = listed[len(before) : max(segment.stop - first, 0)]
        first += len(listed)
        rows = np.isin(recording.frame, chosen) & ~np.isin(recording.frame, before)
        if rows.any():
            columns = {name: getattr(recording, name)[rows] for name in ("frame", "agent", "xy")}
            parts.append(dataclasses.replace(recording, **columns))
    return parts


def _check_kinds(places: Sequence[Domain]) -> None:
    first = places[0].card
    for card in (place.card for place in places):
        if not math.isclose(card.dt, first.dt, rel_tol=1e-6):
            raise SpecError(
                f"The domains of a stream have one step, but {first.name} has dt={first.dt} s and {card.name} "
                f"dt={card.dt} s: leave one of them out."
            )
        if len(card.features) != len(first.features):
            raise SpecError(
                f"The domains of a stream show the same features, but {first.name} has {', '.join(first.features)} "
                f"and {card.name} {', '.join(card.features)}: give all of them an alpha, or none."
            )


def _check_overlap(segments: Sequence[Segment]) -> None:
    for number, one in enumerate(segments):
        for other in segments[:number]:
            same = one.domain.world == other.domain.world  # type: ignore[union-attr]
            if same and one.start < other.stop and other.start < one.stop:
                raise SpecError(
                    f"Two segments overlap: both play frames {max(one.start, other.start)} to "
                    f"{min(one.stop, other.stop)} of {one.domain.world}. A predictor could remember it: "  # type: ignore[union-attr]
                    "give each segment frames of its own."
                )
