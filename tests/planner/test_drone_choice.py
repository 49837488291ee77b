"""The skyline keeps every drone that somebody could want, and no other."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.errors import PayloadError
from skyway.models.drones.drone import M200_V2
from skyway.planner.drone_choice import skyline
from skyway.planner.problem.objective import Objective

few = st.sampled_from([1.0, 2.0, 3.0])


@st.composite
def fleets(draw):
    priced = draw(st.booleans())
    return [
        replace(
            M200_V2,
            id=f"d{k}",
            max_payload_kg=draw(few),
            endurance_full_s=600.0 * draw(few),
            max_airspeed_mps=10.0 * draw(few),
            recharge_full_s=3600.0 * draw(few),
            price_per_km=draw(few) if priced else None,
        )
        for k in range(draw(st.integers(1, 8)))
    ]


def better(a, b):
    """By the definition, written again."""
    ours = [a.max_payload_kg, a.flight_range_m, a.max_airspeed_mps, a.recharge_rate_w]
    theirs = [b.max_payload_kg, b.flight_range_m, b.max_airspeed_mps, b.recharge_rate_w]
    if a.price_per_km is not None:
        ours.append(-a.price_per_km)
        theirs.append(-b.price_per_km)
    pairs = list(zip(ours, theirs, strict=True))
    return all(x >= y for x, y in pairs) and any(x > y for x, y in pairs)


@given(fleets(), st.sampled_from([0.5, 1.5, 2.5]))
def test_it_equals_the_definition(fleet, payload):
    able = [drone for drone in fleet if drone.max_payload_kg >= payload]
    if not able:
        with pytest.raises(PayloadError):
            skyline(fleet, payload)
        return
    expected = [d.id for d in able if not any(better(other, d) for other in able)]
    assert [d.id for d in skyline(fleet, payload)] == expected


def test_a_drone_that_cannot_lift_the_package_dominates_nobody():
    strong = replace(M200_V2, id="strong", max_payload_kg=5.0, max_airspeed_mps=10.0)
    fast = replace(M200_V2, id="fast", max_payload_kg=1.0, max_airspeed_mps=30.0)
    assert [d.id for d in skyline([strong, fast], 2.0)] == ["strong"]


def test_twins_are_both_kept():
    twin = replace(M200_V2, id="twin")
    assert [d.id for d in skyline([M200_V2, twin], 1.0)] == ["m200-v2", "twin"]


def test_the_error_names_the_heaviest_payload():
    with pytest.raises(PayloadError, match=r"no drone lifts 9 kg: the fleet's heaviest payload is 1.45 kg"):
        skyline([M200_V2], 9.0)


def test_spending_keeps_a_thriftier_drone():
    """A slow drone of less power counts only where energy counts, one with less wear only where the cost does."""
    fast = replace(M200_V2, id="fast", wear_per_flight_h=5.0)
    thrifty = replace(M200_V2, id="thrifty", max_airspeed_mps=15.0, endurance_empty_s=1.5 * M200_V2.endurance_empty_s)
    thrifty = replace(thrifty, endurance_full_s=1.05 * M200_V2.endurance_full_s, wear_per_flight_h=5.0)
    sturdy = replace(M200_V2, id="sturdy", max_airspeed_mps=15.0, wear_per_flight_h=1.0)
    fleet = [fast, thrifty, sturdy]
    chosen = {aim: [one.id for one in skyline(fleet, 1.0, Objective.parse(aim))] for aim in ("mean", "energy", "cost")}
    assert chosen["mean"] == ["fast"]
    assert chosen["energy"] == ["fast", "thrifty"]
    assert chosen["cost"] == ["fast", "thrifty", "sturdy"]
