"""JSON of typed structs: the names of their fields are its names; NaN and infinities are null."""

from __future__ import annotations

import json
import math
from dataclasses import fields, is_dataclass
from typing import Any

HIDDEN = {"json": False}
"""Metadata of a dataclass field that JSON omits."""


def json_text(value: Any, *, indent: int | None = None) -> str:
    """Write a value as JSON; NaN and infinities, which JSON does not know, become null: unknown."""
    return json.dumps(plain(value), indent=indent, allow_nan=False)


def plain(value: Any) -> Any:
    """Return plain JSON values of any value: structs as objects, without fields that are hidden or not set."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if hasattr(value, "__struct_fields__"):
        if hasattr(value, "to_json"):  # it defines its own JSON form
            return value.to_json()
        from msgspec import UNSET

        names = zip(value.__struct_encode_fields__, value.__struct_fields__, strict=True)
        found = ((name, getattr(value, field)) for name, field in names)
        return {name: plain(one) for name, one in found if one is not UNSET}
    if is_dataclass(value):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value) if one.metadata != HIDDEN}
    return value
