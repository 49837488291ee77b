"""Small worlds of missions that are cut at pads: places on a plane, a drone with a share of a battery, pads."""

from dataclasses import replace

import numpy as np

from skyway.missions import Command, FlightConditions, Frame, Home, Mission, MissionItem, family_named
from skyway.missions.checks.weather import SteadyWind
from skyway.missions.items.coordinates import Point
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.drones.drone import M200_V2
from skyway.models.network.station import Station
from skyway.recharge.problem import RechargeOptions

LAT, LON = 47.4, 8.55
FAMILIES = [family_named("px4"), family_named("ardupilot")]


def small(share):
    """A drone with a share of the battery."""
    return replace(
        M200_V2,
        battery_j=M200_V2.battery_j * share,
        endurance_empty_s=M200_V2.endurance_empty_s * share,
        endurance_full_s=M200_V2.endurance_full_s * share,
        recharge_full_s=600.0,
    )


def at(east, north, command=Command.NAV_WAYPOINT, height=50.0, **fields):
    point = Point.of_degrees(LAT + north / 111_195.0, LON + east / (111_195.0 * np.cos(np.radians(LAT))))
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=height, **fields)


def do(command, *params):
    return MissionItem(command, Frame.MISSION, *params)


def pad(name, east, north, elevation=400.0, **fields):
    place = at(east, north).point
    return Station(name, name, place.lat, place.lon, elevation, pads=2, **fields)


def mission_of(items, speed=8.0, firmware=12):
    home = Home(at(0, 0).point, 400.0)
    return Mission((at(0, 0, Command.NAV_TAKEOFF), *items), home, 15.0, speed, firmware, 2)


WIND = SteadyWind(3.0, 200.0)


def options(share=0.15, wind=WIND, **fields):
    return RechargeOptions(FlightConditions(small(share), weather=wind), TransitRules(12.0), **fields)
