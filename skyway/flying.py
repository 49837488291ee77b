"""Preparation of a plan file for flight: its scenario, its request, and the first forecast."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, tzinfo
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from skyway.link.supervisor.journal import fields as of
from skyway.models.base.errors import InputError
from skyway.models.base.fields import finite
from skyway.models.base.formatting import duration, percent, zone_clock
from skyway.models.base.units import from_posix

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import datetime

    from skyway.link.supervisor.job import Outcome
    from skyway.link.supervisor.journal.entries import Tracked
    from skyway.link.supervisor.journal.file import Record
    from skyway.models.composition.composition import Composition
    from skyway.models.composition.release import Release
    from skyway.models.flight.way_heights import Over
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.request import Request

FAR_S = 300.0
"""A vehicle whose clock is so far from ours is simulated, or replayed: then its time is taken."""


def scenario_of(
    composition: Composition,
    folder: Path | None,
    terrain: list[str] | None = None,
    obstacles: list[str] | None = None,
    zones: Sequence[Path] = (),
) -> Scenario:
    """Read the scenario that a plan was made in, or the one named; stations of the plan that it lacks are added.

    It lies over the terrain that is named, else over that of the plan. The zones of the files that are named, else of those that the plan
    names, count beside its own; authorizations are those of the plan.

    Raises an `InputError` if it cannot be found, or has changed since the plan was made.
    """
    from skyway.scenarios import BUILT_IN, load_scenario, with_terrain

    path = composition.scenario_path
    if folder is None and path not in (None, BUILT_IN):
        folder = Path(str(path))
        if not folder.exists():
            remedy = "give its folder with --scenario"
            raise InputError("the scenario of the plan was not found", str(path), remedy=remedy)
    scenario = load_scenario(folder)
    planned, found = composition.scenario_sha256, scenario.sha256
    if planned is not None and found is not None and planned != found:
        remedy = "plan again, or give its scenario with --scenario"
        raise InputError("the scenario differs from the plan's", scenario.path, remedy=remedy)
    if terrain or obstacles:
        scenario = with_terrain(scenario, terrain, obstacles)
    elif composition.terrain is not None:
        scenario = over_plan(composition, scenario)
    scenario = scenario.with_airspace(zone_files(composition, zones), composition.authorized)
    for name in (composition.origin, composition.destination):
        if name not in scenario.network.index:
            place = composition.stations[name]
            scenario = scenario.with_target(place.lat, place.lon, id=name)
    return scenario


def refuse_closed(scenario: Scenario, destination: str) -> None:
    """Raise an `InputError` where a zone always closes the place of delivery."""
    from skyway.models.airspace.ways import columns

    network = scenario.network
    if network.zones is None or destination not in network.index:
        return
    node = network.index[destination]
    here = network.lat[node : node + 1], network.lon[node : node + 1]
    climb = columns(*here, network.ground_m[node : node + 1], scenario.rules.cruise_height_m)
    zone = network.zones.holding(*here, climb).get(0)
    if zone is not None and zone.activation.is_permanent:
        problem = (
            f"the place of delivery, {destination}, lies in the zone {zone.label}, or nearer to it than the margin"
        )
        raise InputError(
            problem, zone.source, remedy="plan to another place, or give --authorized if that opens the zone"
        )


def zone_files(composition: Composition, named: Sequence[Path]) -> Sequence[Path]:
    """Named files of zones, else those of the plan. Raises an `InputError` if one is missing."""
    from skyway.models.airspace.pressure import split_pressure

    files = named or [Path(one) for one in composition.zones]
    missing = [str(one) for one in files if not named and not split_pressure(one)[0].is_file()]
    if missing:
        remedy = "give the zones of the plan with --zones"
        raise InputError("was not found: the plan was made with its zones", ", ".join(missing), remedy=remedy)
    return files


def over_plan(composition: Composition, scenario: Scenario) -> Scenario:
    """Return a scenario over the terrain that a plan was made over, with what was kept over it."""
    from skyway.models.scenario.ground import over_terrain

    over = terrain_of(composition)
    if over is None or (
        scenario.network.over is not None and scenario.network.over.terrain.files == over.terrain.files
    ):
        return scenario
    return over_terrain(replace(scenario, rules=replace(scenario.rules, clearance=over.clearance)), over.terrain)


def terrain_of(
    composition: Composition, terrain: list[str] | None = None, obstacles: list[str] | None = None
) -> Over | None:
    """Terrain that the missions of a plan are made over: as named, else that of the plan; None without any."""
    from skyway.models.flight.clearance import Clearance
    from skyway.models.flight.way_heights import Over
    from skyway.models.terrain.files import read_named, read_terrain

    planned = composition.terrain
    clearance = Clearance() if planned is None else planned.clearance
    if terrain or obstacles:
        found = read_terrain(terrain or (), obstacles or ())
    elif planned is None:
        return None
    else:
        try:
            found = read_named(planned.files)
        except InputError as error:
            faults = [replace(one, remedy="give the terrain of the plan with --terrain") for one in error.faults]
            raise InputError(faults) from None
    return Over(found, clearance, composition.cruise_height_m)


def request_of(composition: Composition, scenario: Scenario) -> Request:
    """Return what was asked when the plan was made."""
    from skyway.models.composition.composition import State
    from skyway.planner.problem.request import NEAREST_PAD, Request

    scenario.drone(composition.drone)
    way = composition.way_back
    first = composition.stops[0].soc_from if composition.stops else 1.0
    if composition.services:
        first = composition.services[0].soc_depart
    return Request(
        state=State(composition.depart, composition.origin, None, min(max(first, 0.0), 1.0)),
        destination=composition.destination,
        payload_kg=composition.payload_kg,
        drone=composition.drone,
        airspeed_mps=composition.airspeed_mps,
        reserve_soc=composition.reserve_soc,
        seed=composition.seed or 0,
        return_to=NEAREST_PAD if way is None or way.plan is None else way.station,
        dwell_s=0.0 if way is None else way.dwell_s,
        undelivered_to=None if way is None else way.undelivered_to,
        release="gripper" if way is None else way.release,
        not_before=composition.not_before,
    )


def release_of(composition: Composition, given: Release | None) -> Release:
    """Return how the package is released: as given, else as planned; in the air where it was planned so, and nowhere else."""
    from skyway.models.composition.release import hovers

    planned: Release = "gripper" if composition.way_back is None else composition.way_back.release
    if given is None or given == planned:
        return planned
    if hovers(given) or hovers(planned):
        remedy = (
            f"remove it, or plan with --release {given}: only a plan keeps the charge for a hover and the flight on"
        )
        raise InputError(f"the plan was made for --release {planned}", field="--release", value=given, remedy=remedy)
    return given


def heights(scenario: Scenario | None, given: list[str] | None) -> dict[str, float]:
    """Read ground heights typed as ``STATION=METRES``; of a scenario's stations only, where one is given."""
    found: dict[str, float] = {}
    for text in given or ():
        name, _, value = text.rpartition("=")
        metres = finite(value)
        if not name or metres is None or not -500.0 < metres < 9000.0:
            remedy = "STATION=METRES, for example clinic=34"
            raise InputError("not a height", field="--elevation", value=text, remedy=remedy)
        if scenario is not None and name.strip() not in scenario.network.index:
            raise InputError("no such station", field="--elevation", value=name)
        found[name.strip()] = metres
    return found


def journal_name(origin: str, destination: str, now: datetime) -> str:
    """Return a name for the journal of a delivery between two stations."""
    return f"{now:%Y-%m-%d-%H%M%S}-{origin}-{destination}.jsonl"


class FlightSummary(msgspec.Struct, frozen=True, kw_only=True):
    """Outcome of a supervised delivery: the last line of ``skyway fly --json``."""

    schema: str = "skyway.fly/1"
    delivered: bool
    done: bool
    """The package arrived; all work was done."""
    state: str
    reason: str
    """The last state, and a sentence."""
    station: str | None
    """Where the drone stands, as far as that is a station."""
    flights: int
    journal: str
    report: str | None
    """Files that were written."""
    proof: str = ""
    proof_reason: str = ""
    """What became of the package (``delivered``, ``not delivered``, ``unsure``, or nothing yet), and what shows it."""
    logs: tuple[str, ...] = ()
    """Files of the logs that were fetched from the vehicle."""


def summary(outcome: Outcome, journal: Path, report: Path | None, logs: Sequence[Path] = ()) -> FlightSummary:
    """Return the summary of a flight."""
    written = None if report is None else str(report)
    return FlightSummary(
        delivered=outcome.delivered, done=outcome.done, state=outcome.state, reason=outcome.reason, station=outcome.station,
        flights=outcome.flights, journal=str(journal), report=written, proof=outcome.proof, proof_reason=outcome.proof_reason,
        logs=tuple(map(str, logs)),
    )  # fmt: skip


SHOWN = frozenset({"state", "change", "reboot", "link", "turn", "check", "waits", "upload", "order"})
"""Events that a person sees as a line; what else a person must know is told by the supervisor itself."""


def line_of(record: Record, zone: tzinfo = UTC) -> str | None:
    """Describe a record of the journal in a line, its time in a zone; None for those that a person need not see."""
    from skyway.link.supervisor.journal.entries import Tracked
    from skyway.link.supervisor.states import State

    at_s = of.instant_s(record.time)
    clock = "unknown time" if at_s is None else zone_clock(from_posix(at_s), zone)
    if (entry := record.entry(Tracked)) is not None and entry.expected.left_s is not None:
        old = "last heard: " if record.state == State.LOST_LINK else ""
        return f"{clock}  {record.state:<12} {old}{_flight_line(entry)}"
    return f"{clock}  {record.state:<12} {record.reason}" if record.event in SHOWN else None


def _flight_line(entry: Tracked) -> str:
    """Where a flight stands, beside what was planned."""
    expected = entry.expected
    line = (
        f"{_figure(entry.height_m)} m above home, {_figure(entry.ground_speed_mps, 1)} m/s, {percent(entry.soc)}; "
        f"{expected.destination} in {duration(expected.left_s)} ({duration(expected.late_s or 0.0, signed=True)}), "
        f"landing with {percent(expected.soc_land)} (planned {percent(expected.planned_soc_land)}), "
        f"{_figure(expected.cross_track_m)} m off the route, wind {entry.measured_words() or 'not measured'} "
        f"(forecast {entry.forecast.words() or 'unknown'})"
    )
    return f"{line}; {expected.limited}" if expected.limited else line


def _figure(value: float | None, digits: int = 0) -> str:
    return "unknown" if value is None else f"{value:.{digits}f}"
