"""Journals of a folder: past flights, and totals."""

from __future__ import annotations

import html
import re
import tempfile
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import SkywayError
from skyway.models.base.geodesy import distance_m
from skyway.models.base.units import J_PER_WH

if TYPE_CHECKING:
    from skyway.report.flight_report import FlightReport

HEAD = 4096
"""Bytes of a page with its generator and its title, and of a journal with its schema."""
_WRITTEN = '<meta name="generator" content="skyway report">'
_TITLE = re.compile(r"<title>([^<]*)</title>")
GAP_S = 60.0
"""The way between samples further apart in time is unknown."""


def told(root: str, names: list[tuple[str, float]]) -> list[dict[str, Any]]:
    """Return a row for each journal: names within the folder and when each was changed; other files are omitted.

    The row of a journal that cannot be read has only its name and the reason, `unread`.
    """
    return [row for name, changed_s in names if (row := _row(root, name, changed_s)) is not None]


@lru_cache(maxsize=5000)
def _row(root: str, name: str, changed_s: float) -> dict[str, Any] | None:  # noqa: ARG001  the time is part of the key
    from skyway.report.report import flight

    try:
        report = flight(Path(root) / name)
    except SkywayError as error:
        return {"file": name, "unread": str(error)} if _begins_as_journal(Path(root) / name) else None
    wanted, totals = report.delivery, report.totals
    flown_m, measured_m, energy_j = flown(report.series.track)
    arrived_s = (
        None
        if totals.actual.depart_s is None or totals.actual.delivery_s is None
        else totals.actual.depart_s + totals.actual.delivery_s
    )
    return {
        "file": name, "from": wanted.origin or "", "to": wanted.destination or "", "drone": wanted.drone or "",
        "payload_kg": wanted.payload_kg, "planner": wanted.planner or "", "state": report.outcome.state, "reason": report.outcome.reason or "",
        "hands_over": wanted.hands_over, "arrived": report.outcome.arrived, "delivered": report.outcome.delivered, "ended": report.outcome.ended, "depart_s": totals.actual.depart_s,
        "flight_s": totals.actual.flight_s, "delivery_s": totals.actual.delivery_s, "flights": totals.actual.flights or 0,
        "lowest_soc": totals.actual.lowest_soc, "reserve_soc": wanted.reserve_soc,
        "flown_m": flown_m, "measured_m": measured_m, "energy_j": energy_j,
        "half_kept": _kept("arrive_p50_s", arrived_s, report),
        "promise_kept": _kept("arrive_p95_s", arrived_s, report),
        "decisions": len(report.decisions), "resumed": report.outcome.resumed,
    }  # fmt: skip


def _begins_as_journal(path: Path) -> bool:
    """Whether a file was a journal before it was damaged."""
    from skyway.link.supervisor.journal.file import SCHEMA

    try:
        with path.open("rb") as file:
            return SCHEMA.encode() in file.read(HEAD)
    except OSError:
        return False


def reports(root: str, names: list[str]) -> list[dict[str, str]]:
    """Return file and title of each report that ``skyway report`` has written into a folder; other pages are omitted."""
    found = []
    for name in names:
        try:
            with (Path(root) / name).open("rb") as file:
                head = file.read(HEAD).decode("utf-8", "replace")
        except OSError:
            continue
        title = _TITLE.search(head)
        if _WRITTEN in head and title is not None:
            found.append({"file": name, "title": html.unescape(title[1])[:300]})
    return found


def _kept(name: str, arrived_s: float | None, report: FlightReport) -> bool | None:
    """Whether a promise was kept; not if the delivery failed, unknown while it is in progress.

    None without a package, or if its planner simulated no deliveries: a dispatcher promises by its own plan, not by that of a flight.
    """
    planned = report.totals.planned
    promised_s: float | None = getattr(planned, name) if planned.runs else None
    if promised_s is None or not report.outcome.ended or not report.delivery.hands_over:
        return None
    return report.outcome.delivered and arrived_s is not None and arrived_s <= promised_s


def flown(track: dict[str, list[Any]]) -> tuple[float, float, float]:
    """Return the way flown, m, the part of it with known power, m, and the energy over that part, J: from sample to sample in the air."""
    names = ("time_s", "flight", "air", "lat", "lon", "power_w")
    flown_m = measured_m = energy_j = 0.0
    for before, now in pairwise(zip(*(track.get(name, []) for name in names), strict=True)):
        took_s = now[0] - before[0]
        if before[1] != now[1] or not (before[2] and now[2]) or None in (*before[3:5], *now[3:5]) or took_s > GAP_S:
            continue
        step_m = distance_m(before[3], before[4], now[3], now[4])
        flown_m += step_m
        if before[5] is not None and now[5] is not None:
            measured_m += step_m
            energy_j += took_s * (before[5] + now[5]) / 2.0
    return flown_m, measured_m, energy_j


def report(path: str, scenario: str | None) -> bytes:
    """Return the report of a journal, as ``skyway report`` writes it: a self-contained HTML page."""
    from skyway.report.report import write_report
    from skyway.web.work.region import loaded

    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "report.html"
        write_report(Path(path), page, scenario=None if scenario is None else loaded(scenario))
        return page.read_bytes()


def energy_per_km(rows: list[dict[str, Any]]) -> float | None:
    """Return Wh per km flown, if the power is known."""
    way_km = sum(row["measured_m"] for row in rows) / 1000.0
    return sum(row["energy_j"] for row in rows) / J_PER_WH / way_km if way_km > 0.0 else None
