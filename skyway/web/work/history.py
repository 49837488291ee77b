"""Journals of a folder: what was flown, and totals."""

from __future__ import annotations

import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any

from skyway.models.base.errors import SkywayError
from skyway.models.base.units import J_PER_WH


def told(root: str, names: list[tuple[str, float]]) -> list[dict[str, Any]]:
    """Return a row for each journal: names within the folder and when each was changed; what is no journal is left out."""
    return [row for name, changed_s in names if (row := _row(root, name, changed_s)) is not None]


@lru_cache(maxsize=5000)
def _row(root: str, name: str, changed_s: float) -> dict[str, Any] | None:  # noqa: ARG001  the time is part of the key
    from skyway.report.report import flight

    try:
        report = flight(Path(root) / name)
    except SkywayError:
        return None
    wanted, totals = report.delivery, report.totals
    distance_m = sum(leg.distance_m or 0.0 for leg in report.planned.legs)
    track = report.series.track
    energy = [value for value in track.get("power_w", []) if value is not None]
    used = [leg.used_soc for leg in report.legs if leg.used_soc is not None]
    promise_s = totals.planned.arrive_p95_s
    arrived_s = (
        None
        if totals.actual.depart_s is None or totals.actual.delivery_s is None
        else totals.actual.depart_s + totals.actual.delivery_s
    )
    return {
        "file": name, "from": wanted.origin or "", "to": wanted.destination or "", "drone": wanted.drone or "",
        "payload_kg": wanted.payload_kg, "planner": wanted.planner or "", "state": report.outcome.state, "reason": report.outcome.reason or "",
        "delivered": report.outcome.delivered, "ended": report.outcome.ended, "depart_s": totals.actual.depart_s,
        "flight_s": totals.actual.flight_s, "delivery_s": totals.actual.delivery_s, "flights": totals.actual.flights or 0,
        "lowest_soc": totals.actual.lowest_soc, "reserve_soc": wanted.reserve_soc, "distance_m": distance_m,
        "promise_kept": None if promise_s is None or arrived_s is None or not report.outcome.delivered else arrived_s <= promise_s,
        "soc_used": sum(used) if used else None, "power_w": sum(energy) / len(energy) if energy else None,
        "decisions": len(report.decisions), "resumed": report.outcome.resumed,
    }  # fmt: skip


def report(path: str, scenario: str | None) -> bytes:
    """Return the report of a journal as ``skyway report`` writes it: a page of HTML that needs nothing else."""
    from skyway.report.report import write_report
    from skyway.web.work.region import loaded

    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        write_report(Path(path), page, scenario=None if scenario is None else loaded(scenario))
        return page.read_bytes()


def energy_per_km(rows: list[dict[str, Any]]) -> float | None:
    """Return Wh per km over the flights whose power was told."""
    known = [row for row in rows if row["power_w"] is not None and row["flight_s"] and row["distance_m"]]
    way_km = sum(row["distance_m"] for row in known) / 1000.0
    return sum(row["power_w"] * row["flight_s"] for row in known) / J_PER_WH / way_km if way_km > 0.0 else None
