"""Addresses of ledgers in databases, ``postgresql://USER:PASSWORD@HOST/DATABASE``; the password is never told."""

from __future__ import annotations

import re

from skyway.models.base.errors import InputError

_USER = re.compile(r"^(?P<scheme>\w+://)(?P<user>[^:?]*)(?P<password>:[^?]*)?@", re.ASCII)


def without_password(address: str) -> str:
    """Return an address, or any other name of a ledger, as it may be told and stored."""
    told = _USER.sub(r"\g<scheme>\g<user>@", address)
    return re.sub(r"(?<=[?&])password=[^&]*&?", "", told).rstrip("?&") if "://" in told else told


def refuse_unescaped(address: str) -> None:
    """Refuse an address whose user or password has a separator, with an `InputError`: parts of it would be taken for the host, and told."""
    found = _USER.match(address)
    if found is not None and re.search("[/@#]", found["user"] + (found["password"] or "")):
        remedy = "write / as %2F, @ as %40 and # as %23, or give the password in PGPASSWORD"
        raise InputError(
            "has a separator in the user or the password",
            field="--ledger",
            value=without_password(address),
            remedy=remedy,
        )
