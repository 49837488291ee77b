"""Calibration and health of simulated vehicles, and of what real ones tell, judged: unknown is never good."""

import json
import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st
from wires import FAMILIES, Scene, a_mission, changed_frame

from skyway.link.vehicle import health
from skyway.link.vehicle.health import HealthItem, Vibration, look_at
from skyway.link.vehicle.health_book import NAME, HealthBook, VibrationWatch
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.frames import FrameWriter
from skyway.missions.autopilots.registry import family_named
from skyway.models.base.errors import VehicleTimeoutError
from skyway.models.base.units import parse_instant
from skyway.sim_stub.faults import parse_fault

UNTOLD = {"px4": {"battery cells", "battery cycles", "vibration"}}
UNTOLD["ardupilot"] = UNTOLD["px4"] | {"motors"}


def aboard(family, *faults, **config):
    scene = Scene(family, faults=[parse_fault(fault) for fault in faults], **config)
    scene.craft = Vehicle(scene.connection)
    scene.connection.run_for(1.0)
    return scene


def looked(scene, flown=None):
    return {item.name: item for item in look_at(scene.craft, flown)}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_sound_vehicle_is_good_and_what_it_does_not_tell_is_unknown(family):
    items = looked(aboard(family))
    assert all(item.ok for item in items.values()), items
    assert {name for name, item in items.items() if item.verdict == "unknown"} == UNTOLD[family]
    assert "compass calibration" in items
    assert "accelerometer calibration" in items


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(
    ("fault", "item", "said"),
    [
        ("sensor-ill=compass", "sensors", "compass"),
        ("sensor-ill=motors", "sensors", "motor outputs"),
        ("gps", "sensors", "GPS"),
        ("gps", "GPS", "fix 1"),
        ("gps", "filter", "no sound estimate"),
        ("cell-low=0.3", "battery cells", "300 mV apart"),
    ],
)
def test_what_is_wrong_is_found_and_named(family, fault, item, said):
    found = looked(aboard(family, fault))[item]
    assert (found.verdict, said in found.said) == ("no", True), found
    assert not found.ok


def test_a_motor_that_reports_a_failure_is_found_where_controllers_report():
    found = looked(aboard("px4", "motor-ill=3"))["motors"]
    assert (found.verdict, found.said) == ("no", "failing: 3")


@pytest.mark.parametrize(
    ("family", "parameters", "item", "said"),
    [
        ("ardupilot", {"COMPASS_OFS_X": 0, "COMPASS_OFS_Y": 0, "COMPASS_OFS_Z": 0}, "compass calibration", "never calibrated"),
        ("ardupilot", {"COMPASS_OFS_X": 1700, "COMPASS_OFS_Y": 1700}, "compass calibration", "2404 long, 1800 at most"),
        ("ardupilot", {"COMPASS_USE": 0}, "compass calibration", "not in use"),
        ("ardupilot", {"INS_ACCOFFS_X": 0, "INS_ACCOFFS_Y": 0, "INS_ACCOFFS_Z": 0}, "accelerometer calibration", "never calibrated"),
        ("px4", {"CAL_MAG0_ID": 0}, "compass calibration", "CAL_MAG0_ID"),
        ("px4", {"CAL_GYRO0_PRIO": 0}, "gyro calibration", "not in use"),
    ],
)  # fmt: skip
def test_calibrations_that_are_none_are_found(family, parameters, item, said):
    found = looked(aboard(family, parameters=tuple((name, float(value)) for name, value in parameters.items())))[item]
    assert (found.verdict, said in found.said) == ("no", True), found


@pytest.mark.parametrize("family", FAMILIES)
def test_nothing_told_is_unknown_and_never_good(family):
    kin = family_named(family)
    needed = [
        health.sensors(None),
        health.filter_state(None, kin),
        health.receiver(None),
        *health.calibrations(kin.calibrations, {}),
    ]
    assert {item.verdict for item in needed} == {"unknown"}
    assert not any(item.ok for item in needed)
    optional = [
        health.cells(None),
        health.worst(health.cells, {}),
        health.cycles(None),
        health.motors({}),
        health.vibration(None, kin),
    ]
    assert {item.verdict for item in optional} == {"unknown"}
    assert all(item.ok for item in optional)


def test_offsets_that_are_not_told_are_no_calibration():
    places = family_named("ardupilot").calibrations
    items = {one.name: one for one in health.calibrations(places, {"COMPASS_DEV_ID": 5.0, "INS_ACC_ID": 5.0})}
    assert {name: one.verdict for name, one in items.items()} == {
        "compass calibration": "no", "accelerometer calibration": "no", "gyro calibration": "unknown"
    }  # fmt: skip


@given(st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_sensors_are_good_only_where_all_that_are_needed_are_on_and_all_that_are_on_are_healthy(
    present, enabled, healthy
):
    told = {"present": present, "enabled": enabled, "health": healthy}
    item = health.sensors({f"onboard_control_sensors_{name}": value for name, value in told.items()})
    needed = 0x1 | 0x2 | 0x8 | 0x20
    if item.verdict == "ok":
        assert present & enabled & healthy & needed == needed
    if not healthy & 0x1:
        assert item.verdict == "no"


@given(st.lists(st.integers(1, 5000), min_size=0, max_size=10))
def test_cells_are_good_only_where_they_are_told_singly_and_close(millivolts):
    told = {"voltages": (*millivolts, *[65535] * (10 - len(millivolts)))}
    item = health.cells(told)
    if len(millivolts) < 2 or len(set(millivolts)) == 1:
        assert item.verdict == "unknown"
    else:
        assert (item.verdict == "ok") == (
            max(millivolts) - min(millivolts) <= 100 and 3000 <= min(millivolts) <= max(millivolts) <= 4400
        )


def test_old_batteries_and_those_that_report_a_fault_are_found():
    smart = {"cycle_count": 301, "capacity_full": 4000, "capacity_full_specification": 5000}
    assert health.cycles(smart).verdict == "no"
    found = health.cycles(smart | {"cycle_count": 20})
    assert (found.verdict, "20 cycles; it holds 80 %" in found.said) == ("ok", True)
    assert health.cycles(smart | {"cycle_count": 65535}).verdict == "unknown"
    assert health.cells({"voltages": (4000, 4010), "fault_bitmask": 4}).verdict == "no"


@pytest.mark.parametrize(
    ("satellites", "eph", "verdict"), [(14, 90, "ok"), (255, 90, "unknown"), (14, 65535, "unknown"), (14, 0, "unknown"), (255, 300, "no"), (5, 90, "no")]
)  # fmt: skip
def test_satellites_and_precision_that_are_not_reported_are_not_good(satellites, eph, verdict):
    assert health.receiver({"fix_type": 3, "satellites_visible": satellites, "eph": eph}).verdict == verdict


def test_a_filter_that_finds_its_accelerometer_wrong_is_not_good():
    tests = dict.fromkeys(family_named("px4").filter_tests, 0.1)
    assert health.filter_state({"flags": 0x33F, **tests}, family_named("px4")).verdict == "ok"
    assert health.filter_state({"flags": 0x33F | 0x800, **tests}, family_named("px4")).verdict == "no"


def test_the_worst_of_several_batteries_counts_and_all_are_named():
    good, low = {"voltages": (4000, 4010, 4020)}, {"voltages": (4000, 2600, 4010)}
    assert health.worst(health.cells, {0: good}).said == health.cells(good).said
    found = health.worst(health.cells, {0: good, 1: low})
    assert (found.verdict, found.ok) == ("no", False)
    assert found.said.startswith("battery 0: 3 cells")
    assert "battery 1: 3 cells, 2.60 to 4.01 V" in found.said
    assert health.worst(health.cells, {0: good, 1: {"voltages": (65535,) * 10}}).verdict == "unknown"


@pytest.mark.parametrize(("state", "verdict"), [(1, "ok"), (5, "no"), (6, "no"), (7, "ok")])
def test_a_battery_that_reports_itself_broken_is_found(state, verdict):
    assert health.cells({"voltages": (4000, 4010), "charge_state": state}).verdict == verdict


SECOND = {"id": 1, "voltages": (3800, 3800, 2600, *(65535,) * 7), "battery_remaining": 5}


@pytest.mark.parametrize("in_turn", [False, True], ids=["at once", "in turn"])
@pytest.mark.parametrize("family", FAMILIES)
def test_every_battery_of_a_vehicle_is_looked_at(family, in_turn):
    turn = [0]

    def spoil(number, message, frame, up):
        if up or message is None or message.name != "BATTERY_STATUS":
            return frame
        turn[0] += 1
        second = changed_frame(message, **SECOND)
        return (second if turn[0] % 2 else frame) if in_turn else frame + second

    scene = aboard(family, spoil=spoil)
    found = looked(scene)["battery cells"]
    assert (found.verdict, found.ok) == ("no", False)
    assert "battery 1: 3 cells, 2.60 to 3.80 V" in found.said
    now_s = scene.connection.clock.now_s()
    assert scene.craft.batteries.lowest(now_s) == (1, 0.05)
    assert re.fullmatch(r"battery 1 reports 5 %, battery 0 \d+ %", scene.craft.batteries.apart(now_s))
    assert scene.craft.batteries.lowest(now_s + 60.0) is None, "old reports say nothing of now"


def test_a_battery_of_the_payload_is_none_to_fly_on():
    def spoil(number, message, frame, up):
        of_payload = not up and message is not None and message.name == "BATTERY_STATUS"
        return frame + changed_frame(message, **SECOND, battery_function=4) if of_payload else frame

    scene = aboard("px4", spoil=spoil)
    looked(scene)
    assert set(scene.craft.batteries.reports(scene.connection.clock.now_s())) == {0}


@pytest.mark.parametrize("family", FAMILIES)
def test_a_link_that_is_lost_amid_the_check_is_no_good_vehicle(family):
    cut = []

    def spoil(number, message, frame, up):
        return b"" if cut else frame

    scene = aboard(family, spoil=spoil)
    items = look_at(scene.craft, None)
    assert next(item for item in items if item.name == "GPS").ok
    cut.append(True)
    with pytest.raises(VehicleTimeoutError, match="did not answer"):
        list(items)


def test_a_vehicle_that_cannot_be_asked_for_messages_is_judged_by_those_that_it_streams():
    """PX4 before 1.11, and bridges: REQUEST_MESSAGE is unsupported."""
    refused = FrameWriter(1, 1)

    def spoil(number, message, frame, up):
        if message is None or (up and message.name != "COMMAND_LONG") or (not up and message.name != "COMMAND_ACK"):
            return frame
        if up:
            asks = message["command"] == 512
            return changed_frame(message, command=31999) if asks else frame
        return refused.frame("COMMAND_ACK", message.fields | {"command": 512}) if message["command"] == 31999 else frame

    scene = aboard("px4", spoil=spoil)
    scene.connection.run_for(3.0)
    items = looked(scene)
    assert {items[name].verdict for name in ("sensors", "filter", "GPS")} == {"ok"}, items
    assert items["battery cycles"].verdict == "unknown"


def group(index, count=6, info=0x3F, failures=(0, 0, 0, 0)):
    return {"index": index, "count": count, "info": info, "failure_flags": failures}


def test_motors_beyond_the_fourth_are_looked_at():
    assert health.motors({0: group(0), 4: group(4)}).verdict == "ok"
    assert health.motors({0: group(0), 4: group(4, failures=(0, 4, 0, 0))}).said == "failing: 6"
    assert health.motors({0: group(0, info=0x1F), 4: group(4, info=0x1F)}).said == "not heard: 6"
    found = health.motors({0: group(0)})
    assert (found.verdict, "5, 6 are not reported" in found.said) == ("unknown", True)


@pytest.mark.parametrize(("value", "verdict"), [(20.0, "ok"), (45.0, "ok"), (60.0, "no"), (math.nan, "unknown")])
def test_vibration_is_judged_by_what_the_autopilot_measures(value, verdict):
    assert health.vibration(Vibration(value, 0), family_named("ardupilot")).verdict == verdict
    assert health.vibration(Vibration(12.0, 0), family_named("px4")).verdict == "no"
    assert health.vibration(Vibration(1.0, 101), family_named("px4")).verdict == "no"


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize(("faults", "verdict"), [((), "ok"), (("vibration=90",), "no")])
def test_how_it_shook_on_its_last_flight_is_watched_kept_and_judged(family, faults, verdict, tmp_path):
    scene = aboard(family, *faults)
    book = HealthBook(tmp_path)
    watch = VibrationWatch(scene.craft)
    scene.craft.upload(a_mission(3, height=20.0))
    scene.craft.start(60.0)
    scene.connection.run_for(10.0)
    shook = watch.end()
    book.flew(7, 1.7e9, shook)
    found = looked(scene, HealthBook(tmp_path).last_flight(7))["vibration"]
    assert found.verdict == verdict, found


def test_a_check_counts_for_its_day_in_the_zone_of_the_flights(tmp_path):
    from zoneinfo import ZoneInfo

    book = HealthBook(tmp_path, ZoneInfo("Australia/Melbourne"))
    at = lambda text: parse_instant(text).timestamp()  # noqa: E731
    good = [HealthItem("sensors", "ok", "gyro")]
    book.add(5, at("2026-11-23T08:00:00+11:00"), good)
    assert book.passed_today(5, at("2026-11-23T23:30:00+11:00")) is not None
    assert book.passed_today(5, at("2026-11-24T00:10:00+11:00")) is None
    assert book.passed_today(5, at("2026-11-23T07:59:00+11:00")) is None, "another clock: it is of the future"
    assert book.passed_today(6, at("2026-11-23T09:00:00+11:00")) is None
    book.add(5, at("2026-11-23T10:00:00+11:00"), [HealthItem("sensors", "no", "gyro")])
    assert book.passed_today(5, at("2026-11-23T11:00:00+11:00")) is None
    book.add(0, at("2026-11-23T10:00:00+11:00"), good)
    assert book.passed_today(0, at("2026-11-23T10:00:00+11:00")) is None


@given(st.binary(max_size=200))
def test_a_book_with_anything_in_it_is_read(tmp_path_factory, junk):
    folder = tmp_path_factory.mktemp("book")
    book = HealthBook(folder)
    book.add(5, 1.7e9, [HealthItem("sensors", "ok", "gyro")])
    with (folder / NAME).open("ab") as stream:
        stream.write(junk + b"\n" + json.dumps({"schema": "skyway.health-check/1", "uid": 5}).encode() + b"\n")
    assert book.passed_today(5, 1.7e9 + 60.0) is not None
