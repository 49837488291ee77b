"""Flights from Bellevue in steady winds: what several tests of decisions ask about."""

from dataclasses import replace
from datetime import datetime

import numpy as np

from skyway.missions.examples import NEW_YORK
from skyway.models.base import geodesy
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.forecast import constant_wind
from skyway.planner.online.information import FlightMemory, Information
from skyway.planner.problem.problem import HORIZON_H

DEPART = datetime.fromisoformat("2013-07-10T14:00-04:00")
QUICK = "pfs-charge-aware"
SURE = EnergyBelief(1.0, 0.02)


def wind(speed=3.0, from_deg=230.0):
    return constant_wind(speed, from_deg, DEPART, HORIZON_H, 40.8, -73.9, 60.0)


def standing(air, belief=SURE, station="bellevue", soc=1.0, **more):
    time_s, seen = DEPART.timestamp(), frozenset({station})
    free = dict.fromkeys((one.id for one in NETWORK().stations if one.pads), 0)
    given = {"busy_pads": free, "visited": seen} | more
    return Information(time_s=time_s, soc=soc, forecast=air, belief=belief, station=station, **given)


def calming(hours, speed=14.0):
    """Wind above the limit that falls after some hours."""
    air = wind(speed=speed)
    share = np.where(np.arange(air.slots) * air.slot_s < hours * 3600.0, 1.0, 0.3)[None, :, None]
    return replace(air, north=air.north * share, east=air.east * share)


class Flight:
    """A leg from Bellevue to Yankee Stadium, flown point by point with whatever noise."""

    def __init__(self, policy, soc, drain):
        network = policy.scenario.network
        a, b = (network.index[name] for name in ("bellevue", "yankee-stadium"))
        self.start = (float(network.lat[a]), float(network.lon[a]))
        self.end = (float(network.lat[b]), float(network.lon[b]))
        self.memory = FlightMemory()
        self.length = geodesy.distance_m(*self.start, *self.end)
        self.soc, self.drain, self.flown, self.commanded = soc, drain, 0.0, 15.0

    def steps(self):
        while self.flown < self.length - 400.0:
            share = self.flown / self.length
            here = tuple(s + share * (e - s) for s, e in zip(self.start, self.end, strict=True))
            yield here, DEPART.timestamp() + self.flown / 18.0
            self.flown += 180.0
            self.soc -= self.drain


def fly(policy, flight, rng, *, noise):
    acts = []
    diverted = None
    for here, time_s in flight.steps():
        belief = EnergyBelief(1.0 + noise * rng.gauss(0.0, 0.03), 0.04)
        air = wind(max(3.0 + noise * rng.gauss(0.0, 0.8), 0.0), 230.0 + noise * rng.gauss(0.0, 10.0))
        known = Information(
            here=here,
            time_s=time_s,
            soc=flight.soc + noise * rng.gauss(0.0, 0.006),
            forecast=air,
            belief=belief,
            destination="yankee-stadium",
            commanded_mps=flight.commanded,
            diverts=("bellevue", "belvedere", "columbia"),
            flight=flight.memory,
        )
        decision = policy.in_air(known)
        acts.append(decision.action)
        if decision.action == "speed":
            flight.commanded = decision.speed_mps
        if decision.action in ("divert", "station", "land"):
            diverted = decision
            break
    return acts, diverted


def known_at(share, soc, air, belief=SURE, **more):
    """On the way from Bellevue to Yankee Stadium."""
    network, (a, b) = NETWORK(), ("bellevue", "yankee-stadium")
    places = [(float(network.lat[network.index[name]]), float(network.lon[network.index[name]])) for name in (a, b)]
    here = tuple(s + share * (e - s) for s, e in zip(*places, strict=True))
    given = {
        "via": (),
        "destination": b,
        "commanded_mps": 20.0,
        "diverts": ("bellevue", "belvedere", "columbia"),
    } | more
    return Information(here=here, time_s=DEPART.timestamp(), soc=soc, forecast=air, belief=belief, **given)


def NETWORK():  # noqa: N802  read once
    return read_scenario(NEW_YORK).network
