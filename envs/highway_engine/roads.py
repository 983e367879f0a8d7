"""The road networks of the scenarios, where vehicles enter, and who gives way to whom.

Coordinates are those of highway-env, x to the east and y to the *south*, metres, with the zero point in the middle.
Lanes have no speed limit, because a limit of a lane would hide the target speed of a style.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from highway_env.road.lane import AbstractLane, CircularLane, LineType, SineLane, StraightLane
from highway_env.road.road import Road, RoadNetwork

Segment = tuple[str, str]
"""A road from a node to a node; a lane index has the number of the lane in addition."""
WIDTH = AbstractLane.DEFAULT_WIDTH
NONE, STRIPED, LINE = LineType.NONE, LineType.STRIPED, LineType.CONTINUOUS_LINE
TOUCHING = 0.5
"""Largest distance, in metres, between the end of a lane and the start of the lane that continues it."""
BESIDE = 1.0
"""A vehicle is on a lane if its centre is at most this far beside it, metres."""
BOX_MARGIN = 2.0
"""Margin of the boxes in which vehicles are looked for, metres: more than what a bend rises between their points."""


@dataclass(frozen=True)
class Entry:
    """A lane on which vehicles enter.

    Attributes:
        lane: Index of the lane.
        flow: Vehicles per second that want to enter.
        routes: Routes, one of which a vehicle draws; empty for vehicles without a route.
    """

    lane: tuple[str, str, int]
    flow: float
    routes: Sequence[Sequence[tuple[str, str, int | None]]] = ()


@dataclass(frozen=True)
class Gate:
    """What lets a vehicle wait at the end of a road.

    Attributes:
        occupied: Roads on which there must be no vehicle.
        arriving: Roads that no other vehicle may reach at about the same time.
    """

    occupied: frozenset[Segment]
    arriving: frozenset[Segment]


@dataclass(frozen=True)
class Scenario:
    """A road network with its traffic.

    Attributes:
        network: The lanes.
        entries: Where vehicles enter.
        speed: Target speeds here, as a share of those on a free straight road.
        lane_changes: Whether vehicles change lane.
        gates: Gates by the road at whose end vehicles give way and the road that they follow then.
    """

    network: Any
    entries: Sequence[Entry]
    speed: float = 1.0
    lane_changes: bool = True
    gates: Mapping[tuple[Segment, Segment], Gate] = field(default_factory=dict)


class TrafficRoad(Road):
    """A road of highway-env that knows which lane continues which, and finds neighbours faster.

    The package continues lane i of a road by lane i of the next road, although a ramp joins at another number. Here a
    lane continues the lane at whose end it starts.
    """

    def __init__(self, scenario: Scenario, np_random: np.random.Generator):
        super().__init__(network=scenario.network, np_random=np_random)
        self.scenario = scenario
        lanes = scenario.network.lanes_dict()
        ends = {index: lane.position(lane.length, 0) for index, lane in lanes.items()}
        starts = {index: lane.position(0, 0) for index, lane in lanes.items()}
        self.next: dict[Any, list[Any]] = {
            index: [
                other
                for other in lanes
                if other[0] == index[1] and np.linalg.norm(starts[other] - ends[index]) < TOUCHING
            ]
            for index in lanes
        }
        self.previous: dict[Any, list[Any]] = {
            index: [other for other, following in self.next.items() if index in following] for index in lanes
        }
        self.dead_ends = {index for index in lanes if index[1] in scenario.network.graph and not self.next[index]}
        """Lanes that end while the road goes on: ramps."""
        self.near: dict[Segment, list[Any]] = {
            index[:2]: [other for other in lanes if other[0] in index[:2]] for index in lanes
        }
        """Lanes on which a vehicle of a road can be one step later."""
        self._boxes = np.array([_box(lane) for lane in lanes.values()])
        self._rows = {index: row for row, index in enumerate(lanes)}
        self._inside: list[list[bool]] = []
        self._placed: dict[Any, list[tuple[float, Any]]] = {}

    def act(self) -> None:
        """Let every vehicle decide, from the same positions."""
        self._placed.clear()
        super().act()

    def step(self, dt: float) -> None:
        """Move every vehicle; only pairs that are near each other are checked for collisions."""
        self._placed.clear()
        for vehicle in self.vehicles:
            vehicle.step(dt)
        xy = np.array([vehicle.position for vehicle in self.vehicles]).reshape(-1, 2)
        reach = np.array([vehicle.diagonal / 2 + vehicle.speed * dt for vehicle in self.vehicles])
        apart = np.linalg.norm(xy[:, None] - xy, axis=-1)
        for one, other in zip(*np.nonzero(np.triu(apart < reach[:, None] + reach, 1)), strict=True):
            self.vehicles[one].handle_collisions(self.vehicles[other], dt)

    def placed(self, index: Any) -> list[tuple[float, Any]]:
        """Longitudinal coordinate, in metres, and vehicle of all vehicles that are on a lane or move into it."""
        if index not in self._placed:
            if not self._placed:
                xy = np.array([vehicle.position for vehicle in self.vehicles]).reshape(-1, 2)
                low, high = self._boxes[:, None, :2], self._boxes[:, None, 2:]
                inside: Any = (low < xy) & (xy < high)
                self._inside = inside.all(axis=2).tolist()
            lane = self.network.get_lane(index)
            here = []
            for vehicle, near in zip(self.vehicles, self._inside[self._rows[index]], strict=True):
                if not near and vehicle.target_lane_index != index:
                    continue
                s, lateral = lane.local_coordinates(vehicle.position)
                if vehicle.target_lane_index == index or lane.on_lane(vehicle.position, s, lateral, margin=BESIDE):
                    here.append((s, vehicle))
            self._placed[index] = here
        return self._placed[index]

    def neighbour_vehicles(self, vehicle: Any, lane_index: Any = None) -> tuple[Any, Any]:
        """The nearest vehicle in front and behind on a lane, its continuations and its predecessors."""
        index = lane_index or vehicle.lane_index
        lane = self.network.get_lane(index)
        own = lane.local_coordinates(vehicle.position)[0]
        lanes = [(index, 0.0)]
        lanes += [(other, lane.length) for other in self.next[index]]
        lanes += [(other, -self.network.get_lane(other).length) for other in self.previous[index]]
        front = rear = None
        front_s, rear_s = np.inf, -np.inf
        for other, offset in lanes:
            for s, neighbour in self.placed(other):
                if neighbour is vehicle:
                    continue
                s += offset
                if own <= s < front_s:
                    front_s, front = s, neighbour
                elif rear_s < s < own:
                    rear_s, rear = s, neighbour
        return front, rear


def _box(lane: Any) -> tuple[float, float, float, float]:
    """Smallest x and y, and largest x and y, of vehicles that can be on a lane, in metres, with a margin."""
    along = np.linspace(-lane.VEHICLE_LENGTH, lane.length + lane.VEHICLE_LENGTH, 17)
    beside = lane.width / 2 + BESIDE
    xy = np.array([lane.position(s, lateral) for s in along for lateral in (-beside, beside)])
    return (*(xy.min(axis=0) - BOX_MARGIN).tolist(), *(xy.max(axis=0) + BOX_MARGIN).tolist())


def straight() -> Scenario:
    """Three lanes, 600 m long."""
    network = RoadNetwork()
    for lane in range(3):
        y = (lane - 1) * WIDTH
        lines = [LINE if lane == 0 else STRIPED, LINE if lane == 2 else NONE]
        network.add_lane("west", "east", StraightLane([-300, y], [300, y], line_types=lines, speed_limit=None))
    return Scenario(network, [Entry(("west", "east", lane), 0.3) for lane in range(3)])


def merge() -> Scenario:
    """Two lanes and a ramp that ends after 200 m beside them; as the package's merge, and longer."""
    network = RoadNetwork()
    west, first, last, east = -300, -80, 120, 300
    for a, b, start, end in (("a", "b", west, first), ("b", "c", first, last), ("c", "d", last, east)):
        for lane in range(2):
            lines = [LINE if lane == 0 else STRIPED, NONE if lane == 0 else STRIPED if a == "b" else LINE]
            y = lane * WIDTH
            network.add_lane(a, b, StraightLane([start, y], [end, y], line_types=lines, speed_limit=None))
    amplitude, bend = 3.25, 80
    beside = 2 * WIDTH
    approach = StraightLane(
        [west, beside + 2 * amplitude],
        [first - bend, beside + 2 * amplitude],
        line_types=[LINE, LINE],
        forbidden=True,
        speed_limit=None,
    )
    curve = SineLane(
        [first - bend, beside + amplitude],
        [first, beside + amplitude],
        amplitude,
        2 * np.pi / (2 * bend),
        np.pi / 2,
        line_types=[LINE, LINE],
        forbidden=True,
        speed_limit=None,
    )
    ramp = StraightLane([first, beside], [last, beside], line_types=[NONE, LINE], forbidden=True, speed_limit=None)
    network.add_lane("j", "k", approach)
    network.add_lane("k", "b", curve)
    network.add_lane("b", "c", ramp)
    # A numbered lane in a route makes MOBIL change to it as soon as that is safe.
    joins = [("j", "k", 0), ("k", "b", 0), ("b", "c", 1), ("c", "d", None)]
    entries = [*(Entry(("a", "b", lane), 0.22) for lane in range(2)), Entry(("j", "k", 0), 0.12, [joins])]
    return Scenario(network, entries)


ARMS = ("e", "s", "w", "n")
"""Arms of a crossing, clockwise. Arm i points to the angle i * 90 degrees, as y points down."""
ARM = 110.0
"""Metres from the middle to the outer end of an arm."""


def _axes(arm: int) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors out of the middle along an arm, and to the right of it."""
    angle = arm * np.pi / 2
    return np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])


def _add_path(network: Any, nodes: Sequence[str], points: Sequence[np.ndarray]) -> None:
    """Add straight lanes from node to node."""
    for a, b, start, end in zip(nodes[:-1], nodes[1:], points[:-1], points[1:], strict=True):
        network.add_lane(a, b, StraightLane(start, end, line_types=[LINE, LINE], speed_limit=None))


def _route(nodes: Sequence[str]) -> list[tuple[str, str, int | None]]:
    return [(a, b, 0) for a, b in itertools.pairwise(nodes)]


def roundabout() -> Scenario:
    """A roundabout of one lane with four arms; vehicles on the circle pass first.

    Nodes of arm e: it begins at e0, bends at e1, joins the circle at e2, leaves it at e3, bends at e4 and ends at e5.
    """
    network, radius, half_angle, bend = RoadNetwork(), 25.0, np.deg2rad(20), 55.0
    entries, gates = [], {}
    for number, arm in enumerate(ARMS):
        out, side = _axes(number)
        middle, before = number * np.pi / 2, ARMS[(number + 1) % 4]
        # Traffic on the right circles anticlockwise: from the exit of an arm to its entry, and on to the next exit.
        for a, b, start, end in (
            (f"{arm}3", f"{arm}2", middle + half_angle, middle - half_angle),
            (f"{before}2", f"{arm}3", middle + np.pi / 2 - half_angle, middle + half_angle),
        ):
            lines = [LINE, LINE]
            circle = CircularLane([0, 0], radius, start, end, clockwise=False, line_types=lines, speed_limit=None)
            network.add_lane(a, b, circle)
        along, across = radius * np.cos(half_angle), radius * np.sin(half_angle)
        lane = side * WIDTH / 2
        _add_path(network, [arm + n for n in "012"], [out * ARM - lane, out * bend - lane, out * along - side * across])
        _add_path(network, [arm + n for n in "345"], [out * along + side * across, out * bend + lane, out * ARM + lane])
        routes = []
        for turn in (1, 2, 3):
            passed = [ARMS[(number - k) % 4] + n for k in range(1, turn + 1) for n in "32"][:-1]
            routes.append(_route([f"{arm}0", f"{arm}1", f"{arm}2", *passed, f"{passed[-1][0]}4", f"{passed[-1][0]}5"]))
        entries.append(Entry((f"{arm}0", f"{arm}1", 0), 0.1, routes))
        circle_road = frozenset([(f"{arm}3", f"{arm}2")])
        after = (f"{arm}2", f"{ARMS[(number - 1) % 4]}3")
        gates[(f"{arm}1", f"{arm}2"), after] = Gate(circle_road, circle_road)
    return Scenario(network, entries, speed=0.35, lane_changes=False, gates=gates)


def intersection() -> Scenario:
    """A crossing of four arms of one lane; traffic from east and west passes first, and left turns give way.

    Nodes of arm e: it begins at e0 and ends at e1 before the crossing, leaves the crossing at e2 and ends at e3.
    """
    network, corner = RoadNetwork(), 16.0
    turns = {}
    for number, arm in enumerate(ARMS):
        out, side = _axes(number)
        lane, angle = side * WIDTH / 2, number * np.pi / 2
        _add_path(network, [f"{arm}0", f"{arm}1"], [out * ARM - lane, out * corner - lane])
        _add_path(network, [f"{arm}2", f"{arm}3"], [out * corner + lane, out * ARM + lane])
        _add_path(network, [f"{arm}1", f"{ARMS[(number + 2) % 4]}2"], [out * corner - lane, -out * corner - lane])
        for turn, sign in ((-1, 1), (1, -1)):  # right, left
            center = corner * (out + _axes(number + turn)[0])
            start = angle + sign * np.pi / 2
            arc = CircularLane(
                center, corner - sign * WIDTH / 2, start, start + sign * np.pi / 2, clockwise=sign > 0,
                line_types=[NONE, NONE], speed_limit=None,
            )  # fmt: skip
            network.add_lane(f"{arm}1", f"{ARMS[(number + turn) % 4]}2", arc)
        turns.update({(f"{arm}1", f"{ARMS[(number + turn) % 4]}2"): (number, turn) for turn in (-1, 1, 2)})
    entries = [
        Entry(
            (f"{arm}0", f"{arm}1", 0),
            0.06,
            [_route([f"{arm}0", f"{arm}1", b, f"{b[0]}3"]) for a, b in turns if a == f"{arm}1"],
        )
        for arm in ARMS
    ]
    gates = {}
    for own, (number, turn) in turns.items():
        crossed = {o for o, (n, t) in turns.items() if n != number and _cross((number, turn), (n, t))}
        first = {o for o in crossed if _passes_first(turns[o], (number, turn))}
        gates[(f"{ARMS[number]}0", f"{ARMS[number]}1"), own] = Gate(frozenset(crossed), frozenset(first))
    return Scenario(network, entries, speed=0.27, lane_changes=False, gates=gates)


def _cross(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether the paths of two movements, (arm, turn), from different arms meet."""
    (a, turn), (b, other_turn) = one, other
    if (a + turn - b - other_turn) % 4 == 0:
        return True  # the same exit
    if turn == -1 or other_turn == -1:
        return False  # a right turn meets others at its exit only
    return (a - b) % 2 == 1 or turn != other_turn  # opposite arms: a left turn crosses the way straight on


def _passes_first(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether a movement passes before another movement that it meets."""
    (a, turn), (b, other_turn) = one, other
    if (a - b) % 2:
        return a % 2 == 0
    return other_turn == 1 and turn != 1  # opposite arms


SCENARIOS = {"straight": straight, "merge": merge, "roundabout": roundabout, "intersection": intersection}
