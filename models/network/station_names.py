"""Search for a station by id or name."""

from __future__ import annotations

import difflib
from typing import TYPE_CHECKING

from skyway.models.base.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.models.network.station import Station


def find(stations: Sequence[Station], index: Mapping[str, int], text: str) -> int:
    """Return the node of a station by id, else by an unambiguous part of its id or name, ignoring case.

    `index` has the node of each id. Raises an `InputError` if nothing matches (with the nearest names), or if several do.
    """
    if text in index:
        return index[text]
    wanted = text.strip().casefold()
    exact = [i for i, s in enumerate(stations) if wanted in (s.id.casefold(), s.name.casefold())]
    if len(exact) == 1:
        return exact[0]
    hits = [
        i
        for i, s in enumerate(stations)
        if wanted and not s.flyover and (wanted in s.name.casefold() or wanted in s.id.casefold())
    ]
    if len(hits) == 1:
        return hits[0]
    if hits:
        names = ", ".join(stations[i].id for i in hits[:6]) + (", …" if len(hits) > 6 else "")
        raise InputError("fits several stations", field="station", value=text, remedy=f"choose one of {names}")
    raise InputError("no such station", field="station", value=text, remedy=_suggestion(stations, wanted))


def _suggestion(stations: Sequence[Station], wanted: str) -> str:
    """Return a remedy that names the stations of similar names."""
    names = {s.id.casefold(): s.id for s in stations}
    for station in stations:
        for word in (station.name, *station.name.split()):
            names.setdefault(word.casefold(), station.id)
    close = difflib.get_close_matches(wanted, names, n=6, cutoff=0.5)
    ids = list(dict.fromkeys(names[name] for name in close))[:3]
    if ids:
        return "did you mean " + " or ".join(ids) + "?"
    return "skyway network lists the stations"
