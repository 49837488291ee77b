"""Charts of a plan as SVG: the schedule as bars, the arrival as a distribution, the charge as a fan.

Text is escaped; colours are classes of ``static/page.css``. Marks differ by pattern too, never by colour alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING, Any

from skyway.models.base.formatting import clock, distance_text, duration, percent
from skyway.report.svg import safe, time_ticks

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import tzinfo

    from skyway.web.preferences import Preferences

WIDTH = 720.0
LEFT, RIGHT = 76.0, 14.0
BAR = 22.0
PATTERNS = (
    '<defs><pattern id="p-wait" width="6" height="6" patternUnits="userSpaceOnUse"><path d="M0 6L6 0" class="hatch"/></pattern>'
    '<pattern id="p-hold" width="6" height="6" patternUnits="userSpaceOnUse"><path d="M0 0L6 6M0 6L6 0" class="hatch"/></pattern>'
    '<pattern id="p-charge" width="6" height="6" patternUnits="userSpaceOnUse"><circle cx="3" cy="3" r="1.2" class="dot"/></pattern></defs>'
)
KINDS = {"fly": "flies", "wait": "waits for a pad", "charge": "charges", "hold": "holds"}


@dataclass(frozen=True, slots=True)
class Frame:
    """A time axis of a chart."""

    begin_s: float
    end_s: float
    zone: tzinfo

    def x(self, at_s: float) -> float:
        """Right of the left edge."""
        share = (at_s - self.begin_s) / max(self.end_s - self.begin_s, 1.0)
        return LEFT + min(max(share, 0.0), 1.0) * (WIDTH - LEFT - RIGHT)

    def ticks(self, top: float, bottom: float) -> str:
        """Grid and clock times."""
        offset_s = (datetime.fromtimestamp(self.begin_s, self.zone).utcoffset() or timedelta()).total_seconds()
        parts = []
        for at_s, name in time_ticks(self.begin_s + offset_s, self.end_s + offset_s, 8):
            x = self.x(at_s - offset_s)
            parts.append(f'<path class="grid" d="M{x:.1f} {top:g}V{bottom:g}"/>')
            parts.append(f'<text class="tick" x="{x:.1f}" y="{bottom + 14:g}" text-anchor="middle">{name}</text>')
        return "".join(parts)


def bars(plans: Sequence[dict[str, Any]], names: Sequence[str], zone: tzinfo) -> str:
    """Return the bars of some plans on one time axis: the drone's actions in the typical schedule of each."""
    everything = [bar for plan in plans for bar in plan["bars"]]
    if not everything:
        return ""
    frame = Frame(min(one["begin_s"] for one in everything), max(one["end_s"] for one in everything), zone)
    bottom = 8.0 + (BAR + 8.0) * len(plans)
    parts = [PATTERNS, frame.ticks(4.0, bottom)]
    for row, (plan, name) in enumerate(zip(plans, names, strict=True)):
        y = 8.0 + (BAR + 8.0) * row
        parts.append(f'<text class="name" x="{LEFT - 8:g}" y="{y + 15:g}" text-anchor="end">{safe(name)}</text>')
        for one in plan["bars"]:
            x, width = frame.x(one["begin_s"]), max(frame.x(one["end_s"]) - frame.x(one["begin_s"]), 1.5)
            lasts = duration(one["end_s"] - one["begin_s"])
            shape = f'x="{x:.1f}" y="{y:g}" width="{width:.1f}" height="{BAR:g}"'
            pattern = "" if one["kind"] == "fly" else f'<rect {shape} fill="url(#p-{one["kind"]})"/>'
            label = ""
            if width > 44.0:
                label = f'<text class="on-bar" x="{x + width / 2:.1f}" y="{y + 15:g}" text-anchor="middle">{one["kind"]}</text>'
            words = f"{KINDS[one['kind']]} {lasts}: {one['where']}"
            parts.append(
                f'<g><title>{safe(words)}</title><rect class="bar {one["kind"]}" {shape}/>{pattern}{label}</g>'
            )
    said = "; ".join(f"{KINDS[one['kind']]} {duration(one['end_s'] - one['begin_s'])}" for one in plans[0]["bars"])
    return _svg("".join(parts), bottom + 20.0, f"What the drone does in the typical schedule: {said}")


def arrivals(plan: dict[str, Any], zone: tzinfo) -> str:
    """Return the distribution of the arrival, with the promise and the deadline."""
    found = plan["arrivals"]
    if found is None:
        return ""
    edges, shares = found["edges_s"], found["share"]
    deadline = plan["deadline_s"]
    end_s = max([edges[-1], *([deadline] if deadline else [])])
    frame = Frame(min(plan["depart_s"], edges[0]), end_s, zone)
    top, bottom = 20.0, 130.0
    most = max(shares) or 1.0
    parts = [frame.ticks(top, bottom)]
    for number, share in enumerate(shares):
        x, right = frame.x(edges[number]), frame.x(edges[number + 1])
        height = (bottom - top) * share / most
        late = deadline is not None and edges[number] >= deadline
        style = "mass late" if late else "mass"
        parts.append(
            f'<rect class="{style}" x="{x:.1f}" y="{bottom - height:.1f}" width="{max(right - x - 0.6, 0.6):.1f}" height="{height:.1f}"/>'
        )
    marks = [
        (found["quantiles_s"]["0.5"], "half", "median"),
        (found["quantiles_s"]["0.95"], "95 %: the promise", "promise"),
    ]
    if deadline is not None:
        marks.append((deadline, "deadline", "deadline"))
    for row, (at_s, words, style) in enumerate(sorted(marks)):
        x = frame.x(at_s)
        anchor = "end" if x > WIDTH * 0.75 else "start"
        dx = -4 if anchor == "end" else 4
        parts.append(f'<path class="mark {style}" d="M{x:.1f} {top - 10:g}V{bottom:g}"/>')
        parts.append(
            f'<text class="mark-name" x="{x + dx:.1f}" y="{top - 2 + 13 * (row % 3):g}" text-anchor="{anchor}">{words}</text>'
        )
    parts.append(f'<text class="name" x="{LEFT - 8:g}" y="{bottom:g}" text-anchor="end">arrival</text>')
    said = ", ".join(f"{words} by {_clock(at_s, zone)}" for at_s, words, _ in sorted(marks))
    if found["beyond"] > 0.0:
        beyond = f"{percent(found['beyond'], 1)} arrive after {_clock(edges[-1], zone)}"
        parts.append(f'<text class="tick" x="{WIDTH - RIGHT:g}" y="{bottom - 4:g}" text-anchor="end">{beyond}</text>')
        said += f", {beyond}"
    return _svg("".join(parts), bottom + 20.0, f"Distribution of the arrival: {said}")


def charge(plan: dict[str, Any]) -> str:
    """Return the charge over the legs as a fan: quantiles of the simulated deliveries, the typical schedule, and the reserve."""
    legs = plan["charge"]["legs"]
    if not legs:
        return ""
    top, bottom = 10.0, 150.0
    wide = (WIDTH - LEFT - RIGHT) / len(legs)

    def y(soc: float) -> float:
        return bottom - (bottom - top) * min(max(soc, 0.0), 1.0)

    parts = []
    for soc in (0.0, 0.25, 0.5, 0.75, 1.0):
        parts.append(f'<path class="grid" d="M{LEFT:g} {y(soc):.1f}H{WIDTH - RIGHT:g}"/>')
        parts.append(
            f'<text class="tick" x="{LEFT - 8:g}" y="{y(soc) + 4:.1f}" text-anchor="end">{percent(soc)}</text>'
        )
    for number, leg in enumerate(legs):
        left = LEFT + wide * number + 0.08 * wide
        right = left + 0.84 * wide
        words = f"leg {number + 1}, {leg['from']} to {leg['to']}: {percent(leg['typical'][0])} to {percent(leg['typical'][1])}"
        if leg["fan"] is not None:
            leaves, lands = leg["fan"]
            words += f"; 9 of 10 deliveries land with {percent(lands[0])} to {percent(lands[-1])}"
            for low, high, style in ((0, -1, "outer"), (1, -2, "inner")):
                corners = (left, leaves[low]), (right, lands[low]), (right, lands[high]), (left, leaves[high])
                parts.append(f'<path class="fan {style}" d="M{"L".join(f"{x:.1f} {y(s):.1f}" for x, s in corners)}Z"/>')
        begin, end = leg["typical"]
        if leg["back"]:
            words = f"way back, {words}"
            if not legs[number - 1]["back"]:
                x = left - 0.08 * wide
                parts.append(f'<path class="mark median" d="M{x:.1f} {top:g}V{bottom:g}"/>')
                parts.append(f'<text class="mark-name" x="{x + 4:.1f}" y="{top + 8:g}">way back</text>')
        parts.append(
            f'<path class="{"planned" if leg["back"] else "typical"}" d="M{left:.1f} {y(begin):.1f}L{right:.1f} {y(end):.1f}"/>'
        )
        shown = f"to {leg['to']}" if wide > 90.0 else str(number + 1)
        parts.append(
            f'<text class="tick" x="{(left + right) / 2:.1f}" y="{bottom + 14:g}" text-anchor="middle">{safe(_short(shown, wide))}</text>'
        )
        parts.append(
            f'<rect x="{left:.1f}" y="{top:g}" width="{right - left:.1f}" height="{bottom - top:g}" fill="transparent"><title>{safe(words)}</title></rect>'
        )
    reserve = plan["reserve_soc"]
    parts.append(f'<path class="reserve" d="M{LEFT:g} {y(reserve):.1f}H{WIDTH - RIGHT:g}"/>')
    parts.append(
        f'<text class="mark-name" x="{LEFT + 4:g}" y="{y(reserve) + 14:.1f}">reserve {safe(plan["reserve"])}</text>'
    )
    lowest = min(leg["typical"][1] for leg in legs)
    said = f"Charge over {len(legs)} {'leg' if len(legs) == 1 else 'legs'}: lowest {percent(lowest)} in the typical schedule, reserve {plan['reserve']}"
    return _svg("".join(parts), bottom + 20.0, said)


def _short(words: str, width: float) -> str:
    """Cut a text that is wider than its place."""
    most = max(int(width / 6.5), 3)
    return words if len(words) <= most else words[: most - 1] + "…"


def profile(legs: Sequence[dict[str, Any]], wanted: Preferences) -> str:
    """Return the heights above home along a mission."""
    points = [one for leg in legs for one in leg["profile"]]
    if not points:
        return ""
    top, bottom, far = 8.0, 86.0, max(points[-1][0], 0.001)
    high, low = max(one[1] for one in points), min(0.0, *(one[1] for one in points))
    span = max(high - low, 1.0)

    def place(one: Sequence[float]) -> str:
        return (
            f"{LEFT + (WIDTH - LEFT - RIGHT) * one[0] / far:.1f} {bottom - (bottom - top) * (one[1] - low) / span:.1f}"
        )

    parts = [f'<path class="grid" d="M{LEFT:g} {bottom:g}H{WIDTH - RIGHT:g}M{LEFT:g} {top:g}H{WIDTH - RIGHT:g}"/>']
    for value, y in ((high, top), (low, bottom)):
        parts.append(
            f'<text class="tick" x="{LEFT - 8:g}" y="{y + 4:g}" text-anchor="end">{wanted.height_text(value)}</text>'
        )
    parts += [
        f'<path class="typical" d="M{"L".join(place(one) for one in leg["profile"])}"/>'
        for leg in legs
        if leg["profile"]
    ]
    parts.append(
        f'<text class="tick" x="{WIDTH - RIGHT:g}" y="{bottom + 13:g}" text-anchor="end">{wanted.in_words(distance_text(1000.0 * far))}</text>'
    )
    return _svg(
        "".join(parts),
        bottom + 18.0,
        f"Heights above home along {wanted.in_words(distance_text(1000.0 * far))}, up to {wanted.height_text(high)}",
    )


def heights(legs: Sequence[dict[str, Any]], wanted: Preferences) -> str:
    """Return ground, corridor obstacles, and the way flown, leg after leg, with the smallest clearance of all."""
    if not legs:
        return ""
    top, bottom = 16.0, 126.0
    low: float = min(min(leg["ground_m"]) for leg in legs)
    high: float = max(max(*leg["path_height_m"], *leg["top_m"]) for leg in legs)
    far_m: float = sum(leg["along_m"][-1] for leg in legs)
    begin_m, parts = 0.0, list[str]()
    least = min(legs, key=lambda leg: float(leg["least_m"]))

    def y(height_m: float) -> float:
        return bottom - (bottom - top) * (height_m - low) / max(high - low, 30.0)

    def line(along: Sequence[float], values: Sequence[float]) -> str:
        return "L".join(f"{x(at):.1f} {y(value):.1f}" for at, value in zip(along, values, strict=True))

    def x(at_m: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (begin_m + at_m) / max(far_m, 1.0)

    for leg in legs:
        for name, style in (("top_m", "standing"), ("ground_m", "soil")):
            ends = f"L{x(leg['along_m'][-1]):.1f} {bottom:g}L{x(0.0):.1f} {bottom:g}Z"
            parts.append(f'<path class="{style}" d="M{line(leg["along_m"], leg[name])}{ends}"/>')
        parts.append(f'<path class="typical" d="M{line(leg["path_along_m"], leg["path_height_m"])}"/>')
        for at_m, top_m, name in leg["obstacles"]:
            words = safe(f"{name}: {wanted.height_text(top_m)}")
            parts.append(
                f'<path class="tower" d="M{x(at_m):.1f} {bottom:g}V{y(top_m):.1f}"><title>{words}</title></path>'
            )
        if leg is least:
            parts.append(f'<path class="mark deadline" d="M{x(leg["least_along_m"]):.1f} {top:g}V{bottom:g}"/>')
            near = "end" if x(leg["least_along_m"]) > 0.7 * WIDTH else "start"
            said = f"least clearance {wanted.height_text(leg['least_m'])}"
            parts.append(
                f'<text class="mark-name" x="{x(leg["least_along_m"]) + (4 if near == "start" else -4):.1f}" y="{top - 4:g}" text-anchor="{near}">{said}</text>'
            )
        begin_m += float(leg["along_m"][-1])
    parts += [
        f'<text class="tick" x="{LEFT - 8:g}" y="{y(height_m) + 4:.1f}" text-anchor="end">{wanted.height_text(height_m)}</text>'
        for height_m in (low, high)
    ]
    parts.append(
        f'<text class="tick" x="{WIDTH - RIGHT:g}" y="{bottom + 14:g}" text-anchor="end">{wanted.in_words(distance_text(far_m))}</text>'
    )
    words = f"Heights along {wanted.in_words(distance_text(far_m))}, least clearance {wanted.height_text(least['least_m'])} on the way from {least['from']} to {least['to']}"
    return _svg("".join(parts), bottom + 20.0, words)


def _svg(inner: str, height: float, words: str) -> str:
    drawing = (
        f'<svg class="chart" viewBox="0 0 {WIDTH:g} {height:g}" role="img" aria-label="{safe(words)}">{inner}</svg>'
    )
    return f'<div class="scroll">{drawing}</div>'


def _clock(at_s: float, zone: tzinfo) -> str:
    instant = datetime.fromtimestamp(at_s, zone)
    return clock(instant, zone, instant)
