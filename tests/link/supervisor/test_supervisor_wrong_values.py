"""What a vehicle tells wrongly for a while, or somebody in its name, brings it down nowhere but at a station."""

import math
import random

import pytest
from failing_packs import CAPACITY_J, HOVER_W, LANDING_S, MOMENTS_S
from failing_packs import fly as fly_battery
from wrong_values import KINDS, PACKETS, Wrong, fields_read, fly_each_wrong, fly_wrong

from benchmarks.link.deliveries import Story
from skyway.link.supervisor.observed.vehicle_state import flies
from skyway.link.supervisor.soc.reported_soc import ReportedSoc
from skyway.link.supervisor.soc.voltage import VoltageWatch, open_voltage
from skyway.link.telemetry.plausible import STRANGE_BOOTS, BootTimes, Plausible
from skyway.models.drones.telemetry import TelemetrySample
from skyway.sim_stub.faults import parse_fault

AUTOPILOTS = ("px4", "ardupilot")
SAFE = ("delivered", "held", "stopped")
STATES = (("flying", 60.0), ("flying", 5.0), ("charging", 0.0), ("connecting", 0.0), ("preflight", 0.0), ("arming", 0.0),
          ("flying", 90.0), ("landed", 0.0))  # fmt: skip
LANDING_SOC = LANDING_S * 0.9 * HOVER_W / CAPACITY_J
UNREAD = (("MISSION_CURRENT", "mission_id"), ("MISSION_CURRENT", "fence_id"))
"""Read from the payload itself: pymavlink's tables do not have them."""
BURSTS = (
    Wrong("SYS_STATUS", "battery_remaining", "plausible", 10, after_s=40.0),
    Wrong("SYS_STATUS", "voltage_battery", "plausible", 10, after_s=70.0),
    Wrong("HEARTBEAT", "base_mode", "plausible", 10, after_s=100.0),
    Wrong("EXTENDED_SYS_STATE", "landed_state", "plausible", 10, after_s=130.0),
    Wrong("GLOBAL_POSITION_INT", "lat", "plausible", 100, after_s=150.0),
    Wrong("HEARTBEAT", "custom_mode", "plausible", 1, after_s=180.0),
    Wrong("ATTITUDE", "time_boot_ms", "plausible", 10, after_s=190.0),
    Wrong("SYS_STATUS", "battery_remaining", "zero", 10, after_s=205.0),
    Wrong("GLOBAL_POSITION_INT", "vx", "high", 10, after_s=220.0),
)


def delivery(autopilot, **how):
    return Story(autopilot=autopilot, start="bellevue", to="city-hall", soc=0.3, traffic=False, **how)


def short_delivery(autopilot):
    """The shortest there is that charges first."""
    return Story(autopilot=autopilot, start="jersey-city", to="hoboken", soc=0.38, traffic=False)


@pytest.mark.parametrize("autopilot", ["px4", pytest.param("ardupilot", marks=pytest.mark.slow)])
def test_wrong_values_one_after_the_other_in_one_flight_change_nothing(autopilot, tmp_path):
    ended = fly_wrong(delivery(autopilot), tmp_path, *BURSTS)
    assert ended.kind == "delivered", ended
    assert ended.done == tuple(wrong.packets for wrong in BURSTS)


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_forger_beside_the_vehicle_is_not_believed(autopilot, tmp_path):
    forged = Wrong("SYS_STATUS", "battery_remaining", "zero", 100, forged=True)
    assert fly_wrong(delivery(autopilot), tmp_path, forged).kind == "delivered"


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_on_a_signed_link_a_forger_is_not_even_heard(autopilot, tmp_path):
    for number, (message, name) in enumerate((("HEARTBEAT", "base_mode"), ("SYS_STATUS", "battery_remaining"))):
        wrong = Wrong(message, name, "plausible", 100, forged=True)
        assert fly_wrong(delivery(autopilot), tmp_path / str(number), wrong, key=bytes(range(32))).kind == "delivered"


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("part", range(16))
def test_every_field_that_is_read_may_be_wrong_for_a_while(autopilot, part, tmp_path, monkeypatch):
    """Each field with each kind of wrong value; numbers of packets, states and forgers are drawn."""
    story = short_delivery(autopilot)
    found = [*fields_read(story, tmp_path / "watched", monkeypatch), *UNREAD]
    wrongs = []
    for message, name in found[part::16]:
        for kind in KINDS:
            for packets in PACKETS:
                luck = random.Random(f"{message}.{name}/{kind}/{packets}")
                wrongs.append(Wrong(message, name, kind, packets, *luck.choice(STATES), forged=luck.random() < 0.3))
    assert wrongs
    ended = fly_each_wrong(story, tmp_path / "wrong", wrongs)
    assert not {wrong: end for wrong, end in ended.items() if end.kind not in SAFE}


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
@pytest.mark.parametrize("seed", range(4))
def test_a_voltage_told_wrongly_lands_no_healthy_vehicle_in_the_street(autopilot, seed, tmp_path):
    """Far from stations, in climb, turn, gusts and level flight, by much and by little, for one packet to a hundred."""
    luck = random.Random(f"street/{seed}")
    faults = tuple(parse_fault(f"gust={luck.uniform(4.0, 8.0):.1f}@T+{at}s+20s") for at in (40, 160, 300))
    story = Story(autopilot=autopilot, start="bellevue", to="yankee-stadium", seed=seed, faults=faults, traffic=False)
    moments = [
        luck.choice((1.0, 6.0)),
        luck.choice((12.0, 17.0)),
        luck.choice((24.0, 40.0, 90.0)),
        luck.uniform(100, 350),
    ]
    wrongs = [
        Wrong("SYS_STATUS", "voltage_battery", f"times {luck.uniform(0.6, 0.97):.3f}", packets, "flying", after_s)
        for after_s in moments
        for packets in (10, 100)
    ]
    ended = fly_each_wrong(story, tmp_path, wrongs)
    assert not {wrong: end for wrong, end in ended.items() if end.kind not in SAFE}


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", AUTOPILOTS)
def test_a_voltage_told_too_high_lands_no_healthy_vehicle_in_the_street(autopilot, tmp_path):
    story = Story(autopilot=autopilot, start="bellevue", to="yankee-stadium", seed=1, traffic=False)
    wrongs = [
        Wrong("SYS_STATUS", "voltage_battery", f"times {factor}", packets, "flying", after_s)
        for after_s, factor in ((6.0, 1.2), (90.0, 1.1), (186.0, 1.33))
        for packets in (10, 100)
    ]
    ended = fly_each_wrong(story, tmp_path, wrongs)
    assert {end.kind for end in ended.values()} == {"delivered"}, ended


# The charge told


RATE = 0.0008


def told_flight(reports, *, soc=0.8, drop=0.0, at=100, seconds=300, volts_known=True, seed=1):
    """Fly with a true charge and reports made of it; returns what was believed each second, and the truth."""
    luck, told, believed, truth = random.Random(seed), ReportedSoc(), [], []
    for second in range(seconds):
        soc -= RATE + (drop if second == at else 0.0)
        volts = 6.0 * open_voltage(max(soc, 0.0)) + luck.gauss(0.0, 0.03)
        told.hear(float(second), reports(second, soc), volts if volts_known else math.nan, RATE * 1.2, flies=True)
        believed.append(told.line(float(second), RATE * 1.2))
        truth.append(soc)
    return believed, truth


@pytest.mark.parametrize("packets", [1, 3, 10, 100])
@pytest.mark.parametrize("wrong", [0.0, 0.05, 0.3, 0.5, 1.0, math.nan])
def test_a_charge_told_wrongly_is_not_believed_where_the_voltage_says_otherwise(packets, wrong):
    believed, truth = told_flight(lambda n, soc: wrong if 100 <= n < 100 + packets else soc)
    assert max(abs(one - other) for one, other in zip(believed, truth, strict=True)) < 0.08


@pytest.mark.parametrize("seed", range(20))
def test_a_charge_that_is_lost_is_believed_within_seconds(seed):
    luck = random.Random(f"lost/{seed}")
    drop, soc = luck.uniform(0.3, 0.6), luck.uniform(0.75, 1.0)
    believed, truth = told_flight(lambda _, soc: soc, soc=soc, drop=drop, seed=seed)
    late = next(n for n in range(100, 300) if abs(believed[n] - truth[n]) < 0.05) - 100
    assert late <= 5


def test_reports_of_before_a_counter_was_set_are_no_loss():
    told = ReportedSoc()
    for second in range(60):
        told.hear(float(second), 0.38, math.nan, 0.0, flies=False)
    told.measured(60.0, 0.73)
    for second, soc in ((58.0, 0.38), (59.0, 0.38), (61.0, 0.73), (62.0, 0.72)):
        assert told.hear(second, soc, math.nan, 0.0006, flies=second > 61.5) == 0.0
        assert told.line(second, 0.0006) == pytest.approx(0.73, abs=0.015)


def test_without_a_voltage_a_charge_must_be_told_for_longer_than_a_burst():
    burst, truth = told_flight(lambda n, soc: 0.1 if 100 <= n < 200 else soc, volts_known=False)
    assert max(abs(one - other) for one, other in zip(burst, truth, strict=True)) < 0.08
    lasting, _ = told_flight(lambda n, soc: 0.1 if n >= 100 else soc, volts_known=False)
    assert lasting[240] == pytest.approx(0.1, abs=0.01)


def watched(seconds, volts_of, *, soc=0.8, constant_power=True):
    """Fly by a battery whose voltage is measured wrongly, or fails; returns the watch and what it said."""
    watch, said, luck = VoltageWatch(ohm=0.02), [], random.Random(3)
    for second in range(seconds):
        true_v = 6.0 * open_voltage(soc - RATE * second)
        volts, real = volts_of(second, true_v)
        amperes = luck.gauss(720.0, 15.0) / (real if constant_power else true_v)
        said.append(watch.hear(float(second), volts, amperes, soc - RATE * second))
    return watch, said


def test_a_voltage_that_is_measured_wrongly_is_doubted_and_what_was_lost_comes_back():
    burst, said = watched(200, lambda n, v: (0.9 * v if 100 <= n < 160 else v, v))
    assert sum(said) == pytest.approx(0.0, abs=1e-9)
    assert max(said) > 0.1
    assert burst.lost == pytest.approx(0.0, abs=1e-9)
    lasting, _ = watched(150, lambda n, v: (0.9 * v if n >= 100 else v, v))
    assert lasting.doubtful()
    left_v = [6.0 * open_voltage(0.12 - RATE * n) for n in range(95)]
    failed, _ = watched(195, lambda n, v: (left_v[n - 100], left_v[n - 100]) if n >= 100 else (v, v))
    assert failed.lost > 0.1
    assert not failed.doubtful()


@pytest.mark.parametrize("packets", [10, 60, 100])
@pytest.mark.parametrize("factor", [1.04, 1.1, 1.2, 1.34])
def test_a_voltage_that_was_told_too_high_loses_nothing_when_it_is_told_rightly_again(factor, packets):
    watch, said = watched(400, lambda n, v: (factor * v if 100 <= n < 100 + packets else v, v))
    assert not any(said)
    assert watch.lost == 0.0


@pytest.mark.parametrize("gap", [0, 5, 60, 150])
@pytest.mark.parametrize("packets", [3, 10, 100])
def test_a_pack_that_fails_after_its_voltage_was_told_too_high_is_noticed(packets, gap):
    fails = 100 + packets + gap

    def volts(second, true_v):
        failed_v = 6.0 * open_voltage(max(0.15 - RATE * (second - fails), 0.0))
        real = true_v if second < fails else failed_v
        return (1.2 * real if 100 <= second < 100 + packets else real), real

    watch, said = watched(fails + 150, volts)
    assert next(second for second, lost in enumerate(said) if lost > 0.1) <= fails + 8
    assert not watch.doubtful(affordable=False)


def test_a_voltage_that_falls_on_as_that_of_an_empty_battery_is_not_doubted():
    def falling(rate):
        watch = VoltageWatch(ohm=0.02)
        for second in range(140):
            volts = 6.0 * open_voltage(0.8 - RATE * second)
            error = 1.0 if second < 100 else 0.9 - rate * (second - 100)
            watch.hear(float(second), volts * error, 700.0 / (volts * error), 0.8 - RATE * second)
        assert watch.lost > 0.1
        return watch

    assert falling(0.0).doubtful()
    assert not falling(0.001).doubtful()


def test_an_error_that_grows_and_takes_the_measured_power_with_it_is_no_battery_that_goes_empty():
    watch = VoltageWatch(ohm=0.02)
    for second in range(160):
        volts = 6.0 * open_voltage(0.8 - RATE * second)
        error = 1.0 if second < 100 else 0.85 - 0.001 * (second - 100)
        watch.hear(float(second), volts * error, 700.0 / volts, 0.8 - RATE * second)
    assert watch.lost > 0.1
    assert watch.doubtful(affordable=False)


def forged_flight(number):
    """A flight with a sound battery whose voltage is told wrongly: how, from when on, and what became of it."""
    luck = random.Random(f"forged/{number}")
    at_s = MOMENTS_S[list(MOMENTS_S)[number % len(MOMENTS_S)]] + luck.randrange(5)
    packets = luck.choice((1, 3, 10, 100))
    how = {
        "soc": luck.choice((1.0, 0.9, 0.7, 0.5, 0.4, 0.3)), "factor": luck.uniform(0.6, 0.97), "packets": packets,
        "at_s": at_s, "gusts": luck.choice((0.01, 0.03, 0.06, 0.1)),
    }  # fmt: skip
    return how, fly_battery(10_000 + number, **how), int(at_s) + packets + 12


def check_forged(number):
    how, flown, over = forged_flight(number)
    condemned = [k for k, (lost, doubt) in enumerate(zip(flown.lost, flown.doubted, strict=True)) if lost and not doubt]
    assert not condemned, (how, condemned)
    assert max(flown.lost[over:], default=0.0) < 1e-9, how


def check_failing(number):
    """A pack that fails is believed to have while the charge that is left is enough for a landing."""
    luck = random.Random(f"fails/{number}")
    at_s = MOMENTS_S[list(MOMENTS_S)[number % len(MOMENTS_S)]] + luck.randrange(5)
    soc = luck.choice((1.0, 0.9, 0.7))
    how = {
        "soc": soc,
        "left": luck.uniform(0.05, soc - 0.4),
        "at_s": at_s,
        "gusts": luck.choice((0.01, 0.03, 0.06, 0.1)),
    }
    flown = fly_battery(20_000 + number, seconds=800, **how)
    each = zip(flown.lost, flown.doubted, flown.soc, strict=True)
    believed = next((left for lost, doubt, left in each if lost and not doubt and left < 0.2), min(flown.soc))
    assert believed > LANDING_SOC, (how, believed)


@pytest.mark.parametrize("number", range(14))
def test_a_voltage_told_wrongly_at_any_moment_of_a_flight_condemns_no_sound_battery(number):
    check_forged(number)


@pytest.mark.parametrize("number", range(14))
def test_a_pack_that_fails_at_any_moment_of_a_flight_is_believed_in_time_to_land(number):
    check_failing(number)


@pytest.mark.slow
def test_voltages_told_wrongly_and_packs_that_fail_are_told_apart_in_a_thousand_flights():
    for number in range(1_000, 1_500):
        check_forged(number)
        check_failing(number)


# What cannot be


def place(second, **other):
    north = 10.0 * second
    told = {"lat_deg": 40.7 + north / 111_045.0, "lon_deg": -74.0, "alt_msl_m": 80.0, "height_m": 60.0,
            "vel_north_mps": 10.0, "vel_east_mps": 0.0, "vel_down_mps": 0.0}  # fmt: skip
    return told | other


@pytest.mark.parametrize("other", [{"lat_deg": 40.8}, {"lat_deg": 0.0}, {"lon_deg": math.nan}, {"lon_deg": 3e9},
                                   {"alt_msl_m": -4e5}, {"height_m": 20.0}])  # fmt: skip
def test_a_place_where_it_cannot_be_is_unknown_until_it_is_back_or_stays(other):
    checked = Plausible()
    checked.hear({"landed": 0.0}, 0.0)
    for second in range(50):
        assert checked.hear(place(second), float(second))["lat_deg"] == pytest.approx(place(second)["lat_deg"])
    for second in range(50, 70):
        assert math.isnan(checked.hear(place(second, **other), float(second))["lat_deg"])
    assert checked.hear(place(70), 70.0)["lat_deg"] == pytest.approx(place(70)["lat_deg"])


def test_a_speed_that_jumps_is_unknown_and_one_that_changes_as_a_vehicle_does_is_not():
    checked = Plausible()
    checked.hear(place(0), 0.0)
    assert math.isnan(checked.hear(place(0.2, vel_east_mps=40.0), 0.2)["vel_east_mps"])
    assert checked.hear(place(0.4, vel_east_mps=2.0), 0.4)["vel_east_mps"] == 2.0
    assert math.isnan(checked.hear(place(0.6, vel_down_mps=math.inf), 0.6)["vel_down_mps"])


@pytest.mark.parametrize("factor", [0.97, 0.8, 0.74, 0.694, 0.66, 0.6, 0.3, 0.0, 1.2, 1.3, 1.4, 1.6])
@pytest.mark.parametrize("packets", [1, 10, 20, 100])
def test_a_voltage_is_known_again_as_soon_as_it_is_told_rightly_again(factor, packets):
    checked = Plausible()
    for second in range(60):
        assert checked.hear({"voltage_v": 25.0}, float(second))["voltage_v"] == 25.0
    for second in range(60, 60 + packets):
        known = checked.hear({"voltage_v": 25.0 * factor}, float(second))["voltage_v"]
        assert known == 25.0 * factor if 0.65 < factor < 1.35 else math.isnan(known)
    for second in range(60 + packets, 100 + packets):
        assert checked.hear({"voltage_v": 25.0}, float(second))["voltage_v"] == 25.0


@pytest.mark.parametrize("volts", [0.0, 12.0, 50.0])
def test_a_voltage_that_stays_elsewhere_is_believed_and_so_are_those_after_it(volts):
    checked = Plausible()
    for second in range(60):
        checked.hear({"voltage_v": 25.0}, float(second))
    known = [checked.hear({"voltage_v": volts}, 60.0 + second)["voltage_v"] for second in range(300)]
    assert all(math.isnan(one) for one in known[:120])
    assert known[120:] == [volts] * 180


def test_a_time_since_boot_that_jumps_is_left_out_and_a_restart_is_not():
    times = BootTimes()
    assert all(times.believed(1000.0 * second, second) for second in range(100, 200))
    for second in range(200, 300):
        assert not times.believed(3e6, second)
        assert not times.believed(0.0, second)
        assert times.believed(1000.0 * second, second)
    restart = [times.believed(100.0 * n, 300.0 + 0.1 * n) for n in range(STRANGE_BOOTS + 5)]
    assert restart == [False] * (STRANGE_BOOTS - 1) + [True] * 6


def test_one_witness_alone_lands_no_vehicle_and_lifts_none():
    known = {
        "landed": 0.0,
        "vel_north_mps": 9.0,
        "vel_east_mps": 0.0,
        "vel_down_mps": 0.0,
        "current_a": 31.0,
        "armed": 1.0,
    }
    stands = {
        "landed": 1.0,
        "vel_north_mps": 0.0,
        "vel_east_mps": 0.0,
        "vel_down_mps": 0.0,
        "current_a": 0.6,
        "armed": 0.0,
    }
    for truth, other in ((known, stands), (stands, known)):
        up = flies(TelemetrySample(time_s=0.0, **truth))
        assert up is (truth is known)
        for name in ("landed", "vel_north_mps", "current_a"):
            for wrong in (other[name], math.nan):
                assert flies(TelemetrySample(time_s=0.0, **(truth | {name: wrong}))) is up
    assert flies(TelemetrySample(time_s=0.0)) is None
