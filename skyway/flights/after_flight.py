"""Data kept after a flight: its logs, downloaded once the vehicle stands disarmed, and its vibration."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from skyway.link.files.flight_logs import LogsBefore, fetch_added, logs_before
from skyway.link.supervisor.journal.entries import LogsSeen
from skyway.link.supervisor.journal.file import read_journal
from skyway.models.base.errors import InputError, LinkError
from skyway.models.base.formatting import bytes_text

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from skyway.link.files.aboard import Way
    from skyway.link.supervisor.context import Context
    from skyway.link.vehicle.health_book import VibrationWatch


def keep_vibration(context: Context, watch: VibrationWatch) -> None:
    """Keep the vibration of a flight, for the check before the next; reports a failure to write it."""
    shook, book = watch.end(), context.job.health
    if shook is None or book is None:
        return
    try:
        book.flew(context.observed.uid, context.now_s, shook)
    except InputError as error:
        context.operator.tell(f"the vibration of the flight was not stored: {error}")


class LogsHome:
    """The logs of one delivery."""

    def __init__(self, context: Context, folder: Path, tell: Callable[[str], None], *, resumed: bool) -> None:
        self._context, self._folder, self._tell = context, folder, tell
        self._before = self._noted() if resumed else self._look()

    def _look(self) -> LogsBefore | None:
        """List what is aboard; a resumed flight finds it in the journal."""
        ctx = self._context
        try:
            found = logs_before(ctx.vehicle)
        except LinkError as error:
            self._tell(f"the onboard logs are unknown ({error}): after the flight the latest is downloaded")
            return None
        aboard = f"{len(found.sizes)} on board, {bytes_text(sum(found.sizes.values()))}"
        ctx.note(LogsSeen(by=found.way, sizes_bytes=dict(found.sizes)), f"logs before the flight: {aboard}")
        return found

    def _noted(self) -> LogsBefore | None:
        """Return what the journal of a resumed flight says; a flight started without --fetch-log has the latest fetched."""
        for record in read_journal(self._context.journal.path).records:
            entry = record.entry(LogsSeen)
            if entry is not None and entry.by in ("ftp", "requests"):
                sizes = {name: size for name, size in entry.sizes_bytes.items() if isinstance(size, int)}
                return LogsBefore(cast("Way", entry.by), sizes)
        return None

    def fetch(self) -> list[Path]:
        """Fetch what the flight has added, as far as that can be; the outcome of the flight stays what it is."""
        vehicle = self._context.vehicle
        recorder = vehicle.connection.recorder
        flight = [*(() if recorder is None else recorder.paths), self._context.journal.path]
        return [one.path for one in fetch_added(vehicle, self._before, self._folder, flight, self._tell)]
