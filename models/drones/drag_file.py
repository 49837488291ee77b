"""Drag files (``schema = "skyway.drag/1"``), written by ``skyway calibrate wind``.

The drag of a multirotor stands at the top, the airspeed sensor of a plane in a table ``[airspeed]``; a VTOL may have both.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.fields import Table, read_toml
from skyway.models.drones.airspeed import AirspeedModel
from skyway.models.drones.drag import DragModel

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SCHEMA = "skyway.drag/1"


@dataclass(frozen=True, slots=True)
class AirFile:
    """Contents of a drag file; None for missing parts."""

    drag: DragModel | None
    airspeed: AirspeedModel | None


def drag_file(drag: DragModel | None, notes: Sequence[str] = (), airspeed: AirspeedModel | None = None) -> str:
    """Write a drag, an airspeed sensor, or both as TOML, with notes as comments, with the uncertainty for another flight."""
    lines = [*(f"# {note}" for note in notes), f'schema = "{SCHEMA}"']
    if drag is not None:
        drag = drag.another_flight()
        lines += [f"{item.name} = {float(getattr(drag, item.name))!r}" for item in fields(drag)]
    if airspeed is not None:
        airspeed = airspeed.another_flight()
        lines += ["", "[airspeed]", f"factor = {airspeed.factor!r}"]
        lines += [f"heading_offset_deg = {math.degrees(airspeed.heading_offset_rad)!r}"]
        lines += [f"sigma_mps = {airspeed.sigma_mps!r}", f"slip_sigma_deg = {math.degrees(airspeed.slip_sigma_rad)!r}"]
        lines += [f"factor_sigma = {airspeed.factor_sigma!r}"]
        lines += [f"heading_sigma_deg = {math.degrees(airspeed.heading_sigma_rad)!r}"]
    return "\n".join(lines) + "\n"


def read_drag(path: Path) -> DragModel:
    """Read the drag of a file that has one; an `InputError` with every fault in the file."""
    drag = read_air(path).drag
    if drag is None:
        raise InputError("is missing", str(path), None, "linear_per_s")
    return drag


def read_air(path: Path) -> AirFile:
    """Read a file; an `InputError` with every fault in it."""
    faults: list[Fault] = []
    top = Table(read_toml(path), str(path), "", faults)
    top.text("schema", SCHEMA, choices=(SCHEMA,))
    airspeed = _airspeed(top.table("airspeed")) if "airspeed" in top else None
    drag = _drag(top) if airspeed is None or "linear_per_s" in top else None
    top.finish()
    if drag is not None and not faults and drag["linear_per_s"] + drag["quadratic_per_m"] <= 0.0:
        top.fault("linear_per_s", "is 0, and so is quadratic_per_m: with a drag of 0 the wind cannot be estimated")
    refuse(faults)
    return AirFile(None if drag is None else DragModel(**drag), None if airspeed is None else AirspeedModel(**airspeed))


def _drag(top: Table) -> dict[str, float]:
    known = DragModel().another_flight()
    return {
        "linear_per_s": top.number("linear_per_s", low=0.0, high=10.0),
        "quadratic_per_m": top.number("quadratic_per_m", 0.0, low=0.0, high=10.0),
        "bias_forward_mps2": top.number("bias_forward_mps2", 0.0, low=-5.0, high=5.0),
        "bias_right_mps2": top.number("bias_right_mps2", 0.0, low=-5.0, high=5.0),
        "sigma_mps2": top.number("sigma_mps2", known.sigma_mps2, above=0.0, high=20.0),
        "period_s": top.number("period_s", known.period_s, low=0.1, high=60.0),
        "relative_sigma": top.number("relative_sigma", known.relative_sigma, low=0.0, high=1.0),
        "bias_sigma_mps2": top.number("bias_sigma_mps2", known.bias_sigma_mps2, low=0.0, high=5.0),
        "manoeuvre_share": top.number("manoeuvre_share", known.manoeuvre_share, low=0.0, high=1.0),
    }


def _airspeed(part: Table) -> dict[str, float]:
    known = AirspeedModel().another_flight()
    values = {
        "factor": part.number("factor", 1.0, low=0.2, high=5.0),
        "heading_offset_rad": math.radians(part.number("heading_offset_deg", 0.0, low=-180.0, high=180.0)),
        "sigma_mps": part.number("sigma_mps", known.sigma_mps, above=0.0, high=20.0),
        "slip_sigma_rad": math.radians(part.number("slip_sigma_deg", 5.0, above=0.0, high=90.0)),
        "factor_sigma": part.number("factor_sigma", known.factor_sigma, low=0.0, high=1.0),
        "heading_sigma_rad": math.radians(
            part.number("heading_sigma_deg", math.degrees(known.heading_sigma_rad), low=0.0, high=180.0)
        ),
    }
    part.finish()
    return values
