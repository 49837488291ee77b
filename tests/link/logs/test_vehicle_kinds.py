"""What a vehicle is comes from its log, and only what its kind can tell of the wind is told."""

import math

import numpy as np
import pytest
from drone_truth import fly
from log_factory import dataflash, multirotor, plane, tlog, ulog

from skyway.cli.main import main
from skyway.link.logs.common.vehicle_kind import KINDS, MAV_KINDS, KindEvidence
from skyway.link.logs.reader import open_log
from skyway.link.replay.replay import ReplayOptions, flight_blocks, replay
from skyway.link.replay.report import replay_report
from skyway.models.base.errors import InputError
from skyway.models.base.json_text import json_text
from skyway.models.calibration.wind import identify_drag

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own
PITOT = 0x10
WIND = (-4.0, 3.0)
PLANE = plane(wind=WIND, duration_s=150.0)
COPTER = fly(seed=3, duration_s=240.0, courses_deg=(0.0, 180.0), sigma_mps=0.7)


def replayed(tmp_path, log, name="flight.log", **options):
    path = tmp_path / name
    path.write_bytes(log.data)
    return replay(open_log(path), ReplayOptions(**options))


def no_wind(found, kind):
    assert found.vehicle.kind == kind
    assert not len(found.wind)
    assert not found.observations
    assert not found.measured
    assert any("no wind" in event.text for event in found.events)
    json_text(replay_report(found))


WINGLESS_TELLERS = {
    "DataFlash of ArduPlane": lambda: dataflash(PLANE, "ArduPlane V4.5.7 (2a3dc4b7)"),
    "DataFlash of old ArduPlane": lambda: dataflash(PLANE, "APM:Plane V3.1.0"),
    "DataFlash that lost its banner": lambda: dataflash(PLANE, "", {"RLL2SRV_RMAX": 75.0}),
    "MAVLink 1 of ArduPlane": lambda: tlog(PLANE, 1),
    "MAVLink 2 of PX4": lambda: tlog(PLANE, 1, 12, first_version=False),
    "ULog": lambda: ulog(PLANE, status=lambda _: (2, 0, 0, 1)),
    "ULog that knows only its parameter": lambda: ulog(
        PLANE, status=lambda _: (0, 0, 0, 0), parameters={"MAV_TYPE": 1}
    ),
}


@pytest.mark.parametrize("log", WINGLESS_TELLERS.values(), ids=WINGLESS_TELLERS)
def test_a_fixed_wing_without_an_airspeed_sensor_tells_no_wind(tmp_path, log):
    """A made-up airspeed, as autopilots send it in VFR_HUD without a sensor, is none."""
    no_wind(replayed(tmp_path, log()), "fixed wing")


SENSED = {
    "DataFlash": lambda: dataflash(PLANE, "ArduPlane V4.5.7 (2a3dc4b7)", sensor=True),
    "MAVLink 1": lambda: tlog(PLANE, 1, sensors=PITOT),
    "ULog": lambda: ulog(PLANE, status=lambda _: (2, 0, 0, 1), sensor=True),
}


@pytest.mark.parametrize("log", SENSED.values(), ids=SENSED)
def test_a_fixed_wing_with_a_sensor_tells_the_wind_it_flew_in(tmp_path, log):
    found = replayed(tmp_path, log())
    assert found.vehicle.kind == "fixed wing"
    assert set(found.measured) == {"airspeed"}
    assert found.wind.wind[-60:].mean(axis=0) == pytest.approx(WIND, abs=0.8)


@pytest.mark.parametrize(
    "kind", [number for number, name in MAV_KINDS.items() if name not in ("multirotor", "fixed wing", "VTOL")]
)
def test_what_is_no_aircraft_of_ours_tells_no_wind_and_is_named(tmp_path, kind):
    no_wind(replayed(tmp_path, tlog(multirotor(COPTER), kind, sensors=PITOT)), MAV_KINDS[kind])


@pytest.mark.parametrize(
    ("banner", "parameters", "kind"),
    [
        ("ArduRover V4.2.3", {}, "rover"),
        ("APM:Rover V3.0.0", {}, "rover"),
        ("ArduRover V4.2.3", {"FRAME_CLASS": 2.0}, "boat"),
        ("ArduSub V4.1.0", {}, "submarine"),
        ("Blimp V4.4.0", {}, "airship"),
        ("ArduCopter V4.3.1", {"FRAME_CLASS": 6.0}, "helicopter"),
        ("", {"H_RSC_MODE": 1.0, "ATC_RAT_RLL_P": 0.1}, "helicopter"),
        ("", {"CRUISE_THROTTLE": 50.0}, "rover"),
        ("", {}, "unknown"),
        ("SomethingElse V1", {"RC1_MIN": 1000.0}, "unknown"),
    ],
)
def test_a_dataflash_log_of_something_else_tells_no_wind_and_is_named(tmp_path, banner, parameters, kind):
    no_wind(replayed(tmp_path, dataflash(multirotor(COPTER), banner, parameters)), kind)


@pytest.mark.parametrize(
    ("status", "parameters", "kind"),
    [
        ((3, 0, 0, 10), {}, "rover"),
        ((1, 0, 0, 4), {}, "helicopter"),
        ((1, 0, 0, 0), {"CA_AIRFRAME": 10}, "helicopter"),
        ((4, 0, 0, 7), {}, "airship"),
        ((0, 0, 0, 12), {}, "submarine"),
        ((0, 0, 0, 0), {}, "unknown"),
    ],
)
def test_a_ulog_of_something_else_tells_no_wind_and_is_named(tmp_path, status, parameters, kind):
    no_wind(replayed(tmp_path, ulog(multirotor(COPTER), status=lambda _: status, parameters=parameters)), kind)


COPTERS = {
    "DataFlash": lambda: dataflash(multirotor(COPTER)),
    "DataFlash that lost its banner": lambda: dataflash(multirotor(COPTER), "", {"MOT_SPIN_ARMED": 0.1}),
    "hexarotor, MAVLink 1": lambda: tlog(multirotor(COPTER), 13),
    "octorotor of PX4": lambda: tlog(multirotor(COPTER), 14, 12, first_version=False),
    "ULog": lambda: ulog(multirotor(COPTER)),
}


@pytest.mark.parametrize("log", COPTERS.values(), ids=COPTERS)
def test_a_multirotor_tells_the_same_wind_in_every_format(tmp_path, log):
    found = replayed(tmp_path, log())
    assert found.vehicle.kind == "multirotor"
    miss = found.wind.wind[60:].mean(axis=0) - COPTER.wind[600:, 0].mean(axis=0)
    assert np.hypot(*miss) < 1.0
    assert found.observations


def quadplane(hover_s=120.0):
    """A hover as a multirotor, then wings: columns, and the row at which the wings begin."""
    hover, wings = (
        multirotor(fly(seed=3, duration_s=hover_s, courses_deg=(0.0, 180.0), leg_s=20.0)),
        plane(wind=(9.0, 9.0)),
    )
    count = len(hover["time_s"])
    joined = {name: np.concatenate([hover[name], wings[name]]) for name in hover if name != "time_s"}
    joined["airspeed_mps"] = np.concatenate([np.full(count, 0.3), wings["airspeed_mps"]])
    joined["time_s"] = np.concatenate([hover["time_s"], wings["time_s"] + hover_s])
    return joined, count


@pytest.mark.parametrize("form", ["DataFlash", "tlog", "ULog"])
@pytest.mark.parametrize("tilting", [False, True])
def test_a_vtol_tells_wind_by_its_lean_only_while_it_hovers_as_a_multirotor(tmp_path, form, tilting):
    columns, wings = quadplane()

    def mode(row):
        return 18 if row < wings else 5

    if form == "DataFlash":
        parameters = {"Q_ENABLE": 1.0, "Q_TILT_ENABLE": float(tilting)}
        log = dataflash(columns, "ArduPlane V4.5.7", parameters, modes=mode)
    elif form == "tlog":
        kind, parameters = (21, {}) if tilting else (1, {"Q_ENABLE": 1.0})
        log = tlog(columns, kind, modes=mode, parameters=parameters)
    else:
        system = 21 if tilting else 22
        log = ulog(columns, status=lambda row: (1 if row < wings else 2, 1, int(wings <= row < wings + 50), system))
    found = replayed(tmp_path, log)
    assert found.vehicle.kind == "VTOL"
    assert found.measured.get("airspeed", 0) == 0
    if tilting:
        assert not found.measured
    else:
        assert 60 < found.measured["tilt"] <= 121
        assert found.wind.time_s[-1] <= found.seconds.time_s[0] + 122.0


def test_a_kind_that_is_given_is_used_where_the_log_is_silent_and_refused_where_it_says_otherwise(tmp_path):
    silent = replayed(tmp_path, dataflash(multirotor(COPTER), ""), vehicle="multirotor")
    assert silent.vehicle.told_by == "--vehicle"
    assert len(silent.wind) > 200
    with pytest.raises(InputError, match="the log is of a fixed wing"):
        replayed(tmp_path, dataflash(PLANE, "ArduPlane V4.5.7"), vehicle="multirotor")
    with pytest.raises(InputError, match="is not a kind of vehicle"):
        replayed(tmp_path, dataflash(PLANE, ""), vehicle="bird")


def test_forecast_and_calibrate_learn_nothing_from_a_fixed_wing_without_a_sensor(tmp_path, capsys):
    path = tmp_path / "plane.bin"
    path.write_bytes(dataflash(PLANE, "ArduPlane V4.5.7").data)
    assert main(["forecast", str(path)]) == 2
    said = capsys.readouterr().err
    assert "fixed wing" in said
    assert "wind could be estimated" in said
    assert main(["calibrate", "wind", str(path)]) == 1
    log = open_log(path)
    assert identify_drag(flight_blocks(log, 1)).drag is None


def test_a_log_that_contradicts_itself_is_of_no_known_kind():
    evidence = KindEvidence()
    evidence.types = {1: None, 2: None}
    assert evidence.vehicle().kind == "unknown"
    assert "contradicts itself" in evidence.vehicle().told_by
    evidence.parameter("Q_ENABLE", 1.0)
    assert evidence.vehicle().kind == "VTOL"


def test_parameters_of_any_value_end_in_some_kind():
    for value in (math.nan, math.inf, -3e38, -1.0, 0.0, 1e9):
        evidence = KindEvidence()
        for name in ("MAV_TYPE", "FRAME_CLASS", "CA_AIRFRAME", "Q_FRAME_CLASS", "Q_ENABLE"):
            evidence.parameter(name, value)
        evidence.text("ArduCopter V4.5")
        assert evidence.vehicle().kind in KINDS
