"""Radios, other aircraft and Remote ID in a flight report, from the journal."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.link.supervisor.journal import entries
from skyway.link.supervisor.journal import fields as of
from skyway.models.base.formatting import UNKNOWN, percent, spent
from skyway.report.flight_report import AircraftSeen, RadioSeen, RemoteIdSeen

if TYPE_CHECKING:
    from skyway.link.supervisor.journal.file import Record
    from skyway.report.flight_report import FlightReport

Measured = list[tuple[float, entries.RadioMeasured]]
_MAX_ROWS = 1000


def radios_seen(records: tuple[Record, ...]) -> list[RadioSeen]:
    """Return each radio, in the order of first appearance."""
    found: dict[str, Measured] = {}
    for at_s, record in of.timed(records):
        entry = record.entry(entries.RadioMeasured)
        if entry is not None and entry.radio is not None:
            found.setdefault(entry.radio, []).append((at_s, entry))
    return [_radio(name, told) for name, told in found.items()]


def _radio(name: str, told: Measured) -> RadioSeen:
    received = sum(max(one.received or 0, 0) for _, one in told)
    lost = sum(max(one.lost or 0, 0) for _, one in told)
    losses = [(_loss(one.received or 0, one.lost or 0), at_s) for at_s, one in told]
    known = [(loss, at_s) for loss, at_s in losses if loss is not None]
    worst = max(known, default=None)
    rssi = [value for _, one in told for value in (one.rssi, one.remote_rssi) if value is not None]
    pairs = ((one.rssi, one.noise) for _, one in told), ((one.remote_rssi, one.remote_noise) for _, one in told)
    margins = [signal - noise for side in pairs for signal, noise in side if signal is not None and noise is not None]
    return RadioSeen(
        radio=name, used_share=sum(one.used is True for _, one in told) / len(told), received=received, lost=lost,
        loss=_loss(received, lost), worst_loss=None if worst is None else worst[0], worst_at_s=None if worst is None else worst[1],
        delay_s=max((one.delay_s for _, one in told if one.delay_s is not None), default=None),
        round_trip_s=max((one.round_trip_s for _, one in told if one.round_trip_s is not None), default=None),
        lowest_rssi=min(rssi, default=None), worst_margin=min(margins, default=None),
    )  # fmt: skip


def _loss(received: int, lost: int) -> float | None:
    """Share that did not arrive; all of it where nothing came, as far as is known."""
    return lost / (received + lost) if received > 0 else None


def aircraft_seen(records: tuple[Record, ...]) -> list[AircraftSeen]:
    """Return other aircraft that came near, and what was done about them."""
    events = {entries.AircraftNear.event(), entries.GaveWay.event()}
    return _said(records, events)[:_MAX_ROWS]


def remote_id_seen(records: tuple[Record, ...]) -> RemoteIdSeen | None:
    """Return what the Remote ID module said; None where the journal does not tell."""
    told = [entry for _, record in of.timed(records) if (entry := record.entry(entries.RemoteIdNote)) is not None]
    if not told:
        return None
    said = _said(records, {entries.RemoteIdNote.event()})[:_MAX_ROWS]
    return RemoteIdSeen(operator=told[-1].operator, self_id=told[-1].self_id, said=said)


def _said(records: tuple[Record, ...], events: set[str]) -> list[AircraftSeen]:
    return [
        AircraftSeen(time_s=at_s, flight=record.flight, said=record.reason or record.event)
        for at_s, record in of.timed(records)
        if record.event in events
    ]


RADIO_HEAD = (
    "radio",
    "in use",
    "packets",
    "lost",
    "lost at worst",
    "at",
    "behind the quickest",
    "round trip",
    "RSSI at worst",
    "above noise at worst",
)


def radio_rows(document: FlightReport) -> list[tuple[str, ...]]:
    """Return the radios as rows under `RADIO_HEAD`."""
    return [
        (
            one.radio, percent(one.used_share), str(one.received), percent(one.loss), percent(one.worst_loss),
            UNKNOWN if one.worst_at_s is None else document.clock(one.worst_at_s), _time(one.delay_s), _time(one.round_trip_s),
            _number(one.lowest_rssi), _number(one.worst_margin),
        )
        for one in document.radios
    ]  # fmt: skip


def remote_id_line(document: FlightReport) -> str:
    """Return whether the operator's identity was broadcast."""
    found = document.remote_id
    if found is None:
        return "Remote ID: not in the journal."
    told = ", ".join(one for one in (found.operator, found.self_id) if one) or "no operator was given"
    return f"Remote ID: {told}; " + "; ".join(f"{document.clock(one.time_s)} {one.said}" for one in found.said)


def _time(seconds: float | None) -> str:
    return UNKNOWN if seconds is None else spent(seconds)


def _number(value: int | None) -> str:
    return UNKNOWN if value is None else str(value)
