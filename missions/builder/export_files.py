"""The files of an exported plan: missions, one for each leg if requested, and the parameters that the vehicle needs."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.missions.files.mission_file import files_of, write
from skyway.models.base.files import write_atomically

if TYPE_CHECKING:
    from pathlib import Path

    from skyway.missions.builder.from_composition import Export


def targets_of(export: Export, output: Path) -> list[Path]:
    """Return the file of each mission: the given name, with the number of the leg if there are several."""
    count = len(export.documents)
    if count == 1:
        return [output]
    return [output.with_name(f"{output.stem}.leg{number}{output.suffix}") for number in range(1, count + 1)]


def planned_files(export: Export, output: Path) -> list[Path]:
    """Return all files that will be written, the parameters last."""
    pairs = zip(export.documents, targets_of(export, output), strict=True)
    return [*(file for document, target in pairs for file in files_of(document, target)), output.with_suffix(".param")]


def write_export(export: Export, parameters: str, output: Path, *, force: bool = False) -> list[Path]:
    """Write every mission and the parameters; returns the files, the parameters last."""
    pairs = zip(export.documents, targets_of(export, output), strict=True)
    written = [file for document, target in pairs for file in write(document, target, force=force)]
    settings = output.with_suffix(".param")
    write_atomically(settings, parameters, force=force)
    return [*written, settings]
