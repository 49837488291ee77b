"""A mission that was cut at pads, as HTML; every text is escaped."""

from __future__ import annotations

from datetime import UTC
from typing import Any

from skyway.models.base.formatting import distance_text, duration, modelled, percent
from skyway.report.svg import safe
from skyway.web import drawn
from skyway.web.pages.plan_answer import LEGEND


def figures(found: dict[str, Any]) -> str:
    """Time of the end, and the kept reserve."""
    told = found["summary"]
    mean, _, late = told["ends_s"]
    stops = len(told["flights"]) - 1
    cells = [
        ("ends, on average", duration(mean), "after the first take-off"),
        ("half by", duration(told["end_p50_s"]), f"95 % by {duration(late)}, of {told['runs']} simulated runs"),
        ("with no stop", duration(told["work_s"]), "the work alone"),
        (
            "reserve kept",
            modelled(told["p_reserve"]),
            f"every landing with {percent(told['reserve_soc'])} or more",
        ),
    ]
    pictures = told["pictures"]
    if pictures["before"] or pictures["after"]:
        lost = (
            "none lost, none twice"
            if pictures["before"] == pictures["after"]
            else f"the flights take {pictures['after']}"
        )
        cells.append(("pictures", str(pictures["before"]), lost))
    parts = "".join(
        f"<div><dt>{name}</dt><dd>{safe(value)}<span class='small'>{safe(small)}</span></dd></div>"
        for name, value, small in cells
    )
    head = (
        f"{stops} stop{'' if stops == 1 else 's'}, {stops + 1} batter{'y' if stops == 0 else 'ies'} of {told['drone']}"
    )
    return f"<p class='big'>{safe(head)}</p><dl class='figures'>{parts}</dl>"


def pictures(found: dict[str, Any]) -> str:
    """The bar of the day, and the charge of each flight."""
    plan = {"bars": found["bars"], "charge": found["charge"], "reserve_soc": found["reserve_soc"]}
    plan["reserve"] = percent(found["reserve_soc"])
    return (
        f"<h2>Hours and minutes after the first take-off</h2>{LEGEND}{drawn.bars([plan], ['drone'], UTC)}"
        f"<h2>Charge of each flight</h2>{drawn.charge(plan)}"
    )


def flights(found: dict[str, Any]) -> str:
    """Each flight: progress of the work, landing pad, charging time; a button of each shows where the work is left."""
    rows = []
    for one in found["summary"]["flights"]:
        left, stay = one["left_at"], one["stay"]
        done = (
            "its end"
            if left is None
            else f"{'on the way to ' if left['on_the_way'] else ''}item {left['item']} ({left['command']})"
        )
        at = (
            safe(done)
            if left is None
            else f'<button type="button" class="chip" data-flight="{one["number"]}">{safe(done)}</button>'
        )
        charges = (
            f"{duration(stay['charge_s'])} to {percent(stay['soc_to'])}" if stay and stay["charge_s"] >= 0.5 else ""
        )
        wait = duration(stay["wait_s"]) if stay and stay["wait_s"] >= 0.5 else ""
        cells = (
            duration(one["depart_s"]), duration(one["flight_s"]), distance_text(one["distance_m"]), f"{one['energy_wh']:.0f}",
            f"{percent(one['soc_start'])} to {percent(one['soc_end'])}", modelled(one["p_reserve"]),
        )  # fmt: skip
        rows.append(
            f"<tr><td class='n'>{one['number']}</td><td>{at}</td>{''.join(f'<td class=n>{safe(cell)}</td>' for cell in cells)}"
            f"<td>{safe(stay['pad'] if stay else 'the end')}</td><td class='n'>{safe(wait)}</td><td>{safe(charges)}</td></tr>"
        )
    names = ("leaves after", "flight", "distance", "energy, Wh", "charge", "reserve kept")
    head = (
        f"<tr><th class='n'>battery</th><th>work done as far as</th>{''.join(f'<th class=n>{name}</th>' for name in names)}"
        "<th>lands on</th><th class='n'>wait</th><th>charges</th></tr>"
    )
    return (
        f"<h2>Flights</h2><div class='scroll'><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def notes(found: dict[str, Any]) -> str:
    """Gain from the order of the parts, decisions in flight, and notes."""
    told = found["summary"]
    said = [f"skyway fly decides {line}" for line in told["decided_on_the_way"]] + list(told["notes"])
    return f"<h2>Notes</h2><ul class='notes'>{''.join(f'<li>{safe(one)}</li>' for one in said)}</ul>" if said else ""
