"""Remote ID: the operator's data that a drone broadcasts."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.models.base.errors import Fault, InputError

if TYPE_CHECKING:
    from skyway.models.base.fields import Table

MAX_OPERATOR_ID, MAX_SELF_ID = 20, 23
"""Characters that the messages hold."""
_ALPHABET = "0123456789abcdefghijklmnopqrstuvwxyz"
_EU = re.compile(r"([A-Z]{3}[0-9a-z]{13})(?:-([0-9a-z]{3}))?")


@dataclass(frozen=True, slots=True, kw_only=True)
class RemoteId:
    """Operator data for Remote ID; empty texts are not sent."""

    operator_id: str = ""
    """Registration of the operator, as it is broadcast: without the secret digits."""
    self_id: str = ""
    """Purpose of the flight, in words."""
    lat_deg: float = math.nan
    lon_deg: float = math.nan
    """`lat_deg`, `lon_deg`: position of the operator; NaN is the place of take-off."""

    @property
    def given(self) -> bool:
        """Whether any value was given."""
        return bool(self.operator_id or self.self_id or math.isfinite(self.lat_deg))

    def changed(self, operator_id: str | None, self_id: str | None, place: tuple[float, float] | None) -> RemoteId:
        """Return it with the typed values applied. Raises an `InputError` if they cannot be broadcast."""
        found = self
        if operator_id is not None:
            found = replace(found, operator_id=broadcast_id(operator_id, "--operator-id"))
        if self_id is not None:
            found = replace(found, self_id=_words(self_id, "--self-id"))
        return found if place is None else replace(found, lat_deg=place[0], lon_deg=place[1])


NOBODY = RemoteId()
"""Nothing is broadcast about the operator."""


def broadcast_id(text: str, field: str) -> str:
    """Return the part of an operator's registration that is broadcast.

    European registrations (``FIN87astrdge12k8-xyz``) end in three secret digits, by which alone the check digit can be verified: they are
    verified and left out. Raises an `InputError` if it is not a registration.
    """
    text = text.strip()
    found = _EU.fullmatch(text)
    if found is not None and found[2] is not None:
        body = found[1][3:15] + found[2]
        if check_digit(body) != found[1][15]:
            remedy = "type it as it was issued: one character is wrong, or two are exchanged"
            raise InputError(Fault("its check digit is wrong", field=field, value=found[1], remedy=remedy))
        return found[1]
    if "-" in text and len(text) > MAX_OPERATOR_ID - 1:
        remedy = "three letters of the country, 13 letters or digits, in Europe a dash and three secret digits"
        raise InputError(Fault("is not a registration", field=field, value=text[:40], remedy=remedy))
    return _fitting(text, MAX_OPERATOR_ID, field)


def check_digit(text: str) -> str:
    """Return the check digit of small letters and digits (Luhn's, modulo 36), as European registrations have it."""
    total = 0
    for number, one in enumerate(reversed(text)):
        value = _ALPHABET.index(one) * (2 - number % 2)
        total += value // 36 + value % 36
    return _ALPHABET[-total % 36]


def _words(text: str, field: str) -> str:
    return _fitting(text.strip(), MAX_SELF_ID, field)


def _fitting(text: str, most: int, field: str) -> str:
    if not text or not text.isascii() or not text.isprintable() or len(text) > most:
        remedy = f"1 to {most} letters, digits and signs of ASCII: the message has no more space"
        raise InputError(Fault("cannot be broadcast", field=field, value=text[:40], remedy=remedy))
    return text


def read_remote_id(table: Table) -> RemoteId:
    """Read the table ``[remote_id]`` of a scenario; faults are collected there."""
    found: dict[str, str] = {}
    for key, take in (("operator_id", broadcast_id), ("self_id", _words)):
        if key not in table:
            continue
        try:
            found[key] = take(table.text(key), f"{table.path}.{key}")
        except InputError as error:
            for one in error.faults:
                table.fault(key, one.problem, one.value, one.remedy)
    lat_deg = lon_deg = math.nan
    if "lat" in table or "lon" in table:
        lat_deg, lon_deg = table.number("lat", low=-90, high=90), table.number("lon", low=-180, high=180)
    table.finish()
    return RemoteId(
        operator_id=found.get("operator_id", ""), self_id=found.get("self_id", ""), lat_deg=lat_deg, lon_deg=lon_deg
    )
