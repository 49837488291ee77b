"""Altitude frames of mission items by name (MAV_FRAME): above sea level, above home, above the terrain.

Source: MAVLink common message definitions. A light table of our own, as that of the commands.
"""

from __future__ import annotations

from enum import IntEnum


class Frame(IntEnum):
    """Coordinate frame of an item (MAV_FRAME)."""

    GLOBAL = 0
    LOCAL_NED = 1
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    LOCAL_ENU = 4
    GLOBAL_INT = 5
    GLOBAL_RELATIVE_ALT_INT = 6
    GLOBAL_TERRAIN_ALT = 10
    GLOBAL_TERRAIN_ALT_INT = 11


_FRAMES = {int(frame): frame for frame in Frame}

_FRAME_NAMES: dict[int, str] = {
    Frame.GLOBAL: "sea level",
    Frame.LOCAL_NED: "local",
    Frame.MISSION: "-",
    Frame.GLOBAL_RELATIVE_ALT: "home",
    Frame.LOCAL_ENU: "local",
    Frame.GLOBAL_INT: "sea level",
    Frame.GLOBAL_RELATIVE_ALT_INT: "home",
    Frame.GLOBAL_TERRAIN_ALT: "terrain",
    Frame.GLOBAL_TERRAIN_ALT_INT: "terrain",
}

GLOBAL_FRAMES = frozenset(
    {
        Frame.GLOBAL,
        Frame.GLOBAL_RELATIVE_ALT,
        Frame.GLOBAL_INT,
        Frame.GLOBAL_RELATIVE_ALT_INT,
        Frame.GLOBAL_TERRAIN_ALT,
        Frame.GLOBAL_TERRAIN_ALT_INT,
    }
)

RELATIVE_FRAMES = frozenset({Frame.GLOBAL_RELATIVE_ALT, Frame.GLOBAL_RELATIVE_ALT_INT})
"""Frames of altitudes above home."""

TERRAIN_FRAMES = frozenset({Frame.GLOBAL_TERRAIN_ALT, Frame.GLOBAL_TERRAIN_ALT_INT})
"""Frames of altitudes above the terrain under the item."""


def frame_of(number: int) -> int:
    """Return the named frame of a number, or the number itself where we have no name."""
    return _FRAMES.get(number, number)


def frame_name(number: int) -> str:
    """Return what an altitude counts from, in a word or two."""
    return _FRAME_NAMES.get(number, f"frame {number}")
