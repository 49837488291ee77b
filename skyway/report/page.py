"""The report of a flight as one self-contained page, made from the struct `FlightReport` alone."""

from __future__ import annotations

from importlib import resources
from typing import TYPE_CHECKING

from skyway import __version__
from skyway.link.supervisor.journal import fields as of
from skyway.models.base.formatting import (
    UNKNOWN,
    counter,
    date_clock,
    distance_text,
    duration,
    mass_text,
    percent,
    speed_text,
)
from skyway.models.base.units import from_posix
from skyway.models.base.views import how_often
from skyway.report.charts import charts
from skyway.report.heights import drawn_heights
from skyway.report.map import drawn_map
from skyway.report.seen import RADIO_HEAD, radio_rows, remote_id_line
from skyway.report.svg import safe

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from skyway.report.flight_report import FlightReport
    from skyway.report.map import Zone
    from skyway.report.series import WindExpected, WindFound

_MAX_EVENTS = 2_000
_MARKED = {"ok": "ok", "no": "no"}
"""CSS class of a verdict."""
_BAD_ENDS = {
    "stopped-safe": "stopped, safe on the ground",
    "landed-elsewhere": "landed away from a station",
    "crashed": "crashed",
    "left-to-itself": "left to the drone's own failsafes",
}


def page(document: FlightReport, zones: list[Zone] | None) -> str:
    """Return the page."""
    template = page_template()
    delivery = document.delivery
    title = f"{_headline(document)}: {delivery.origin or UNKNOWN} to {delivery.destination or UNKNOWN}"
    body = "\n".join(
        (
            _head(document),
            '<div class="two">' + _section("Map", drawn_map(document, zones)) + _story(document) + "</div>",
            _section("Flights: planned at take-off, and flown", _legs(document)),
            _section("Course", _figures(document)),
            *([_section("Terrain", heights)] if (heights := drawn_heights(document)) else []),
            _section("Wind", _winds(document)),
            _section("Stops", _stops(document)),
            _section("Decisions and reasons", _decisions(document)),
            _section("Plans in the order flown", _plans(document)),
            _section("Radios, other aircraft, Remote ID", _seen(document)),
            _section("Preflight checks", _preflights(document)),
            _section("All events", _events(document)),
            _foot(document),
        )
    )
    before, after = template.split("<!--BODY-->")
    return before.replace("<!--TITLE-->", safe(title)) + body + after


def page_template() -> str:
    """Return the page without its content."""
    return (resources.files("skyway.report") / "page.html").read_text(encoding="utf-8")


def _section(title: str, content: str) -> str:
    return f"<section><h2>{safe(title)}</h2>{content}</section>"


def rows(head: Sequence[str], body: Iterable[Sequence[str]], kinds: str) -> str:
    """Return a table; `kinds` gives for each column numbers (n), times (t) or words (w)."""
    lines = [
        "<tr>"
        + "".join(f'<td class="{kind}">{safe(cell)}</td>' for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in body
    ]
    if not lines:
        return '<p class="none">none</p>'
    top = "".join(f'<th scope="col" class="{kind}">{safe(cell)}</th>' for kind, cell in zip(kinds, head, strict=True))
    return f'<div class="wide"><table><thead><tr>{top}</tr></thead><tbody>{"".join(lines)}</tbody></table></div>'


def _headline(document: FlightReport) -> str:
    outcome = document.outcome
    if not outcome.ended:
        return f"Not ended: the journal breaks off in the state {outcome.state}"
    delivers = document.delivery.hands_over
    if outcome.state == "delivered":
        return "Delivered" if delivers else "Arrived, without a package to deliver"
    if outcome.state == "done":
        return "Work done"
    end = _BAD_ENDS.get(outcome.state)
    if end is None:
        return f"Ended in state {outcome.state}"
    return f"{'Not delivered' if delivers else 'Not arrived'}: {end}"


def _head(document: FlightReport) -> str:
    delivery, outcome = document.delivery, document.outcome
    planned, actual = document.totals.planned, document.totals.actual
    good = "good" if outcome.arrived else "bad"
    what = [delivery.drone_name or delivery.drone or "drone unknown", mass_text(delivery.payload_kg)]
    what += [f"planner {delivery.planner or UNKNOWN}", delivery.vehicle or "vehicle unknown"]
    if outcome.resumed:
        what.append(f"resumed {outcome.resumed} times")
    where = f"at {outcome.station}" if outcome.station else "station unknown"
    lines = (
        ("until the end", "delivery_s", counter), ("in flight", "flight_s", counter), ("waiting for pads", "wait_s", counter),
        ("charging", "charge_s", counter), ("flights", "flights", lambda n: UNKNOWN if n is None else f"{n}"),
        ("lowest charge at a landing", "lowest_soc", percent),
    )  # fmt: skip
    cells = "".join(
        f"<div><dt>{name}</dt><dd><b>{safe(show(getattr(actual, key)))}</b><span>typical schedule {safe(show(getattr(planned, key)))}</span></dd></div>"
        for name, key, show in lines
    )
    last = of.instant_s(document.outcome.time)
    ended = UNKNOWN if last is None else date_clock(from_posix(last), document.zone, named=True)
    proof = f"<p>Package {safe(outcome.proof)}: {safe(outcome.proof_reason or '')}</p>" if outcome.proof else ""
    return (
        f'<header><span class="badge {good}">{safe(_headline(document))}</span>'
        f"<h1>{safe(delivery.origin or UNKNOWN)} to {safe(delivery.destination or UNKNOWN)}</h1>"
        f"<p>{safe(outcome.reason or 'no reason recorded')} ({safe(where)}, {safe(ended)})</p>"
        f"{proof}<p><b>{safe(_expectation(document))}</b></p>"
        f'<p class="soft">{safe(", ".join(what))}</p><dl class="totals">{cells}</dl></header>'
    )


def _expectation(document: FlightReport) -> str:
    """Say how long it took beside what was expected: on average, and by when half and 95 % of such flights arrive."""
    planned, actual = document.totals.planned, document.totals.actual
    arrives = (planned.arrive_mean_s, planned.arrive_p50_s, planned.arrive_p95_s)
    begun, known = planned.depart_s, [at_s for at_s in arrives if at_s is not None]
    if begun is None or len(known) < len(arrives):
        return "The expected time is unknown."
    mean, half, most = (duration(at_s - begun) for at_s in known)
    took = actual.delivery_s if document.outcome.arrived else None
    arrived = "It did not arrive" if took is None else f"It took {duration(took)}"
    return f"{arrived}; expected at the first plan: {mean} on average, half within {half}, 95 % within {most}."


def _story(document: FlightReport) -> str:
    """Return what differed from the plan, in short: decisions that changed something, and what was not meant to happen."""
    changed = [d for d in document.decisions if d.new_plan or d.action not in ("continue", "speed", None)]
    lines = [(d.time_s, f"{d.action or 'decided'}: {d.reason or 'no reason recorded'}") for d in changed]
    for event in document.contingencies:
        words = event.reason or event.event
        told_already = any(d.reason and d.reason in words and d.time_s == event.time_s for d in changed)
        if event.event != "decision" and not told_already:
            lines.append((event.time_s, words))
    speeds = sum(1 for d in document.decisions if d.action == "speed")
    told = rows(
        (f"at, {document.zone_name}", "what and why"),
        [(document.clock(at_s), text) for at_s, text in sorted(lines)],
        "tw",
    )
    if not lines:
        told = '<p class="none">Nothing: the first plan was flown.</p>'
    sent = how_often(speeds)
    return _section("What changed on the way", f"{told}<p class='soft'>The ground speed was changed {sent}.</p>")


def _figures(document: FlightReport) -> str:
    found = charts(document)
    return (
        f'<div class="charts">{"".join(chart.drawn() for chart in found)}</div>'
        if found
        else '<p class="none">unknown: no data with times</p>'
    )


def _legs(document: FlightReport) -> str:
    head = (
        "",
        "from",
        "to",
        "took off",
        "took",
        "(planned)",
        "charge",
        "landed with",
        "(planned)",
        "used",
        "(model)",
        "most off the route",
        "diverts",
    )
    body = []
    for leg in document.legs:
        to = " > ".join([*(f"({name})" for name in leg.via), leg.destination or UNKNOWN])
        if leg.land_s is None:
            to += ", no landing recorded"
        elif leg.as_planned is False or leg.landed_at != leg.destination:
            to += f", landed at {leg.landed_at or 'an unknown place'}"
        body.append(
            (
                str(leg.flight), leg.origin or UNKNOWN, to, document.clock(leg.depart_s), counter(leg.flight_s),
                f"({counter(leg.planned_s)})", percent(leg.soc_depart), percent(leg.soc_land),
                f"({percent(leg.planned_soc)})", percent(leg.used_soc), f"({percent(leg.modelled_soc)})",
                distance_text(leg.most_cross_track_m), ", ".join(leg.diverts) or "none",
            )
        )  # fmt: skip
    return rows(head, body, "nswtnnnnnnnns")


def _winds(document: FlightReport) -> str:
    def wind_text(wind: WindFound | None, without: str = UNKNOWN) -> str:
        return without if wind is None or wind.words is None else wind.words

    def expected(wind: WindExpected) -> str:
        origin = f" ({wind.origin})" if wind.origin else ""
        return UNKNOWN if wind.words is None else f"{wind.words}{origin}"

    head = (
        "flight",
        "expected at the take-off",
        "measured",
        "sigma",
        "true (simulation)",
        "error of the forecast",
        "error of the estimate",
    )
    body = [
        (
            str(leg.flight), expected(wind.forecast), wind_text(wind.estimate, "not measured"), speed_text(wind.estimate_sigma_mps),
            wind_text(wind.truth), speed_text(wind.forecast_rms_mps), speed_text(wind.estimate_rms_mps),
        )
        for leg in document.legs for wind in (leg.wind,)
    ]  # fmt: skip
    note = (
        "Mean speed (10 to 90 %) and prevailing direction of each flight; errors: root mean square of the difference to "
        "the true wind, gusts included; of the forecast, its mean vector."
    )
    return rows(head, body, "nttntnn") + f'<p class="soft">{note}</p>'


def _stops(document: FlightReport) -> str:
    planned = list(document.planned.stops)
    head = ("station", "landed", "left", "waited", "typical", "charged for", "typical", "charge", "typical")
    body = []
    for stop in document.stops:
        was = next((one for one in planned if one.station == stop.station), None)
        if was is not None:
            planned.remove(was)  # a station may be landed at twice
        body.append(
            (
                stop.station or UNKNOWN, document.clock(stop.arrive_s), document.clock(stop.leave_s), counter(stop.wait_s),
                "no stop" if was is None else counter(was.wait_s), counter(stop.charge_s),
                "no stop" if was is None else counter(was.charge_s),
                f"{percent(stop.soc_from)} > {percent(stop.soc_to)}",
                "no stop" if was is None else f"{percent(was.soc_from)} > {percent(was.soc_to)}",
            )
        )  # fmt: skip
    return rows(head, body, "tttnnnnnn")


def _decisions(document: FlightReport) -> str:
    body = [
        (
            document.clock(d.time_s), str(d.flight), d.where or UNKNOWN, d.action or UNKNOWN, d.reason or "none",
            percent(d.figures.get("soc")), percent(d.figures.get("soc_land", d.figures.get("planned_soc"))),
        )
        for d in document.decisions
    ]  # fmt: skip
    return rows(
        (f"at, {document.zone_name}", "flight", "on", "decided", "because", "charge", "charge needed, or at landing"),
        body,
        "tnttwnn",
    )


def _plans(document: FlightReport) -> str:
    body = [(document.clock(p.time_s), " > ".join(p.route) or "no plan", p.reason or "none") for p in document.plans]
    return rows((f"at, {document.zone_name}", "route", "because"), body, "tww")


def _seen(document: FlightReport) -> str:
    aircraft = [(document.clock(one.time_s), str(one.flight), one.said) for one in document.aircraft]
    told = (
        rows((f"at, {document.zone_name}", "flight", "other aircraft"), aircraft, "tnw")
        if aircraft
        else '<p class="none">No other aircraft came near, as far as the receiver of the drone heard.</p>'
    )
    return f"{rows(RADIO_HEAD, radio_rows(document), 'tnnnntnnnn')}{told}<p>{safe(remote_id_line(document))}</p>"


def _preflights(document: FlightReport) -> str:
    parts = []
    for entry in document.preflights:
        lines = [
            f'<tr><td class="t">{safe(check.name or UNKNOWN)}</td>'
            f'<td class="t {_MARKED.get(check.verdict or "", "unknown")}">{safe(check.verdict or UNKNOWN)}</td>'
            f'<td class="w">{safe(check.said or "")}</td></tr>'
            for check in entry.checks
        ]
        parts.append(
            f"<details><summary>{document.clock(entry.time_s)}, before flight {entry.flight + 1}: "
            f"{safe(entry.reason or UNKNOWN)}</summary>"
            f'<div class="wide"><table><tbody>{"".join(lines)}</tbody></table></div></details>'
        )
    return "".join(parts) or '<p class="none">none</p>'


def _events(document: FlightReport) -> str:
    events = document.events
    body = [(str(e.n), document.clock(e.time_s), e.state, e.event, e.reason or "") for e in events[:_MAX_EVENTS]]
    more = "" if len(events) <= _MAX_EVENTS else f"<p>{len(events) - _MAX_EVENTS} more are in the journal.</p>"
    table = rows(("n", f"at, {document.zone_name}", "state", "event", "what"), body, "ntttw")
    return f"<details><summary>{len(events)} events, without telemetry</summary>{table}{more}</details>"


def _foot(document: FlightReport) -> str:
    sources = document.sources
    told = [] if sources is None else [f"journal {sources.journal}", *(f"recording {name}" for name in sources.logs)]
    if sources is not None and sources.plan:
        told.append(f"plan {sources.plan}")
    members = document.delivery.forecast.members
    if members is not None:
        told.append(f"forecast of {members} members")
    return (
        f"<footer>Made by skyway {safe(__version__)} from {safe(', '.join(told))}. Times are {safe(document.zone_name)}; wind directions are those the wind comes from. "
        "Values missing in the journal are shown as unknown.</footer>"
    )
