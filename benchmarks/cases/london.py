"""Weather of London, 1998 to 2005, over a network that stands nowhere: New York's stations and charging drones, moved to where London's wind was measured.

Seven years of another climate; no station of London is in the data. What is planned and promised for it was tuned on nothing of it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from benchmarks.cases.networks import new_york
from skyway.models.base import geodesy
from skyway.models.base.errors import Fault, InputError
from skyway.models.flight.rules import FlightRules
from skyway.models.network.network import Network
from skyway.models.queues.load import PadLoad
from skyway.models.scenario.scenario import Scenario
from skyway.models.wind.columns import WindColumns
from skyway.models.wind.history import WindSite, read_history

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "wind" / "london_1998_2005_hourly_wind.csv.gz"
ZONE = "Europe/London"
SITE = WindSite("london", 51.5225, -0.1546)


@lru_cache(maxsize=1)
def london() -> Scenario:
    """The scenario.

    Raises
    ------
    InputError
        The record is not beside the checkout.
    """
    if not DATA.exists():
        remedy = "it needs london_1998_2005_hourly_wind.csv.gz in ../shared/data/wind beside the checkout"
        raise InputError(Fault("the wind of London is not here", remedy=remedy))
    base = new_york()
    network = base.network
    middle = float(np.mean(network.lat)), float(np.mean(network.lon))
    stations = []
    for one in network.stations:
        bearing, far_m = geodesy.bearing_deg(*middle, one.lat, one.lon), geodesy.distance_m(*middle, one.lat, one.lon)
        lat, lon = geodesy.direct(SITE.lat, SITE.lon, bearing, far_m)
        stations.append(replace(one, lat=float(lat), lon=float(lon)))
    columns = WindColumns(time="time_utc", site=None, speed="wind_speed_mps", from_="wind_from_deg", time_zone="UTC")
    return Scenario(
        name="London",
        network=Network.from_pairs(stations, np.stack((network.tail, network.head), axis=1)),
        drones=base.drones,
        rules=FlightRules(),
        load=PadLoad(base.load.arrivals_per_s, base.load.mean_charging_s, ZONE),
        history=read_history(DATA, columns, (SITE,), base.measured_at_m),
        wind_sites=(SITE,),
        timezone=ZONE,
    )
