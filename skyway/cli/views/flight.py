"""Live view of a flight: a panel at the bottom of a terminal, or plain lines."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from datetime import UTC, datetime, tzinfo
from typing import TYPE_CHECKING, Any

import typer

from skyway.flying import line_of
from skyway.link.supervisor.journal import fields as of
from skyway.link.supervisor.journal.entries import CheckDone, Landed, LegBegun, StateEntered, Tracked
from skyway.models.base.formatting import (
    UNKNOWN,
    counter,
    distance_text,
    duration,
    height_text,
    percent,
    probability,
    speed_text,
    zone_clock,
)
from skyway.models.base.units import from_posix

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console as Terminal
    from rich.console import Group
    from rich.live import Live
    from rich.table import Table

    from skyway.link.supervisor import Record
    from skyway.link.supervisor.context import Context

_REFRESH_HZ = 2.0


class FlightView:
    """Shows the records of a journal as they are written, and the status between them.

    `typed` returns the operator's input on the current line so far.
    """

    def __init__(self, terminal: Terminal, zone: tzinfo = UTC, typed: Callable[[], str] = lambda: "") -> None:
        self._terminal, self._zone, self.typed = terminal, zone, typed
        self._live: Live | None = None
        self._leg: LegBegun | None = None
        self._took_off_s: float | None = None
        self._track: Record | None = None
        self._state, self._meaning, self._entered_s = "", "", time.monotonic()
        self._checks: dict[str, tuple[str, str]] = {}
        self._context: Context | None = None

    @property
    def lives(self) -> bool:
        """Whether there is a terminal for a permanent panel."""
        return self._terminal.is_terminal and not self._terminal.is_dumb_terminal

    @contextmanager
    def shown(self) -> Iterator[FlightView]:
        """Keep the panel at the foot of the terminal, if it is one."""
        from rich.live import Live

        if not self.lives:
            yield self
            return
        with Live(
            console=self._terminal, get_renderable=self.panel, refresh_per_second=_REFRESH_HZ,
            redirect_stdout=False, redirect_stderr=False,
        ) as live:  # fmt: skip
            self._live = live
            try:
                yield self
            finally:
                self._live = None

    def doing(self, what: str) -> None:
        """Return the current activity before there is a journal: connecting, identifying the vehicle."""
        self._state, self._meaning, self._entered_s = what, "", time.monotonic()
        self.say(what)

    def say(self, line: str) -> None:
        """Print a line, above the panel."""
        if self._live is None:
            typer.echo(line)
            sys.stdout.flush()
        else:
            self._terminal.print(line, markup=False, highlight=False, emoji=False, soft_wrap=True)

    def tick(self, context: Context) -> None:
        """Take the latest state of the delivery."""
        self._context = context

    def take(self, record: Record) -> None:
        """Show a record."""
        if entered := record.entry(StateEntered):
            self._enter(entered.after or record.state)
        elif check := record.entry(CheckDone):
            self._checks[check.name or ""] = (check.verdict or "", check.said or "")
        elif leg := record.entry(LegBegun):
            self._leg, self._took_off_s = leg, of.instant_s(record.time)
        elif record.event == Landed.event():
            self._leg, self._took_off_s, self._track = None, None, None
        if record.event == "track":
            self._track = record
            if self._live is not None:
                self._live.refresh()
                return
        line = line_of(record, self._zone)
        if line is not None:
            self.say(line)

    def _enter(self, after: str) -> None:
        from skyway.link.supervisor.states import TABLE, State

        known = {str(state): rule.meaning for state, rule in TABLE.items()}
        self._state, self._meaning, self._entered_s = after, known.get(after, ""), time.monotonic()
        if after == State.PREFLIGHT:
            self._checks = {}

    # The panel

    def panel(self) -> Group:
        """Return the panel at the foot of the terminal."""
        from rich.console import Group
        from rich.text import Text

        context, track = self._context, self._track
        parts: list[Any] = [Text(self._head(context), style="bold", no_wrap=True, overflow="ellipsis")]
        if self._leg and track is not None:
            parts.append(self.table(track))
        parts += [Text(line, no_wrap=True, overflow="ellipsis") for line in self._now(context)]
        if context is not None and context.conversation.question:
            parts.append(Text(f"? {context.conversation.question}", style="bold"))
        typed = self.typed()
        if typed or (context is not None and context.conversation.question):
            parts.append(Text(f"> {typed}", style="bold"))
        return Group(*parts)

    def _head(self, context: Context | None) -> str:
        now = from_posix(context.now_s) if context is not None else datetime.now(UTC)
        lasts = counter(time.monotonic() - self._entered_s)
        meaning = f": {self._meaning}" if self._meaning else ""
        return f"{zone_clock(now, self._zone)}  {self._state} ({lasts}){meaning}"

    def _now(self, context: Context | None) -> list[str]:
        """Current values, besides the table of a flight."""
        if context is None:
            return []
        sample, silent_s = context.observed.sample, context.vehicle.silent_s
        heard = f"silent for {duration(silent_s)}" if silent_s > 2.0 else "connected"
        found = [f"drone: {context.vehicle.mode}, {'armed' if context.vehicle.armed else 'disarmed'}, {heard}"]
        if sample is not None and not self._leg:
            aim = (
                ""
                if context.delivery.charge_to is None
                else f", to be charged to {percent(context.delivery.charge_to)}"
            )
            found[0] += (
                f"; at {context.delivery.station or 'no known station'}; charge {percent(context.battery.soc)}{aim}"
            )
        if self._checks and not self._leg:
            found += self._open_checks()
        if context.texts.latest is not None:
            found.append(f"last message: {context.texts.latest}")
        return found

    def _open_checks(self) -> list[str]:
        checks = dict(self._checks)  # the panel is drawn beside the flight
        wrong = {name: entry for name, entry in checks.items() if entry[0] != "ok"}
        words = {"no": "NOT OK", "unknown": "UNKNOWN"}
        lines = [f"checks: {len(checks) - len(wrong)} passed" + (f", {len(wrong)} not:" if wrong else "")]
        return lines + [f"  {name}: {words.get(verdict, verdict)}: {said}" for name, (verdict, said) in wrong.items()]

    def table(self, record: Record) -> Table:
        """Return expected beside actual values, from a ``track`` record."""
        from rich.table import Table

        from skyway.link.supervisor.states import State

        to = Tracked.read(record.data).expected.destination or (None if self._leg is None else self._leg.destination)
        at_s = of.instant_s(record.time)
        clock = UNKNOWN if at_s is None else zone_clock(from_posix(at_s), self._zone)
        head = f"{clock}  {record.state}" + (f"  flight {record.flight} to {to}" if to else "")
        found = Table(title=head, title_justify="left", title_style="bold")
        actual = "last heard" if record.state == State.LOST_LINK else "actual"
        for name, side in (("", "left"), ("expected", "right"), (actual, "right")):
            found.add_column(name, justify="right" if side == "right" else "left")
        for row in self.rows(record):
            found.add_row(*row)
        return found

    def rows(self, record: Record) -> list[tuple[str, str, str]]:
        """Return name, expected and actual of time, charge, wind, speed and way; unknown values are marked."""
        entry, now_s = Tracked.read(record.data), of.instant_s(record.time)
        expected, planned_s = entry.expected, None if self._leg is None else self._leg.planned_s
        flown = None if now_s is None or self._took_off_s is None else now_s - self._took_off_s
        left = expected.left_s
        whole = None if flown is None or left is None else flown + left
        rows = [
            ("flight time", counter(planned_s), f"{counter(whole)}{_late(expected.late_s)}; {counter(left)} left"),
            ("charge now", percent(self._expected_now(flown, planned_s)), percent(entry.soc)),
            ("charge at the landing", percent(expected.planned_soc_land), percent(expected.soc_land)),
            ("below the reserve", "", probability(expected.p_below_reserve, 1)),
            ("wind", entry.forecast.words() or UNKNOWN, entry.measured_words() or "not measured"),
            ("ground speed", speed_text(expected.commanded_mps), speed_text(entry.ground_speed_mps)),
            ("off the route", "0 m", distance_text(expected.cross_track_m)),
            ("height above home", "", height_text(entry.height_m)),
        ]  # fmt: skip
        if expected.limited:
            rows.append(("", "", expected.limited))
        if self._leg is None:  # on the ground there is no expectation of a way
            rows = [row for row in rows if row[0] in ("charge now", "wind")]
        return rows

    def _expected_now(self, flown_s: float | None, planned_s: float | None) -> float | None:
        """Return the expected present charge by the plan of the take-off, consumed evenly over its time."""
        first, last = (None, None) if self._leg is None else (self._leg.soc, self._leg.planned_soc)
        if first is None or last is None or flown_s is None or not planned_s:
            return None
        return first + (last - first) * min(max(flown_s / planned_s, 0.0), 1.0)


class RecordLines(FlightView):
    """View for a program: each record of the journal is a line of JSON; messages go to standard error."""

    def say(self, line: str) -> None:
        """Print a line outside the records."""
        typer.echo(line, err=True)

    def take(self, record: Record) -> None:
        """Write a record."""
        import msgspec

        typer.echo(msgspec.json.encode(record).decode())


def view_for(*, as_json: bool, zone: tzinfo) -> FlightView:
    """Return the requested view."""
    import io

    from rich.console import Console

    if as_json:
        return RecordLines(Console(file=io.StringIO()), zone)
    return FlightView(Console(highlight=False, markup=False, emoji=False), zone)


def _late(seconds: float | None) -> str:
    return "" if seconds is None else f" ({duration(seconds, signed=True)})"
