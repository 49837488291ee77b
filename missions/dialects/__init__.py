"""Dialects: one file per autopilot, each quirk at home in its own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.missions.dialects.ardupilot.dialect import ARDUPILOT
from skyway.missions.dialects.px4.dialect import PX4
from skyway.missions.dialects.settings import version_of
from skyway.missions.items.parameters import dumps
from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.dialects.protocol import Dialect
    from skyway.missions.items.parameters import Parameter

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (PX4, ARDUPILOT)}


def dialect(name: str) -> Dialect:
    """Return the dialect of an autopilot by its name; an `InputError` for another name."""
    try:
        return DIALECTS[name]
    except KeyError:
        choices = " or ".join(DIALECTS)
        raise InputError(Fault("is no autopilot that we know", None, None, "autopilot", name, choices)) from None


def dumps_for(autopilot: Dialect, parameters: Sequence[Parameter], firmware: str) -> str:
    """Return the text of a parameter file for a version of an autopilot's firmware, such as ``4.6`` or ``main``."""
    version = version_of(firmware)
    words = f"{autopilot.name} {firmware} (another version: --firmware)"
    return dumps(parameters, firmware=words, way=lambda need: autopilot.settings.in_version(need, version))


def dialect_of_firmware(firmware: int | None) -> Dialect | None:
    """Return the dialect of a MAV_AUTOPILOT number, or None where we have none."""
    return next((known for known in DIALECTS.values() if known.firmware == firmware), None)
