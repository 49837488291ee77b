"""What plans say of the airspace, and why there is no route in one."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
import shapely

from skyway.building import build_scenario
from skyway.models.airspace.activation import Activation, Period
from skyway.models.airspace.airspace import Airspace
from skyway.models.airspace.limits import GROUND, Limit
from skyway.models.airspace.zone import Volume, Zone
from skyway.models.base.errors import InputError, NoRouteError
from skyway.models.base.json_text import json_text
from skyway.models.composition.composition import State
from skyway.models.composition.file import from_json, to_json
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.network.station import ConnectionRule, Station
from skyway.models.wind.forecast import constant_wind
from skyway.planner.plan import plan
from skyway.planner.problem.request import Request
from skyway.planner.reach.reach import Reach

NOON = datetime(2026, 8, 5, 12, tzinfo=UTC)
CALM = constant_wind(0.0, 0.0, NOON - timedelta(hours=2), 12, 47.0, 8.0, 60.0)
STATIONS = [Station("a", "A", 47.0, 8.0, 400.0), Station("b", "B", 47.06, 8.0, 430.0)]
BETWEEN, AT_B = shapely.box(7.99, 47.03, 8.01, 47.035), shapely.box(7.995, 47.055, 8.005, 47.065)


def zone(kind, box=BETWEEN, *, ceiling=None, until_min=None):
    volume = Volume(box) if ceiling is None else Volume(box, GROUND, ceiling)
    spans = () if until_min is None else (Period(0.0, NOON.timestamp() + 60.0 * until_min),)
    when = Activation(spans) if spans else Activation()
    return Zone("Z1", "Park", kind, (volume,), when, "park.json", "call the keeper")


def planned(*zones, authorized=(), drones=(M200_V2,), **rules):
    airspace = Airspace(zones, **rules).with_authorized(authorized)
    scenario = build_scenario(STATIONS, segments=ConnectionRule(max_length_m=20_000.0), zones=airspace, drones=drones)
    request = Request(state=State(NOON, "a", None, 1.0), destination="b", payload_kg=0.1)
    return plan(scenario, request, planner="exact", forecast=CALM).composition


def test_a_plan_tells_what_it_waits_for_and_counts_on():
    (waits,) = planned(zone("prohibited", until_min=40)).notes
    assert waits == "a to b is closed until 12:40:00 UTC by Z1 (Park) (prohibited): the drone waits at a"
    given = planned(zone("authorization"), authorized=["Z1"])
    assert given.authorized == ("Z1",)
    assert given.notes == ("a to b is flown under the authorization for Z1 (Park): call the keeper",)
    assert from_json(json_text(to_json(given))).authorized == ("Z1",)
    around = planned(zone("authorization"), max_detour=2.0)
    assert around.services[0].via
    assert around.notes == ("the straight way needs an authorization for Z1 (Park): with it, give --authorized Z1",)
    assert planned(zone("conditional")).notes[0].endswith("under the conditions of Z1 (Park): call the keeper")
    assert planned(zone("information")).notes == ()


@pytest.mark.parametrize(
    ("zones", "changes", "said"),
    [
        ([zone("authorization")], {}, "closed throughout the forecast by Z1 (Park) (authorization, active always); with the authorization: --authorized Z1"),
        ([zone("prohibited", AT_B)], {}, "b lies in the zone Z1 (Park) of park.json, prohibited from ground to unlimited at all times"),
        ([], {"drones": (replace(M200_V2, max_height_m=80.0),)}, "higher above the ground than m200-v2 may be (80 m)"),
    ],
)  # fmt: skip
def test_no_route_in_an_airspace_names_what_closes_it(zones, changes, said):
    with pytest.raises(NoRouteError) as error:
        planned(*zones, **changes)
    assert said in str(error.value)
    assert error.value.constraint == "airspace"


def test_a_low_zone_closes_no_divert_over_it_and_one_at_its_end_does():
    for box, ceiling, clear in (
        (BETWEEN, Limit(30.0, "AGL"), True),
        (BETWEEN, Limit(100.0, "AGL"), False),
        (AT_B, Limit(30.0, "AGL"), False),
    ):
        airspace = Airspace((zone("prohibited", box, ceiling=ceiling),))
        scenario = build_scenario(STATIONS, segments=[("a", "b")], zones=airspace)
        reach = Reach(scenario, CALM, M200_V2, 0.1, EnergyBelief())
        assert reach.clear((47.0, 8.0), reach.pads[1:], NOON.timestamp()).tolist() == [clear]
    ended = build_scenario(STATIONS, segments=[("a", "b")], zones=Airspace((zone("prohibited", until_min=10),)))
    reach = Reach(ended, CALM, M200_V2, 0.1, EnergyBelief())
    clear_at = [
        reach.clear((47.0, 8.0), reach.pads[1:], NOON.timestamp() + 60.0 * minutes).tolist() for minutes in (0, 11)
    ]
    assert clear_at == [[False], [True]]


def test_zones_with_lat_and_lon_swapped_are_refused(tmp_path):
    path = tmp_path / "zones.geojson"
    path.write_text('{"type": "Polygon", "coordinates": [[[47.0, 8.0], [47.1, 8.0], [47.1, 8.1], [47.0, 8.0]]]}')
    scenario = build_scenario(STATIONS, segments=[("a", "b")])
    with pytest.raises(InputError, match=r"zones\.geojson: zone 1: lat and lon look swapped"):
        scenario.with_airspace([path])
