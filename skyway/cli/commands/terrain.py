"""Command ``terrain``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from skyway import typed_values
from skyway.cli import options
from skyway.cli.views.sheet import say
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.formatting import distance_text, percent, with_unit
from skyway.models.base.json_text import json_text
from skyway.models.base.views import counted

if TYPE_CHECKING:
    from skyway.models.terrain.contents import ObstacleContents, TerrainContents


def terrain(
    files: Annotated[list[str] | None, typer.Argument(metavar="FILE...", help=options.TERRAIN_HELP)] = None,
    obstacles: options.ObstacleFiles = None,
    at: Annotated[
        list[str] | None, typer.Option(help="LAT,LON: ground there, and the highest within 200 m; repeatable.")
    ] = None,
    as_json: options.AsJson = False,
) -> None:
    """Show the contents of terrain and obstacle files: extent, spacing, datum, voids, lowest and highest height.

    Examples
    --------
      skyway terrain S36E149.hgt.zip
      skyway terrain dem.tif@ellipsoid --obstacles towers.csv --at -35.3633,149.1652
    """
    from skyway.models.terrain.contents import SCHEMA, obstacle_contents, terrain_contents

    if not files and not obstacles:
        raise InputError("no file named", field="FILE", remedy="name terrain files, or obstacles with --obstacles")
    faults: list[Fault] = []
    models: list[TerrainContents] = []
    standing: list[ObstacleContents] = []
    for text in files or ():
        try:
            models.append(terrain_contents(text))
        except InputError as error:
            faults += error.faults
    for text in obstacles or ():
        try:
            standing.append(obstacle_contents(text))
        except InputError as error:
            faults += error.faults
    refuse(faults)
    places = [_height_at(text, files or [], obstacles or []) for text in at or ()]
    if as_json:
        document = {"schema": SCHEMA, "terrain": models, "obstacles": standing, "places": places}
        typer.echo(json_text(document, indent=1))
        return
    for number, model in enumerate(models):
        if number:
            say("")
        _say_terrain(model)
    for one in standing:
        _say_obstacles(one)
    for place in places:
        say(_place_words(place))


def _say_terrain(one: TerrainContents) -> None:
    say(f"{one.file}: {one.format}, {one.columns} x {one.rows} heights ({one.packed})")
    say(f"  extent   {one.south:.5f} to {one.north:.5f} N, {one.west:.5f} to {one.east:.5f} E, {one.crs}")
    seconds = one.spacing_arcsec
    angle = "" if seconds is None else f" ({seconds[0]:.4g}″ x {seconds[1]:.4g}″)"
    say(
        f"  spacing  {distance_text(one.spacing_m[0])} north to south, {distance_text(one.spacing_m[1])} west to east{angle}"
    )
    means = "of a point" if one.registration == "node" else "of the cell about it"
    unit = "metres" if one.unit_m == 1.0 else f"units of {one.unit_m:g} m, shown in metres,"
    above = "above a datum that the file does not name" if one.datum == "unknown" else f"above {one.datum}"
    say(f"  heights  {unit} {above}; each is that {means}")
    spread = "none is known" if one.least_m is None else f"{one.least_m:.1f} to {with_unit(one.greatest_m, 'm')}"
    total = one.rows * one.columns
    say(
        f"  values   {spread}; voids: {one.voids:,} of {total:,}"
        + (f" ({percent(one.voids / total, 1)})" if one.voids else "")
    )
    if one.note is not None:
        say(f"  note     {one.note}")


def _say_obstacles(one: ObstacleContents) -> None:
    say(f"{one.file}: {counted(one.points, 'point')} of obstacles")
    if one.points:
        say(f"  extent   {one.south:.5f} to {one.north:.5f} N, {one.west:.5f} to {one.east:.5f} E")
    if one.tallest_m is not None:
        say(f"  tallest  {with_unit(one.tallest_m, 'm')} above ground")
    if one.highest_m is not None:
        say(f"  highest  {with_unit(one.highest_m, 'm')} above mean sea level")


def _height_at(text: str, files: list[str], obstacles: list[str]) -> dict[str, float | None]:
    """Ground and highest thing at a place as typed, metres above mean sea level; None where not known.

    A place at which nothing is known, but is with latitude and longitude exchanged, is refused.
    """
    import numpy as np

    from skyway.models.terrain.files import read_terrain

    found = typed_values.parse_position(text)
    if found is None:
        raise InputError("not a place", field="--at", value=text, remedy="LAT,LON in degrees")
    known = read_terrain(files, obstacles)
    lat, lon = np.array(found[:1]), np.array(found[1:])
    heights = float(known.ground_m(lat, lon)[0]), float(known.top_m(lat, lon, WITHIN_M)[0])
    if np.isnan(heights[0]) and abs(found[1]) <= 90.0 and np.isfinite(known.ground_m(lon, lat)[0]):
        problem = "lies beyond the files: lat and lon look swapped"
        raise InputError(problem, field="--at", value=text, remedy="latitude first, then longitude")
    ground, top = (None if np.isnan(one) else one for one in heights)
    return {"lat": found[0], "lon": found[1], "ground_m": ground, "top_m": top}


WITHIN_M = 200.0
"""Half the usual width of a corridor."""


def _place_words(place: dict[str, float | None]) -> str:
    where = f"{place['lat']:.6f},{place['lon']:.6f}"
    if place["ground_m"] is None:
        return f"{where}: no height: a void, or beyond the files"
    top = "not known throughout" if place["top_m"] is None else with_unit(place["top_m"], "m")
    return f"{where}: ground {with_unit(place['ground_m'], 'm')} above mean sea level, highest within {WITHIN_M:g} m: {top}"
