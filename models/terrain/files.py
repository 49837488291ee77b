"""Names of terrain and obstacle files, with options: ``dem.tif``, ``dem.tif@ellipsoid``, ``dem.tif@ft``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.formatting import distance_text
from skyway.models.terrain.geotiff import read_geotiff
from skyway.models.terrain.hgt import is_hgt, read_hgt
from skyway.models.terrain.obstacles import FOOT_M, Obstacles, joined, read_obstacles
from skyway.models.terrain.raster import Raster, crs_name
from skyway.models.terrain.terrain import COARSEST_M, Terrain

if TYPE_CHECKING:
    from collections.abc import Sequence

DATUMS = {"egm96": "EGM96", "egm2008": "EGM2008", "msl": "mean sea level", "ellipsoid": "ellipsoid"}
UNITS_M = {"m": 1.0, "ft": FOOT_M}
GEOID = "geoid="
"""Before the name of a grid of the geoid, as GeoTIFF: ``dem.tif@geoid=egm2008.tif``."""
SEA_LEVEL = ("EGM96", "EGM2008", "mean sea level")


def split_name(text: str) -> tuple[Path, list[str]]:
    """File of a name, and its suffix after ``@``."""
    parts = text.split("@")
    said: list[str] = []
    while len(parts) > 1:
        word = parts[-1].strip()
        if word.lower() not in (*DATUMS, *UNITS_M) and not word.startswith(GEOID):
            break
        said.insert(0, word if word.startswith(GEOID) else word.lower())
        parts.pop()
    return Path("@".join(parts)), said


def with_folder(said: Sequence[str], folder: Path) -> list[str]:
    """Return the settings of a file, geoid grids by their place in a folder."""
    return [GEOID + str(folder / word.removeprefix(GEOID)) if word.startswith(GEOID) else word for word in said]


def read_raster(text: str) -> Raster:
    """Read one terrain file, with the settings in its name. Raises an `InputError` with the problem."""
    path, said = split_name(text)
    if not path.exists():
        raise InputError("no such file", str(path), remedy=_meant(path))
    if path.is_dir():
        raise InputError("is a folder, not a file", str(path), remedy="name its files")
    raster = read_hgt(path) if is_hgt(path) else read_geotiff(path)
    for word in said:
        if word.startswith(GEOID):
            raster = _over_geoid(raster, Path(word.removeprefix(GEOID)))
        elif word in DATUMS:
            if raster.datum not in ("unknown", DATUMS[word]):
                problem = f"counts from {raster.datum} according to the file"
                raise InputError(problem, str(path), value=f"@{word}", remedy=f"remove @{word}")
            raster = replace(raster, datum=DATUMS[word])
        else:
            if raster.unit_m not in (1.0, UNITS_M[word]):
                raise InputError("is in another unit according to the file", str(path), value=f"@{word}", remedy=f"remove @{word}")  # fmt: skip
            raster = replace(raster, unit_m=UNITS_M[word])
    return raster


def _meant(path: Path) -> str | None:
    """Suggestion for a name that is not a file: an unknown word after ``@``."""
    file, _, word = str(path).rpartition("@")
    if not file or not Path(file).is_file():
        return None
    return f"{word} is not an option of {file}: {', '.join((*DATUMS, *UNITS_M, GEOID + 'GRID.tif'))}"


def _over_geoid(raster: Raster, path: Path) -> Raster:
    """Return a raster above the ellipsoid, with the grid for the conversion to mean sea level."""
    if raster.datum not in ("unknown", "ellipsoid"):
        problem = f"counts from {raster.datum} according to the file"
        raise InputError(problem, raster.file, value=f"@{GEOID}{path}", remedy="remove the geoid: it is not needed")
    if not path.is_file():
        raise InputError("no such file", str(path), remedy="name a grid of the geoid, as GeoTIFF")
    return replace(raster, datum="ellipsoid", geoid=read_geotiff(path))


def read_terrain(terrain: Sequence[str], obstacles: Sequence[str] = ()) -> Terrain:
    """Read the headers of terrain and obstacle files; heights are read on demand.

    An `InputError` lists every file that cannot be read, or whose heights are too coarse for the ground below a leg.
    """
    faults: list[Fault] = []
    rasters: list[Raster] = []
    for text in terrain:
        try:
            raster = _fine_enough(read_raster(text))
            rasters.append(raster)
        except InputError as error:
            faults += error.faults
    parts = _obstacles(obstacles, faults)
    refuse(faults)
    if obstacles and not rasters:
        remedy = "give a terrain model too: heights above ground count from it"
        raise InputError("obstacles stand on ground that is not known", str(obstacles[0]), remedy=remedy)
    notes = [note for raster in rasters if (note := datum_note(raster)) is not None]
    return Terrain(rasters, joined(parts), (*terrain, *obstacles), notes)


def _obstacles(files: Sequence[str], faults: list[Fault]) -> list[Obstacles]:
    """Read obstacle files; faults are collected."""
    parts: list[Obstacles] = []
    for text in files:
        try:
            parts.append(read_obstacles(Path(text)))
        except InputError as error:
            faults += [fault if fault.file else replace(fault, file=text) for fault in error.faults]
    return parts


def read_named(files: Sequence[str]) -> Terrain:
    """Read terrain models and obstacles named together, distinguished by their contents."""
    standing = [text for text in files if Path(text).suffix.lower() in (".csv", ".geojson", ".json")]
    return read_terrain([text for text in files if text not in standing], standing)


def with_obstacles(terrain: Terrain, files: Sequence[str]) -> Terrain:
    """Return a terrain model with more obstacles; an `InputError` lists the faults of their files."""
    faults: list[Fault] = []
    parts = _obstacles(files, faults)
    refuse(faults)
    return Terrain(terrain.rasters, joined([terrain.obstacles, *parts]), (*terrain.files, *files), terrain.notes)


def _fine_enough(raster: Raster) -> Raster:
    """Refuse a model whose cells are too wide for the ground below a leg."""
    widest_m = max(raster.spacing_m())
    if widest_m > COARSEST_M:
        problem = f"has cells of {distance_text(widest_m)}: they say nothing about the ground below a leg"
        raise InputError(problem, raster.file, remedy="take a finer model, such as Copernicus GLO-30")
    return raster


def datum_note(raster: Raster) -> str | None:
    """Note on the vertical datum of a file; None if it is mean sea level, or is converted to it."""
    name = Path(raster.file).name
    if raster.datum == "unknown":
        return (
            f"{name} does not state its vertical datum: its heights are used as heights above mean sea level; "
            f"if that is right, name it {name}@msl, else {name}@ellipsoid"
        )
    if raster.datum in (*SEA_LEVEL, "ellipsoid"):
        return None
    return f"the heights of {name} refer to {crs_name(raster.datum)}: used as heights above mean sea level"
