"""Results of the mission protocol as text."""

from __future__ import annotations

from dataclasses import fields
from enum import IntEnum

from skyway.missions.autopilots.wire import WireItem


class MissionKind(IntEnum):
    """Kind of a transferred list: MAV_MISSION_TYPE."""

    MISSION = 0
    FENCE = 1
    RALLY = 2

    @property
    def word(self) -> str:
        """For people."""
        return ("mission", "fence", "rally points")[self]


ITEM_FIELDS = tuple(field.name for field in fields(WireItem))
"""Of an item, as in MISSION_ITEM_INT."""
ACCEPTED = 0
ERROR = 1
UNSUPPORTED = 3
INVALID_SEQUENCE = 13
DENIED = 14
CANCELLED = 15
PASSING = frozenset({ERROR, DENIED, CANCELLED})
"""Answers that may also be to a late or duplicate packet, or come while the vehicle serves another station."""

RESULTS = {
    0: "accepted",
    1: "an unspecified error",
    2: "the frame (reference of altitudes) is not supported",
    3: "the command is not supported",
    4: "not enough memory for so many items",
    5: "an item is invalid",
    6: "parameter 1 is invalid",
    7: "parameter 2 is invalid",
    8: "parameter 3 is invalid",
    9: "parameter 4 is invalid",
    10: "the latitude (parameter 5) is invalid",
    11: "the longitude (parameter 6) is invalid",
    12: "the altitude (parameter 7) is invalid",
    13: "an item out of sequence",
    14: "not from this ground station, or not now",
    15: "the transfer was cancelled",
}
"""MAV_MISSION_RESULT."""


def in_words(result: int) -> str:
    """Return the text of a result."""
    return RESULTS.get(result, f"answer {result}")
