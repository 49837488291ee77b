"""The history page: journals of the work folder, searchable, and totals."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from nicegui import ui

from skyway.models.base.errors import SkywayError
from skyway.models.base.formatting import distance_text, duration, percent
from skyway.report.svg import safe
from skyway.web import shell
from skyway.web.controls import Button, CommandShown, Field
from skyway.web.folder import REPORTS
from skyway.web.pages.under_way import UnderWay
from skyway.web.work.history import energy_per_km

if TYPE_CHECKING:
    from nicegui import Client

    from skyway.web.preferences import Preferences
    from skyway.web.site import Site

AT_ONCE = 50
"""Number of journals that are read before they are shown."""


def add(site: Site) -> None:
    """Add the page."""
    shell.add(site, "/history", HistoryPage)


class HistoryPage:
    """One open page."""

    def __init__(self, site: Site, client: Client, wanted: Preferences) -> None:
        self.site, self.wanted = site, wanted
        self.rows: list[dict[str, Any]] = []
        self.unread: list[dict[str, Any]] = []
        self.reports: list[dict[str, Any]] = []
        self.sought = ""
        self.timezone = "UTC"
        with ui.element("div").classes("panel whole"):
            with ui.element("div").classes("line"):
                Field("Search", self.seek, hint="Station, drone, state, file; several words narrow it")
                Button("Refresh the folder", self._begin)
            self.at_work = UnderWay(client, self._begin, "Read on", lambda: "Not all journals were read.")
            self.totals = ui.html("")
            self.table = ui.html("")
            self.kept = ui.html("")
            CommandShown("history", "skyway report JOURNAL.jsonl")
        ui.timer(0.01, self._begin, once=True)

    def _begin(self) -> None:
        self.at_work.begin(self._read())

    async def _read(self) -> None:
        """Read the folder, the newest journals first; results are shown while the rest is read."""
        names = [(one.name, one.modified_s) for one in self.site.folder.files(".jsonl")]
        pages = [one.name for one in self.site.folder.files(*REPORTS)]
        root = str(self.site.folder.root.resolve())
        self.rows, self.unread, tell = [], [], self.at_work.status.tell
        tell("Reading …")
        try:
            self.timezone = (await self.site.region())["timezone"]
            self.reports = await self.site.workers.ask("history.reports", root, pages)
            for first in range(0, len(names), AT_ONCE):
                self.at_work.tell(f"Reading {first} of {len(names)} …")
                found = await self.site.workers.ask("history.told", root, names[first : first + AT_ONCE])
                self.rows += [row for row in found if "unread" not in row]
                self.unread += [row for row in found if "unread" in row]
                self._draw()
        except SkywayError as error:
            tell(str(error), wrong=True)
            return
        tell(
            ""
            if self.rows or self.unread
            else "No journals in the work folder yet: flights of the page Fly write them, and skyway fly and skyway demo.",
        )
        self._draw()

    def seek(self, words: Any) -> None:
        """Show the rows that contain all words."""
        self.sought = str(words)
        self._draw()

    def _draw(self) -> None:
        found = _with(self.rows, self.sought)
        self.totals.set_content(_totals(found, self.wanted))
        self.table.set_content(self._table(found) + _unread(_with(self.unread, self.sought)))
        self.kept.set_content(_reports(_with(self.reports, self.sought)))

    def _table(self, found: list[dict[str, Any]]) -> str:
        rows = []
        for row in found:
            when = (
                "unknown"
                if row["depart_s"] is None
                else self.wanted.clock(datetime.fromtimestamp(row["depart_s"], UTC), self.timezone)
            )
            kept = {True: "kept", False: "<span class='warn'>missed</span>", None: ""}[row["promise_kept"]]
            low = row["lowest_soc"]
            below = low is not None and row["reserve_soc"] is not None and low < row["reserve_soc"]
            reserve = f"<span class='{'warn' if below else ''}'>{percent(low)}{' (below the reserve)' if below else ''}</span>"
            told = row["state"] if row["ended"] else f"not ended: {row['state']}"
            state = f"<span class='good'>{_end(row)}</span>" if row["arrived"] else safe(told)
            link = f'<a href="/replay?log={quote(row["file"])}">{safe(row["file"])}</a>'
            kept_as = f'<a href="/api/report?journal={quote(row["file"])}" download>report<span class="only-heard"> of {safe(row["file"])}</span></a>'
            rows.append(
                f"<tr><td>{safe(when)}</td><td>{safe(row['from'])} &gt; {safe(row['to'])}</td><td>{safe(row['drone'])}</td><td>{state}</td>"
                f"<td class='n'>{row['flights']}</td><td class='n'>{duration(row['delivery_s'])}</td><td>{kept}</td><td class='n'>{reserve}</td>"
                f"<td class='n'>{row['decisions']}</td><td>{link}</td><td>{kept_as}</td></tr>"
            )
        head = (
            "<tr><th>departure</th><th>from &gt; to</th><th>drone</th><th>end</th><th class='n'>flights</th><th class='n'>took</th><th>promise (95 %)</th>"
            "<th class='n'>lowest charge</th><th class='n'>decisions</th><th>journal</th><th>report</th></tr>"
        )
        return (
            f"<div class='scroll'><table><thead>{head}</thead><tbody>{''.join(rows)}</tbody></table></div>"
            if found
            else ""
        )


def _with(rows: list[dict[str, Any]], sought: str) -> list[dict[str, Any]]:
    """Return the rows that contain all words."""
    words = sought.casefold().split()
    return [row for row in rows if all(word in " ".join(map(str, row.values())).casefold() for word in words)]


def _unread(found: list[dict[str, Any]]) -> str:
    """Journals that cannot be read, and why."""
    lines = "".join(f"<li class='warn'>{safe(one['unread'])}</li>" for one in found)
    return f"<h2>Damaged journals, not counted</h2><ul class='notes small-notes'>{lines}</ul>" if found else ""


def _reports(found: list[dict[str, Any]]) -> str:
    """Reports in the folder; each is downloaded, not shown as a page of ours."""
    rows = "".join(
        f"<tr><td>{safe(one['title'])}</td><td><a href='/api/report?file={quote(one['file'])}' download>{safe(one['file'])}</a></td></tr>"
        for one in found
    )
    head = "<thead><tr><th>report</th><th>file</th></tr></thead>"
    return f"<h2>Reports in the folder</h2><table>{head}<tbody>{rows}</tbody></table>" if found else ""


def _end(row: dict[str, Any]) -> str:
    """How a flight ended that went as intended."""
    if row["delivered"]:
        return "delivered"
    return "work done" if row["state"] == "done" else "arrived, no package"


def _share(found: list[dict[str, Any]], name: str) -> tuple[str, str]:
    """Number of kept promises, and its share for comparison with the promised one."""
    known = [row[name] for row in found if row[name] is not None]
    return (f"{sum(known)} of {len(known)}", percent(sum(known) / len(known))) if known else ("none given", "")


def _totals(found: list[dict[str, Any]], wanted: Preferences) -> str:
    kept = [
        (row["lowest_soc"], row["reserve_soc"]) for row in found if None not in (row["lowest_soc"], row["reserve_soc"])
    ]
    lows = [row["lowest_soc"] for row in found if row["lowest_soc"] is not None]
    energy = energy_per_km(found)
    carried = [row for row in found if row["hands_over"]]
    delivered = [row["delivered"] for row in carried if row["ended"]]
    apart = {"not ended": len(carried) - len(delivered), "without a package": len(found) - len(carried)}
    others = ", ".join(f"{count} {words}" for words, count in apart.items() if count)
    cells = [
        ("deliveries", f"{sum(delivered)} of {len(delivered)}", f"and {others}" if others else ""),
        ("flights", str(sum(row["flights"] for row in found)), ""),
        ("in the air", duration(sum(row["flight_s"] or 0.0 for row in found)), ""),
        ("way flown", wanted.in_words(distance_text(sum(row["flown_m"] for row in found))), ""),
        ("energy", "unknown" if energy is None else f"{energy:.1f} Wh/km", ""),
        ("kept of 95 % promises", *_share(found, "promise_kept")),
        ("kept of 50 % promises", *_share(found, "half_kept")),
        ("lowest charge", percent(min(lows)) if lows else "unknown", ""),
        ("reserve kept", f"{sum(low >= reserve for low, reserve in kept)} of {len(kept)}", ""),
    ]
    figures = "".join(
        f"<div><dt>{name}</dt><dd>{safe(value)}{f'<span class=small>{safe(small)}</span>' if small else ''}</dd></div>"
        for name, value, small in cells
    )
    return f"<dl class='figures'>{figures}</dl>" if found else ""
