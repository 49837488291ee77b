"""Release of a package in the air: the items over the target, from the way there to the onward flight.

A winch: hover, line out, wait for it, line in, wait. DO_WINCH takes no time by itself on ArduPilot; PX4 continues when its winch has answered, or after MIS_COMMAND_TOUT:
so the hover that waits is an item of its own, which both fly. A payload place (ArduPilot's NAV_PAYLOAD_PLACE) descends until the thrust falls, opens the gripper
and climbs back; if it detects no ground within `param1` metres it climbs with the package, and the mission continues without an error.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.mission import MissionItem
from skyway.models.base.errors import Fault, InputError
from skyway.models.composition.release import (
    PLACE_HEIGHT_M,
    PLACE_LOWEST_M,
    WINCH_HEIGHT_M,
    WINCH_MPS,
    WINCH_SLACK_M,
    winch_s,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.builder.leg_builder import LegBuilder
    from skyway.models.composition.service import DroneService

RELATIVE_LENGTH = 1.0
"""WINCH_ACTIONS: additional length of line; negative is less."""
RELEASING = frozenset({Command.DO_WINCH, Command.NAV_PAYLOAD_PLACE})


def released_on_way(
    build: LegBuilder, station: str, home_ground_m: float, onward: DroneService | None
) -> list[MissionItem]:
    """Return the items from over the target on: the release, and the onward flight, which lands.

    Raises an `InputError` if there is no onward flight.
    """
    if onward is None or onward.origin != station:
        remedy = "plan with --release winch or place: such a plan keeps the charge for it"
        problem = f"the drone does not land at {station}, and the plan has no flight on from there"
        raise InputError(Fault(problem, field="release", value=build.options.release, remedy=remedy))
    if build.options.release == "place" and not build.dialect.places_payloads:
        remedy = "--release winch, gripper or hand"
        problem = f"{build.dialect.name} has no payload place"
        raise InputError(Fault(problem, field="release", value="place", remedy=remedy))
    items = _winched if build.options.release == "winch" else _placed
    return [
        *items(build, station, home_ground_m),
        build.above(onward, home_ground_m),
        *build.way(onward, home_ground_m),
    ]


def _winched(build: LegBuilder, station: str, home_ground_m: float) -> list[MissionItem]:
    hover = build.position(Command.NAV_WAYPOINT, station, build.ground_m(station) - home_ground_m + WINCH_HEIGHT_M)
    wait = replace(hover, command=Command.NAV_LOITER_TIME, param1=float(round(winch_s())), param4=0.0)
    length_m = WINCH_HEIGHT_M + WINCH_SLACK_M
    winch = (
        MissionItem(Command.DO_WINCH, Frame.MISSION, float(build.options.winch), RELATIVE_LENGTH, metres, WINCH_MPS)
        for metres in (length_m, -length_m)
    )
    return [hover, next(winch), wait, next(winch), wait]


def _placed(build: LegBuilder, station: str, home_ground_m: float) -> list[MissionItem]:
    ground_m = build.ground_m(station) - home_ground_m
    over = build.position(Command.NAV_WAYPOINT, station, ground_m + PLACE_HEIGHT_M)
    place = replace(over, command=Command.NAV_PAYLOAD_PLACE, param1=PLACE_HEIGHT_M - PLACE_LOWEST_M, param4=0.0)
    return [over, place]


def release_range(items: Sequence[MissionItem]) -> tuple[int, int] | None:
    """Numbers of the first and the last item that release the package in the air; None if none does."""
    found = [number for number, item in enumerate(items) if item.command in RELEASING]
    if not found:
        return None
    last = items[found[-1]]
    return found[0], found[-1] + (last.command is Command.DO_WINCH)
