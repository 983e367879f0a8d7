"""Driving styles: the parameters of IDM and MOBIL, their ranges, and named styles."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

from motion_gym.specs import number

RANGES = {
    "headway": (0.5, 4.0),
    "distance": (1.0, 10.0),
    "politeness": (0.0, 1.0),
    "acceleration": (0.5, 4.0),
    "braking": (0.5, 5.0),
    "speed": (15.0, 35.0),
}
"""Lowest and highest value of each parameter of a style."""


@dataclass(frozen=True)
class Style:
    """A driving style.

    IDM (Treiber, Hennecke, Helbing 2000) sets the acceleration, MOBIL (Kesting, Treiber, Helbing 2007) decides when a
    vehicle changes lane.

    Attributes:
        headway: Desired time headway to the vehicle in front, bumper to bumper, seconds.
        distance: Desired distance to it at a standstill, bumper to bumper, metres.
        politeness: Weight of the accelerations of other vehicles in the decision to change lane, 0 to 1.
        acceleration: Comfortable acceleration, m/s^2.
        braking: Comfortable deceleration, m/s^2.
        speed: Mean target speed on a free straight road, m/s.
    """

    headway: float
    distance: float
    politeness: float
    acceleration: float
    braking: float
    speed: float

    def replace(self, changes: Mapping[str, float | None], owner: str) -> Style:
        """The style with some parameters changed; None leaves a parameter as it is.

        Raises:
            SpecError: A value is outside its range.
        """
        checked = {
            name: number(name, value, *RANGES[name], owner=owner)
            for name, value in changes.items()
            if value is not None
        }
        return replace(self, **checked)

    @property
    def parameters(self) -> dict[str, float]:
        """The parameters with their values."""
        return asdict(self)


STYLES = {
    "calm": Style(headway=2.2, distance=4.0, politeness=0.6, acceleration=1.2, braking=1.5, speed=22.0),
    "normal": Style(headway=1.5, distance=3.0, politeness=0.3, acceleration=1.8, braking=2.2, speed=25.0),
    "assertive": Style(headway=0.9, distance=2.0, politeness=0.0, acceleration=2.6, braking=3.2, speed=28.0),
    "brisk": Style(headway=1.2, distance=2.5, politeness=0.15, acceleration=2.2, braking=2.7, speed=26.5),
    "aggressive": Style(headway=0.6, distance=1.5, politeness=0.0, acceleration=3.2, braking=4.0, speed=31.0),
}
"""Named styles. ``brisk`` lies between ``normal`` and ``assertive``, and ``aggressive`` beyond ``assertive``."""
SOURCE_STYLES = ("calm", "normal", "assertive")
"""Styles to train on."""
