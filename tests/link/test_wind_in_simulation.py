"""The wind that the filter finds in logs of the simulator, which has its own drag, autopilots, gusts and truth.

A calibration flight (a square in a light wind) gives the drag; another flight in a strong gusty wind is judged with it.
"""

import math
import struct

import numpy as np
import pytest
from batch_filter import nees
from sim_station import LAND, SPEED, TAKEOFF, WAYPOINT, Stage, item, plain

from skyway.link.logs.reader import open_log
from skyway.link.replay.replay import ReplayOptions, replay
from skyway.models.drones.drag import DragModel
from skyway.sim_stub.faults import parse_fault
from skyway.sim_stub.plant.wind_truth import ConstantWind

SQUARE = ((800, 0), (800, 800), (0, 800), (0, 0))
TRIANGLE = ((1500, 0), (750, 1300), (0, 0))
STREAMS = ((30, 10), (33, 5), (1, 1), (245, 1), (74, 2))


def fly(path, legs, *, wind, speed_mps, seed, autopilot="px4", faults=()):
    """Fly legs, recording what the vehicle sends as a tlog; returns the true wind of each second, {second: (n, e)}."""
    stage = Stage(autopilot, wind=ConstantWind.of(*wind), seed=seed, faults=faults)
    vehicle, station = stage.vehicle, stage.station
    truth: dict[int, list[tuple[float, float]]] = {}
    step, read = vehicle._step, station.read

    def watched_step(now):
        step(now)
        truth.setdefault(math.floor(vehicle.posix_s), []).append(vehicle._wind_now)

    with path.open("wb") as log:

        def recorded_read(seconds):
            found = read(seconds)
            for message in found:
                log.write(struct.pack(">Q", round(vehicle.posix_s * 1e6)) + bytes(message.get_msgbuf()))
            return found

        vehicle._step, station.read = watched_step, recorded_read
        if autopilot == "px4":
            stage.pilot.parameters.set("MPC_XY_VEL_MAX", 20.0)
        else:
            stage.pilot.parameters.set("WPNAV_SPEED", 100.0 * speed_mps)
            for number, rate_hz in STREAMS:
                station.command(511, number, 1e6 / rate_hz)
        way = [item(WAYPOINT, *place, z=60) for place in legs]
        items = [item(TAKEOFF, z=60), plain(SPEED, 1, speed_mps, -1), *way, item(LAND, *legs[-1], z=0.0)]
        assert station.upload(stage.mission(*items)) == 0
        stage.start()
        stage.rest(1500.0)
    return {second: np.mean(values, axis=0) for second, values in truth.items()}


def misses(found, truth):
    """Estimate minus truth, and truth, at each second in which something was measured, shape (n, 2) each."""
    true = np.array([truth[math.floor(time_s)] for time_s in found.wind.time_s])
    return found.wind.wind - true, true


@pytest.fixture(scope="module", params=["px4", pytest.param("ardupilot", marks=pytest.mark.slow)])
def calibrated(request, tmp_path_factory):
    """The autopilot, and the drag found in a square flown in a light wind."""
    path = tmp_path_factory.mktemp("simulated") / "square.tlog"
    fly(path, SQUARE, wind=(3, 200), speed_mps=16, seed=11, autopilot=request.param)
    found = replay(open_log(path))
    assert found.drag_source == "identified", found.drag_reason
    return request.param, found.drag


@pytest.fixture(scope="module")
def gusty(calibrated, tmp_path_factory):
    """A flight at 17 m/s in 8 m/s with gusts, and its truth."""
    path = tmp_path_factory.mktemp("simulated") / "gusty.tlog"
    return path, fly(path, TRIANGLE, wind=(8, 300), speed_mps=17, seed=3, autopilot=calibrated[0])


def test_the_drag_found_is_that_of_the_simulated_airframe(calibrated):
    from skyway.sim_stub.plant.airframe import Airframe

    frame, (_, drag) = Airframe(), calibrated
    true = frame.drag_n_per_speed(17.0, 0.0) / frame.mass_kg(0.0)
    assert drag.linear_per_s + 17.0 * drag.quadratic_per_m == pytest.approx(true, rel=0.05)


def test_in_gusts_at_17_mps_the_wind_is_found_to_half_a_metre_per_second_and_10_degrees(calibrated, gusty):
    path, truth = gusty
    found = replay(open_log(path), ReplayOptions(drag=calibrated[1]))
    miss, true = misses(found, truth)
    wind = found.wind.wind
    turned = np.arctan2(wind[:, 1], wind[:, 0]) - np.arctan2(true[:, 1], true[:, 0])
    degrees = np.degrees(np.angle(np.exp(1j * turned)))[np.hypot(*true.T) > 3.0]
    rmse, direction = math.sqrt((miss**2).sum(axis=1).mean()), math.sqrt((degrees**2).mean())
    spread = math.sqrt((true - true.mean(axis=0)).var(axis=0).sum())
    squares = float(nees(found.wind, true).mean())
    print(f"vector RMSE {rmse:.2f} m/s (gusts of {spread:.2f}), direction {direction:.1f} degrees, NEES {squares:.2f}")
    assert rmse <= 0.5
    assert rmse < 0.5 * spread
    assert direction <= 10.0
    assert squares < 2.5


def test_with_the_drag_of_another_flight_the_estimate_does_not_lose_against_a_constant(calibrated, tmp_path):
    """The constant is the mean of the true wind of each flight, unknown before its end; the drag is as sure as its file says."""
    autopilot, drag = calibrated
    flights = {
        "light": [(SQUARE, 1.5, 70, 31), (TRIANGLE, 2.0, 160, 32), (((2500, 600),), 2.5, 290, 33)],
        "stronger": [(((2500, 0),), 6.0, 205, 34)],
    }
    for kind, legs in flights.items():
        squares, by_constant = [], []
        for way, speed_mps, from_deg, seed in legs:
            path = tmp_path / f"{kind}{seed}.tlog"
            truth = fly(path, way, wind=(speed_mps, from_deg), speed_mps=14, seed=seed, autopilot=autopilot)
            miss, true = misses(replay(open_log(path), ReplayOptions(drag=drag.another_flight())), truth)
            squares.append((miss**2).sum(axis=1).mean())
            by_constant.append(((true - true.mean(axis=0)) ** 2).sum(axis=1).mean())
        rmse, constant = math.sqrt(np.mean(squares)), math.sqrt(np.mean(by_constant))
        print(
            f"{kind} wind: vector RMSE {rmse:.2f} m/s, of a constant {constant:.2f}; each {np.sqrt(squares).round(2)}"
        )
        assert rmse <= constant


def test_a_drag_wrong_by_30_percent_is_noticed_in_flight_and_the_right_one_is_not(calibrated, gusty):
    _, drag = calibrated
    path, _ = gusty
    wrong = DragModel(linear_per_s=1.3 * drag.linear_per_s, quadratic_per_m=1.3 * drag.quadratic_per_m, sigma_mps2=0.08)
    for used, expected in ((wrong, True), (drag, False)):
        notices = []
        replay(open_log(path), ReplayOptions(drag=used), notice=notices.append)
        said = [one for one in notices if "the drag in use is wrong" in one.text]
        assert bool(said) is expected


def test_a_wind_that_shifts_in_flight_is_followed_and_never_lost(calibrated, tmp_path):
    autopilot, drag = calibrated
    path = tmp_path / "shift.tlog"
    fault = parse_fault("wind-shift=9@120s")
    truth = fly(path, TRIANGLE, wind=(6, 300), speed_mps=16, seed=5, autopilot=autopilot, faults=(fault,))
    found = replay(open_log(path), ReplayOptions(drag=drag))
    miss, true = misses(found, truth)
    jump = int(np.argmax(np.hypot(*np.diff(true, axis=0).T)))
    size = np.hypot(*(true[jump + 2] - true[jump - 1]))
    settled = next(second for second in range(60) if (np.hypot(*miss[jump + second : jump + second + 5].T) < 1.5).all())
    print(f"a shift of {size:.1f} m/s is followed after {settled} s")
    assert size > 5.0
    assert settled <= 10
    assert found.wind.accepted[-60:].mean() > 0.95
