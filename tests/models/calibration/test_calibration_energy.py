"""Energy models fitted to flights predict flights that they have not seen."""

import math
from dataclasses import replace

import numpy as np
import pytest

from skyway.link.logs.reader import open_log
from skyway.models.base.errors import InputError
from skyway.models.calibration.energy import (
    SMOOTH_S,
    PowerRecord,
    calibrated,
    drone_file,
    fit_energy,
    power_record,
    published_errors,
)
from skyway.models.drones.drone import M200_V2
from skyway.models.drones.fleet import read_fleet
from skyway.models.drones.power import EnduranceEnergy, MomentumEnergy
from skyway.models.drones.telemetry import TelemetryTrack

M100 = replace(M200_V2, id="m100", name="DJI Matrice 100", mass_kg=3.68, max_payload_kg=1.0)


def made(model, masses, seconds=(20.0, 200.0, 30.0)):
    phases = ("climb", "cruise", "descent")
    return [
        PowerRecord(
            f"flight {mass}",
            mass,
            dict(zip(phases, seconds, strict=True)),
            {phase: model.power_w(mass, phase) * time_s for phase, time_s in zip(phases, seconds, strict=True)},
            0.0,
        )
        for mass in masses
    ]


def test_a_momentum_model_is_found_again():
    truth = MomentumEnergy({"climb": (75.0, 20.0), "cruise": (60.0, 30.0), "descent": (65.0, -5.0)}, 1.2)
    fit = fit_energy(made(truth, (3.7, 4.0, 4.3)), "momentum", M100, 1.2)
    assert fit.worst < 1e-9
    for phase, (b1, b0) in truth.coefficients.items():
        assert fit.model.coefficients[phase] == pytest.approx((b1, b0))


def test_an_endurance_model_is_found_again():
    truth = EnduranceEnergy(M100.battery_j, 3.68, 4.68, 1500.0, 1000.0)
    fit = fit_energy(made(truth, (3.7, 4.0, 4.3)), "endurance", M100, 1.2)
    assert fit.worst < 1e-9
    assert fit.model.kappa == pytest.approx(truth.kappa)


def test_flights_with_one_mass_give_a_model_without_an_offset_and_a_single_flight_no_error():
    records = made(MomentumEnergy(), (4.0,))
    fit = fit_energy(records, "momentum", M100, 1.225)
    assert math.isnan(fit.left_out_error[0])
    assert all(b0 == 0.0 for _, b0 in fit.model.coefficients.values())


@pytest.mark.parametrize("name", ["endurance", "momentum"])
def test_a_calibrated_drone_is_read_back_by_the_fleet_reader(tmp_path, name):
    fit = fit_energy(made(MomentumEnergy(), (3.7, 4.0, 4.3)), name, M100, 1.225)
    drone = calibrated(M100, fit)
    path = tmp_path / "drones.toml"
    path.write_text(drone_file(drone, ["fitted to three flights"]))
    (read,) = read_fleet(path)
    for mass in (3.68, 4.2, 4.68):
        for phase in ("climb", "cruise", "descent"):
            assert read.energy_model.power_w(mass, phase) == pytest.approx(fit.model.power_w(mass, phase))
    assert read.id == "m100"
    assert read.energy_belief == fit.belief
    assert read.energy_belief.leg_sd < 0.5 * M100.energy_belief.leg_sd


def test_a_log_without_power_is_refused():
    count = 100
    track = TelemetryTrack.of_columns(1, np.arange(count, dtype=float), {"vel_down_mps": np.zeros(count)})
    with pytest.raises(InputError, match="no battery power"):
        power_record("flight.bin", track, 4.0)


@pytest.fixture(scope="module")
def flights(shared_data):
    records = []
    for number in (268, 269, 271, 272, 276):
        log = open_log(shared_data / "power" / f"m100_flight_{number}.csv")
        (track,) = log.tracks()
        records.append(power_record(str(number), track, 3.68 + log.payload_kg))
    return records


@pytest.mark.parametrize("name", ["endurance", "momentum"])
def test_each_m100_flight_is_predicted_by_the_four_others(flights, name):
    """Targets: worst 10 %, median 2.4 % (what one coefficient on m^1.5 achieves)."""
    fit = fit_energy(flights, name, M100, 1.2)
    for record, error in zip(flights, fit.left_out_error, strict=True):
        print(f"{name}: flight {record.name}, {record.mass_kg:.2f} kg, {record.total_s:.0f} s: {error:+.1%}")
    assert fit.worst <= 0.04
    assert fit.median <= 0.02
    published = published_errors(flights, 1.2)
    assert fit.median < float(np.median(np.abs(published)))


def test_time_with_the_motors_off_is_left_out(flights):
    idle = {record.name: record.idle_s for record in flights}
    assert idle["269"] == pytest.approx(16.3, abs=0.5)
    assert max(value for name, value in idle.items() if name != "269") < 2.0


@pytest.mark.parametrize("stood_s", [245, 20_000])
def test_time_on_the_ground_does_not_change_the_flight_however_long_it_was(flights, shared_data, stood_s):
    """Rows of 8 W in front of a file that tells no states."""
    log = open_log(shared_data / "power" / "m100_flight_268.csv")
    (track,) = log.tracks()
    before_s = track.time_s[0] - np.arange(stood_s, 0.0, -0.2)
    ground = {"power_w": np.full(len(before_s), 8.0), "vel_down_mps": np.zeros(len(before_s))}
    whole = TelemetryTrack.joined([TelemetryTrack.of_columns(track.system, before_s, ground), track])
    record = power_record("268", whole, 3.68 + log.payload_kg)
    assert record.time_s == pytest.approx(flights[0].time_s, abs=0.5 * SMOOTH_S)
    assert record.total_j == pytest.approx(flights[0].total_j, rel=1e-3)
    assert record.idle_s == pytest.approx(stood_s + flights[0].idle_s, abs=1.0)


def test_a_disarmed_vehicle_does_not_fly(shared_data):
    """Real copter: on the ground at 5 to 7 W for the first 450 s, then 165 to 186 W in the air."""
    log = open_log(shared_data / "logs" / "dronekit_copter_flight.tlog")
    track = TelemetryTrack.joined(log.tracks())
    record = power_record("copter", track, 2.0)
    assert record.idle_s > 450.0
    assert 165.0 < record.total_j / record.total_s < 186.0


def test_an_armed_vehicle_on_the_ground_does_not_fly_whatever_it_draws():
    time_s = np.arange(0.0, 300.0, 0.2)
    columns = {"power_w": np.where(time_s < 200.0, 100.0, 200.0), "vel_down_mps": np.zeros_like(time_s)}
    columns |= {"armed": np.ones_like(time_s), "landed": (time_s < 200.0).astype(float)}
    record = power_record("flight", TelemetryTrack.of_columns(1, time_s, columns), 4.0)
    assert record.total_s == pytest.approx(100.0, abs=0.5)
    never = TelemetryTrack.of_columns(1, time_s, columns | {"armed": np.zeros_like(time_s)})
    with pytest.raises(InputError, match="no flight"):
        power_record("flight", never, 4.0)


def flown(step_s, **columns):
    """A flight of 300 s that climbs to 20 m, with 400 W."""
    time_s = np.arange(0.0, 300.0 + step_s / 2.0, step_s)
    height_m = np.interp(time_s, [0.0, 20.0, 280.0, 300.0], [0.0, 20.0, 20.0, 0.0])
    given = {"power_w": np.full(len(time_s), 400.0), "height_m": height_m} | columns
    return TelemetryTrack.of_columns(1, time_s, given)


@pytest.mark.parametrize("step_s", [0.1, 1.0, 2.0])
def test_a_flight_counts_in_full_however_often_it_was_sampled(step_s):
    record = power_record("slow", flown(step_s), 3.0)
    assert record.total_s == pytest.approx(300.0, abs=2.0 * step_s)
    assert record.total_j == pytest.approx(400.0 * 300.0, rel=0.02)


def test_a_pause_of_the_log_does_not_count_as_flight():
    track = flown(1.0)
    time_s = np.where(track.time_s > 150.0, track.time_s + 600.0, track.time_s)
    assert power_record("gap", TelemetryTrack(1, time_s, track.values), 3.0).total_s < 310.0


def test_climb_and_descent_are_found_from_the_height_if_there_is_no_vertical_speed():
    record = power_record("height", flown(0.2), 3.0)
    assert record.time_s["climb"] == pytest.approx(20.0, abs=1.5)
    assert record.time_s["descent"] == pytest.approx(20.0, abs=1.5)


def test_what_a_log_lacks_is_named():
    with pytest.raises(InputError, match="neither vertical speed nor height"):
        power_record("flight", flown(1.0, height_m=np.full(301, np.nan)), 3.0)
    with pytest.raises(InputError, match=r"negative battery power.*factor = -1"):
        power_record("flight", flown(1.0, power_w=np.full(301, -400.0)), 3.0)


def test_masses_in_the_wrong_order_are_refused(flights):
    """Power that falls as the mass rises is impossible."""
    right = made(MomentumEnergy(), (3.7, 4.0, 4.3))
    swapped = [replace(record, mass_kg=mass) for record, mass in zip(right, (4.3, 4.0, 3.7), strict=True)]
    for name in ("endurance", "momentum"):
        with pytest.raises(InputError, match="--payload: power falls as the mass rises"):
            fit_energy(swapped, name, M100, 1.225)
    real = [replace(record, mass_kg=7.86 - record.mass_kg) for record in flights]
    with pytest.raises(InputError, match="--payload"):
        fit_energy(real, "momentum", M100, 1.2)


def test_a_flight_given_twice_is_refused_whatever_its_name_and_load():
    records = made(MomentumEnergy(), (3.7, 4.0))
    for copy in (replace(records[0], name="copy"), replace(records[0], name="copy", mass_kg=4.2)):
        with pytest.raises(InputError, match=r"copy: is the same flight as flight 3\.7"):
            fit_energy([*records, copy], "momentum", M100, 1.225)
