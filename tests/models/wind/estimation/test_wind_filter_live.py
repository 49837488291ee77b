"""The filter as it flies: sample by sample, with nothing known of what comes later."""

from dataclasses import replace

import numpy as np
import pytest
from batch_filter import filter_log
from drone_truth import fly

from skyway.models.drones.drag import DragModel
from skyway.models.wind.ensemble import WindEnsemble
from skyway.models.wind.estimation.blocks import blocks
from skyway.models.wind.estimation.forecast_update import update_forecast
from skyway.models.wind.estimation.live import LiveWind, forecast_of, settings_for
from skyway.models.wind.estimation.measurement import measurements

DRAG = DragModel(linear_per_s=0.15, quadratic_per_m=0.010, sigma_mps2=0.115)


@pytest.fixture(scope="module")
def flight():
    return fly(seed=11, duration_s=180.0, sigma_mps=0.7).track(0)


def test_sample_by_sample_gives_the_same_as_the_whole_log_at_once(flight):
    live, whole = LiveWind(drag=DRAG), LiveWind(drag=DRAG)
    heard = [now for sample in flight.samples() if (now := live.hear(sample)) is not None]
    course = whole.feed(flight)
    assert [now.time_s for now in heard] == course.time_s.tolist()
    assert [now.north_mps for now in heard] == course.wind[:, 0].tolist()
    assert live.check_drag() == whole.check_drag()
    assert live.observations() == whole.observations()


def test_live_and_the_compiled_filter_over_a_log_agree(flight):
    live = LiveWind(drag=DRAG, forecast=lambda *_: (-4.0, 3.0))
    course = live.feed(flight)
    taken = measurements(blocks(flight), DRAG)
    log = filter_log(taken.time_s, taken.wind, taken.noise, np.array([-4.0, 3.0]), live.settings)
    common = np.isin(course.time_s, log.time_s)
    assert common.sum() == len(log)
    assert course.wind[common] == pytest.approx(log.wind, abs=1e-9)
    assert course.nis[common] == pytest.approx(log.nis, abs=1e-9)


def test_an_estimate_is_at_most_a_period_old_and_knows_nothing_of_the_future(flight):
    short, long = LiveWind(drag=DRAG), LiveWind(drag=DRAG)
    for number, sample in enumerate(flight.samples()):
        now = long.hear(sample)
        if number < 905:
            short.hear(sample)
        if number == 904:
            early = now or long.estimate
            assert sample.time_s - early.time_s <= 1.0 + 0.5
    assert short.estimate == early


def test_a_late_sample_is_left_out(flight):
    samples = list(flight.samples())
    live = LiveWind(drag=DRAG)
    for sample in [*samples[:500], samples[100], *samples[500:600]]:
        live.hear(sample)
    straight = LiveWind(drag=DRAG)
    for sample in samples[:600]:
        straight.hear(sample)
    assert live.estimate == straight.estimate


def test_before_take_off_the_wind_is_the_forecast_and_after_landing_that_of_the_last_leg(flight):
    live = LiveWind(drag=DRAG, forecast=lambda *_: (-4.0, 3.0))
    ground = [replace(sample, landed=1.0) for sample in flight.samples()]
    for sample in ground[:100]:
        live.hear(sample)
    assert (live.estimate.source, live.estimate.north_mps) == ("forecast", -4.0)
    shift = flight.time_s[-1] - flight.time_s[0] + 20.0
    for sample in flight.samples():
        live.hear(replace(sample, time_s=sample.time_s + 20.0))
    flown = live.estimate
    for sample in ground[:600]:
        live.hear(replace(sample, time_s=sample.time_s + shift))
    assert (flown.source, live.estimate.source) == ("measured", "held")
    assert live.estimate.north_mps == pytest.approx(flown.north_mps, abs=0.5)
    assert live.estimate.sigma_mps > flown.sigma_mps


def test_what_a_drone_measures_updates_a_forecast(flight):
    generator = np.random.default_rng(0)
    before = WindEnsemble(
        site_lat=np.array([47.0]),
        site_lon=np.array([8.0]),
        start_s=float(flight.time_s[0]) - 600.0,
        slot_s=3600.0,
        north=np.repeat(generator.normal(0.0, 3.0, (20, 1, 1)), 6, axis=1),
        east=np.repeat(generator.normal(0.0, 3.0, (20, 1, 1)), 6, axis=1),
        probability=np.full(20, 0.05),
        labels=tuple(map(str, range(20))),
        height_m=60.0,
    )
    live = LiveWind(drag=DRAG, forecast=forecast_of(before), settings=settings_for(before))
    live.feed(flight)
    after = update_forecast(before, live.observations())
    mean = forecast_of(after)(float(flight.time_s[-1]), 47.0, 8.0, 60.0)
    assert mean == pytest.approx((-4.0, 3.0), abs=1.2)
    assert settings_for(after).sigma_mps < settings_for(before).sigma_mps


@pytest.mark.parametrize("every_s", [5.0, 17.0])
def test_samples_worked_out_many_at_once_give_the_estimates_that_they_give_second_by_second(every_s):
    samples = list(fly(seed=3, duration_s=120.0, sigma_mps=0.7).track(0).samples())
    each, many = LiveWind(drag=DRAG), LiveWind(drag=DRAG, every_s=every_s)
    told = 0
    for sample in samples:
        each.hear(sample)
        told += many.hear(sample) is not None
        if sample is samples[len(samples) * 48 // 100]:
            assert many.estimate != each.estimate  # not yet
            many.catch_up()
            assert many.estimate == each.estimate
    assert told == pytest.approx(120.0 / every_s, abs=1.0)
    many.catch_up()
    assert many.estimate == each.estimate
    assert many.observations() == each.observations()
