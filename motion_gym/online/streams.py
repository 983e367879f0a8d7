"""Streams: one domain after another, frame by frame, so that a predictor meets a shift while it runs."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motion_gym import catalog
from motion_gym.contract import WINDOW, Domain, Recording, SpecError
from motion_gym.data.domains import spec_of
from motion_gym.data.windows import positions_only
from motion_gym.stepping.stream_clock import StreamClock

KINDS = {
    "sudden": "one domain after the other, each once",
    "gradual": "from one domain to the next in blocks, of which more and more are of the next",
    "recurring": "one domain after the other, and all over again",
    "mixed": "blocks of all domains in random order",
}
BLOCKS = 10
"""Blocks that the visit of a domain is cut into where domains mix."""
MOST_FRAMES = 4000
"""Frames of a visit where no number is asked for."""
UNIT = WINDOW
"""Visits begin and end at multiples of this many frames: simulated scenes are as long, and stay whole."""


@dataclass(frozen=True)
class Segment:
    """Some listed frames of a domain, which a stream plays without a break.

    Attributes:
        domain: A name, a spec or a domain.
        start: First listed frame, counted over all recordings of the split.
        stop: Behind the last one.
    """

    domain: str | Domain
    start: int
    stop: int


class Stream:
    """Segments of domains, played one after another.

    Nobody is carried over from one segment to the next: who is seen on both sides is two agents, and forecasts
    that are outstanding are censored. No frame is played twice, since a future that was shown once could be known.

    Args:
        segments: In the order in which they are played.
        split: Which split of all domains.
        name: For tables; by default the domains.

    Raises:
        SpecError: there is no segment, one is of an unknown domain, empty or longer than the domain, two show the same
            frames, or domains have other steps or features than others.
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
        self.split, made = split, {}
        for segment in segments:
            key = segment.domain if isinstance(segment.domain, str) else id(segment.domain)
            if key not in made:
                made[key] = catalog.domain(segment.domain)
        places = [made[s.domain if isinstance(s.domain, str) else id(s.domain)] for s in segments]
        self.segments = [dataclasses.replace(s, domain=p) for s, p in zip(segments, places, strict=True)]
        self.domains: list[Domain] = list(made.values())
        self.labels = [spec_of(place) for place in places]
        """Specs of the domains of the segments."""
        _check_kinds(self.domains)
        _check_overlap(self.segments)
        parts, features, ends = [], [], []
        frames = {id(place): frames_of(place, split) for place in self.domains}
        for segment, place in zip(self.segments, places, strict=True):
            cut = _cut(place.recordings(split), segment, frames[id(place)])
            parts += cut
            features += [getattr(place, "history", positions_only)] * len(cut)
            ends.append(segment.stop - segment.start)
        self.ends = np.cumsum(ends)
        """[segments] listed frame of the stream behind each segment."""
        self.clock = StreamClock(parts, features)
        self.dt = self.clock.dt
        self.name = name if name is not None else " -> ".join(self.labels)
        if not len(self.clock.times):
            raise SpecError(f"Nobody is observed for 8 frames in {self.name}: give longer segments.")

    def segment_at(self, time: np.ndarray | int) -> np.ndarray:
        """Number of the segment that listed frames of the stream belong to."""
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
    """A stream over domains.

    Domains that show the same place (as ``eth:alpha=1`` and ``eth:alpha=64``, or crowds of other styles, which begin
    alike) share its frames: each visit goes on where the last one ended.

    Args:
        domains: One or several: names, specs or domains.
        kind: ``sudden``, ``gradual``, ``recurring`` or ``mixed``, see ``KINDS``.
        frames: Listed frames of each visit of a domain, rounded down to a multiple of 20, or, in blocks, of 200; by
            default as many as there are, and at most 4000; a single domain is played whole.
        cycles: Visits of each domain where they recur or mix.
        seed: Which part of a place is played, where there is more than is needed, and the order of blocks.
        split: Which split of all domains.

    Raises:
        SpecError: a name, kind or number is not known or not allowed, or there are not enough frames.
    """
    if not isinstance(kind, str) or kind not in KINDS:
        raise SpecError(f"There is no kind of stream `{kind}`.{catalog.suggest(str(kind), KINDS)}")
    seed = catalog.whole_number("seed", seed, 0, 2**31)
    cycles = catalog.whole_number("cycles", cycles, 1, 1000)
    if isinstance(domains, (set, frozenset, dict)):
        raise SpecError("The domains of a stream are played in order: give a list, not a set.")
    places = [catalog.domain(d) for d in (domains if isinstance(domains, (list, tuple)) else [domains])]  # type: ignore[arg-type]
    if not places:
        raise SpecError("A stream needs at least one domain, as orca:d=0.3.")
    _check_kinds(places)
    if len(places) == 1 and frames is None and kind == "sudden":
        return Stream([Segment(places[0], 0, frames_of(places[0], split))], split)
    visits = list(range(len(places))) * (cycles if kind in ("recurring", "mixed") else 1)
    there: dict[str, int] = {}
    for place in places:
        there[place.world] = min(frames_of(place, split), there.get(place.world, 10**12))
    wanted = {w: sum(places[v].world == w for v in visits) for w in there}
    most = min(there[w] // wanted[w] for w in there) // UNIT * UNIT
    if frames is None:
        frames = max(min(most, MOST_FRAMES), UNIT)
    if catalog.whole_number("frames", frames, UNIT, 10**9) % UNIT:
        warnings.warn(
            f"`frames={frames}`: visits have a multiple of {UNIT} frames, so {frames // UNIT * UNIT} are played.",
            stacklevel=2,
        )
    frames = frames // UNIT * UNIT
    if kind in ("gradual", "mixed") and frames < BLOCKS * UNIT:
        raise SpecError(
            f"`frames={frames}`: `{kind}` cuts a visit into {BLOCKS} blocks of at least {UNIT} frames, give "
            f"{BLOCKS * UNIT} or more; there are {most} for each."
        )
    if frames > most:
        short = min(there, key=lambda w: there[w] // wanted[w])
        raise SpecError(
            f"`frames={frames}`: {short} has {there[short]} frames in split `{split}`, for {wanted[short]} visits "
            f"of at least {UNIT} frames: "
            + (f"ask for at most {most}." if most else "ask for fewer visits (`cycles`), or for other domains.")
        )
    rng = np.random.default_rng([seed, len(places)])
    begins = {w: int(rng.integers((there[w] - wanted[w] * frames) // UNIT + 1)) * UNIT for w in there}
    order = visits if kind in ("sudden", "recurring") else _blocks(kind, visits, len(places), rng)
    length = frames if kind in ("sudden", "recurring") else max(frames // BLOCKS // UNIT, 1) * UNIT
    longest = {w: begins[w] + wanted[w] * frames for w in there}
    segments: list[Segment] = []
    for number in order:
        world = places[number].world
        start, stop = begins[world], min(begins[world] + length, longest[world])
        if stop <= start:
            continue  # chance has asked for more blocks of a place than there are
        begins[world] = stop
        goes_on = kind in ("gradual", "mixed") and segments and segments[-1].domain is places[number]
        if goes_on and segments[-1].stop == start:
            segments[-1] = dataclasses.replace(segments[-1], stop=stop)
            continue
        segments.append(Segment(places[number], start, stop))
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
    """Name of what ``stream`` gives, without reading any data."""
    name = f"{kind}({', '.join(spec_of(catalog.domain(d)) for d in domains)}; frames={frames // UNIT * UNIT}"
    name += f", cycles={cycles}" if kind in ("recurring", "mixed") else ""
    return f"{name}, seed={seed}{'' if split == 'test' else f', {split}'})"


def _blocks(kind: str, visits: Sequence[int], places: int, rng: np.random.Generator) -> list[int]:
    """Which place each block is of."""
    count = len(visits) * BLOCKS
    if kind == "mixed":
        return [int(v) for v in rng.permutation(np.repeat(visits, BLOCKS))]
    # Half a visit of the first place alone, then ramps, then half a visit of the last one alone.
    along = np.clip((np.arange(count) + 0.5) / BLOCKS - 0.5, 0, places - 1)
    return [int(v) for v in np.floor(along) + (rng.random(count) < along % 1)]


def frames_of(domain: Domain, split: str) -> int:
    """Number of listed frames of all recordings of a split."""
    return sum(len(np.unique(recording.frame)) for recording in domain.recordings(split))


def _cut(recordings: Sequence[Recording], segment: Segment, frames: int) -> list[Recording]:
    if not 0 <= segment.start < segment.stop <= frames:
        raise SpecError(
            f"A segment of {spec_of(segment.domain)} has frames {segment.start} to {segment.stop}: it must have at "  # type: ignore[arg-type]
            f"least one, from 0 up to {frames}."
        )
    parts, first = [], 0
    for recording in recordings:
        listed = np.unique(recording.frame)
        chosen = listed[max(segment.start - first, 0) : max(segment.stop - first, 0)]
        first += len(listed)
        if len(chosen):
            rows = (recording.frame >= chosen[0]) & (recording.frame <= chosen[-1])
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
                    f"{min(one.stop, other.stop)} of {one.domain.world}. What was shown once could be known: "  # type: ignore[union-attr]
                    "give each segment frames of its own."
                )
