"""How long a forecast takes to be read, and a plan on it, beside xarray and cfgrib by the book.

The forecast is an ensemble of 50 members over New York, hourly for 48 h, u and v at 10 and 100 m on a quarter of a degree: 9,800 messages of GRIB2, packed as the open data of ECMWF are
(CCSDS). Reading ends with the wind that planners fly in. By the book is one `xarray.open_dataset` for each height with the engine of cfgrib, cut to the region and loaded; it has no
wind at the height of flight, and no errors. The plan is compared with the same request on the built-in record, and its wind is cut off nowhere.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
import warnings
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.tables.figure import Figure
from skyway.models.composition.composition import State
from skyway.models.weather import region_files
from skyway.models.weather.readers.grib import loaded_eccodes
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.scenarios import load_scenario

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble

MEMBERS, HOURS = 50, 48
TARGET_S = 2.0
RATIO = 10.0
"""By the book over ours, at least."""
SLOWER = 1.3
DEPART = datetime(2013, 7, 10, 14, 30, tzinfo=UTC)
REQUESTS = (("bellevue", "siuh-north"), ("coney-island", "jacobi"), ("lij", "columbia"), ("jamaica-bay", "montefiore"))
ROUNDS = 3


def write_ensemble(path: Path) -> None:
    """Write the forecast: a west wind that each member has in its own strength, with noise."""
    ec = loaded_eccodes()
    rng = np.random.default_rng(1)
    handle = ec.codes_grib_new_from_samples("regular_ll_sfc_grib2")
    keys = {
        "Ni": 13, "Nj": 9, "latitudeOfFirstGridPointInDegrees": 42, "latitudeOfLastGridPointInDegrees": 40,
        "longitudeOfFirstGridPointInDegrees": 284.5, "longitudeOfLastGridPointInDegrees": 287.5, "iDirectionIncrementInDegrees": 0.25,
        "jDirectionIncrementInDegrees": 0.25, "productDefinitionTemplateNumber": 1, "dataDate": 20130710, "dataTime": 0, "centre": "ecmf",
        "numberOfForecastsInEnsemble": MEMBERS, "bitsPerValue": 16,
    }  # fmt: skip
    for key, value in keys.items():
        ec.codes_set(handle, key, value)
    ec.codes_set_values(handle, rng.normal(size=117))
    ec.codes_set(handle, "packingType", "grid_ccsds")
    with path.open("wb") as stream:
        for name, mean in (("10u", 4.0), ("10v", 1.0), ("100u", 7.0), ("100v", 2.0)):
            ec.codes_set(handle, "shortName", name)
            for hour in range(HOURS + 1):
                ec.codes_set(handle, "step", hour)
                for member in range(MEMBERS):
                    ec.codes_set(handle, "perturbationNumber", member)
                    ec.codes_set_values(handle, mean * (0.7 + 0.6 * member / MEMBERS) + 0.3 * rng.normal(size=117))
                    ec.codes_write(handle, stream)
    ec.codes_release(handle)


def _least(run: Callable[[], object]) -> float:
    """Least time of some runs, s."""
    spent = []
    for _ in range(ROUNDS):
        begin = time.perf_counter()
        run()
        spent.append(time.perf_counter() - begin)
    return min(spent)


def _by_the_book(path: Path) -> dict[int, object]:
    """Return the winds of the region at both heights, as the documentation of cfgrib has it."""
    import xarray

    found: dict[int, object] = {}
    for height in (10, 100):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            keys = {"filter_by_keys": {"level": height}, "indexpath": ""}
            data = xarray.open_dataset(path, engine="cfgrib", backend_kwargs=keys)
        found[height] = data.sel(latitude=slice(41.5, 40.0), longitude=slice(285.0, 287.0)).load()
    return found


def _planning_s(world: Scenario, wind: WindEnsemble) -> float:
    """Processor time of the requests, each at its least, s."""
    total = 0.0
    for start, to in REQUESTS:
        request = Request(state=State(DEPART, start, None, 1.0), destination=to, payload_kg=0.8)
        spent = []
        for _ in range(ROUNDS):
            begin = time.process_time()
            plan(world, request, forecast=wind)
            spent.append(time.process_time() - begin)
        total += min(spent)
    return total


def measure() -> list[Figure]:
    """Return the figures."""
    world = load_scenario(None)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ensemble.grib2"
        write_ensemble(path)

        def ours() -> WindEnsemble:
            region_files.forget()
            return world.forecast_from([path], DEPART, HORIZON_H)

        spent_s = _least(ours)
        figures = [
            Figure("48 h of 50 members over New York: read, cut, made ready", spent_s, "s", TARGET_S, "9,800 messages")
        ]
        if importlib.util.find_spec("cfgrib") and importlib.util.find_spec("xarray"):
            begin = time.perf_counter()
            _by_the_book(path)
            book_s = time.perf_counter() - begin
            note = f"xarray and cfgrib take {book_s:.1f} s, ours {spent_s:.2f} s; target {RATIO:g} or more"
            figures.append(Figure("the same by the book, over ours", book_s / spent_s, "times", None, note))
        record, forecast = (_planning_s(world, wind) for wind in (world.forecast(DEPART, HORIZON_H), ours()))
        note = f"{len(REQUESTS)} requests: {forecast:.2f} s of processor on the forecast, {record:.2f} s on the record"
        figures.append(Figure("a plan on it, over one on the record", forecast / record, "times", SLOWER, note))
    return figures
