"""The supervisor: one delivery, led from state to state by the table, until it ends."""

from __future__ import annotations

import contextlib
from dataclasses import asdict
from typing import TYPE_CHECKING
from zoneinfo import ZoneInfo

from skyway.link.supervisor import connect, holding, lost_link
from skyway.link.supervisor import resume as resuming
from skyway.link.supervisor.context import Context
from skyway.link.supervisor.conversation import Conversation
from skyway.link.supervisor.departure import charging, departure, ground
from skyway.link.supervisor.departure.parameter_changes import restore_at_end
from skyway.link.supervisor.flight import air, landing
from skyway.link.supervisor.job import Outcome
from skyway.link.supervisor.journal.entries import Ended, Resumed, Start, StateEntered
from skyway.link.supervisor.journal.file import SCHEMA, read_journal
from skyway.link.supervisor.journal.parts import Forecast
from skyway.link.supervisor.progress import DeliveryProgress
from skyway.link.supervisor.proof.evidence import Verdict
from skyway.link.supervisor.proof.proof import Proof
from skyway.link.supervisor.soc.energy_learning import EnergyLearning
from skyway.link.supervisor.states import ENDS, IN_AIR, State, Status, Turn
from skyway.link.supervisor.wind_book import WindBook
from skyway.link.supervisor.work import ground as work_ground
from skyway.models.base.errors import LinkError, StationConflictError
from skyway.models.base.formatting import duration
from skyway.models.composition.file import to_json
from skyway.models.wind.estimation.field import ResidualModel

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.link.supervisor.context import After
    from skyway.link.supervisor.job import DeliveryJob
    from skyway.link.supervisor.journal.file import Journal
    from skyway.link.supervisor.operators import Operator
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.base.clock import Clock
    from skyway.models.queues.pad_service import PadService

CLOCK_SLACK_S = 60.0
"""Clocks of a vehicle may differ by this before and after a resume."""
STEPS: Mapping[State, Callable[[Context], After]] = {
    State.CONNECTING: connect.connecting,
    State.REPLANNING: ground.replanning,
    State.WAITING: charging.waiting,
    State.CHARGING: charging.charging,
    State.PREFLIGHT: departure.preflight,
    State.UPLOADING: departure.uploading,
    State.READY: departure.ready,
    State.ARMING: departure.arming,
    State.FLYING: air.flying,
    State.DIVERTING: air.diverting,
    State.LANDED: landing.after_landing,
    State.LOST_LINK: lost_link.lost_link,
    State.HOLDING: holding.holding,
}
"""Action of each state that is not an end."""


WORK_STEPS = {**STEPS, State.REPLANNING: work_ground.deciding}
"""The same for work that is flown battery by battery."""


class Supervisor:
    """Leads one delivery to its end; with `resume` the unfinished one of the journal."""

    def __init__(
        self,
        job: DeliveryJob,
        vehicle: Vehicle,
        clock: Clock,
        pads: PadService,
        operator: Operator,
        journal: Journal,
        *,
        resume: bool = False,
        on_tick: Callable[[Context], None] | None = None,
    ) -> None:
        rules = job.scenario.rules
        wind = WindBook(
            job.forecast, rules, drag=job.drag,
            ground_m=lambda lat, lon: float(job.scenario.network.ground_at_m(lat, lon)[0]),
            residual=ResidualModel(tau_s=job.parameters.online.residual_tau_s),
            least_members=job.parameters.online.least_members,
            field=job.scenario.field_error,
            at_stations=job.observed,
        )  # fmt: skip
        belief = job.scenario.drone(job.request.drone or "").energy_belief
        self.context = Context(
            vehicle, clock, journal, pads, operator, job, wind, Status(clock.now_s()), DeliveryProgress(resumed=resume),
            EnergyLearning(belief if job.drag is None else belief.counting_airspeed()), Conversation(operator), on_tick=on_tick,
            proof=Proof(zone=ZoneInfo(job.scenario.timezone)),
        )  # fmt: skip
        vehicle.traffic.take_limits(job.traffic.limits)
        if resume:
            records = read_journal(journal.path).records
            resuming.restore(self.context, records)
            self.context.note(Resumed(last=records[-1].n), f"the journal ends in the state {records[-1].state}")
            self._tell_earlier_clock(records[-1].time_s)
        else:
            self.context.note(self._start(job), f"{'delivery' if job.work is None else 'work'} {job.composition}")

    def _tell_earlier_clock(self, ended_s: float) -> None:
        """Say that the times of a resumed journal go back."""
        before_s = ended_s - self.context.now_s
        if before_s > CLOCK_SLACK_S:
            self.context.tell(
                f"the clock is {duration(before_s)} before the end of the journal, so its times go back, and durations in its report will be wrong: "
                "is it the same vehicle, or was a simulation started again?"
            )

    @staticmethod
    def _start(job: DeliveryJob) -> Start:
        """Record all that a report, or a resume, needs of the beginning."""
        forecast = job.forecast
        return Start(
            schema=SCHEMA,
            composition=to_json(job.composition),
            planner=job.composition.planner,
            supervised=job.replanning,
            replanning=asdict(job.parameters.online) if job.replanning else None,
            release=job.options.release,
            asking=job.asking,
            forecast=Forecast(members=len(forecast), labels=tuple(forecast.labels), height_m=forecast.height_m),
            destination=job.request.destination,
            reserve_soc=job.request.reserve_soc,
            payload_kg=job.request.payload_kg,
            hands_over=job.delivers,
        )

    def run(self) -> Outcome:
        """Run to the end. Raises an `InputError` if the journal or the recording can no longer be written."""
        ctx = self.context
        steps = STEPS if ctx.job.work is None else WORK_STEPS
        while ctx.state not in ENDS:
            try:
                after, reason = steps[ctx.state](ctx)
            except Turn as turn:
                after, reason = turn.state, turn.reason
            except LinkError as error:
                after, reason = self._failed(error)
            self._go(after, reason)
        restore_at_end(ctx)
        self._let_go()
        station, flights = ctx.delivery.station, ctx.delivery.flight
        ctx.note(Ended(outcome=str(ctx.state), station=station, flights=flights), self.reason)
        known = ctx.proof.evidence.tried or ctx.proof.lost
        verdict, why = ctx.proof.verdict if known else ("", "")
        onward = ctx.delivery.onward
        handed_over = onward is not None and onward.delivered and verdict is not Verdict.NOT_DELIVERED
        return Outcome(str(ctx.state), self.reason, station, flights, str(verdict), why, handed_over)

    def _let_go(self) -> None:
        """Return control, and no longer broadcast that we supervise the vehicle."""
        ctx = self.context
        ctx.vehicle.connection.supervise(None)
        ctx.remote_id.end()
        if ctx.on_ground:
            with contextlib.suppress(LinkError):
                ctx.vehicle.give_control_back()

    reason = ""

    def _go(self, after: State, reason: str) -> None:
        """Enter the next state, if the table allows it."""
        ctx = self.context
        before = ctx.state
        leg = ctx.delivery.leg
        if after is State.STOPPED and leg is not None and leg.origin == ctx.delivery.station:
            reason += (
                f"; the mission to {leg.destination} is still on board, and is flown if the drone is armed and started: "
                "skyway clear --kind all --yes removes it"
            )
        ctx.status.enter(after, ctx.clock.now_s())
        self.reason = reason
        ctx.note(StateEntered(before=str(before), after=str(after)), reason)
        if after in (State.HOLDING, State.LOST_LINK):  # an end is the last line of the command
            ctx.tell(f"{after}: {reason}")

    def _failed(self, error: LinkError) -> After:
        """Enter a named end state after a failure of the link."""
        ctx = self.context
        if isinstance(error, StationConflictError):
            return (State.HOLDING if ctx.in_air else State.STOPPED), str(error)
        if ctx.state is State.LOST_LINK:
            return State.LEFT, str(error)
        if ctx.state in IN_AIR or ctx.in_air:
            return State.LOST_LINK, str(error)
        return State.STOPPED, str(error)
