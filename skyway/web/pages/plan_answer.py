"""The result of a request of the plan page, as HTML; every text is escaped."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from skyway.models.base.formatting import distance_text, energy_text, watt_hours
from skyway.report.svg import safe
from skyway.web import drawn

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import tzinfo

    from skyway.web.preferences import Preferences

_COMMAND, _CODE = re.compile(r"`([^`]+)`"), r"<code>\1</code>"
LEGEND = (
    '<ul class="legend"><li><i class="fly"></i>fly</li><li><i class="wait"></i>wait for a pad</li><li><i class="charge"></i>charge</li>'
    '<li><i class="hold"></i>hold for wind or room</li></ul>'
)


def figures(plan: dict[str, Any], wanted: Preferences) -> str:
    """Expected figures."""
    cells = [
        (one["name"], safe(one["value"]), f"by {safe(one['by'])}; {safe(one['range'])}") for one in plan["figures"]
    ]
    if plan["on_time"]:
        cells.append(("on time", safe(plan["on_time"]), "of the deliveries, by the deadline"))
    if plan["kept"]:
        cells.append(("reserve kept", safe(plan["kept"]), f"every landing with {safe(plan['reserve'])} or more"))
    mean_j = plan["mean_energy_j"]
    mean = "" if mean_j is None else f"{energy_text(mean_j)} on average; "
    far = safe(wanted.in_words(distance_text(plan["distance_m"])))
    cells.append(("energy, typically", energy_text(plan["energy_j"]), mean + far))
    cells += [(safe(one["name"]), safe(one["value"]), safe(one["small"])) for one in plan["spending"]]
    parts = [
        f"<div><dt>{name}</dt><dd>{value}<span class='small'>{small}</span></dd></div>" for name, value, small in cells
    ]
    never = (
        f"<p class='warn'>In {safe(plan['never'])} of the deliveries the wind closes a leg until the forecast ends.</p>"
        if plan["never"]
        else ""
    )
    return f"<p class='big'>{safe(plan['headline'])}</p><dl class='figures'>{''.join(parts)}</dl>{never}"


def pictures(plans: Sequence[dict[str, Any]], chosen: int, zone: tzinfo, wanted: Preferences) -> str:
    """The bars of all plans; arrival, charge, and heights over terrain of the chosen one."""
    plan = plans[chosen]
    back = " (way back: dashed)" if any(leg["back"] for leg in plan["charge"]["legs"]) else ""
    names = [label(one, number) for number, one in enumerate(plans)]
    return (
        f"<h2>Typical schedule</h2>{LEGEND}{drawn.bars(plans, names, zone)}"
        f"{_titled('Arrival in the simulated deliveries', drawn.arrivals(plan, zone))}"
        f"<h2>Charge over the legs: 9 of 10 deliveries, half of them, and the typical schedule{back}</h2>{drawn.charge(plan)}"
        f"{_titled('Heights above sea level, and the least clearance', drawn.heights(plan['heights'], wanted))}"
    )


def _titled(title: str, drawing: str) -> str:
    """A chart with its title; empty if there is nothing to draw."""
    return f"<h2>{title}</h2>{drawing}" if drawing else ""


def label(plan: dict[str, Any], number: int) -> str:
    """Short name of a plan: its number, and its planner if that differs."""
    return f"{number + 1} {plan['planner']}"


def beside(plans: Sequence[dict[str, Any]], chosen: int, without: Sequence[dict[str, str]]) -> str:
    """Return the plans side by side; a button of each shows it."""
    if len(plans) < 2 and not without:
        return ""
    rows = []
    for number, one in enumerate(plans):
        stops = " &gt; ".join(safe(name) for name in one["stops"]) or "no stop"
        values = {figure["name"]: figure["minutes"] for figure in one["figures"]}
        button = (
            f'<button type="button" data-plan="{number}" aria-pressed="{"true" if number == chosen else "false"}">'
            f"{'Shown' if number == chosen else 'Show'}<span class='only-heard'> plan {number + 1}</span></button>"
        )
        rows.append(
            f'<tr class="{"chosen" if number == chosen else ""}"><td>{button}</td><td>{safe(label(one, number))}</td><td>{stops}</td>'
            f"<td>{safe(one['drone'])}</td><td class='n'>{safe(values.get('on average', ''))}</td><td class='n'>{safe(values.get('95 % within', ''))}</td>"
            f"<td class='n'>{safe(one['kept'] or '')}</td><td class='n'>{watt_hours(one['energy_j'])}</td>"
            f"<td class='n'>{'' if one['mean_energy_j'] is None else watt_hours(one['mean_energy_j'])}</td></tr>"
        )
    head = (
        "<tr><th><span class='only-heard'>Choose</span></th><th>plan</th><th>stops at</th><th>drone</th><th class='n'>average, min</th>"
        "<th class='n'>95 %, min</th><th class='n'>reserve kept</th><th class='n'>Wh, typically</th>"
        "<th class='n'>Wh on average</th></tr>"
    )
    missing = "".join(f"<p class='faint'>{safe(one['planner'])}: {safe(one['why'])}</p>" for one in without)
    return f"<h2>Side by side</h2><div class='scroll'><table class='wordy'><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>{missing}"


def explained(found: dict[str, Any], wanted: Preferences) -> str:
    """Reasons for the stops, the assumptions of the promise, and the changes with the greatest gain."""
    parts = []
    if found["reasons"]:
        lines = [
            f"<p><b>{safe(one['station'])}</b>: {safe(wanted.in_words(one['why']))}; {safe(wanted.in_words(one['charge']))}.</p>"
            for one in found["reasons"]
        ]
        parts.append(f"<h2>Why these stops</h2><div class='reasons'>{''.join(lines)}</div>")
    if found["rests_on"]:
        rows = [
            f"<tr><td>{safe(one['what'])}</td><td>{safe(wanted.in_words(one['size']))}</td><td>{safe(one['source'])}</td><td class='n'>{safe(one['gain'])}</td>"
            f"<td>{safe(one['remedy'])}</td></tr>"
            for one in found["rests_on"]
        ]
        head = "<tr><th>the promise rests on</th><th>uncertain by</th><th>data</th><th class='n'>half of it gains</th><th>what would help</th></tr>"
        parts.append(
            f"<h2>What would change it</h2><div class='scroll'><table class='wordy'><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>"
        )
    if found["bound"]:
        parts.append(
            f"<p class='faint'>With a perfect forecast no plan takes less than {safe(found['bound'])} on average.</p>"
        )
    if found["between_sites"]:
        parts.append(f"<p>{_COMMAND.sub(_CODE, safe(wanted.in_words(' '.join(found['between_sites']))))}</p>")
    if found["not_counted"]:
        parts.append(f"<p class='faint'>Not counted: {safe(wanted.in_words('; '.join(found['not_counted'])))}.</p>")
    return "".join(parts)


def notes(plan: dict[str, Any], answer: dict[str, Any], wanted: Preferences) -> str:
    """Notes, departures tried, other drones."""
    parts = []
    if answer["departures"]:
        rows = [
            f"<tr class='{'chosen' if one['chosen'] else ''}'><td>{safe(one['depart'])}</td><td class='n'>{safe(one['mean'])}</td>"
            f"<td class='n'>{safe(one['on_time'] or '')}</td><td>{'chosen' if one['chosen'] else ''}</td></tr>"
            for one in answer["departures"]
        ]
        head = "<tr><th>departure</th><th class='n'>on average</th><th class='n'>on time</th><th></th></tr>"
        parts.append(f"<h2>Departures tried</h2><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table>")
    told = [*plan["notes"], *(f"not {drone}: {why}" for drone, why in answer["rejected"].items())]
    said = [safe(wanted.in_words(one)) for one in told]
    if said:
        parts.append(f"<h2>Notes</h2><ul class='notes'>{''.join(f'<li>{one}</li>' for one in said)}</ul>")
    return "".join(parts)
