"""The commented example scenarios that ``skyway scenario init`` writes."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error, write_atomically

if TYPE_CHECKING:
    from pathlib import Path

FILES = {
    "template": ("scenario.toml", "stations.csv", "drones.toml", "load.csv", "wind.csv", "zones.geojson"),
    "hills": (
        "scenario.toml",
        "stations.csv",
        "terrain.tif",
        "obstacles.csv",
        "airspace.json",
        "forecast.json",
        "README.md",
    ),
}
"""Files of each example."""


def write_template(folder: Path, example: str = "template") -> list[Path]:
    """Write an example into a new or empty folder; an `InputError` where it is neither, or cannot be written."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError("exists already and is not an empty folder", str(folder), remedy="name a new folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise file_error("made", folder, error) from error
    source = resources.files("skyway.missions.examples") / example
    written = []
    for name in FILES[example]:
        write_atomically(folder / name, (source / name).read_bytes())
        written.append(folder / name)
    return written
