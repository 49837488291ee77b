"""The independent world shares nothing with the product, and its parts agree with closed forms."""

import ast
import math
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.independent import ground, pads
from benchmarks.independent.product import planning
from benchmarks.independent.vehicle import battery, craft, energy
from benchmarks.independent.weather import profile, reports, series, turbulence, wind

FOLDER = Path(craft.__file__).parents[1]
DOOR = "product"
RUNNERS = {"study.py", "verdict.py", "left_out.py", "__main__.py"}
SHEET = energy.DataSheet(4.69, 1.45, 349.3 * 3600.0, 2280.0, 1440.0, 8064.0, 20.0, 20.0)
HOW = craft.Flying(20.0, 20.0, 5.0, 3.0, 60.0)


def rngs(count, word=0):
    return [np.random.default_rng((7, k, word)) for k in range(count)]


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", sorted(FOLDER.rglob("*.py")), ids=lambda path: path.name)
def test_only_one_room_imports_the_product(path):
    names = set(imported(path))
    top = {name.partition(".")[0] for name in names}
    own = {name for name in names if name.startswith("benchmarks")}
    if path.parent.name == DOOR:
        return
    assert top <= set(sys.stdlib_module_names) | {"numpy", "scipy", "benchmarks"}
    assert all(name.startswith("benchmarks.independent") for name in own)
    if path.name not in RUNNERS:
        assert not any(f".{DOOR}" in name for name in own)


def test_modules_are_small():
    assert all(len(path.read_text(encoding="utf-8").splitlines()) < 300 for path in FOLDER.rglob("*.py"))


# Reports


def test_reports_of_new_york_are_metars_without_the_bogus_row():
    sites = reports.new_york()
    assert [site.id for site in sites] == ["EWR", "JFK", "LGA"]
    for site in sites:
        assert np.all(np.diff(site.time_s) > 0.0)
        assert np.hypot(*site.wind.T).max() < 25.0  # 1048 mph are not among them
        observed = site.as_metars()
        assert np.all(observed.time_s % 3600.0 == 51 * 60.0)
        assert np.all(observed.out_s > observed.time_s)
    ewr = sites[0]
    first = int(np.searchsorted(ewr.time_s, 1357020000.0))  # 2013-01-01T06:00Z: 10.36 mph from 270
    assert ewr.wind[first] == pytest.approx([0.0, 10.35702 * 0.44704], abs=1e-5)


def test_nobody_is_told_a_report_before_it_is_out():
    site = reports.new_york()[1].as_metars()
    for k in (5, 100, 4000):
        assert site.latest(site.out_s[k]) == k
        assert site.latest(site.out_s[k] - 1.0) == k - 1
        assert site.latest(site.time_s[k]) == k - 1


# Wind


def some_sites():
    sites = [site.as_metars() for site in reports.new_york()]
    plane = ground.Plane(40.73, -73.97)
    return sites, plane, plane.xy([site.lat for site in sites], [site.lon for site in sites])


@pytest.mark.parametrize("between", ["steps", "lines", "spectrum"])
def test_the_wind_passes_through_every_report_at_its_time(between):
    sites, _, _ = some_sites()
    begin = np.full(2, 1365_000_000.0 - 1365_000_000.0 % 60.0)
    winds = series.SiteWinds(sites, between, begin, 12.0, rngs(2))
    for column, site in enumerate(sites):
        inside = np.flatnonzero((site.time_s >= begin[0]) & (site.time_s < begin[0] + 12 * 3600.0))
        for k in inside:
            found = winds.at(np.full(2, site.time_s[k] - begin[0]))[:, column]
            assert found == pytest.approx(np.tile(site.wind[k], (2, 1)), abs=1e-9)


def test_a_bridge_has_the_spectrum_and_the_hourly_change_asked_for():
    noise = series.coloured(np.random.default_rng(3), 4096, 200, 1.6)
    lag = 60
    assert np.sqrt(np.mean((noise[lag:] - noise[:-lag]) ** 2)) == pytest.approx(1.6, rel=0.05)
    lags = np.array([5, 10, 20, 40])
    change = [np.mean((noise[k:] - noise[:-k]) ** 2) for k in lags]
    slope = np.polyfit(np.log(lags), np.log(change), 1)[0]
    assert slope == pytest.approx(2.0 / 3.0, abs=0.06)  # structure function of an f^-5/3 spectrum


def test_a_field_passes_through_its_sites_and_has_the_kriging_variance_between_them():
    sites, plane, xy = some_sites()
    runs = 800
    begin = np.full(runs, 1365_000_000.0 - 1365_000_000.0 % 60.0)
    winds = series.SiteWinds(sites, "lines", begin, 2.0, rngs(runs))
    length = 20_000.0
    left = wind.leave_one_out(sites, plane, length)
    field = wind.RandomField(xy, winds, np.full(runs, length), [left] * runs, rngs(runs, 1))
    elapsed = np.full(runs, 1800.0)
    for k in range(len(sites)):
        there = field.at(np.tile(xy[k], (runs, 1)), elapsed)
        assert there == pytest.approx(winds.at(elapsed)[:, k], abs=1e-6)
    place = np.array([3_000.0, 8_000.0])
    weights, variance = wind.ordinary_weights(xy, place, length)
    found = field.at(np.tile(place, (runs, 1)), elapsed)
    error = found - np.einsum("s,rsc->rc", weights, winds.at(elapsed))
    assert np.abs(error.mean(axis=0)).max() < 0.2
    assert error.std() == pytest.approx(left.sill_mps * math.sqrt(variance), rel=0.08)


def test_the_sill_reproduces_the_errors_that_the_record_leaves():
    sites, plane, xy = some_sites()
    left = wind.leave_one_out(sites, plane, 15_000.0)
    variance = np.mean([wind.ordinary_weights(np.delete(xy, k, axis=0), xy[k], 15_000.0)[1] for k in range(3)])
    assert left.sill_mps * math.sqrt(variance) == pytest.approx(left.error_mps)
    assert 1.5 < left.error_mps < 2.2  # 2.5 to 2.7 m/s a component at flight height


def test_turbulence_has_its_intensity_and_falls_as_minus_five_thirds():
    runs = 200
    gusts = turbulence.Harmonics(rngs(runs), 60.0)
    mean = np.full(runs, 8.0)
    met = np.array([gusts.step(np.full(runs, 5.0), mean, 1.0) for _ in range(400)])
    share = (met / (8.0 * gusts.intensity[None, :, None])).reshape(-1, 2)
    assert share.std(axis=0) == pytest.approx([1.0, turbulence.LATERAL], rel=0.08)
    wave = np.geomspace(0.2, 1.0, 5)
    density = turbulence.longitudinal(wave, np.array(200.0))
    assert np.polyfit(np.log(wave), np.log(density), 1)[0] == pytest.approx(-5.0 / 3.0, abs=0.01)
    whole = np.geomspace(1e-7, 1e3, 200_000)
    for spectrum in (turbulence.longitudinal, turbulence.lateral):
        assert np.trapezoid(spectrum(whole, np.array(200.0)), whole) == pytest.approx(1.0, abs=0.01)


def test_the_product_s_gusts_have_the_product_s_size():
    gusts = turbulence.Relaxing(rngs(3000))
    mean = np.full(3000, 10.0)
    steps = np.array([gusts.step(mean, mean, 30.0) for _ in range(7)])
    assert steps[-1].std(axis=0) == pytest.approx([1.5, 1.2], rel=0.05)
    kept = np.corrcoef(steps[0, :, 0], steps[6, :, 0])[0, 1]
    assert kept == pytest.approx(math.exp(-1.0), abs=0.06)  # 180 s later


def test_the_profile_is_steeper_in_calm_nights_than_by_day_and_neutral_in_storms():
    begin = np.full(500, 1373_414_400.0)  # midnight UTC
    stability = profile.Stability(rngs(500), begin, 24.0, 0.0)
    noon = stability.exponent(begin + 12 * 3600.0, np.full(500, 2.0))
    night = stability.exponent(begin + 1 * 3600.0, np.full(500, 2.0))
    storm = stability.exponent(begin + 1 * 3600.0, np.full(500, 12.0))
    for found, (low, high) in ((noon, profile.DAY), (night, profile.NIGHT), (storm, profile.NEUTRAL)):
        assert low - 1e-9 <= found.min()
        assert found.max() <= high + 1e-9
        assert found.mean() == pytest.approx(0.5 * (low + high), abs=0.02)
    later = stability.exponent(begin + 2 * 3600.0, np.full(500, 2.0))
    assert np.corrcoef(night, later)[0, 1] > 0.6


# Craft, energy, battery


class Constant:
    by_segment = False

    def __init__(self, north, east):
        self.value = np.array([north, east])

    def at(self, xy, elapsed_s):
        return np.tile(self.value, (len(xy), 1))


class Still:
    def step(self, path_m, mean_mps, dt_s):
        return np.zeros((len(path_m), 2))


def flown(north, east, course_deg, runs=1, gusts=None, length=9_000.0, power=None):
    air = craft.Air(Constant(north, east), profile.PowerLaw(0.0), 60.0)
    angle = math.radians(course_deg)
    end = np.tile([length * math.cos(angle), length * math.sin(angle)], (runs, 1))
    zero = np.zeros(runs)
    return craft.cruise(
        air, gusts or Still(), power or energy.Flat(SHEET, 0.8), HOW, (np.zeros((runs, 2)), end), zero, zero, 0.5 * end
    )


@pytest.mark.parametrize(
    ("north", "east", "course"), [(-6.0, 0.0, 0.0), (3.0, -7.0, 60.0), (-2.0, 5.0, 300.0), (4.0, 4.0, 45.0)]
)
def test_a_flight_in_constant_wind_takes_its_closed_form(north, east, course):
    angle = math.radians(course)
    along = north * math.cos(angle) + east * math.sin(angle)
    across = -north * math.sin(angle) + east * math.cos(angle)
    speed = min(along + math.sqrt(400.0 - across**2), 20.0)
    found = flown(north, east, course)
    assert found.took_s[0] == pytest.approx(9_000.0 / speed, rel=1e-9)
    assert found.energy_j[0] == pytest.approx(9_000.0 / speed * SHEET.hover_w(0.8), rel=1e-9)
    assert found.wind[0] == pytest.approx([north, east])


def test_out_and_back_through_the_air_takes_longer_than_in_still_air():
    there, back = flown(5.0, 0.0, 0.0), flown(5.0, 0.0, 180.0)
    assert there.took_s + back.took_s > 2 * flown(0.0, 0.0, 0.0).took_s


@pytest.mark.parametrize("payload", [0.0, 1.45])
def test_hover_takes_what_the_data_sheet_says(payload):
    endurance = SHEET.empty_s if payload == 0.0 else SHEET.full_s
    assert SHEET.battery_j / SHEET.hover_w(payload) == pytest.approx(endurance)
    law = energy.Momentum(SHEET, payload, rngs(50))
    law.density = np.full(50, energy.DENSITY_KG_M3)
    law.area_m2 = np.zeros(50)
    assert law(np.zeros(50), 0.0) == pytest.approx(np.full(50, SHEET.battery_j / endurance))


def test_momentum_power_dips_and_rises_and_a_climb_lifts_the_weight():
    law = energy.Momentum(SHEET, 0.8, rngs(50))
    watts = np.array([law(np.full(50, v), 0.0) for v in (0.0, 10.0, 20.0, 25.0)])
    assert np.all(watts[1] < watts[0])
    assert np.all(watts[2] > watts[1])
    assert np.all(watts[3] > watts[0])
    rise = law(np.full(50, 5.0), 5.0) - law(np.full(50, 5.0), 0.0)
    assert np.all(rise > (4.69 + 0.8) * 9.80665 * 5.0)  # motors and wires lose some


def test_induced_power_obeys_glauert():
    law = energy.Momentum(SHEET, 0.0, rngs(1))
    speed = 13.0
    thrust = 5.0 * energy.G_MPS2
    v = float(law._induced_w(5.0, 1.225, speed)) / law.INDUCED / thrust
    hover = thrust / (2.0 * 1.225 * law.DISC_M2)
    assert v**4 + speed**2 * v**2 == pytest.approx(hover**2)


def test_charging_meets_the_data_sheet_and_its_inverse():
    curve = battery.Charging(8064.0)
    assert curve.soc(8064.0) == pytest.approx(1.0)
    assert curve.soc(1.28 * 3600.0) == pytest.approx(0.8)
    for soc in (0.0, 0.3, 0.8, 0.9, 0.99):
        assert curve.soc(curve.time_s(soc)) == pytest.approx(soc, abs=1e-9)
    rates = np.diff([curve.soc(t) for t in np.linspace(0.0, 8064.0, 50)])
    assert np.all(np.diff(rates) < 1e-9)


def test_used_batteries_hold_less_and_gauges_flatter_in_the_cold():
    cold = battery.cold(rngs(400), 100.0, np.full(400, -5.0))
    warm = battery.cold(rngs(400), 100.0, np.full(400, 25.0))
    assert battery.old(rngs(400), 100.0).holds_j == pytest.approx(warm.holds_j)
    assert warm.holds_j.min() >= 80.0
    assert warm.holds_j.max() <= 100.0
    assert cold.holds_j == pytest.approx(0.875 * warm.holds_j)
    assert np.mean([cold.told_one(k, 0.2) - 0.2 for k in range(400)]) > 0.03
    for k in range(20):
        assert cold.told_one(k, cold.true_one(k, 0.7)) == pytest.approx(0.7)


# Pads


def erlang_c(servers, load):
    terms = [load**k / math.factorial(k) for k in range(servers)]
    last = load**servers / math.factorial(servers) * servers / (servers - load)
    return last / (sum(terms) + last)


def test_queues_wait_as_erlang_says():
    rng = np.random.default_rng(5)
    rate, mean, servers = 3.5 / 3600.0, 3600.0, 5
    came = np.cumsum(rng.exponential(1.0 / rate, 60_000))
    service = pads.services(rng, np.full(60_000, mean), "exponential")
    began = np.array(pads.pad_starts(came.tolist(), service.tolist(), servers))
    waits = (began - came)[1000:]
    chance = erlang_c(servers, 3.5)
    assert np.mean(waits > 0.0) == pytest.approx(chance, abs=0.03)
    assert waits.mean() == pytest.approx(chance * mean / (servers - 3.5), rel=0.12)


def test_one_who_comes_waits_for_those_before_it_and_not_for_those_behind():
    line = pads.Line(1, 1, 0, [0.0, 10.0, 30.0], [0.0, 100.0, 150.0], [100.0, 50.0, 50.0], [100.0, 150.0, 200.0])
    assert line.pad_time(20.0) == 150.0
    assert line.place_time(20.0) == 100.0  # one on the pad, one on the spot
    assert line.present(40.0) == 3
    assert line.before(20.0, 40.0) == 2
    assert line.before(20.0, 120.0) == 1
    assert line.pad_time(250.0) == 250.0


def test_thinning_keeps_the_hourly_rates_and_lognormal_times_their_mean():
    rng = np.random.default_rng(1)
    rate = np.zeros(168)
    rate[:3] = np.array([2.0, 0.0, 8.0]) / 3600.0
    came = np.concatenate([pads.arrivals(rng, rate, (0, 1, 2), 0.0) for _ in range(2000)])
    found = np.histogram(came, bins=[0.0, 3600.0, 7200.0, 10800.0])[0] / 2000
    assert found == pytest.approx([2.0, 0.0, 8.0], rel=0.04)
    assert pads.services(rng, np.full(50_000, 60.0), "lognormal").mean() == pytest.approx(60.0, rel=0.02)


def test_distances_on_the_plane_are_those_of_the_ellipsoid():
    plane = ground.Plane(40.7, -74.0)
    ends = plane.xy([40.6386, 40.7794], [-73.7622, -73.8803])  # JFK to LaGuardia
    assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(18_550.0, rel=0.002)
    assert plane.xy(41.7, -74.0)[0] == pytest.approx(111_050.0, rel=2e-4)


@pytest.mark.skipif(not reports.WIND.exists(), reason="the records are beside the checkout")
@pytest.mark.parametrize(
    ("read", "count", "unit_mps"), [(reports.melbourne, 4392, 1 / 3.6), (reports.london, 64_725, 0.1)]
)
def test_records_of_one_site_are_read_in_their_units_and_clocks(read, count, unit_mps):
    (site,) = read()
    assert len(site.time_s) == pytest.approx(count, abs=2)
    assert np.all(np.diff(site.time_s) >= 3600.0)
    assert 1.0 < np.hypot(*site.wind.T).mean() < 6.0
    assert np.hypot(*site.wind[5]) == pytest.approx(
        round(float(np.hypot(*site.wind[5])) / unit_mps, 2) * unit_mps, abs=0.01
    )


@pytest.mark.skipif(not reports.WIND.exists(), reason="the records are beside the checkout")
def test_london_is_new_yorks_network_about_another_anemometer():
    here, there = planning.scenario_of("london"), planning.scenario_of("new-york")
    assert here.network.distance_m == pytest.approx(there.network.distance_m, rel=2e-3)
    (site,) = here.wind_sites
    assert np.hypot(here.network.lat.mean() - site.lat, here.network.lon.mean() - site.lon) < 0.01
    assert len(here.history) == 65_533
