"""A delivery under way: its parts, each written only by its owner, and the passing of time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from skyway.link.supervisor.departure.failsafes import Failsafes
from skyway.link.supervisor.departure.parameter_changes import ParameterChanges
from skyway.link.supervisor.flight.divert import Divert
from skyway.link.supervisor.flight.lean import LeanWatch, watch_lean
from skyway.link.supervisor.flight.pilot_intervention import follows_a_landing, must_be_alone, refuse_on_ground
from skyway.link.supervisor.flight.track import Track
from skyway.link.supervisor.journal.entries import Changed, PlanTaken, Rebooted
from skyway.link.supervisor.journal.standing import standing
from skyway.link.supervisor.observed.clients import tell_clients, tell_radios, tell_traffic
from skyway.link.supervisor.observed.link_watch import LinkWatch, must_be_in_contact, request_telemetry
from skyway.link.supervisor.observed.vehicle_state import VehicleState
from skyway.link.supervisor.observed.vehicle_texts import TextLog, tell_texts
from skyway.link.supervisor.proof.proof import Proof
from skyway.link.supervisor.soc.modelled_use import count_use
from skyway.link.supervisor.soc.soc_estimator import SocEstimator
from skyway.link.supervisor.states import ON_GROUND, TABLE, State, Status, Turn
from skyway.models.base.formatting import duration
from skyway.models.composition.file import to_json
from skyway.planner.online.policy import OnlinePolicy

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.link.supervisor.conversation import Conversation
    from skyway.link.supervisor.flight.give_way import GiveWay
    from skyway.link.supervisor.job import DeliveryJob
    from skyway.link.supervisor.journal.entry import Entry
    from skyway.link.supervisor.journal.file import Journal, Record
    from skyway.link.supervisor.observed.remote_id_watch import RemoteIdWatch
    from skyway.link.supervisor.operators import Operator
    from skyway.link.supervisor.progress import DeliveryProgress
    from skyway.link.supervisor.soc.energy_learning import EnergyLearning
    from skyway.link.supervisor.wind_book import WindBook
    from skyway.link.supervisor.work.progress import WorkProgress
    from skyway.link.telemetry.vehicle_monitor import Change
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.base.clock import Clock
    from skyway.models.queues.pad_service import PadService
    from skyway.planner.problem.request import Request

After = tuple[State, str]
"""The next state, and the reason for it."""
TICK_S, REST_TICK_S = 1.0, 3.0
"""Step of the supervisor, s: normally, and while the drone rests on a pad and no operator can give input."""


@dataclass(frozen=True, slots=True)
class Context:
    """A delivery under way: its inputs, and one owner for each part of its state.

    Only its own methods write a part; every state reads all parts (decision 0075).
    """

    vehicle: Vehicle
    clock: Clock
    journal: Journal
    pads: PadService
    operator: Operator
    job: DeliveryJob
    wind: WindBook
    status: Status
    delivery: DeliveryProgress
    energy: EnergyLearning
    conversation: Conversation
    on_tick: Callable[[Context], None] | None = None
    """Called after each step."""
    observed: VehicleState = field(default_factory=VehicleState)
    battery: SocEstimator = field(default_factory=SocEstimator)
    lean: LeanWatch = field(default_factory=LeanWatch)
    divert: Divert = field(default_factory=Divert)
    parameters: ParameterChanges = field(default_factory=ParameterChanges)
    failsafes: Failsafes = field(default_factory=Failsafes)
    texts: TextLog = field(default_factory=TextLog)
    link: LinkWatch = field(default_factory=LinkWatch)
    track: Track = field(default_factory=Track)
    proof: Proof = field(default_factory=Proof)

    def policy(self) -> OnlinePolicy:
        """Build the policy that decides on the ground and in the air, and computes reachable stations."""
        m = self.job
        return OnlinePolicy(m.scenario, self.request, m.parameters, drag=m.drag)

    @property
    def request(self) -> Request:
        """The current request: the delivery, or the flight that follows it from the target."""
        onward = self.delivery.onward
        return self.job.request if onward is None else onward.request(self.job.request)

    @property
    def work(self) -> WorkProgress:
        """Progress of the work, if the drone flies a mission."""
        return self.delivery.work

    def delivers_at(self, station: str | None) -> bool:
        """Whether the package is to be delivered at a station."""
        return self.job.delivers and self.delivery.onward is None and station == self.job.request.destination

    # Values of the parts that many states read

    @property
    def state(self) -> State:
        """The state of the delivery."""
        return self.status.state

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle is known to stand disarmed on the ground."""
        return self.observed.on_ground

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, or is armed and not known to be on the ground."""
        return self.observed.in_air

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude of the vehicle; None if unknown."""
        return self.observed.place

    @property
    def give_way(self) -> GiveWay:
        """Giving way to other aircraft."""
        return self.divert.give_way

    @property
    def remote_id(self) -> RemoteIdWatch:
        """Identity of the operator, as broadcast."""
        return self.observed.remote_id

    @property
    def stands_in_air(self) -> bool:
        """Whether the vehicle holds its position in the air, on a person's order or for another aircraft."""
        return self.conversation.paused or self.give_way.holds

    def here_station(self) -> str | None:
        """Known station at the vehicle's position, or None."""
        return self.delivery.station_at(self.place, self.job.scenario)

    # Time

    @property
    def now_s(self) -> float:
        """Current time, POSIX seconds."""
        return self.clock.posix_s()

    def tick(self, duration_s: float = TICK_S) -> list[Change]:
        """Let time pass, process messages, and return what changed about the vehicle; a change ends the wait at once.

        An event that moves the delivery to another state is raised as a `Turn`.
        """
        for sample in self.vehicle.samples(duration_s, undisturbed=True):
            self.observed.hear(sample)
            self.battery.hear(self, sample)
            self.wind.hear(sample, math.nan if self.delivery.leg is None else self.delivery.leg.home_ground_m)
            watch_lean(self, sample)
            self.proof.hear(self, sample)
        changes = self.vehicle.changes()
        for change in changes:
            own = change.ours or follows_a_landing(self, change)
            said = str(replace(change, ours=own)) + ("" if own == change.ours else ": it has landed")
            self.note(Changed(what=change.what, before=change.before, after=change.after, ours=own), said)
        self._after_reboot()
        tell_texts(self)
        tell_clients(self)
        tell_radios(self)
        tell_traffic(self)
        self.remote_id.watch(self)
        self.link.radios.write(self)
        self.conversation.listen(self)
        count_use(self)
        self.track.write(self)
        if self.on_tick is not None:
            self.on_tick(self)
        must_be_in_contact(self)
        must_be_alone(self)
        if self.state in ON_GROUND:
            refuse_on_ground(self, changes)
        self._end_overdue()
        return changes

    def _after_reboot(self) -> None:
        """Request telemetry again from a vehicle that has restarted."""
        if self.observed.restarted(self.vehicle.reboots):
            self.battery.forget()
            self.link.restarted()
            self.note(
                Rebooted(), "the drone has restarted: it is identified, checked and uploaded again before it takes off"
            )
            request_telemetry(self)

    def _end_overdue(self) -> None:
        """End a state that exceeds its time limit; a vehicle in flight is never reported as stopped."""
        rule = TABLE[self.state]
        if rule.overdue is None or self.clock.now_s() - self.status.entered_s <= rule.longest_s:
            return
        flies = self.in_air and rule.overdue is State.STOPPED
        reason = f"the state {self.state} exceeded its limit of {duration(rule.longest_s)}"
        raise Turn(State.HOLDING if flies else rule.overdue, reason)

    def wait(self, duration_s: float) -> None:
        """Let some time pass."""
        end = self.clock.now_s() + duration_s
        while (left := end - self.clock.now_s()) > 1e-6:
            self.tick(min(left, TICK_S))

    def wait_until(self, posix_s: float) -> None:
        """Let time pass until an instant of the vehicle's clock."""
        tick_s = REST_TICK_S if self.link.resting and self.job.dispatched else TICK_S
        while self.now_s < posix_s:
            self.tick(min(max(posix_s - self.now_s, 0.05), tick_s))

    # Messages and journal

    def note(self, entry: Entry, reason: str | None = None) -> Record:
        """Write a journal entry."""
        return self.journal.write(self.state, entry, reason, flight=self.delivery.flight)

    def tell(self, line: str) -> None:
        """Send a message to the operator."""
        self.operator.tell(line)

    def say(self, entry: Entry, reason: str) -> None:
        """Write a journal entry, and show its sentence to the operator."""
        self.note(entry, reason)
        self.tell(reason)

    def note_plan(self, reason: str) -> None:
        """Write the plan in force, and all data needed for a resume."""
        plan = None if self.delivery.plan is None else to_json(self.delivery.plan)
        self.note(PlanTaken(plan=plan, standing=standing(self)), reason)
