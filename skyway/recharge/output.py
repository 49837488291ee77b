"""The folder of a cut mission: one mission per flight for each autopilot, the parameters of the vehicle, and the summary."""

from __future__ import annotations

import hashlib
import json
import math
import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from skyway.missions.autopilots.registry import family_named
from skyway.missions.checks.route import fly
from skyway.missions.files import plan_writer
from skyway.missions.files.mission_file import files_of
from skyway.missions.items.commands import Command
from skyway.missions.items.parameters import FlightNeeds
from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.base.json_text import json_text

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from skyway.missions.items.document import MissionDocument
    from skyway.missions.items.parameters import Parameter
    from skyway.recharge.cutting import Recharged
    from skyway.recharge.summary import RechargeSummary

SUMMARY = "recharge.json"
"""Marks a folder of ours: others are never replaced."""


REORDERED = "reordered.plan"
"""The whole mission in its new order, if that differs: reports use its item numbers."""
WHOLE = "all-batteries.plan"
"""All flights in one mission, if an autopilot stays in it after a landing that disarms."""


def names_of(found: Recharged) -> dict[str, list[str]]:
    """Return the file of each flight by autopilot."""
    return {
        name: [f"{name}/battery-{number}.plan" for number in range(1, len(flights) + 1)]
        for name, flights in found.flights.items()
    }


def refuse_folder(folder: Path, *, force: bool) -> None:
    """Refuse at the beginning a folder that could not be written at the end."""
    if not folder.parent.is_dir():
        raise InputError("no such folder", str(folder.parent), remedy="create it first")
    if not os.access(folder.parent, os.W_OK):
        raise InputError("cannot be written to", str(folder.parent), remedy="choose another folder")
    if not folder.exists():
        return
    ours = folder.is_dir() and ((folder / SUMMARY).is_file() or not any(folder.iterdir()))
    if not ours:
        raise InputError("exists, and was not written by skyway recharge", str(folder), remedy="name another one")
    if not force and any(folder.iterdir()):
        raise InputError("exists already", str(folder), remedy="give another name, or --force to replace it")


def mission_texts(found: Recharged) -> dict[str, str]:
    """Return the mission files of a set by their names in its folder."""
    texts: dict[str, str] = {}
    for name, flights in found.flights.items():
        for file, flight in zip(names_of(found)[name], flights, strict=True):
            made = files_of(flight.document, Path(file))
            texts |= {str(path): make(flight.document) for path, make in made.items()}
    return texts


def identity_of(found: Recharged) -> str:
    """Return the name of a set: the same missions have the same name."""
    texts = sorted(mission_texts(found).items())
    return f"set-{hashlib.sha256(json.dumps(texts).encode()).hexdigest()[:12]}"


def write_folder(
    found: Recharged,
    summary: RechargeSummary,
    folder: Path,
    *,
    force: bool = False,
    beside: Callable[[Mapping[str, str]], Mapping[str, str | bytes]] = lambda _: {},
) -> list[Path]:
    """Write the folder of a set atomically; return its files."""
    return write_contents(contents_of(found, summary, beside), folder, force=force)


def contents_of(
    found: Recharged,
    summary: RechargeSummary,
    beside: Callable[[Mapping[str, str]], Mapping[str, str | bytes]] = lambda _: {},
) -> dict[str, str | bytes]:
    """Return the files of a set by their names in its folder, with those made from them by `beside`."""
    texts = {SUMMARY: json_text(summary, indent=1) + "\n", **mission_texts(found)}
    if found.order is not None and found.order.moved:
        texts[REORDERED] = plan_writer.dumps(replace(found.told[0].document, mission=found.problem.work.mission))
    for name in found.flights:
        if name in found.whole:
            texts |= {f"{name}/{WHOLE}": plan_writer.dumps(found.whole[name])}
        family = family_named(name)
        texts[f"{name}/vehicle.param"] = family.parameter_file(parameters_of(found, name), family.released)
    return {**texts, **beside(texts)}


def write_contents(contents: Mapping[str, str | bytes], folder: Path, *, force: bool = False) -> list[Path]:
    """Write a folder atomically; return its files.

    It is made beside its place and then moved there, so that it is never incomplete.
    """
    refuse_folder(folder, force=force)
    try:
        made = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise file_error("written", folder, error) from error
    try:
        for file, content in contents.items():
            path = made / file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        made.chmod(0o777 & ~_umask())
        _moved(made, folder)
    except OSError as error:
        raise file_error("written", folder, error) from error
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return [folder / file for file in contents]


def _moved(beside: Path, folder: Path) -> None:
    """Replace a folder by another; the old one is removed only when the new one is in place."""
    if not folder.exists():
        beside.rename(folder)
        return
    old = Path(tempfile.mkdtemp(prefix=f".{folder.name}-old-", dir=folder.parent))
    folder.rename(old / folder.name)
    try:
        beside.rename(folder)
    except OSError:
        (old / folder.name).rename(folder)
        raise
    finally:
        shutil.rmtree(old, ignore_errors=True)


def _umask() -> int:
    mask = os.umask(0o022)
    os.umask(mask)
    return mask


def parameters_of(
    found: Recharged, name: str, documents: Sequence[MissionDocument] | None = None
) -> tuple[Parameter, ...]:
    """Return the required settings of a vehicle for all flights, or for named ones."""
    written = documents or [flight.document for flight in found.flights[name]]
    options = found.problem.options
    conditions = options.conditions
    items = [item for one in written for item in one.mission.items]
    speeds = [item.param2 for item in items if item.command == Command.DO_CHANGE_SPEED and item.param2 > 0.0]
    if documents is None:
        heights = [step.height_m for step in found.problem.work.steps]
        heights += [float(found.problem.ways.level_m[cut.point, cut.pads[0]]) for cut in found.cuts]
        highest_m = max(heights) - min([0.0, *found.problem.ways.ground_m])
    else:
        highest_m = max(step.height_m for one in documents for step in fly(one.mission).steps)
    document = written[0]
    needs = FlightNeeds(
        ground_speed_mps=max([*speeds, options.transit.speed_mps]),
        climb_rate_mps=conditions.climb_rate_mps,
        descent_rate_mps=conditions.descent_rate_mps,
        return_height_m=math.ceil(highest_m),
        fenced=bool(document.fence),
        has_rally_points=len(document.rally) > 0,
        continues_after_landing=False,
        stays_armed=False,
        uses_gripper=any(item.command == Command.DO_GRIPPER for item in items),
    )
    return family_named(name).parameters(needs)
