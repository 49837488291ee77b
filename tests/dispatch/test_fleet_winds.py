"""What drones tell the dispatcher of the wind."""

from datetime import datetime

import pytest

from skyway.dispatch.fleet_winds import FleetForecast, FleetWinds, last_of
from skyway.dispatch.records import FlightRecord, Progress, ServiceRecord
from skyway.dispatch.region import Region
from skyway.models.drones.drag import DragModel
from skyway.models.wind.estimation.field import WindObservation

BEGIN_S = datetime.fromisoformat("2013-07-10T14:00:00-04:00").timestamp()


def seen(time_s, north=5.0, east=5.0):
    return WindObservation(time_s, 40.7, -74.0, north, east, 0.3)


def test_the_last_measurement_is_told_and_comes_back_the_same():
    assert last_of([]) is None
    told = last_of([seen(2.0), seen(3.0, north=1.0), seen(1.0)])
    back = WindObservation(*told)
    assert (back.time_s, back.lat_deg, back.lon_deg, back.north_mps, back.east_mps, back.variance) == (3.0, 40.7, -74.0, 1.0, 5.0, 0.3)  # fmt: skip


def test_old_measurements_and_ones_own_tell_nothing():
    winds = FleetWinds()
    winds.tell(1, [seen(100.0)])
    winds.tell(2, [seen(5000.0)])
    assert [one.time_s for one in winds.of_others(3, 5000.0)] == [5000.0]
    assert [one.time_s for one in winds.of_others(2, 3000.0)] == [100.0]
    assert winds.of_others(1, 4000.0) == ()
    assert [one.time_s for one in winds.of_others(1, 200.0, own_until_s=150.0)] == [100.0]
    assert winds.of_others(1, 200.0, own_until_s=50.0) == ()
    winds.tell(2, [seen(4000.0)])  # older than what is known
    assert [one.time_s for one in winds.at(5000.0)] == [5000.0]


@pytest.mark.slow
def test_the_dispatcher_plans_with_what_was_measured():
    region = Region(ServiceRecord(begin_s=BEGIN_S, folder=".", ledger="none", actual_wind="2013-07-10"))
    drone = region.base.drones[0].id
    region.service.drags = {drone: DragModel(linear_per_s=0.17, relative_sigma=0.1, bias_sigma_mps2=0.1)}
    known = FleetForecast(region)
    before, margins = known.at(BEGIN_S)
    assert margins[drone].least >= 1.0
    assert known.at(BEGIN_S + 60.0)[0] is before
    flight = FlightRecord(
        drone="d", type=drone, system=1, order=None, phase="home", mass_kg=0.0, composition="", steps=(), not_before_s=0.0, journal="",
        progress=Progress(at_s=BEGIN_S + 90.0, state="flying", wind=last_of([seen(BEGIN_S + 90.0)])),
    )  # fmt: skip
    known.hear([flight])
    after, _ = known.at(BEGIN_S + 120.0)  # at once, since it is the first
    apart = []
    for one in (before, after):
        north, east = one.wind_at(40.7, -74.0, one.slot_at(BEGIN_S + 120.0))
        apart.append(abs(float(one.probability @ north) - 5.0) + abs(float(one.probability @ east) - 5.0))
    assert apart[1] < 0.5 * apart[0]
