"""What all states of a supervised delivery share: the vehicle, the clock, the journal, what is known, and the passing of time."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, TypeVar

from skyway.link.supervisor.departure.parameter_changes import ParameterChanges
from skyway.link.supervisor.flight.flies import flies
from skyway.link.supervisor.flight.lean import LeanWatch, watch_lean
from skyway.link.supervisor.flight.pilot_intervention import follows_a_landing, refuse_on_ground
from skyway.link.supervisor.flight.track import write_track
from skyway.link.supervisor.legs import station_at
from skyway.link.supervisor.soc.reported_soc import ReportedSoc
from skyway.link.supervisor.soc.soc_estimator import read_gauge
from skyway.link.supervisor.soc.voltage import VoltageWatch
from skyway.link.supervisor.states import IN_AIR, ON_GROUND, TABLE, State, Turn
from skyway.link.supervisor.vehicle_texts import NOTICE, SEVERITIES, TextLog
from skyway.models.base.errors import LinkError, VehicleTimeoutError
from skyway.models.composition.composition import Place
from skyway.models.composition.file import to_json
from skyway.planner.online.energy_belief import EnergyBelief
from skyway.planner.online.replan import GroundReplanner

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from skyway.link.supervisor.job import DeliveryJob
    from skyway.link.supervisor.journal import Journal, Record
    from skyway.link.supervisor.legs import Leg
    from skyway.link.supervisor.operators import Operator
    from skyway.link.supervisor.wind_book import WindBook
    from skyway.link.telemetry.vehicle_monitor import Change
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.models.base.clock import Clock
    from skyway.models.composition.composition import Composition
    from skyway.models.drones.telemetry import TelemetrySample
    from skyway.models.queues.pad_service import PadService

After = tuple[State, str]
"""The next state, and why."""
T = TypeVar("T")
TICK_S = 1.0
SILENT_S = 5.0
"""Not heard for so long, the link is lost."""
ASK_AGAIN_S, ASK_FOR_S = 2.0, 900.0
"""A question without an answer is asked again after so long, for so long."""
AT_STATION_M = 60.0
PLACE_FRESH_S = 10.0
"""A position told so long ago still counts: over bad radios many are lost."""
FLYING_RATES: Mapping[int, float] = {30: 10.0, 33: 5.0, 74: 1.0, 1: 1.0, 245: 2.0, 42: 1.0, 2: 1.0, 168: 1.0}
GROUND_RATES: Mapping[int, float] = {30: 1.0, 33: 2.0, 74: 0.5, 1: 1.0, 245: 1.0, 42: 1.0, 2: 1.0, 168: 0.2, 24: 0.5}
"""Messages a second on the ground, where nothing moves for hours."""


@dataclass(slots=True)
class Context:
    """A delivery under way.

    Attributes
    ----------
    plan : Composition or None
        From where the vehicle stands, or from the leg under way, on.
    station : str or None
        Where it stands; None in the air and away from stations.
    flight : int
        Flights begun.
    visited : set of str
        Stations landed at.
    charge_to : float or None
        Charge to leave with.
    seen_at : (lat, lon, POSIX seconds)
        Position told last.
    soc, told_soc : float
        State of charge: believed, and as the vehicle says, as far as that can be.
    told : ToldCharge
        What is believed of its reports.
    gauge : float
        Charge really used, for what the vehicle says it used: learnt at pads, which measure.
    voltage : VoltageWatch
        Notices charge that is lost without being counted.
    flown_from : (float, float)
        Charge at the first take-off after charging: as the vehicle said, and believed.
    lean : LeanWatch
        Notices that it leans as far as it may and is slower than commanded.
    lost_s : float
        When charge was last lost at once, POSIX seconds.
    entered_s : float
        When the present state began.
    before : State
        The state before a lost link or a hold.
    divert_to : str or None
        Station of a divert under way; None lands here.
    turned : bool
        The vehicle holds the mission of that divert.
    landed_at : str or None
        Where the last flight ended, once that is written down.
    resumed : bool
        The delivery is one that was begun by an earlier run of the program.
    stop_after_leg : bool
        The operator wants it to stay at the next landing.
    parameters : ParameterChanges
        Parameters changed on the vehicle, and those about to be.
    texts : TextLog
        What the vehicle says in words.
    question : str or None
        What the operator has been asked and has not answered.
    """

    vehicle: Vehicle
    clock: Clock
    journal: Journal
    pads: PadService
    operator: Operator
    job: DeliveryJob
    wind: WindBook
    on_tick: Callable[[Context], None] | None = None
    state: State = State.CONNECTING
    before: State = State.CONNECTING
    entered_s: float = 0.0
    plan: Composition | None = None
    leg: Leg | None = None
    station: str | None = None
    flight: int = 0
    visited: set[str] = field(default_factory=set)
    diverts: tuple[str, ...] = ()
    unusable: dict[str, float] = field(default_factory=dict)
    charge_to: float | None = None
    charged: bool = False
    belief: EnergyBelief = field(default_factory=EnergyBelief)
    failsafes: dict[str, float] = field(default_factory=dict)
    sample: TelemetrySample | None = None
    seen_at: tuple[float, float, float] = (math.nan, math.nan, -math.inf)
    soc: float = math.nan
    told_soc: float = math.nan
    gauge: float = 1.0
    told: ReportedSoc = field(default_factory=ReportedSoc)
    gauged_s: float = -math.inf
    voltage: VoltageWatch = field(default_factory=VoltageWatch)
    flown_from: tuple[float, float] = (math.nan, math.nan)
    lost_s: float = -math.inf
    lean: LeanWatch = field(default_factory=LeanWatch)
    soc_source: str = "unknown"
    uid: int = 0
    asked_once: bool = False
    stop_after_leg: bool = False
    parameters: ParameterChanges = field(default_factory=ParameterChanges)
    texts: TextLog = field(default_factory=TextLog)
    question: str | None = None
    divert_to: str | None = None
    turned: bool = False
    landed_at: str | None = None
    resumed: bool = False
    unanswered_said: str = ""
    outlook: dict[str, Any] = field(default_factory=dict)
    reboots: int = 0
    interrupts: int = 0
    words: list[str] = field(default_factory=list)
    tracked_s: float = -math.inf
    samples: int = 0

    def replanner(self) -> GroundReplanner:
        """Make what decides at a landing, and what tells what can be reached."""
        m = self.job
        return GroundReplanner(m.scenario, m.request, m.planner, m.replanning, drag=m.drag)

    # Time

    @property
    def now_s(self) -> float:
        """POSIX seconds."""
        return self.clock.posix_s()

    def tick(self, duration_s: float = TICK_S) -> list[Change]:
        """Let time pass, listening; whatever takes the delivery to another state is raised as a `Turn`.

        Returns
        -------
        list of Change
            What became different about the vehicle.
        """
        for sample in self.vehicle.samples(duration_s):
            self.samples += 1
            self.sample = sample
            if math.isfinite(sample.lat_deg) and math.isfinite(sample.lon_deg):
                self.seen_at = (sample.lat_deg, sample.lon_deg, sample.time_s)
            read_gauge(self, sample)
            self.wind.hear(sample)
            watch_lean(self, sample)
        changes = self.vehicle.changes()
        for change in changes:
            own = change.ours or follows_a_landing(self, change)
            said = str(replace(change, ours=own)) + ("" if own == change.ours else ": it has landed")
            self.note("change", said, what=change.what, before=change.before, after=change.after, ours=own)
        self._after_reboot()
        self._hear_texts()
        self._listen()
        self._count_use()
        write_track(self)
        if self.on_tick is not None:
            self.on_tick(self)
        if self.state is not State.LOST_LINK and self.vehicle.silent_s > SILENT_S:
            raise Turn(State.LOST_LINK, f"nothing was heard of the vehicle for {self.vehicle.silent_s:.0f} s")
        if self.state in ON_GROUND:
            refuse_on_ground(self, changes)
        self._end_overdue()
        return changes

    def _end_overdue(self) -> None:
        """End a state that lasts too long; a vehicle that flies is never said to have stopped."""
        rule = TABLE[self.state]
        if rule.overdue is None or self.clock.now_s() - self.entered_s <= rule.longest_s:
            return
        flies = self.in_air and rule.overdue is State.STOPPED
        reason = f"{self.state} has lasted longer than {rule.longest_s / 60:.0f} min"
        raise Turn(State.HOLDING if flies else rule.overdue, reason)

    def _count_use(self) -> None:
        """Count what the flight should have taken by the model, at the airspeed that wind and ground speed give."""
        s, use = self.sample, None if self.leg is None else self.leg.modelled
        if use is None or s is None or not self.in_air:
            return
        estimate = self.wind.estimate
        wind = self.wind.expected(s.time_s, s.lat_deg, s.lon_deg)
        if estimate is not None:
            wind = estimate.north_mps, estimate.east_mps
        use.hear(self.now_s, (s.vel_north_mps, s.vel_east_mps), wind)

    def wait(self, duration_s: float) -> None:
        """Let some time pass."""
        end = self.clock.now_s() + duration_s
        while (left := end - self.clock.now_s()) > 1e-6:
            self.tick(min(left, TICK_S))

    def wait_until(self, posix_s: float) -> None:
        """Let time pass until an instant of the vehicle's time."""
        while self.now_s < posix_s:
            self.tick(min(max(posix_s - self.now_s, 0.05), TICK_S))

    def _after_reboot(self) -> None:
        """A vehicle that has restarted is asked for its telemetry anew."""
        if self.vehicle.reboots == self.reboots:
            return
        self.reboots = self.vehicle.reboots
        self.voltage.forget()
        self.told.forget()
        self.note("reboot", "the vehicle has restarted: identified, checked and uploaded anew before it flies again")
        self.request_telemetry()

    def _hear_texts(self) -> None:
        """Tell what the vehicle says: a refusal that is repeated 200 times is one line, with its count."""
        for said in self.texts.hear(self.vehicle.new_texts(), self.clock.now_s()):
            word = SEVERITIES[min(max(said.severity, 0), len(SEVERITIES) - 1)]
            self.note("text", str(said), text=said.text, severity=word, count=said.count)
            if said.severity <= NOTICE:
                self.tell(f"the vehicle says: {said}")

    def request_telemetry(self) -> None:
        """Ask for the messages of the state we are in."""
        try:
            self.vehicle.request_telemetry(FLYING_RATES if self.state in IN_AIR or self.in_air else GROUND_RATES)
        except LinkError as error:
            self.note("link", f"telemetry could not be asked for: {error}")

    def _listen(self) -> None:
        """Take what the operator says at any time."""
        word = self.operator.heard()
        if word:
            self.words.append(word.strip().lower())
        if self.operator.interrupts > self.interrupts:
            first = not self.stop_after_leg
            self.interrupts = self.operator.interrupts
            if first and self.on_ground and self.state in (State.CONNECTING, *ON_GROUND):
                self.note("operator", "Ctrl-C on the ground")
                raise Turn(State.STOPPED, f"Ctrl-C: the vehicle stays at {self.heading_for}, disarmed")
            if first:
                self.stop_after_leg = True
                self.note("operator", "Ctrl-C: the vehicle stays at the next landing")
                self.operator.ask(
                    f"Ctrl-C: the vehicle stays at {self.heading_for}; Ctrl-C again leaves it now, then {self.left_words}. "
                    "Type go to go on after all."
                )
            else:
                raise Turn(State.LEFT, f"Ctrl-C twice: left to itself; {self.left_words}")
        if self.stop_after_leg and self.words and self.words[-1] == "go":
            self.words.pop()
            self.stop_after_leg = False
            self.note("operator", "go: the delivery goes on")

    @property
    def attended(self) -> bool:
        """Whether an answer may come: somebody is there, or has said something that is not yet taken."""
        return self.operator.present or bool(self.words)

    def answer(self, question: str, words: tuple[str, ...]) -> str:
        """Let time pass until the operator says one of some words.

        Raises
        ------
        Turn
            Nobody is there any more who could say one.
        """
        self.note("operator", f"asked: {question}", question=question, answers=list(words))
        self.operator.ask(question)
        self.question = question
        try:
            while True:
                while self.words:
                    word = self.words.pop(0)
                    if word in words:
                        return word
                    self.operator.ask(f"please answer {', '.join(words)}")
                if not self.attended:
                    raise Turn(State.STOPPED, f"nobody is there any more to answer: {question}")
                self.tick()
        finally:
            self.question = None

    @property
    def heading_for(self) -> str:
        """Where it will stand next, for a person."""
        if self.leg is not None and self.in_air:
            return self.leg.destination
        return self.station or "this place"

    @property
    def left_words(self) -> str:
        """What the vehicle does when it is left."""
        from skyway.link.supervisor.departure.failsafes import when_left

        if self.on_ground:
            return "it stands disarmed on the ground"
        if self.vehicle.mode != "mission":
            return f"it is in mode {self.vehicle.mode} and stays in it until its battery failsafe, or a pilot, ends it"
        return when_left(self.vehicle.family.name, self.failsafes)

    # Asking

    def ask(self, question: Callable[[], T]) -> T:
        """Put a question to a vehicle that has time, and put it again until it is answered.

        Raises
        ------
        Turn
            To the lost link, where nothing is answered any more.
        VehicleTimeoutError
            All else is answered, and this has not been for `ASK_FOR_S`.
        """
        end = self.clock.now_s() + ASK_FOR_S
        while True:
            try:
                return question()
            except VehicleTimeoutError as error:
                self.unanswered(error)
                if self.clock.now_s() >= end:
                    raise
                self.wait(ASK_AGAIN_S)

    def unanswered(self, what: VehicleTimeoutError | str) -> None:
        """Say what was not answered, or is not told; the link counts as lost where nothing else is answered either.

        Raises
        ------
        Turn
            To the lost link.
        """
        self.must_answer(str(what))
        if str(what) != self.unanswered_said:
            self.unanswered_said = str(what)
            self.say("link", f"{what}: asked again")

    def must_answer(self, reason: str) -> None:
        """Go on where the vehicle answers at all.

        Raises
        ------
        Turn
            To the lost link, with this reason.
        """
        if not self.vehicle.answers():
            raise Turn(State.LOST_LINK, reason)

    # Where

    @property
    def on_ground(self) -> bool:
        """Whether it is known to stand disarmed on the ground."""
        s = self.sample
        return s is not None and s.armed == 0.0 and not flies(s)

    @property
    def in_air(self) -> bool:
        """Whether it flies, or is armed and not known to be on the ground."""
        s = self.sample
        known = None if s is None else flies(s)
        return s is not None and (s.armed == 1.0 if known is None else known)

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude; None where they are not known."""
        lat, lon, time_s = self.seen_at
        if self.sample is None or self.sample.time_s > time_s + PLACE_FRESH_S:
            return None
        return lat, lon

    def here_station(self) -> str | None:
        """Station at which it is, of all that are known."""
        place = self.place
        if place is None:
            return None
        network = self.job.scenario.network
        known = {s.id: Place(s.lat, s.lon, s.elevation_m, s.name, s.pads) for s in network.stations}
        if self.plan is not None:
            known |= dict(self.plan.stations)
        return station_at(known, *place, AT_STATION_M)

    # Saying

    def note(self, event: str, reason: str | None = None, **data: Any) -> Record:
        """Write into the journal."""
        return self.journal.write(self.state, event, reason, flight=self.flight, data=data)

    def tell(self, line: str) -> None:
        """Say something to the operator."""
        self.operator.tell(line)

    def say(self, event: str, reason: str, **data: Any) -> None:
        """Write into the journal, and say it to the operator."""
        self.note(event, reason, **data)
        self.tell(reason)

    def note_plan(self, reason: str) -> None:
        """Write the plan in force, and all that a resume needs."""
        plan = None if self.plan is None else to_json(self.plan)
        self.note("plan", reason, plan=plan, **self.standing())

    def standing(self) -> dict[str, Any]:
        """What a resume needs besides the plan."""
        return {
            "station": self.station,
            "visited": sorted(self.visited),
            "belief": asdict(self.belief),
            "diverts": list(self.diverts),
            "charge_to": self.charge_to,
            "asked_once": self.asked_once,
            "gauge": self.gauge,
            "lost_soc": self.voltage.lost,
            "observations": self.wind.as_data(),
        }
