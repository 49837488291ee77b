"""The plan of the demonstration."""

from __future__ import annotations

from pathlib import Path


def prepared(folder: str) -> dict[str, str]:
    """Plan the delivery and calibrate its drone, into the work folder."""
    from skyway.flights.demonstration import prepare

    return prepare(Path(folder))
