"""Missions of the evaluation: one leg, and a release by winch."""

from __future__ import annotations

import dataclasses
import math

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import Mission, MissionItem
from skyway.models.composition.release import WINCH_HEIGHT_M, WINCH_SLACK_M, winch_s

LAT, LON = 40.7392, -73.9756
HEIGHT_M, LEG_M = 45.0, 300.0


def leg(north_m: float, *, back: bool = False) -> Mission:
    """Return a mission that takes off, flies a distance north, or back from there, and lands."""
    ends = [LAT, LAT + north_m / 111_000.0]
    begin, end = (round(one * 1e7) for one in (reversed(ends) if back else ends))
    y = round(LON * 1e7)

    def item(command: Command, x: int, z: float) -> MissionItem:
        return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=x, y=y, z=z, param4=math.nan)

    up, over = item(Command.NAV_TAKEOFF, begin, HEIGHT_M), item(Command.NAV_WAYPOINT, end, HEIGHT_M)
    return Mission((up, over, item(Command.NAV_LAND, end, 0.0)))


def lowering(north_m: float, *, back: bool) -> Mission:
    """Return a mission that flies out, hovers, lowers and raises the line, and flies back."""
    out = leg(north_m, back=back).items
    over = out[1]
    hover = dataclasses.replace(over, z=WINCH_HEIGHT_M)
    wait = dataclasses.replace(hover, command=Command.NAV_LOITER_TIME, param1=winch_s(), param4=0.0)
    length_m = WINCH_HEIGHT_M + WINCH_SLACK_M
    down, up = (MissionItem(Command.DO_WINCH, Frame.MISSION, 1.0, 1.0, metres, 1.0) for metres in (length_m, -length_m))
    return Mission((*out[:2], hover, down, wait, up, wait, over, *leg(north_m, back=not back).items[1:]))
