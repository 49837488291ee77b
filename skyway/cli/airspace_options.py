"""Options for zones and authorizations, and the refusal of legs that zones close."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import typer

from skyway import typed_values

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from skyway.missions.autopilots.family import Family
    from skyway.missions.builder.mission_options import MissionOptions
    from skyway.models.airspace.airspace import Airspace
    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario


def zones_of(
    region: Scenario | None,
    files: Sequence[Path],
    authorized: Sequence[str],
    places: Sequence[tuple[float, float]] = (),
) -> Airspace | None:
    """Return the zones of a scenario and of files; prints which parts of the files were not understood.

    `places`, degrees, are flown to: zones that lie there only with latitude and longitude exchanged are refused.
    """
    import numpy as np

    from skyway.models.airspace.airspace import Airspace
    from skyway.models.airspace.reading import read_airspace
    from skyway.models.base.errors import refuse
    from skyway.models.scenario.checks import swapped_zones

    own = region.network.zones if region is not None else None
    if not files and not authorized:
        return own
    more, notes = read_airspace(files)
    for note in notes:
        typer.echo(f"warning: {note}", err=True)
    if places and more:
        refuse(swapped_zones(np.array(places), Airspace(tuple(more)), "the mission"))
    known = own or Airspace()
    with typed_values.as_typed():
        return replace(known, zones=(*known.zones, *more)).with_authorized(authorized)


def refuse_closed(composition: Composition, flown_by: Family, how: MissionOptions, zones: Airspace | None) -> None:
    """Print the zones that prevent all flights at its time, and end."""
    from skyway.missions.builder.from_composition import leg_mission, takes_off
    from skyway.missions.checks.report import AIRSPACE_CODES
    from skyway.missions.checks.report import check as check_mission

    if zones is None:
        return
    found = []
    services = composition.there_and_back.services
    for number in takes_off(composition, how):
        service = services[number]
        document = leg_mission(composition, number, flown_by, how).documents[0]
        report = check_mission(document, dialect=flown_by, zones=zones, depart_s=service.depart.timestamp())
        told = (str(one) for one in report.findings if one.code in AIRSPACE_CODES and one.severity == "error")
        found += [f"leg {number + 1}: {one}" for one in told]
    for line in found:
        typer.echo(line, err=True)
    if found:
        raise typer.Exit(1)
