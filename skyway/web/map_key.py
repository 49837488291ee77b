"""The key of a map: the meaning of its symbols."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nicegui import ui

from skyway.web.controls import text

if TYPE_CHECKING:
    from collections.abc import Sequence

SIGNS = {
    "station": (
        '<circle cx="11" cy="8" r="6" class="k-paper k-station"/><path class="k-fill" d="M11 8V2.5A5.5 5.5 0 1 1 5.5 8Z"/>',
        "station; filled share: probability of a free pad in the hour shown",
    ),
    "stop": (
        '<circle cx="11" cy="8" r="7" class="k-paper k-station"/><circle cx="11" cy="8" r="5.5" class="k-fill"/>',
        "stop of the plan: drag it to another station",
    ),
    "route": ('<path class="k-route" d="M1 8H21"/>', "route of the plan"),
    "other": ('<path class="k-other" d="M1 8H21"/>', "another plan"),
    "flown": ('<path class="k-flown" d="M1 8H21"/>', "flown"),
    "ahead": ('<path class="k-ahead" d="M1 8H21"/>', "planned"),
    "work": ('<path class="k-route" d="M1 8H21"/>', "route of the mission"),
    "pad": (
        '<circle cx="11" cy="8" r="6.5" class="k-pad"/><path class="k-on" d="M9 12V4h3a2 2 0 0 1 0 4H9"/>',
        "pad: drag it; pads that are not used are grey",
    ),
    "cut": (
        '<circle cx="11" cy="8" r="6.5" class="k-ink"/><path class="k-on" d="M9 4v8m4 0V4"/>',
        "the work is left and resumed here",
    ),
    "finding": ('<circle cx="11" cy="8" r="6.5" class="k-warn"/><path class="k-on" d="M11 4v5m0 2v1.5"/>', "finding"),
    "fence": ('<path class="k-fence" d="M2 3H20V13H2Z"/>', "fence"),
    "reach": (
        '<circle cx="11" cy="8" r="6.5" class="k-reach"/>',
        "possible landing: minutes, and charge at the landing; dashed if below the reserve",
    ),
    "vehicle": ('<path class="k-vehicle" d="M11 1L16 14L11 11L6 14Z"/>', "drone"),
    "zone": (
        '<path class="k-zone" d="M2 2H20V14H2Z"/><path class="k-hatch" d="M4 14L16 2M10 14L20 4M2 10L10 2"/>',
        "zone that is closed; dashed: open in its hours or heights",
    ),
    "wind": (
        '<path class="k-wind" d="M3 13L16 5m-5 0h5v5"/><circle cx="16" cy="5" r="4.5" class="k-spread"/>',
        "wind: direction it blows to, longer for stronger; shading around the tip: spread of the forecast (one standard deviation)",
    ),
}
"""Symbol, drawn in a box of 22 by 16, and its text."""

MOVES = ("arrows, + - 0", "move, zoom, show everything")
KEYS = {
    "stations": (("n, p", "next station, the one before"), ("Enter", "menu of the station, else of the middle of the map")),
    "segments": (("s", "next segment of the plan, with its menu"),),
    "pads": (("m", "next pad"), ("Enter", "menu of the pad, else of the middle of the map")),
    "vehicles": (("v", "next drone; Enter opens its flight"),),
    "carry": (("Enter, Escape", "drop what is being moved, or cancel"),),
}  # fmt: skip
"""Keys of a map and their actions, besides `MOVES`; ``static/map/keys.js`` uses them."""


def key(*signs: str, keys: Sequence[str] = ()) -> ui.element:
    """Lay out the key of some `SIGNS` and the actions of some `KEYS`, initially closed."""
    found: Sequence[tuple[str, str]] = [SIGNS[name] for name in signs]
    items = "".join(
        f'<li><svg viewBox="0 0 22 16" aria-hidden="true">{sign}</svg><span>{words}</span></li>'
        for sign, words in found
    )
    pressed = [MOVES, *(one for name in keys for one in KEYS[name])]
    told = "".join(f"<div><dt>{name}</dt><dd>{words}</dd></div>" for name, words in pressed)
    with ui.element("details").classes("map-key") as made:
        text("summary", "Key")
        ui.html(f"<ul>{items}</ul><dl>{told}</dl>")
    return made
