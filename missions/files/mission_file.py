"""Reading and writing mission files in any format: recognised by content, written by suffix."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.missions.files import legacy_files, plan_reader, plan_writer, waypoints_file
from skyway.models.base.errors import Fault, InputError
from skyway.models.base.fields import finite
from skyway.models.base.files import read_bytes, write_atomically

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.missions.items.document import MissionDocument

MAX_BYTES = 32 * 1024 * 1024
SAVE_AS_MISSION = (
    "draw or import it in QGroundControl or Mission Planner, and save it as .plan or .waypoints; zones go with --zones"
)
SAVE_AS_UTF_8 = "save it as UTF-8, or write it again from the ground station"

_FENCE, _RALLY = ".fence.waypoints", ".rally.waypoints"
"""Ends of the names of files that hold a fence alone, and rally points alone."""


def read(path: Path | str) -> MissionDocument:
    """Read a mission, fence or rally file.

    A ``name.waypoints`` file is read together with ``name.fence.waypoints`` and ``name.rally.waypoints`` if these
    are in the same folder, since the format keeps one kind in each file.

    Parameters
    ----------
    path : Path or str
        QGroundControl ``.plan`` or ``.mission``, QGC WPL 110 text, or an old fence or rally text; identified by its
        content.

    Raises
    ------
    InputError
        The file cannot be read, or holds something else.
    """
    path = Path(path)
    document = loads(read_bytes(path, max_bytes=MAX_BYTES), str(path))
    if path.suffix == ".waypoints" and not path.name.endswith((_FENCE, _RALLY)):
        fence_path, rally_path = _siblings(path)
        if fence_path.exists() and not document.fence:
            document = replace(document, fence=read(fence_path).fence)
        if rally_path.exists() and not len(document.rally):
            document = replace(document, rally=read(rally_path).rally)
    return document


def loads(data: bytes, file: str = "mission") -> MissionDocument:
    """Read the bytes of a file of any of the formats; `file` is named in errors (`InputError`)."""
    if data.startswith(b"PK\x03\x04"):
        raise InputError("is a ZIP or KMZ archive, not a mission file", file, remedy=SAVE_AS_MISSION)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text (byte {error.start})", file, remedy=SAVE_AS_UTF_8) from error
    if "\0" in text[:1000]:  # UTF-16 without its mark
        raise InputError("is not UTF-8 text: it has null characters", file, remedy=SAVE_AS_UTF_8)
    head = text.lstrip()[:200]
    if head.startswith(("{", "[")):
        return plan_reader.loads(text, file)
    if head.startswith("QGC"):
        return waypoints_file.loads(text.lstrip(), file)
    words = [line.split() for line in text.splitlines()[:50] if line.strip() and not line.startswith("#")]
    if words and words[0][0] == "RALLY":
        return legacy_files.loads_rally(text, file)
    if words and len(words[0]) == 2 and finite(words[0][0]) is not None:
        return legacy_files.loads_fence(text, file)
    if head.startswith("<"):
        raise InputError("is XML (KML, WPML, GPX), not a mission file", file, None, None, head[:40], SAVE_AS_MISSION)
    if head.lower().startswith("latitude,longitude"):
        raise InputError("is a table (Litchi), not a mission file", file, None, None, head[:40], SAVE_AS_MISSION)
    if words and len(words[0]) == 12 and all(finite(cell) is not None for cell in words[0]):
        remedy = f"the first line of a waypoint file is {waypoints_file.HEADER}"
        raise InputError("is a waypoint file without its first line", file, 1, None, head[:40], remedy)
    remedy = "expected a .plan, a QGC WPL 110 file, or an ArduPilot fence or rally file"
    raise InputError("is not a known mission format", file, None, None, head[:40], remedy)


def write(document: MissionDocument, path: Path | str, *, force: bool = False) -> tuple[Path, ...]:
    """Write a mission file in the format of its suffix; return every file written.

    A ``.waypoints`` file holds the mission alone: fence and rally points go to ``.fence.waypoints`` and
    ``.rally.waypoints`` beside it, where Mission Planner loads them from. A fence alone, or rally points alone, can be written to such
    a file itself. An `InputError` refuses another suffix, a
    file that exists (without `force`), and a folder that cannot be written.
    """
    texts = {file: make(document) for file, make in files_of(document, Path(path)).items()}
    taken = [file for file in texts if file.exists()]
    if taken and not force:
        remedy = "give another name, or --force to overwrite it"
        raise InputError([Fault("exists already", str(file), remedy=remedy) for file in taken])
    for file, text in texts.items():
        write_atomically(file, text, force=force)
    return tuple(texts)


def files_of(document: MissionDocument, path: Path) -> dict[Path, Callable[[MissionDocument], str]]:
    """Return the files that `write` would write, and their writers. Raises an `InputError` for an unknown suffix."""
    if path.suffix == ".plan":
        return {path: plan_writer.dumps}
    if path.suffix != ".waypoints":
        remedy = "name it .plan (QGroundControl) or .waypoints (Mission Planner, QGroundControl)"
        raise InputError("has a suffix that is not a mission format", str(path), remedy=remedy)
    if path.name.endswith(_FENCE) and not len(document.mission) and not len(document.rally):
        return {path: waypoints_file.dumps_fence}
    if path.name.endswith(_RALLY) and not len(document.mission) and not document.fence:
        return {path: waypoints_file.dumps_rally}
    files: dict[Path, Callable[[MissionDocument], str]] = {path: waypoints_file.dumps_mission}
    fence_path, rally_path = _siblings(path)
    # A fence left over from another mission would be read with this one: replace it, or refuse to write.
    if document.fence or fence_path.exists():
        files[fence_path] = waypoints_file.dumps_fence
    if len(document.rally) or rally_path.exists():
        files[rally_path] = waypoints_file.dumps_rally
    return files


def _siblings(path: Path) -> tuple[Path, Path]:
    return path.with_suffix(f".fence{path.suffix}"), path.with_suffix(f".rally{path.suffix}")
