"""Missions and their items.

Items are numbered from 0 and home is not one of them. Each autopilot's own numbering lives in its dialect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import GLOBAL_FRAMES, Frame
from skyway.missions.items.commands import FLOWN_COMMANDS, INDEX_COMMANDS, LOCATED_COMMANDS, command_name
from skyway.missions.items.coordinates import E7, Point

if TYPE_CHECKING:
    from collections.abc import Mapping
    from typing import Any


WING_TYPES = frozenset({1, *range(19, 26)})
"""MAV_TYPE of aeroplanes and of VTOLs."""
SURFACE_TYPES = frozenset({10, 11, 12})
"""MAV_TYPE of rovers, boats and submarines."""


ABOVE_TERRAIN_MODE = 3
"""Altitude mode of QGroundControl: it computes the altitude above sea level from one above terrain."""


@dataclass(frozen=True, slots=True, eq=False)
class MissionItem:
    """One command of a mission, with the fields of MISSION_ITEM_INT."""

    command: int
    """MAV_CMD, by name if it has one here."""
    frame: int = Frame.MISSION
    """MAV_FRAME: the reference of `z`."""
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0
    param4: float = 0.0
    """As the command defines them; 0 where unused, NaN if the command lets the vehicle choose."""
    x: int | None = 0
    y: int | None = 0
    """Parameters 5 and 6 in units of 1e-7: for a located command latitude and longitude in 1e-7 degree. None means not
    given (null in a ``.plan``, the greatest integer on the wire)."""
    z: float = 0.0
    """Parameter 7: for a located command the altitude in metres; NaN means not given."""
    autocontinue: bool = True
    """Continue with the next item automatically."""
    extra: Mapping[str, Any] = field(default_factory=dict, repr=False)
    """Other contents of a file, kept for writing; not compared."""

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, MissionItem):
            return NotImplemented
        return self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[float | str | None, ...]:
        """All compared fields, with NaN equal to itself."""
        return (
            self.command,
            self.frame,
            *("nan" if math.isnan(value) else value for value in self.params),
            self.x,
            self.y,
            "nan" if math.isnan(self.z) else self.z,
            self.autocontinue,
        )

    @property
    def params(self) -> tuple[float, float, float, float]:
        """Parameters 1 to 4."""
        return (self.param1, self.param2, self.param3, self.param4)

    @property
    def name(self) -> str:
        """``NAV_LAND``, or ``MAV_CMD 43003`` for a command without a name here."""
        return command_name(self.command)

    @property
    def param5(self) -> float:
        """Parameter 5 as a number; NaN if not given."""
        return math.nan if self.x is None else self.x / E7

    @property
    def param6(self) -> float:
        """Parameter 6 as a number; NaN if not given."""
        return math.nan if self.y is None else self.y / E7

    @property
    def param5_or_zero(self) -> float:
        """Parameter 5, 0 where not given."""
        return 0.0 if self.x is None else self.x / E7

    @property
    def param6_or_zero(self) -> float:
        """Parameter 6, 0 where not given."""
        return 0.0 if self.y is None else self.y / E7

    @property
    def is_located(self) -> bool:
        """Whether `x`, `y`, `z` are a place on Earth."""
        return self.command in LOCATED_COMMANDS and self.frame in GLOBAL_FRAMES

    @property
    def is_flown_to(self) -> bool:
        """Whether the vehicle goes to the place of this item."""
        return self.command in FLOWN_COMMANDS and self.frame in GLOBAL_FRAMES

    @property
    def point(self) -> Point | None:
        """The place, or None for an item without one; 0, 0 means "here" in take-offs, landings and loiters."""
        if not self.is_located or self.x is None or self.y is None or (self.x == 0 and self.y == 0):
            return None
        return Point(self.x, self.y)

    @property
    def was_planned_above_terrain(self) -> bool:
        """Whether QGroundControl computed this altitude above sea level from one above terrain; its file keeps both."""
        mode, shown, worked_out = (self.extra.get(key) for key in ("AltitudeMode", "Altitude", "AMSLAltAboveTerrain"))
        if self.frame not in (Frame.GLOBAL, Frame.GLOBAL_INT):
            return False
        # before version 4 it numbered its altitude modes from 0
        older = mode == ABOVE_TERRAIN_MODE - 1 and worked_out == self.z and shown != self.z
        return mode == ABOVE_TERRAIN_MODE or older

    @property
    def jump_target(self) -> int | None:
        """Number of the item this one refers to, for the commands that refer to one."""
        if self.command not in INDEX_COMMANDS or not math.isfinite(self.param1):
            return None
        return int(self.param1)


@dataclass(frozen=True, slots=True)
class Home:
    """The planned place of take-off: the reference of relative heights."""

    point: Point
    """On the map."""
    altitude_m: float | None = None
    """Ground above mean sea level; None is unknown."""


@dataclass(frozen=True, slots=True)
class ComplexItem:
    """A pattern of a ground station (a survey, a corridor) that some of the items came from."""

    first: int
    count: int
    """The items it was expanded to."""
    source: Mapping[str, Any] = field(repr=False)
    """As in the file; written again as long as its items are unchanged."""
    is_built: bool = False
    """The file did not hold its items: they were built from its settings."""


@dataclass(frozen=True, slots=True)
class Mission:
    """The commands of one flight, or of several with landings between them."""

    items: tuple[MissionItem, ...] = ()
    """Numbered from 0, home not counted."""
    home: Home | None = None
    """Planned home; None is unknown."""
    cruise_speed_mps: float | None = None
    hover_speed_mps: float | None = None
    """Speeds a ground station plans with, fixed wing and multirotor; None is unknown."""
    firmware: int | None = None
    """MAV_AUTOPILOT the mission was made for (3 ArduPilot, 12 PX4); None is unknown."""
    vehicle_type: int | None = None
    """MAV_TYPE; None is unknown."""
    complex_items: tuple[ComplexItem, ...] = field(default=(), compare=False, repr=False)
    """Patterns that some items came from; not compared."""
    extra: Mapping[str, Any] = field(default_factory=dict, compare=False, repr=False)
    """Other contents of a file, kept for writing; not compared."""

    def __len__(self) -> int:
        return len(self.items)

    @property
    def is_for_wings(self) -> bool:
        """Whether it was planned for an aeroplane or a VTOL: the limits of a multirotor do not apply to its battery."""
        return self.vehicle_type in WING_TYPES

    @property
    def is_for_the_surface(self) -> bool:
        """Whether it was planned for a rover, a boat or a submarine: without take-off, landing or height."""
        return self.vehicle_type in SURFACE_TYPES
