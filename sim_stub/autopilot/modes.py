"""Flight modes that both families have."""

from __future__ import annotations

from enum import Enum


class Mode(Enum):
    """A flight mode; the value is its display name."""

    STABILIZE = "stabilize"
    ALTITUDE = "altitude"
    POSITION = "position"
    HOLD = "hold"
    BRAKE = "brake"
    MISSION = "mission"
    TAKEOFF = "takeoff"
    LAND = "land"
    RTL = "return"
    GUIDED = "guided"
    OFFBOARD = "offboard"


MANUAL_MODES = frozenset({Mode.STABILIZE, Mode.ALTITUDE, Mode.POSITION})
"""Modes a pilot flies in; with the sticks let go the vehicle stays where it is."""


class Action(Enum):
    """Action of a failsafe, in order of severity."""

    NONE = 0
    WARN = 1
    HOLD = 2
    RTL = 3
    LAND = 4
    TERMINATE = 5


ACTION_MODES = {Action.HOLD: Mode.HOLD, Action.RTL: Mode.RTL, Action.LAND: Mode.LAND}
