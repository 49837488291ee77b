"""The live view of a flight: expected against actual as a table where there is a terminal, plain lines where not."""

from __future__ import annotations

import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import typer

from skyway import flight_report_fields as of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    from rich.console import Console as Terminal
    from rich.live import Live
    from rich.table import Table

    from link.supervisor import Record

UNKNOWN = "unknown"


class FlightView:
    """Shows the records of a journal as they are written.

    Parameters
    ----------
    terminal : rich Console
        Where to.
    """

    def __init__(self, terminal: Terminal) -> None:
        self._terminal = terminal
        self._live: Live | None = None
        self._leg: dict[str, Any] = {}
        self._took_off_s: float | None = None

    @contextmanager
    def shown(self) -> Iterator[FlightView]:
        """Keep the table at the foot of the terminal, if it is one."""
        from rich.live import Live

        if not self._terminal.is_terminal:
            yield self
            return
        with Live(console=self._terminal, auto_refresh=False, redirect_stdout=False, redirect_stderr=False) as live:
            self._live = live
            try:
                yield self
            finally:
                self._live = None

    def say(self, line: str) -> None:
        """Say a line, above the table."""
        if self._live is None:
            typer.echo(line)
            sys.stdout.flush()
        else:
            self._terminal.print(line, markup=False, highlight=False, emoji=False, soft_wrap=True)

    def take(self, record: Record) -> None:
        """Show a record."""
        from skyway.flying import line_of

        if record.event == "leg":
            self._leg, self._took_off_s = record.data, of.instant_s(record.time)
        if record.event == "landed":
            self._leg, self._took_off_s = {}, None
        if self._live is not None and record.event == "track":
            self._live.update(self.table(record), refresh=True)
            return
        line = line_of(record)
        if line is not None:
            self.say(line)

    def table(self, record: Record) -> Table:
        """Return what was expected beside what is, from a ``track`` record."""
        from rich.table import Table

        to = of.text(record.data, "destination") or of.text(self._leg, "destination")
        head = f"{record.time[11:19]}  {record.state}" + (f"  flight {record.flight} to {to}" if to else "")
        found = Table(title=head, title_justify="left", title_style="bold")
        for name, side in (("", "left"), ("expected", "right"), ("actual", "right")):
            found.add_column(name, justify="right" if side == "right" else "left")
        for row in self.rows(record):
            found.add_row(*row)
        return found

    def rows(self, record: Record) -> list[tuple[str, str, str]]:
        """Return name, expected and actual of time, charge, wind, speed and way; what is not known says so."""
        data, now_s = record.data, of.instant_s(record.time)
        flown = None if now_s is None or self._took_off_s is None else now_s - self._took_off_s
        left, planned_s, late = of.number(data, "left_s"), of.number(self._leg, "planned_s"), of.number(data, "late_s")
        whole = None if flown is None or left is None else flown + left
        rows = [
            ("flight time", _clock(planned_s), f"{_clock(whole)}{_late(late)}; {_clock(left)} left"),
            ("charge now", _percent(self._expected_now(flown, planned_s)), _percent(of.share(data, "soc"))),
            ("charge at the landing", _percent(of.share(data, "planned_soc_land")), _percent(of.share(data, "soc_land"))),
            ("below the reserve", "", _probability(of.share(data, "p_below_reserve"))),
            ("wind", _wind(data, "forecast"), _wind(data, "wind", of.number(data, "wind_sigma_mps"))),
            ("ground speed", _with(of.number(data, "commanded_mps"), "m/s"), _with(of.number(data, "ground_speed_mps"), "m/s")),
            ("off the way", "0 m", _with(of.number(data, "cross_track_m"), "m")),
            ("height above home", "", _with(of.number(data, "height_m"), "m")),
        ]  # fmt: skip
        if not self._leg:  # on the ground nothing of a way is expected
            rows = [row for row in rows if row[0] in ("charge now", "wind")]
        return rows

    def _expected_now(self, flown_s: float | None, planned_s: float | None) -> float | None:
        """Return the charge that the plan of the take-off has now, evenly spent over its time."""
        first, last = of.share(self._leg, "soc"), of.share(self._leg, "planned_soc")
        if first is None or last is None or flown_s is None or not planned_s:
            return None
        return first + (last - first) * min(max(flown_s / planned_s, 0.0), 1.0)


def view_for(*, as_json: bool) -> tuple[FlightView, Callable[[Record], None], Callable[[str], None]]:
    """Return the view, what takes the records and what takes lines for the person, as it was asked for."""
    from rich.console import Console

    if not as_json:
        view = FlightView(Console(highlight=False, markup=False, emoji=False))
        return view, view.take, view.say
    import io

    import msgspec

    def written(record: Record) -> None:
        typer.echo(msgspec.json.encode(record).decode())

    return FlightView(Console(file=io.StringIO())), written, lambda line: typer.echo(line, err=True)


def _clock(seconds: float | None) -> str:
    return UNKNOWN if seconds is None else f"{max(seconds, 0.0) // 60:.0f}:{max(seconds, 0.0) % 60:02.0f}"


def _late(seconds: float | None) -> str:
    return "" if seconds is None else f" ({seconds:+.0f} s)"


def _percent(share: float | None) -> str:
    return UNKNOWN if share is None else f"{100.0 * share:.0f} %"


def _probability(share: float | None) -> str:
    if share is None:
        return UNKNOWN
    return "below 0.1 %" if share < 0.001 else f"{100.0 * share:.1f} %"


def _with(value: float | None, unit: str) -> str:
    return UNKNOWN if value is None else f"{value:.1f} {unit}"


def _wind(data: dict[str, Any], name: str, sigma: float | None = None) -> str:
    north, east = of.number(data, f"{name}_north_mps"), of.number(data, f"{name}_east_mps")
    speed, direction = of.speed(north, east), of.direction(north, east)
    if speed is None or direction is None:
        return UNKNOWN
    return f"{speed:.1f}{'' if sigma is None else f' ± {sigma:.1f}'} m/s from {direction:.0f}°"
