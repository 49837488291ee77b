"""Drag of a drone as a file (``schema = "skyway.drag/1"``), written by ``skyway calibrate wind``."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from models.drag import DragModel
from models.errors import Fault, InputError
from models.fields import Table, read_toml

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

SCHEMA = "skyway.drag/1"


def drag_file(drag: DragModel, notes: Sequence[str] = ()) -> str:
    """Write a drag as TOML, with notes as comments."""
    lines = [*(f"# {note}" for note in notes), f'schema = "{SCHEMA}"']
    lines += [f"{item.name} = {float(getattr(drag, item.name))!r}" for item in fields(drag)]
    return "\n".join(lines) + "\n"


def read_drag(path: Path) -> DragModel:
    """Read a drag.

    Raises
    ------
    InputError
        With every fault in the file.
    """
    faults: list[Fault] = []
    top = Table(read_toml(path), str(path), "", faults)
    top.text("schema", SCHEMA, choices=(SCHEMA,))
    known = DragModel()
    values = {
        "linear_per_s": top.number("linear_per_s", low=0.0, high=10.0),
        "quadratic_per_m": top.number("quadratic_per_m", 0.0, low=0.0, high=10.0),
        "bias_forward_mps2": top.number("bias_forward_mps2", 0.0, low=-5.0, high=5.0),
        "bias_right_mps2": top.number("bias_right_mps2", 0.0, low=-5.0, high=5.0),
        "sigma_mps2": top.number("sigma_mps2", known.sigma_mps2, above=0.0, high=20.0),
        "period_s": top.number("period_s", known.period_s, low=0.1, high=60.0),
        "relative_sigma": top.number("relative_sigma", 0.0, low=0.0, high=1.0),
    }
    top.finish()
    if not faults and values["linear_per_s"] + values["quadratic_per_m"] <= 0.0:
        top.fault("linear_per_s", "and quadratic_per_m are both 0: a drag of 0 tells no wind")
    if faults:
        raise InputError(faults)
    return DragModel(**values)
