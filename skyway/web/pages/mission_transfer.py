"""A mission and a vehicle: their differences, and the verified upload; both by commands in separate processes."""

from __future__ import annotations

import json
import re
import shlex
from typing import TYPE_CHECKING, Any

from nicegui import ui

from skyway.models.base.errors import SkywayError
from skyway.web.controls import Button, Field, Status, say, text
from skyway.web.live.runs import Run

if TYPE_CHECKING:
    from collections.abc import Callable

    from nicegui import Client

    from skyway.web.site import Site

_STEP = re.compile(r"^(.*?) (\d+)/(\d+)$")
"""A line of progress."""
ENDS = {0: "done: both are equal", 1: "they differ", 2: "not done: see below", 3: "failed: the vehicle or the link"}
"""Text by the exit code of a command."""


class Transfer:
    """The part of the page for the vehicle.

    Parameters
    ----------
    site : Site
        The site with the work folder.
    client : Client
        The browser's page.
    file : callable
        Returns the name of the shown mission.
    differ : callable
        Called with the differences between the file and the vehicle's mission.
    """

    def __init__(
        self, site: Site, client: Client, file: Callable[[], str], differ: Callable[[list[dict[str, Any]]], None]
    ) -> None:
        self.site, self.client, self._file, self._differ = site, client, file, differ
        self.connect, self.sure, self.despite = "", False, False
        self.run: Run | None = None
        text("h2", "Vehicle")
        Field(
            "Connection",
            lambda value: setattr(self, "connect", str(value).strip()[:200]),
            hint="udpin:127.0.0.1:14540, tcp:…, /dev/ttyUSB0,57600",
        )
        with ui.element("div").classes("line"):
            Button("Compare with the vehicle", self.compare)
        Field(
            "Upload it although the check finds errors (--with-errors)",
            lambda on: setattr(self, "despite", bool(on)),
            kind="check",
            value=False,
        )
        self.confirmation = Field(
            "I am sure: replace the mission of the vehicle", self._confirmed, kind="check", value=False
        )
        with ui.element("div").classes("line"):
            Button("Upload and read back", self.upload, "main")
        self.bar = ui.element("progress").props('max=1 value=0 aria-label="Upload"')
        self.progress = Status()
        self.output = text("pre", "", "output")

    async def compare(self) -> None:
        """Compare the file with the vehicle's mission."""
        self._differ([])
        if await self._told("verify", "--json"):
            self._differ(_report(list(self.run.lines if self.run is not None else ())).get("differences", []))

    async def upload(self) -> None:
        """Upload the file, and read it back."""
        if not self.sure:
            words = "An upload replaces the mission of the vehicle: confirm it above."
            self.progress.tell(words, wrong=True)
            return
        self._differ([])
        if await self._told("upload", "--yes", *(["--with-errors"] if self.despite else [])):
            self.doubt()

    def doubt(self) -> None:
        """Ask for the confirmation again: it is for one upload of one file."""
        self.sure = False
        self.confirmation.show(False)  # noqa: FBT003  a value like any other

    def _confirmed(self, on: Any) -> None:
        self.sure = bool(on)
        self.confirmation.keep(self.sure)

    async def _told(self, command: str, *more: str) -> bool:
        """Run a command of the link in its own process, and show its output; False if it could not be started."""
        try:
            path = self.site.folder.existing(self._file())
        except SkywayError as error:
            self.progress.tell(str(error), wrong=True)
            return False
        if not self.connect or self.connect.startswith("-"):
            self.progress.tell("Enter the connection of the vehicle above.", wrong=True)
            return False
        if self.run is not None and self.run.code is None:
            self.progress.tell("Wait for what is running.", wrong=True)
            return False
        self.run = Run([command, str(path), "--connect", self.connect, *more], self._heard, outlives=True)
        self.progress.tell(f"skyway {shlex.join([command, self._file(), '--connect', self.connect, *more])}")
        self.bar.props("max=1 value=0")
        say(self.output, "")
        code = await self.run.finished()
        self.progress.tell(f"{command}: {ENDS.get(code, f'ended with {code}')}", wrong=code != 0)
        return True

    def _heard(self, line: str) -> None:
        with self.client:
            step = _STEP.match(line)
            if step is not None:
                self.bar.props(f"max={step[3]} value={step[2]}")
                self.progress.tell(line)
            elif self.run is not None and not line.startswith("{"):
                plain = (one for one in self.run.lines if not _STEP.match(one) and not one.startswith("{"))
                say(self.output, "\n".join(plain))


def _report(lines: list[str]) -> dict[str, Any]:
    """Return a command's machine-readable result, from the last of its lines; empty if there is none."""
    for line in reversed(lines):
        if line.startswith("{"):
            try:
                found = json.loads(line)
            except ValueError:
                return {}
            return found if isinstance(found, dict) else {}
    return {}
