"""The dispatcher: takes orders, plans, books, gives flights to workers, and replans around flights under way; its state is on the desk."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.dispatch.dispatcher.alone import Alone
from skyway.dispatch.dispatcher.bookings import Bookings
from skyway.dispatch.dispatcher.closed_legs import ClosedLegs
from skyway.dispatch.dispatcher.departures import Departures
from skyway.dispatch.dispatcher.events import Events
from skyway.dispatch.dispatcher.fleet_planner import FleetPlanner
from skyway.dispatch.dispatcher.idle_charging import IdleCharging
from skyway.dispatch.dispatcher.promises import Promises
from skyway.dispatch.dispatcher.reasons import Reasons
from skyway.dispatch.dispatcher.replanning import Replanning
from skyway.dispatch.dispatcher.seen_strangers import SeenStrangers
from skyway.dispatch.dispatcher.situation import Situation
from skyway.dispatch.dispatcher.windows import to_book
from skyway.dispatch.fleet_winds import FleetForecast
from skyway.dispatch.records import OPEN
from skyway.dispatch.worker import worker_name
from skyway.models.base.errors import SkywayError

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.dispatch.leases import KeptLeases
    from skyway.dispatch.region import Region
    from skyway.models.ledger.desk import Desk
    from skyway.models.ledger.ledger import Lease
    from skyway.models.queues.pad_service import PadService


class Dispatcher:
    """One dispatcher; `step` does the due work of an instant.

    Parameters
    ----------
    region : Region
        Region and weather.
    desk : Desk
        Its desk, in the ledger of the bookings.
    leases : KeptLeases
        The leases of this process.
    workers : int
        Number of workers.
    plan_s, iterations : float, int
        Limit of the search for a plan: wall time, s, or iterations.
    say : callable
        Displays a line.
    service : PadService, optional
        The pads, for the drones on them; without it the expected number of other drones is assumed.
    """

    def __init__(
        self, region: Region, desk: Desk, leases: KeptLeases, *, workers: int, plan_s: float = 2.0, iterations: int = 10**9,
        say: Callable[[str], None] = lambda _: None, service: PadService | None = None,
    ) -> None:  # fmt: skip
        self._region, self._desk, self._leases = region, desk, leases
        holder = desk.dispatcher
        self._situation = situation = Situation(desk)
        self._air = air = FleetForecast(region)
        legs = ClosedLegs(region.forecast, say)
        planner = FleetPlanner(region, air, legs, SeenStrangers(region.base, service), plan_s)
        pads = {one.id: one.pads for one in region.base.network.stations}
        self._bookings = bookings = Bookings(desk.ledger, holder, self._lease, pads)
        self._promises = promises = Promises(situation, say)
        self._events = Events(situation, promises, legs, region.base, say)
        self._replanning = Replanning(situation, planner, promises, bookings, holder, iterations)
        self._alone = Alone(situation, planner, promises, bookings, holder, say)
        names = [worker_name(holder, number) for number in range(1, workers + 1)]
        self._idle = IdleCharging(situation, bookings, pads, service, say)
        self._departures = Departures(situation, promises, region, air, legs, names)

    def step(self, now_s: float) -> None:
        """Process new events, and do the due work."""
        why = Reasons()
        self._situation.read()
        self._air.hear(one for _, one in self._situation.flights.values())
        self._events.take_ends(now_s, why)
        self._events.take_delays(now_s, why)
        self._events.take_cancellations(now_s, why)
        self._events.take_orders(why)
        self._replanning.note_waiting(now_s, why)
        self._alone.note_packages(now_s, why)
        self._events.take_pads(now_s, why)
        self._alone.bring_on(now_s)
        if why:
            self._replanning.replan(now_s, why)
        self._idle.give_way(now_s)
        self._departures.begin_due(now_s)
        self._idle.charge(now_s)
        self._promises.refuse_too_late(now_s, self._region.planning.dispatch)
        self._write(now_s)

    def end_idle_charges(self, now_s: float) -> None:
        """End the charges of drones without a task, at the end of the service."""
        self._situation.read()
        self._idle.end(now_s)
        self._write(now_s)

    def close_orders(self, now_s: float) -> None:
        """Process the flights that ended since, and close the orders that are still open: each has an end and a reason."""
        situation = self._situation
        situation.read()
        self._events.take_ends(now_s, Reasons())
        self._events.take_cancellations(now_s, Reasons())
        flying = {flight.order for _, flight in situation.flights.values()}
        for name, (state, order) in list(situation.orders.items()):
            if state == "aboard" or name in flying:
                order.reason = order.reason or "the service ended while its drone was flying"
                self._promises.hand_over(name, order)
            elif state in OPEN:
                order.reason = "the service ended before its flight"
                self._promises.refuse(name, order)
        for name, (state, drone) in situation.drones.items():
            drone.route = ()
            situation.change_drone(name, state, drone)
        self._write(now_s)

    def _write(self, now_s: float) -> None:
        """Write the changes to the desk, and bring the bookings into agreement with them."""
        self._situation.write(self._lease())
        self._bookings.bring_up_to_date(to_book(self._situation, now_s), now_s)

    @property
    def busy(self) -> bool:
        """Whether any order is open, or any drone has a task."""
        return self._situation.busy

    def _lease(self) -> Lease:
        """Return its lease; a `FencedError`: another dispatcher has taken over."""
        self._leases.confirm(self._desk.dispatcher)
        kept = self._leases.kept(self._desk.dispatcher)
        if kept is None:
            raise SkywayError("the lease of the dispatcher is lost")
        return kept
