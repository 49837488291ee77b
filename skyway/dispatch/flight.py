"""One flight of a worker: its supervisor in a thread, fenced by the lease, with its progress on the desk."""

from __future__ import annotations

import json
import math
import threading
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from skyway.dispatch.booked_pads import BookedPads
from skyway.dispatch.fleet_winds import last_of
from skyway.dispatch.records import TO_PACKAGE, WITH_PACKAGE, End, Progress
from skyway.flying import request_of
from skyway.link.protocol.connection import Connection
from skyway.link.supervisor import DeliveryJob, Journal, NobodyThere, Supervisor, read_journal
from skyway.link.supervisor.command.orders import offered
from skyway.link.supervisor.operators import Said
from skyway.link.supervisor.states import IN_AIR, State
from skyway.link.vehicle.vehicle import Vehicle
from skyway.models.base.errors import InputError, LinkError, SkywayError
from skyway.models.composition.file import from_json
from skyway.models.ledger.ledger import FencedError, VersionError
from skyway.sim_stub.transports.lockstep_client import LockstepClient, LockstepPads

if TYPE_CHECKING:
    from skyway.dispatch.records import FlightRecord
    from skyway.dispatch.worker import Worker
    from skyway.link.supervisor import Outcome
    from skyway.link.supervisor.context import Context
    from skyway.models.ledger.desk import Entry

RECORD_EVERY_S, RECORD_LATE_S = 60.0, 30.0
"""Interval of progress records, s; an additional one when the state changes, or the delay grows by the second value."""
ALONE_S, AGAIN_S = 120.0, 5.0
"""Longest wait for another process that still sends commands to its vehicle, and interval of the checks, s."""
WAITS_S = 5400.0
"""Longest wait of a flight for its take-off, s: then it ends at its station, and the dispatcher replans."""
STAY = "stay"
NOT_TOLD = frozenset({State.REPLANNING, State.PREFLIGHT, State.UPLOADING, State.READY, State.ARMING})


@dataclass(slots=True)
class Recall(NobodyThere):
    """Operator of a flight without people: it orders one thing, that the drone stays where it stands or lands next."""

    due: bool = False

    def next_input(self) -> Said | None:
        """Return the order, if it is due."""
        due, self.due = self.due, False
        return Said(word=STAY, name="the dispatcher") if due else None


class Flight:
    """Supervises one flight in a thread."""

    def __init__(self, worker: Worker, entry: Entry, record: FlightRecord) -> None:
        self._worker, self._entry, self._record = worker, entry, record
        self._last = Progress(at_s=-math.inf, state="")
        self._pads: BookedPads | None = None
        self._recall = Recall()
        self._thread = threading.Thread(target=self._run, daemon=True, name=f"flight {entry.id}")

    def start(self) -> None:
        """Begin, or continue."""
        self._thread.start()

    @property
    def fetches(self) -> str | None:
        """The order to whose package it flies."""
        return self._record.order if self._record.phase == TO_PACKAGE else None

    @property
    def alive(self) -> bool:
        """Whether it is still supervised."""
        return self._thread.is_alive()

    def _run(self) -> None:
        record = self._record
        try:
            world = LockstepClient(self._worker.service.world, f"flight {self._entry.id}", system=record.system)
        except LinkError:
            return  # checked again
        try:
            self._fly(world)
        except (FencedError, VersionError):
            pass  # another process has taken it over
        except SkywayError as error:
            self._give_up(world, str(error))
        finally:
            world.close()

    def _fly(self, world: LockstepClient) -> None:
        record, region = self._record, self._worker.region
        path = self._worker.folder() / record.journal
        resumes = path.exists() and bool(read_journal(path).records)
        if not resumes:
            path.unlink(missing_ok=True)
            self._worker.leases.confirm(self._entry.keeper)
            world.order("load", system=record.system, kg=record.mass_kg)
        self._entry = self._worker.change(self._entry, "flying", record)
        composition = from_json(json.dumps(record.composition), file="desk")
        now_s = world.posix_s()
        scenario = region.in_air(region.with_places((composition.origin, composition.destination)), now_s)
        loaded = record.phase == WITH_PACKAGE
        job = DeliveryJob(
            composition=composition,
            scenario=scenario,
            request=replace(request_of(composition, scenario), return_to="none"),
            forecast=region.forecast(now_s),
            observed=lambda at_s: self._worker.winds.of_others(record.system, at_s, record.begin_s),
            drag=self._worker.service.drags.get(composition.drone),
            dispatched=True,
            longest_wait_s=WAITS_S,
            hands_over=loaded,
            not_before_s=record.not_before_s,
            parameters=region.flying,
            asking="never",
        )
        vehicle = self._alone(world)
        pads = self._pads = BookedPads(LockstepPads(world), record.steps, world.posix_s)
        journal = Journal(path, world.posix_s, resume=resumes)
        try:
            supervisor = Supervisor(
                job, vehicle, world, pads, self._recall, journal, resume=resumes, on_tick=self._tell
            )
            outcome = supervisor.run()
            if outcome.station is not None:
                pads.leave(outcome.station, str(record.system))
            self._end(world, supervisor.context, outcome)
        finally:
            journal.close()

    def _alone(self, world: LockstepClient) -> Vehicle:
        """Connect; if the process that had this flight before still sends to the vehicle under our id, wait for its end."""
        until_s = world.now_s() + ALONE_S
        while True:
            connection = Connection(world, world)
            connection.fence = lambda: self._worker.leases.confirm(self._entry.keeper)
            vehicle = Vehicle(connection, self._record.system)
            if connection.conflict is None or world.now_s() >= until_s:
                return vehicle
            world.sleep_until(world.now_s() + AGAIN_S)

    # Progress

    def _tell(self, ctx: Context) -> None:
        """Write the progress if it has changed; send nothing more to the vehicle if another process has the flight."""
        if self._worker.leases.kept(self._entry.keeper) is None:
            raise FencedError(f"the lease of {self._entry.keeper} is lost")
        self._recall.due = self.fetches in self._worker.cancelled and STAY in offered(ctx)
        late_s = self._late_s(ctx)
        last = self._last
        state = "preparing" if ctx.state in NOT_TOLD else str(ctx.state)
        news = state != last.state or abs(late_s - last.late_s) >= RECORD_LATE_S
        if not (news or ctx.now_s >= last.at_s + RECORD_EVERY_S):
            return
        place, soc = ctx.place, ctx.battery.soc
        progress = Progress(
            at_s=ctx.now_s, state=state, flights=ctx.delivery.flight, station=ctx.delivery.station,
            soc=soc if math.isfinite(soc) else None, late_s=late_s, since_s=ctx.now_s if state != last.state else last.since_s,
            lat=None if place is None else place[0], lon=None if place is None else place[1],
            wind=last_of(ctx.wind.measured),
        )  # fmt: skip
        self._last = self._record.progress = progress
        self._worker.winds.tell(self._record.system, ctx.wind.measured)
        self._entry = self._worker.change(self._entry, "flying", self._record)

    def _late_s(self, ctx: Context) -> float:
        """Delay against the plan, s: by the expected landing of the present flight, or by the due take-off."""
        flights = [one for one in self._record.steps if one.kind == "fly"]
        number = ctx.delivery.flight
        leg = ctx.delivery.leg
        if ctx.state in IN_AIR and leg is not None and 1 <= number <= len(flights):
            left_s = None if leg.lookahead is None else leg.lookahead.left_s
            lands_s = leg.start_s + leg.planned_s if left_s is None else ctx.now_s + float(left_s)
            return max(lands_s - flights[number - 1].end_s, 0.0)
        if number < len(flights):
            charged_s = -math.inf if self._pads is None else self._pads.charged_s
            return max(max(ctx.now_s, charged_s) - flights[number].begin_s, 0.0)
        return max(ctx.now_s - flights[-1].end_s, 0.0)

    def _end(self, world: LockstepClient, ctx: Context, outcome: Outcome) -> None:
        record = self._record
        loaded = record.phase == WITH_PACKAGE
        arrived = outcome.state == State.DELIVERED if not loaded else outcome.delivered
        sure = not loaded or outcome.proof in ("", "delivered")
        soc = ctx.battery.soc
        record.end = End(
            at_s=world.posix_s(), state=outcome.state, reason=outcome.reason, station=outcome.station,
            soc=soc if math.isfinite(soc) else None, arrived=arrived, sure=sure, aboard=loaded and not arrived,
        )  # fmt: skip
        self._entry = self._worker.change(self._entry, "ended", record)

    def _give_up(self, world: LockstepClient, why: str) -> None:
        """End a flight that cannot be supervised: a person must inspect it."""
        record = self._record
        record.end = End(
            at_s=world.posix_s(), state="not supervised", reason=why, station=None, soc=None, arrived=False,
            aboard=record.phase == WITH_PACKAGE,
        )  # fmt: skip
        try:
            self._entry = self._worker.change(self._entry, "ended", record)
        except (FencedError, VersionError, InputError):
            return
