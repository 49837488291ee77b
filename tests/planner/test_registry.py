"""The registry of planners."""

from skyway.planner.registry import FORECAST_PLANNERS, PLANNERS, forecast_planner


def test_every_forecast_planner_is_found_by_its_name():
    assert set(FORECAST_PLANNERS) < set(PLANNERS)
    assert all(callable(forecast_planner(name)) for name in FORECAST_PLANNERS)
