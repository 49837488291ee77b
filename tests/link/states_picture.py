"""Draws the table of states: arrows between what is done, coloured dots for the states in which a delivery is stopped or ends."""

from html import escape

from skyway.link.supervisor.states import ENDS, TABLE, State

WIDE, HIGH = 150, 46
PLACES = {
    State.CONNECTING: (20, 330), State.REPLANNING: (215, 120), State.PREFLIGHT: (410, 120), State.UPLOADING: (605, 120),
    State.READY: (800, 120), State.ARMING: (995, 120), State.WAITING: (215, 230), State.CHARGING: (410, 230),
    State.LANDED: (605, 230), State.FLYING: (995, 230), State.DIVERTING: (995, 330),
}  # fmt: skip
DOTS = {
    State.HOLDING: "#8e44ad", State.LOST_LINK: "#7f8c8d", State.STOPPED: "#2471a3", State.LEFT: "#c0392b",
    State.ENDED_ELSEWHERE: "#d35400", State.DELIVERED: "#1e8449", State.CRASHED: "#111111", State.DONE: "#27ae60",
}  # fmt: skip
STYLE = (
    "text{font:13px sans-serif;fill:#222}.s{font-size:11px;fill:#444}rect{fill:#f4f7fb;stroke:#34495e;stroke-width:1.2}"
    "path{fill:none;stroke:#34495e;stroke-width:1.2}"
)


def _box(state):
    x, y = PLACES[state]
    parts = [f'<rect x="{x}" y="{y}" width="{WIDE}" height="{HIGH}" rx="6"/>',
             f'<text x="{x + WIDE / 2}" y="{y + 19}" text-anchor="middle">{state}</text>']  # fmt: skip
    after = [dot for dot in DOTS if dot in TABLE[state].following]
    begin = x + WIDE / 2 - 7 * (len(after) - 1)
    parts += [
        f'<circle cx="{begin + 14 * k}" cy="{y + 34}" r="4.5" fill="{DOTS[dot]}"/>' for k, dot in enumerate(after)
    ]
    if state in TABLE[state].following:
        parts.append(f'<path marker-end="url(#a)" d="M{x + 30},{y} c-14,-34 34,-34 24,-3"/>')
    return parts


def _side(state, other):
    """Where an arrow leaves a box for another: the middle of the nearer side."""
    (x, y), (u, v) = PLACES[state], PLACES[other]
    if y == v or abs(u - x) > 1.6 * abs(v - y) + WIDE:
        return (x + WIDE if u > x else x), y + HIGH / 2
    return x + WIDE / 2, (y + HIGH if v > y else y)


def _arrow(state, other, back):
    (x, y), (u, v) = PLACES[state], PLACES[other]
    if y == v and (
        u < x or u - x > 200
    ):  # within a row, over the boxes between, but for the lowest row, where there are none
        if state is State.CONNECTING:
            return f'<path marker-end="url(#a)" d="M{x + WIDE},{y + HIGH / 2 + 10} L{u - 2},{v + HIGH / 2 + 10}"/>'
        rise = 18 + 0.09 * abs(u - x)
        a, b = x + WIDE / 2 - 18, u + WIDE / 2 + 18
        return f'<path marker-end="url(#a)" d="M{a},{y} C{a},{y - rise} {b},{y - rise} {b},{y - 2}"/>'
    (a, b), (c, d) = _side(state, other), _side(other, state)
    shift = 7 if back else 0  # there and back beside each other
    if a == c:
        a, c = a + shift, c + shift
    else:
        b, d = b + shift, d + shift
    return f'<path marker-end="url(#a)" d="M{a},{b} L{c},{d}"/>'


def drawn_edges():
    """All pairs that the picture tells, by an arrow, by a dot, or in words."""
    pairs = {(s, o) for s in PLACES for o in TABLE[s].following if o in PLACES or o in DOTS}
    return pairs | {(s, o) for s in (State.HOLDING, State.LOST_LINK) for o in TABLE[s].following}


def picture():
    """Return the SVG."""
    arrow = '<path d="M0,0 L8,4 L0,8 z" style="fill:#34495e;stroke:none"/>'
    marker = '<marker id="a" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
    lines = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 1165 560" role="img">',
        f"<title>States of a supervised delivery</title><style>{STYLE}</style>",
        f"<defs>{marker}{arrow}</marker></defs>",
        '<rect x="0" y="0" width="1165" height="560" style="fill:#fff;stroke:none"/>',
    ]
    pairs = [(s, o) for s in PLACES for o in TABLE[s].following if o in PLACES and o is not s]
    lines += [_arrow(s, o, back=s in TABLE[o].following and str(s) > str(o)) for s, o in pairs]
    for state in PLACES:
        lines += _box(state)
    lines.append('<text x="20" y="420">A dot in a state: it may go on to the state of that colour.</text>')
    for row, (state, colour) in enumerate(DOTS.items()):
        y = 444 + 19 * row
        after = ", ".join(map(str, TABLE[state].following))
        told = f"; from there back to {after}" if after else "; the end" if state in ENDS else ""
        lines.append(f'<circle cx="27" cy="{y - 4}" r="5" fill="{colour}"/>')
        lines.append(f'<text class="s" x="40" y="{y}">{escape(f"{state}{told}")}</text>')
    return "\n".join([*lines, "</svg>"]) + "\n"
