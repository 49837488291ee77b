"""The status of a fleet as HTML: alarms, timelines of drones and pads, orders, drones, and changed promises; every text is escaped."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from skyway.models.base.formatting import clock, date_clock, percent
from skyway.models.base.units import from_posix, parse_instant
from skyway.models.base.views import counted
from skyway.report.svg import safe
from skyway.web.drawn import LEFT, PATTERNS, WIDTH, Frame

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import tzinfo

    from skyway.web.preferences import Preferences

PARTS = ("head", "alarms", "drones-when", "pads-when", "orders", "drones", "changes")
"""Parts of the page, from the top."""
ROW = 18.0
"""Height of a row of a chart."""
NAME_CHARS = 11
"""Characters that fit beside a chart."""
LONGEST_S = 24 * 3600.0
"""Time shown in a chart, from now on."""
BEFORE_S = 1800.0
"""Time shown before now."""
LEGEND = (
    '<ul class="legend"><li><i class="fly"></i>fly</li><li><i class="charge"></i>pad (thin: when nine of ten come and leave)</li>'
    '<li><i class="hold"></i>out of order</li><li>upright line: now</li></ul>'
)


def parts(found: dict[str, Any], wanted: Preferences) -> dict[str, str]:
    """Return the parts of the page by their names."""
    zone = wanted.zone(found["timezone"])
    return {
        "head": _head(found, zone),
        "alarms": _alarms(found, wanted),
        "drones-when": _chart("Drones", found["doing"], found, zone),
        "pads-when": _chart("Pads", found["booked"], found, zone),
        "orders": wanted.in_words(_orders(found, zone)),
        "drones": wanted.in_words(_drones(found)),
        "changes": wanted.in_words(_changes(found, zone)),
    }


def cancellable(found: dict[str, Any], wanted: Preferences) -> list[dict[str, str]]:
    """Return the orders that can be cancelled, with words for a list."""
    zone, rows = wanted.zone(found["timezone"]), []
    orders = {one["id"]: one for one in found["orders"]}
    for name in found["cancellable"]:
        one = orders[name]
        state = "cancellation asked" if name in found["asked"] else one["state"]
        rows.append(
            {"id": name, "words": f"{name}: {one['from']} > {one['to']}, due {_when(one['due'], found, zone)}, {state}"}
        )
    return rows


def _head(found: dict[str, Any], zone: tzinfo) -> str:
    counts: dict[str, int] = {}
    for one in found["orders"]:
        counts[one["state"]] = counts.get(one["state"], 0) + 1
    done = [one for one in found["orders"] if one["delivered"] is not None]
    late = sum(parse_instant(one["delivered"]) > parse_instant(one["due"]) for one in done)
    cells = [
        ("orders", str(len(found["orders"])), ", ".join(f"{count} {state}" for state, count in sorted(counts.items()))),
        ("delivered", str(len(done)), f"{late} after their due time" if done else ""),
        ("flights under way", str(len(found["flights"])), f"of {counted(len(found['drones']), 'drone')}"),
        ("pads booked", str(len(found["pads"])), "windows"),
        ("promises changed", str(len(found["changes"])), ""),
    ]
    figures = "".join(
        f"<div><dt>{name}</dt><dd>{value}<span class='small'>{safe(small)}</span></dd></div>"
        for name, value, small in cells
    )
    at = date_clock(from_posix(found["now_s"]), zone, named=True)
    return f"<p class='big'>{safe(found['dispatcher'])}, {safe(found['state'])}, {safe(at)}</p><dl class='figures'>{figures}</dl>"


def _alarms(found: dict[str, Any], wanted: Preferences) -> str:
    lines = "".join(f"<p>! {safe(wanted.in_words(one))}</p>" for one in found["alarms"])
    return f"<div class='alarms'>{lines}</div>" if lines else "<p class='good'>Nothing needs a person.</p>"


def _chart(title: str, rows: Sequence[dict[str, Any]], found: dict[str, Any], zone: tzinfo) -> str:
    """Return rows of bars on one axis of time, with a line at the present time."""
    now_s = float(found["now_s"])
    all_bars = [bar for row in rows for bar in row["bars"] if bar["end_s"] > now_s - BEFORE_S]
    if not all_bars:
        return f"<h2>{title}</h2><p class='faint'>Nothing is planned.</p>"
    begin_s = max(min(now_s, *(bar["begin_s"] for bar in all_bars)), now_s - BEFORE_S)
    end_s = min(max(now_s, *(bar["end_s"] for bar in all_bars)), now_s + LONGEST_S)
    frame = Frame(begin_s, end_s, zone)
    bottom = 6.0 + ROW * len(rows)
    drawn = [PATTERNS, frame.ticks(4.0, bottom)]
    for number, row in enumerate(rows):
        y = 6.0 + ROW * number
        name = _cut(row["name"])
        drawn.append(
            f'<text class="tick" x="{LEFT - 6:g}" y="{y + 12:g}" text-anchor="end"><title>{safe(row["name"])}</title>{"! " if row["wrong"] else ""}{safe(name)}</text>'
        )
        drawn += [_bar(bar, y, frame, zone) for bar in row["bars"] if bar["end_s"] > begin_s and bar["begin_s"] < end_s]
    x = frame.x(now_s)
    drawn.append(f'<path class="mark" d="M{x:.1f} 0V{bottom:g}"/>')
    said = f"{title}: {len(all_bars)} bars of {len(rows)} rows; the tables have the same data"
    more = f"<p class='faint'>The first {len(rows)} are drawn.</p>" if len(rows) >= 200 else ""
    svg = f'<svg class="chart" viewBox="0 0 {WIDTH:g} {bottom + 18:g}" role="img" aria-label="{safe(said)}">{"".join(drawn)}</svg>'
    return f"<h2>{title}</h2>{LEGEND if title == 'Drones' else ''}{svg}{more}"


def _cut(name: str) -> str:
    """Return a name that fits beside a chart; the number at its end, that of a pad or drone, stays."""
    if len(name) <= NAME_CHARS:
        return name
    number = re.search(r"[ -]?[0-9]{0,6}$", name)
    tail = "" if number is None else number[0]
    return f"{name[: NAME_CHARS - 1 - len(tail)]}…{tail}"


def _bar(bar: dict[str, Any], y: float, frame: Frame, zone: tzinfo) -> str:
    x, right = frame.x(bar["begin_s"]), frame.x(bar["end_s"])
    begin = from_posix(bar["begin_s"])
    times = f"{clock(begin, zone, begin)} to {clock(from_posix(bar['end_s']), zone, begin)}"
    shape = f'x="{x:.1f}" y="{y:g}" width="{max(right - x, 1.5):.1f}" height="{ROW - 5:g}"'
    pattern = "" if bar["kind"] == "fly" else f'<rect {shape} fill="url(#p-{bar["kind"]})"/>'
    spread = ""
    if bar.get("from_s", bar["begin_s"]) < bar["begin_s"] or bar.get("until_s", bar["end_s"]) > bar["end_s"]:
        middle = y + (ROW - 5) / 2
        spread = f'<path class="typical" d="M{frame.x(bar["from_s"]):.1f} {middle:g}H{frame.x(bar["until_s"]):.1f}"/>'
    return (
        f'<g><title>{safe(bar["words"])}, {times}</title>{spread}<rect class="bar {bar["kind"]}" {shape}/>{pattern}</g>'
    )


def _table(title: str, names: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table; the last text of each row, a sentence without a column, stands below it where it is in sight on a narrow screen."""
    if not rows:
        return ""
    head = "".join(f"<th>{name}</th>" for name in names)
    body = "".join(_row(row[:-1], row[-1]) for row in rows)
    return (
        f"<h2>{title}</h2><div class='scroll'><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _row(cells: Sequence[str], below: str) -> str:
    row = "".join(f"<td>{safe(cell)}</td>" for cell in cells)
    if not below:
        return f"<tr>{row}</tr>"
    return f"<tr class='explained'>{row}</tr><tr><td colspan='{len(cells)}'><span class='below'>{safe(below)}</span></td></tr>"


def _when(told: str | None, found: dict[str, Any], zone: tzinfo) -> str:
    """Return a time of day, with the days since the service began, as the command line does; an earlier one has its date."""
    if told is None:
        return ""
    at, begin = parse_instant(told), from_posix(found["begin_s"])
    return clock(at, zone, begin) if at >= begin else date_clock(at, zone)


def _orders(found: dict[str, Any], zone: tzinfo) -> str:
    rows = []
    for one in found["orders"]:
        changed = one["promised"] is not None and one["first_promised"] not in {None, one["promised"]}
        first = f" (first {_when(one['first_promised'], found, zone)})" if changed else ""
        rows.append((
            one["id"], one["state"], f"{one['from']} > {one['to']}", _when(one["due"], found, zone), f"{_when(one['promised'], found, zone)}{first}",
            _when(one["delivered"], found, zone), one["drone"] or "", one["reason"],
        ))  # fmt: skip
    return _table("Orders", ("order", "state", "from, to", "due", "promised", "delivered", "drone"), rows)


def _drones(found: dict[str, Any]) -> str:
    rows = [
        (
            one["id"], one["type"], one["shown"], one["place"], percent(one["charge_percent"] / 100.0), one["doing"], ", ".join(one["next"]), one["reason"],
        )
        for one in found["drones"]
    ]  # fmt: skip
    return _table("Drones", ("drone", "type", "state", "place", "charge", "does", "then"), rows)


def _changes(found: dict[str, Any], zone: tzinfo) -> str:
    rows = [
        (
            _when(one["time"], found, zone), one["order"], _when(one["before"], found, zone), _when(one["after"], found, zone) or "none", one["why"],
        )
        for one in reversed(found["changes"])
    ]  # fmt: skip
    return _table("Promises that were changed, and why", ("at", "order", "promised before", "then"), rows)
