"""Altitude frames of mission items by name (MAV_FRAME): above sea level, above home, above the terrain.

Source: MAVLink common message definitions. A light table of our own, as that of the commands.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Self


class Frame(IntEnum):
    """Coordinate frame of an item (MAV_FRAME)."""

    reference: str
    """The altitude reference, in a word or two."""

    def __new__(cls, number: int, reference: str = "") -> Self:
        """Make a member of its number and its altitude reference."""
        frame = int.__new__(cls, number)
        frame._value_, frame.reference = number, reference
        return frame

    GLOBAL = 0, "sea level"
    LOCAL_NED = 1, "local"
    MISSION = 2, "-"
    GLOBAL_RELATIVE_ALT = 3, "home"
    LOCAL_ENU = 4, "local"
    GLOBAL_INT = 5, "sea level"
    GLOBAL_RELATIVE_ALT_INT = 6, "home"
    GLOBAL_TERRAIN_ALT = 10, "terrain"
    GLOBAL_TERRAIN_ALT_INT = 11, "terrain"


_FRAMES = {int(frame): frame for frame in Frame}

GLOBAL_FRAMES = frozenset(frame for frame in Frame if frame.name.startswith("GLOBAL"))
RELATIVE_FRAMES = frozenset(frame for frame in Frame if frame.reference == "home")
"""Frames of altitudes above home."""
TERRAIN_FRAMES = frozenset(frame for frame in Frame if frame.reference == "terrain")
"""Frames of altitudes above the terrain under the item."""


def frame_of(number: int) -> int:
    """Return the named frame of a number, or the number itself if it has no name here."""
    return _FRAMES.get(number, number)


def frame_name(number: int) -> str:
    """Return the altitude reference, in a word or two."""
    frame = _FRAMES.get(number)
    return f"frame {number}" if frame is None else frame.reference
