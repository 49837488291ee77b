"""Report of a flight from its journal: ``report.html``, and the document ``skyway.flight/1``."""

from __future__ import annotations

from typing import TYPE_CHECKING

from msgspec.structs import replace

from skyway.link.supervisor import read_journal
from skyway.link.supervisor.journal.entries import Start
from skyway.models.base.errors import InputError
from skyway.models.base.files import write_atomically
from skyway.models.composition.file import load, to_json
from skyway.report.document import flight_report
from skyway.report.flight_report import FlightReport, Sources, Station
from skyway.report.map import Zone
from skyway.report.page import page
from skyway.report.picture import picture
from skyway.report.series import log_series
from skyway.scenarios import BUILT_IN, load_scenario

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.models.scenario.scenario import Scenario


def flight(journal: Path, *, logs: Sequence[Path] = (), plan: Path | None = None) -> FlightReport:
    """Return what was planned and what happened, as ``skyway.flight/1``.

    The journal may be that of a flight which was broken off; the telemetry of recordings is finer than the journal's.
    Without a plan to compare with, it is the one in the journal. An `InputError` refuses a file that is not what it
    should be.
    """
    records = read_journal(journal).records
    planned = None if plan is None else to_json(load(plan))
    start = records[0].entry(Start)
    if planned is not None and start is not None:
        flown, told = ((one.get("from"), one.get("to")) for one in (start.composition, planned))
        if flown != told and None not in flown:
            problem = f"is a plan from {told[0]} to {told[1]}; the flight was from {flown[0]} to {flown[1]}"
            raise InputError(problem, str(plan), field="--plan", remedy="give a plan of the same delivery")
    document = flight_report(records, planned)
    series = replace(document.series, log=log_series(logs)) if logs else document.series
    sources = Sources(journal=journal.name, logs=[log.name for log in logs], plan=None if plan is None else plan.name)
    return replace(document, series=series, sources=sources)


def write_report(
    journal: Path,
    report: Path,
    *,
    logs: Sequence[Path] = (),
    plan: Path | None = None,
    scenario: Scenario | None = None,
    plot: Path | None = None,
    force: bool = False,
) -> FlightReport:
    """Write the report of a flight as one page that needs no other file; returns what it was made of (see `flight`).

    The scenario gives the no-fly zones on the map; without it the built-in one does, if the plan was made in it. `plot`
    is a picture of map, charge and wind as well: FILE.svg.
    """
    document = flight(journal, logs=logs, plan=plan)
    scenario = scenario or _built_in(document)
    if scenario is not None:
        document = replace(document, timezone=scenario.timezone)
    zones = None if scenario is None else _zones(scenario)
    for one in () if scenario is None else scenario.network.stations:  # beside those that the plan names
        if one.flyover:
            continue
        document.planned.stations.setdefault(one.id, Station(one.lat, one.lon, one.name))
    write_atomically(report, page(document, zones), force=force)
    if plot is not None:
        write_atomically(plot, picture(document, zones), force=force)
    return document


def _built_in(document: FlightReport) -> Scenario | None:
    """Return the built-in scenario, if the plan was made in it; None where its scenario is not at hand.

    No path out of the journal is opened: it may come from anybody.
    """
    source = document.delivery.scenario
    if source.path != BUILT_IN:
        return None
    scenario = load_scenario(None)
    return scenario if scenario.sha256 == source.sha256 else None


def _zones(scenario: Scenario) -> list[Zone]:
    """Return the no-fly zones that the plan knew."""
    zones = scenario.network.zones
    if zones is None:
        return []
    found = []
    for name, shape in zip(zones.names, zones.polygons, strict=True):
        parts = getattr(shape, "geoms", [shape])
        rings = [ring for part in parts for ring in (part.exterior, *part.interiors)]
        found.append(Zone(name, [[(lat, lon) for lon, lat, *_ in ring.coords] for ring in rings]))
    return found
