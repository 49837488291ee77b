"""Parts shared by all pages: the options, the work folder, and the processes that compute."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.web.folder import Folder, stamp
from skyway.web.live.fleet import Fleet
from skyway.web.live.flights import Flights
from skyway.web.work.weather_and_zones import give
from skyway.web.workers import Workers

if TYPE_CHECKING:
    from skyway.web.server import ServeOptions


class Site:
    """One served site.

    Attributes
    ----------
    options : ServeOptions
        As given.
    folder : Folder
        The work folder.
    workers : Workers
        Processes for computations, so that the page remains responsive.
    fleet : Fleet
        Received vehicles.
    flights : Flights
        Deliveries in flight.
    """

    def __init__(self, options: ServeOptions) -> None:
        self.options = options
        self.folder = Folder(options.folder)
        give(options.given)  # it appears in the shown commands
        self.workers = Workers(options.given)
        self.fleet = Fleet(self)
        self.flights = Flights(self.folder)
        self._region: tuple[object, dict[str, Any]] | None = None

    @property
    def scenario(self) -> str | None:
        """The scenario in the form for a worker: its folder, None the built-in one."""
        return None if self.options.scenario is None else str(self.options.scenario)

    async def region(self) -> dict[str, Any]:
        """Return the map data of the scenario; computed once for each state of its files, so that no page waits for a plan."""
        now = stamp(self.options.scenario)
        if self._region is None or self._region[0] != now:
            self._region = now, await self.workers.ask("region.region", self.scenario)
        return self._region[1]

    def start(self) -> None:
        """Start the processes; the first one loads its libraries and the scenario in the background."""
        self.workers.start(self.scenario)

    def stop(self) -> None:
        """End them; repeated calls have no effect."""
        self.fleet.stop_all()
        self.workers.close()
