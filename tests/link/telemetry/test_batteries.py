"""The charge of a vehicle with several batteries is that of the emptiest which drives the propellers."""

import math

import pytest

from skyway.link.telemetry.batteries import Batteries
from skyway.link.wire.messages import Message

NOW_S = 1_000.0


def reported(number, percent, function=1, volts=(15_800,)):
    fields = {"id": number, "battery_remaining": percent, "battery_function": function, "voltages": list(volts)}
    return Message("BATTERY_STATUS", 1, 1, fields)


def status(percent):
    return Message("SYS_STATUS", 1, 1, {"battery_remaining": percent})


def charge(*messages, age_s=0.0):
    batteries = Batteries()
    for message in messages:
        batteries.hear(message, NOW_S)
    return batteries.soc(NOW_S + age_s)


@pytest.mark.parametrize(
    ("messages", "soc"),
    [
        ((reported(0, 80), reported(1, 55)), 0.55),
        ((reported(1, 55), reported(0, 80), status(80)), 0.55),
        ((reported(0, 80), reported(1, 70), status(60)), 0.60),
        ((reported(2, 55),), 0.55),
        ((reported(0, 80), reported(1, 5, function=4), reported(2, 6, function=3)), 0.80),
        ((reported(0, 80), reported(1, 5, function=0)), 0.05),
        ((reported(0, -1), reported(1, 70), status(-1)), 0.70),
        ((status(65),), 0.65),
        ((reported(0, 101),), math.nan),
        ((reported(0, -1), status(-1)), math.nan),
        ((reported(0, 5, function=4),), math.nan),
        ((), math.nan),
    ],
)
def test_the_charge_is_the_lowest_that_is_reported(messages, soc):
    assert charge(*messages) == pytest.approx(soc, nan_ok=True)


def test_old_reports_say_nothing_of_now_and_the_others_do():
    batteries = Batteries()
    batteries.hear(reported(0, 40), NOW_S)
    batteries.hear(status(80), NOW_S)
    batteries.hear(reported(1, 60), NOW_S + 25.0)
    assert batteries.soc(NOW_S + 25.0) == 0.40
    assert batteries.soc(NOW_S + 40.0) == 0.60
    assert math.isnan(batteries.soc(NOW_S + 60.0))


def test_one_of_several_that_reports_no_charge_is_named_and_a_single_one_is_known_by_the_vehicles_status():
    batteries = Batteries()
    batteries.hear(reported(0, -1), NOW_S)
    assert batteries.unknown(NOW_S) == []
    batteries.hear(reported(1, 70), NOW_S)
    assert batteries.unknown(NOW_S) == [0]
    assert batteries.unknown(NOW_S + 60.0) == []


@pytest.mark.parametrize("volts", [(65_535,) * 10, (0,) * 10])
def test_an_input_where_no_battery_is_plugged_in_is_none_until_one_was_there(volts):
    batteries = Batteries()
    batteries.hear(reported(0, 70), NOW_S)
    batteries.hear(reported(1, -1, volts=volts), NOW_S)
    assert batteries.unknown(NOW_S) == []
    batteries.hear(reported(1, 60), NOW_S)
    batteries.hear(reported(1, -1, volts=volts), NOW_S)
    assert batteries.unknown(NOW_S) == [1]


def test_batteries_far_apart_are_told_with_both_values():
    batteries = Batteries()
    batteries.hear(reported(0, 80), NOW_S)
    batteries.hear(reported(1, 75), NOW_S)
    assert not batteries.apart(NOW_S)
    batteries.hear(reported(1, 60), NOW_S)
    assert batteries.apart(NOW_S) == "battery 1 reports 60 %, battery 0 80 %"
