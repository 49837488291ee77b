"""A mission and its findings as HTML; every text is escaped."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.report.svg import safe

if TYPE_CHECKING:
    from skyway.web.preferences import Preferences


def differences(found: list[dict[str, Any]], wanted: Preferences) -> str:
    """Differences between the vehicle's mission and the file; a button for each shows its place."""
    rows = []
    for one in found:
        where = safe(one["kind"]) if one["item"] is None else _place(one["item"])
        rows.append(
            f"<tr><td>{where}</td><td>{safe(one['field'])}</td><td>{safe(wanted.in_words(one['text']))}</td></tr>"
        )
    if not rows:
        return ""
    head = "<tr><th>where</th><th>field</th><th>what the vehicle holds</th></tr>"
    return (
        f"<h2>Differences to the vehicle: {len(rows)}</h2><div class='scroll'><table class='differences'><thead>{head}</thead>"
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _place(item: int) -> str:
    return f'<button type="button" class="chip" data-item="{item}">item {item}</button>'


def bounds(found: dict[str, Any]) -> list[float] | None:
    """Return the box around a mission, degrees: west, south, east, north; None if nothing has a place."""
    points = (
        [at for leg in found["legs"] for at in leg["points"]]
        + found["rally"]
        + [at for area in found["fence"] for at in area["points"]]
    )
    if not points:
        return None
    lat, lon = [at[0] for at in points], [at[1] for at in points]
    return [min(lon), min(lat), max(lon), max(lat)]


def findings(found: list[dict[str, Any]], wanted: Preferences) -> str:
    """Findings of the check; a button of each shows its place."""
    if not found:
        return "<p class='good'>Nothing was found.</p>"
    rows = []
    for one in found:
        where = "mission" if one["item"] is None else _place(one["item"])
        style = {"error": "warn", "warning": "warn"}.get(one["severity"], "faint")
        mend = " (can be corrected automatically)" if one["certain"] else ""
        rows.append(
            f"<tr><td class='{style}'>{safe(one['severity'])}</td><td>{where}</td><td>{safe(wanted.in_words(one['message']))}</td><td>{safe(wanted.in_words(one['remedy']))}{mend}</td></tr>"
        )
    head = "<tr><th>kind</th><th>where</th><th>finding</th><th>what would be right</th></tr>"
    return (
        f"<h2>Findings</h2><div class='scroll'><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>"
    )


def flights(flights: list[dict[str, str]], wanted: Preferences) -> str:
    """Time and energy of each flight of the mission."""
    names = ("items", "distance", "time", "energy", "ends", "kept")
    rows = ["".join(f"<td>{safe(wanted.in_words(one.get(name, '')))}</td>" for name in names) for one in flights]
    head = "<tr><th>items</th><th>distance</th><th>time</th><th>energy</th><th>ends with</th><th>reserve kept</th></tr>"
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    return (
        f"<h2>Flights</h2><div class='scroll'><table><thead>{head}</thead><tbody>{body}</tbody></table></div>"
        if flights
        else ""
    )


def items(found: dict[str, Any], wanted: Preferences) -> str:
    """The items as a table."""
    rows = ""
    for row in found["items"]:
        height = "" if row["height_m"] is None else wanted.height_text(row["height_m"], 1)
        rows += f"<tr>{''.join(f'<td>{safe(cell)}</td>' for cell in row['cells'])}<td class='n'>{height}</td></tr>"
    head = "<tr><th>item</th><th>command</th><th>frame</th><th>parameters 1 to 4</th><th>place</th><th class='n'>height</th></tr>"
    more = (
        f"<p class='faint'>{found['count'] - len(found['items'])} more</p>"
        if found["count"] > len(found["items"])
        else ""
    )
    return f"<h2>Items</h2><div class='scroll'><table><thead>{head}</thead><tbody>{rows}</tbody></table></div>{more}"
