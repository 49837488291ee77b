"""Positions that the vehicle distrusts, and winds that the filter's own health calls inconsistent, are unknown."""

import numpy as np
import pytest
from drone_truth import fly
from log_factory import dataflash, multirotor, tlog, ulog

from skyway.link.logs.common.trust import doubt_in
from skyway.link.logs.reader import open_log
from skyway.link.replay.replay import ReplayOptions, flight_blocks, replay
from skyway.models.drones.drag import DragModel
from skyway.models.drones.telemetry import QUANTITIES, believable
from skyway.models.wind.estimation.health import ConsistencyMonitor

pytestmark = pytest.mark.filterwarnings("ignore")  # pymavlink's own
DRAG = DragModel(linear_per_s=0.15, quadratic_per_m=0.010)
TRUTH = fly(seed=3, duration_s=200.0, courses_deg=(0.0, 180.0), leg_s=40.0, sigma_mps=0.5)
BAD = slice(900, 1300)
"""Rows, ten a second, in which the velocity is wrong."""


def with_fault(kind):
    """Columns of the flight, its velocity wrong for 40 s: by 35 m/s at once, or more and more."""
    columns = multirotor(TRUTH)
    count = BAD.stop - BAD.start
    wrong = np.full(count, 35.0) if kind == "jump" else np.linspace(0.0, 40.0, count)
    north = columns["vel_north_mps"].copy()
    north[BAD] += wrong
    return columns | {"vel_north_mps": north}


def bad(row):
    return BAD.start <= row < BAD.stop


def lost(row):
    return (1, 0, 99.0) if bad(row) else (3, 14, 0.8)


WAYS = {
    "DataFlash: no fix": lambda columns: dataflash(columns, gps=lost),
    "DataFlash: few satellites": lambda columns: dataflash(
        columns, gps=lambda row: (3, 4, 0.8) if bad(row) else (3, 9, 0.8)
    ),
    "DataFlash: innovations": lambda columns: dataflash(
        columns, estimate=lambda row: (1.3, 0.2, 0x33F) if bad(row) else (0.1, 0.1, 0x33F)
    ),
    "DataFlash: glitch flag": lambda columns: dataflash(
        columns, estimate=lambda row: (0.1, 0.1, 0x33F | 1 << 14) if bad(row) else (0.1, 0.1, 0x33F)
    ),
    "tlog: no fix": lambda columns: tlog(columns, gps=lambda row: (1, 0, 65535) if bad(row) else (3, 14, 80)),
    "tlog: poor geometry": lambda columns: tlog(columns, gps=lambda row: (3, 14, 600) if bad(row) else (3, 14, 80)),
    "ULog: no fix": lambda columns: ulog(columns, gps=lost),
    "ULog: test ratios": lambda columns: ulog(
        columns, ratios=lambda row: (0.2, 2.0, 0x33F) if bad(row) else (0.1, 0.1, 0x33F)
    ),
    "ULog: glitch flag": lambda columns: ulog(
        columns, ratios=lambda row: (0.1, 0.1, 0x33F | 1 << 10) if bad(row) else (0.1, 0.1, 0x33F)
    ),
}


def replayed(tmp_path, log):
    path = tmp_path / "flight.log"
    path.write_bytes(log.data)
    return replay(open_log(path), ReplayOptions(drag=DRAG))


def true_wind(found):
    """The wind that blew at the times of the estimates."""
    time_s = found.wind.time_s - found.seconds.time_s[0]
    return np.stack(
        [np.interp(time_s, TRUTH.time_s - TRUTH.time_s[0], TRUTH.wind[:, 0, axis]) for axis in (0, 1)], axis=1
    )


def honest(found):
    """No estimate is far off, and none handed on."""
    miss = np.hypot(*(found.wind.wind - true_wind(found)).T)
    assert len(miss) > 60
    assert miss.max() < 5.0
    mean = TRUTH.wind[:, 0].mean(axis=0)
    for one in found.observations:
        assert np.hypot(one.north_mps - mean[0], one.east_mps - mean[1]) < 2.5


@pytest.mark.parametrize("way", WAYS.values(), ids=WAYS)
def test_what_the_vehicle_distrusts_becomes_no_wind(tmp_path, way):
    found = replayed(tmp_path, way(with_fault("drift")))
    honest(found)
    assert any("no wind from here" in event.text for event in found.events)
    assert any("trusted again" in event.text for event in found.events)


@pytest.mark.parametrize("fault", ["jump", "drift"])
@pytest.mark.parametrize("form", [dataflash, tlog, ulog])
def test_a_wrong_velocity_that_nobody_flags_becomes_no_wind(tmp_path, form, fault):
    honest(replayed(tmp_path, form(with_fault(fault))))


def test_a_glitch_told_only_by_an_error_message_becomes_no_wind(tmp_path):
    columns = with_fault("drift")
    log = dataflash(columns)
    fault = dataflash({name: values[:1] for name, values in columns.items()})
    for row, code in ((BAD.start, 2), (BAD.stop, 0)):
        now = 2_000_000 + row * 100_000
        fault.add("ERR", "QBB", "TimeUS,Subsys,ECode", now, 11, code)
    log.parts += fault.parts[-3:]
    log.parts[-2] = log.parts[-2][:2] + bytes([fault._types["ERR"][0]]) + log.parts[-2][3:]
    path = tmp_path / "flight.bin"
    path.write_bytes(log.data)
    summary = open_log(path).summary
    assert [event.text for event in summary.events if "GPS glitch" in event.text] == [
        "error: GPS glitch",
        "error: GPS glitch cleared",
    ]
    ((begin, end),) = summary.doubted[1]
    assert begin - summary.start_s == pytest.approx(87.5, abs=0.2)
    assert end - summary.start_s == pytest.approx(135.5, abs=0.2)
    honest(replay(open_log(path), ReplayOptions(drag=DRAG)))


@pytest.mark.parametrize("way", ["DataFlash: no fix", "tlog: no fix", "ULog: glitch flag"])
def test_spans_that_the_vehicle_distrusts_do_not_reach_a_calibration(tmp_path, way):
    path = tmp_path / "flight.log"
    path.write_bytes(WAYS[way](with_fault("drift")).data)
    air = flight_blocks(open_log(path), 1)
    begin = air.time_s[0]
    inside = (air.time_s - begin > 93.0) & (air.time_s - begin < 128.0)
    assert inside.sum() > 30
    assert np.isnan(air.velocity[inside]).all()
    assert np.isfinite(air.velocity[~inside]).all(axis=1).mean() > 0.9


def test_a_flight_without_fault_loses_next_to_nothing(tmp_path):
    for form in (dataflash, tlog, ulog):
        found = replayed(tmp_path, form(multirotor(TRUTH)))
        assert len(found.wind) > 170
        assert not any("no wind from here" in event.text for event in found.events)


@pytest.mark.parametrize(
    ("text", "doubts"),
    [
        ("GPS Glitch", True),
        ("GPS Glitch or Compass error", True),
        ("Glitch cleared", False),
        ("GPS Glitch cleared", False),
        ("EKF variance", True),
        ("EKF Failsafe: changed to LAND mode", True),
        ("EKF Failsafe Cleared", False),
        ("PreArm: Need 3D Fix", None),
        ("Mission: 3 WP", None),
    ],
)
def test_lines_that_begin_and_end_a_doubt(text, doubts):
    assert doubt_in(text) is doubts


def test_health_that_begins_anew_trusts_nothing_until_enough_is_consistent():
    monitor = ConsistencyMonitor()
    for _ in range(20):
        monitor.add(2.0)
    assert monitor.verdict == "consistent"
    monitor.restart()
    verdicts = []
    for _ in range(20):
        verdicts.append(monitor.verdict)
        monitor.add(2.0)
    assert set(verdicts) == {"overconfident"}
    assert monitor.verdict == "consistent"


@pytest.mark.parametrize("value", [-3e38, 3e38, np.inf, -np.inf, np.nan, 1e300])
@pytest.mark.parametrize(
    "name", ["roll_rad", "yaw_rad", "vel_north_mps", "vel_down_mps", "airspeed_mps", "lat_deg", "power_w"]
)
def test_an_absurd_value_is_unknown(name, value):
    row = np.zeros(len(QUANTITIES))
    row[QUANTITIES.index(name)] = value
    assert np.isnan(believable(row)[QUANTITIES.index(name)])


@pytest.mark.parametrize("name", ["roll_rad", "pitch_rad", "yaw_rad", "vel_north_mps", "vel_east_mps"])
@pytest.mark.parametrize("form", [dataflash, tlog, ulog])
def test_one_absurd_value_in_a_log_changes_next_to_nothing(tmp_path, form, name):
    columns = multirotor(TRUTH)
    if (form is dataflash and name.endswith("_rad")) or (form is tlog and name.startswith("vel")):
        return  # whole numbers there, which cannot be absurd
    plain = replayed(tmp_path, form(columns))
    wrong = columns[name].copy()
    wrong[700] = -3e38
    found = replayed(tmp_path, form(columns | {name: wrong}))
    miss = np.hypot(*(found.wind.wind.mean(axis=0) - plain.wind.wind.mean(axis=0)))
    assert miss < 0.3


@pytest.mark.parametrize("corrected", [True, False])
def test_before_a_filter_corrects_its_velocity_it_was_wrong(tmp_path, corrected):
    """A drift of 0.3 m/s each second, which alone reads as wind, until PX4 resets the velocity to what is true."""
    columns = multirotor(TRUTH)
    north = columns["vel_north_mps"].copy()
    north[BAD] += np.linspace(0.0, 12.0, BAD.stop - BAD.start)

    def reset(row):
        return (1, 12.0, 0.0) if corrected and row >= BAD.stop else (0, 0.0, 0.0)

    found = replayed(tmp_path, ulog(columns | {"vel_north_mps": north}, reset=reset))
    begin = found.seconds.time_s[0]
    during = found.wind.wind[(found.wind.time_s - begin > 115.0) & (found.wind.time_s - begin < 128.0)]
    assert len(during) == 0 if corrected else len(during) > 5
    assert any("the filter corrects its velocity by 12.0 m/s" in event.text for event in found.events) == corrected
