"""How fast a mission is cut at pads: the stops alone, the whole with files made and checked, and beside frvcpy in the same run.

Times are processor time, so that other work on the machine does not count; kernels are compiled before. frvcpy (of the extra dev) solves
the same routes where its model applies: a fixed order of customers, three kinds of chargers, no wind, no waits.
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.tables.figure import Figure
from skyway.missions.autopilots.registry import family_named
from skyway.missions.checks.energy import FlightConditions
from skyway.missions.checks.weather import SteadyWind
from skyway.missions.items.altitude_frames import Frame
from skyway.missions.items.commands import Command
from skyway.missions.items.coordinates import Point
from skyway.missions.items.document import MissionDocument
from skyway.missions.items.mission import Home, Mission, MissionItem
from skyway.missions.recharge.pad_ways import TransitRules
from skyway.models.base import geodesy
from skyway.models.drones.drone import M200_V2
from skyway.models.flight.kernels import Slots
from skyway.models.network.station import Station
from skyway.planner.fixed_route.charging_stops import FixedRoute, charging_stops
from skyway.planner.fixed_route.way_kernels import Hops
from skyway.recharge.problem import RechargeOptions
from skyway.recharge.recharged import recharged

if TYPE_CHECKING:
    from collections.abc import Callable

LAT, LON = 47.4, 8.55
LINES, PADS = 125, 20
TARGET_S = 1.0
CUSTOMERS, STATIONS, ROUTES = 14, 8, 25


def measure() -> list[Figure]:
    """Measure; takes half a minute."""
    mission, pads = survey(LINES), pads_about(PADS)
    options = RechargeOptions(FlightConditions(M200_V2, weather=SteadyWind(5.0, 250.0)), TransitRules(12.0))
    families = [family_named("px4"), family_named("ardupilot")]
    recharged(MissionDocument(survey(8)), pads[:3], families, options)  # compiles
    whole_s, found = _timed(lambda: recharged(MissionDocument(mission), pads, families, options))
    route = found.problem.route(1.2)
    stops_s, plan = _timed(lambda: charging_stops(route))
    note = f"{len(mission.items)} items, {len(found.problem.work.points)} places, {PADS} pads, {len(plan.stops)} stops"
    figures = [
        Figure("recharge: exact stops", stops_s, "s", TARGET_S, note),
        Figure("recharge: the whole, both autopilots, every flight checked", whole_s, "s", TARGET_S, note),
    ]
    return [*figures, *_beside_frvcpy()]


def survey(lines: int) -> Mission:
    """Lines of 700 m, 25 m apart, a picture every 20 m."""
    items = [_place(0.0, 0.0, Command.NAV_TAKEOFF)]
    for number in range(lines):
        ends = (0.0, 700.0) if number % 2 == 0 else (700.0, 0.0)
        items += [
            _place(25.0 * number, ends[0]),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION, 20.0, 0.0, 1.0),
            _place(25.0 * number, ends[1]),
            MissionItem(Command.DO_SET_CAM_TRIGG_DIST, Frame.MISSION),
        ]
    items.append(MissionItem(Command.NAV_RETURN_TO_LAUNCH, Frame.MISSION))
    return Mission(tuple(items), Home(Point.of_degrees(LAT, LON), 400.0), 15.0, 8.0, 12, 2)


def _place(east_m: float, north_m: float, command: Command = Command.NAV_WAYPOINT) -> MissionItem:
    bearing = float(np.degrees(np.arctan2(east_m, north_m)))
    point = Point.of_degrees(*geodesy.direct(LAT, LON, bearing, float(np.hypot(east_m, north_m))))
    return MissionItem(command, Frame.GLOBAL_RELATIVE_ALT, x=point.lat_e7, y=point.lon_e7, z=60.0)


def pads_about(count: int) -> tuple[Station, ...]:
    """Pads in and about the survey."""
    rng = np.random.default_rng(1)
    found = []
    for number, (east, north) in enumerate(rng.uniform([-300.0, -300.0], [3400.0, 1000.0], (count, 2)).tolist()):
        item = _place(east, north)
        if item.point is not None:
            found.append(Station(f"p{number}", "", item.point.lat, item.point.lon, 400.0))
    return tuple(found)


def _timed(run: Callable[[], Any]) -> tuple[float, Any]:
    started = time.process_time()
    answer = run()
    return time.process_time() - started, answer


def _beside_frvcpy() -> list[Figure]:
    try:
        from frvcpy.solver import Solver
    except ImportError:
        return []
    cases = [_case(np.random.default_rng(seed)) for seed in range(ROUTES)]
    order = [0, *range(1, 1 + CUSTOMERS), 0]
    charging_stops(fixed_route(cases[0], order))  # compiles
    ours_s, ours = _timed(lambda: [charging_stops(fixed_route(case, order)) for case in cases])
    theirs_s, theirs = _timed(
        lambda: [Solver(case, order, case["max_q"], multi_insert=True).solve()[0] for case in cases]
    )
    ends = [(plan.end_s, other) for plan, other in zip(ours, theirs, strict=True) if plan is not None and other]
    apart = max(abs(one - other) for one, other in ends)
    note = f"{ROUTES} routes of {CUSTOMERS} customers and {STATIONS} stations, {len(ends)} of them feasible"
    return [
        Figure("recharge: time over that of frvcpy", ours_s / theirs_s, "", None, f"{note}; frvcpy {theirs_s:.2f} s"),
        Figure("recharge: largest difference from frvcpy", apart, "h", 1e-6, note),
    ]


def _case(rng: np.random.Generator) -> dict[str, Any]:
    """Places in a square and three kinds of chargers, as frvcpy wants them."""
    size = 1 + CUSTOMERS + STATIONS
    at = rng.uniform(0.0, 60.0, (size, 2))
    at[1 + CUSTOMERS] = at[0]
    length = np.hypot(*(at[:, None] - at[None]).transpose(2, 0, 1))
    kinds = [
        {"cs_type": kind, "time": [0.0, 0.4 + kind / 2, 0.6 + kind, 1.0 + 2 * kind], "charge": [0.0, 70.0, 90.0, 100.0]}
        for kind in range(3)
    ]
    return {
        "max_q": 100.0,
        "t_max": 1e3,
        "css": [{"node_id": 1 + CUSTOMERS + n, "cs_type": int(rng.integers(3))} for n in range(STATIONS)],
        "process_times": [0.0] + [0.1] * CUSTOMERS + [0.0] * STATIONS,
        "breakpoints_by_type": kinds,
        "energy_matrix": (length * 1.1).tolist(),
        "time_matrix": (length / 40.0).tolist(),
    }


def fixed_route(instance: dict[str, Any], route: list[int]) -> FixedRoute:
    """Put an instance of frvcpy to skyway: nodes are positions, and who leaves one for a station goes on at the next."""
    times, energies = np.array(instance["time_matrix"]), np.array(instance["energy_matrix"]) / instance["max_q"]
    process = np.array(instance["process_times"], dtype=float)
    nodes = [station["node_id"] for station in instance["css"]]
    kinds = {kind["cs_type"]: kind for kind in instance["breakpoints_by_type"]}
    curves = tuple(
        (np.array(kind["time"], dtype=float), np.array(kind["charge"], dtype=float) / instance["max_q"])
        for kind in (kinds[station["cs_type"]] for station in instance["css"])
    )
    at, on = np.array(route), np.array([*route[1:], route[-1]])
    work_s, work_soc = times[at[:-1], at[1:]] + process[at[1:]], energies[at[:-1], at[1:]]
    back_s, back_soc = times[nodes][:, on].T + process[on][:, None], energies[nodes][:, on].T
    hops = Hops(
        np.ascontiguousarray(work_s[None]),
        np.ascontiguousarray(work_soc[None]),
        np.ascontiguousarray(times[at][:, nodes][None]),
        np.ascontiguousarray(energies[at][:, nodes][None]),
        np.ascontiguousarray(back_s[None]),
        np.ascontiguousarray(back_soc[None]),
        np.ascontiguousarray(times[np.ix_(nodes, nodes)][None]),
        np.ascontiguousarray(energies[np.ix_(nodes, nodes)][None]),
        np.minimum(np.arange(len(route)) + 1, len(route) - 1),
    )
    can_leave = np.arange(len(route)) < len(route) - 1
    nobody = tuple(np.zeros((1, 2)) for _ in nodes)
    return FixedRoute(
        hops,
        Slots(0.0, 1.0, 1),
        can_leave,
        curves,
        nobody,
        float(process[route[0]]),
        1.0,
    )
