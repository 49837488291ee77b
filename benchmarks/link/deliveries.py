"""Supervised deliveries in virtual time: a simulated world, its pads, and our supervisor on one thread."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from functools import cache
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from skyway.calibration_flight import drag_of
from skyway.link.protocol.connection import GROUND_SYSTEM, Connection
from skyway.link.supervisor import DeliveryJob, Journal, NobodyThere, Supervisor
from skyway.link.supervisor.job import nobody_observes
from skyway.link.supervisor.operators import Said
from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.signing import Signing
from skyway.missions.builder.mission_options import MissionOptions
from skyway.missions.examples import NEW_YORK
from skyway.models.composition.composition import State
from skyway.models.scenario.file import read_scenario
from skyway.models.wind.estimation.field import WindObservation
from skyway.planner.plan import plan
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.wind_truth import RecordedWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from collections.abc import Callable
    from datetime import date
    from pathlib import Path

    from skyway.link.forwarding.forwarder import Forwarder
    from skyway.link.supervisor import Operator, Outcome
    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.sim_stub.faults import Fault
    from skyway.sim_stub.transports.channel import Impairment

PLANNER = "pfs-charge-aware"
LOCAL = ZoneInfo("America/New_York")
OBSERVED_S, OUT_S = 51 * 60.0, 56 * 60.0
"""After the beginning of the hour an airport's wind is observed, and its report is out."""
EARLIER_S = 2 * 3600.0
"""So long before the departure reports begin."""
TARGET_GROUND_M = 10.0
REPORT_SD_MPS = 1.2
"""Error that a report is taken to have, as by `skyway fly --observed`."""


@cache
def newyork() -> Scenario:
    return replace(read_scenario(NEW_YORK), path="builtin:newyork")


@dataclass
class Story:
    """One delivery to be told: what, when, in which wind, with which faults."""

    autopilot: str = "px4"
    start: str = "bellevue"
    to: str = "jacobi"
    depart: str = "2013-07-10T14:00-04:00"
    payload_kg: float = 0.8
    seed: int = 1
    drone: str = "m200"
    soc: float = 1.0
    standing_soc: float | None = None
    """What the battery really has when it begins, where it stood for a while since it was planned."""
    faults: tuple[Fault, ...] = ()
    impairment: Impairment | None = None
    traffic: bool = True
    supervised: bool = True
    dispatched: bool = False
    """A dispatcher planned it: its plan is kept to."""
    planner: str = PLANNER
    still: bool = False
    truth: str | None = None
    reports: bool = False
    """The airports' reports are handed over, hour by hour."""
    vehicle: dict[str, Any] = field(default_factory=dict)
    target: tuple[float, float] | None = None
    """Place without pads to deliver to, instead of a station."""
    held_out: bool = False
    """The day of the true wind is left out of the record that it is planned with."""
    weather: tuple[Path, ...] = ()
    """Forecasts that it is planned with, as ``skyway fly --forecast``."""
    asked: dict[str, Any] = field(default_factory=dict)
    """What else is asked of the plan, see `Request`."""

    def scenario(self) -> Scenario:
        if self.target is None:
            return newyork()
        joined = newyork().with_target(*self.target)
        *others, target = joined.network.stations
        stations = (*others, replace(target, elevation_m=TARGET_GROUND_M))
        return replace(joined, network=replace(joined.network, stations=stations))

    def instant(self) -> datetime:
        return datetime.fromisoformat(self.depart)

    def day(self) -> date:
        """The day of the record whose wind blows."""
        return (datetime.fromisoformat(self.truth) if self.truth else self.instant()).astimezone(LOCAL).date()

    def plan(self) -> tuple[Request, WindEnsemble, Composition]:
        scenario, depart = self.scenario(), self.instant()
        request = Request(
            state=State(depart, self.start, None, self.soc),
            destination=self.to if self.target is None else scenario.network.stations[-1].id,
            payload_kg=self.payload_kg,
            drone=self.drone,
            seed=self.seed,
            **self.asked,
        )
        left_out = self.day() if self.held_out else None
        if self.weather:
            forecast = scenario.forecast_from(self.weather, depart, HORIZON_H, truth=left_out)
        else:
            forecast = scenario.forecast(depart, HORIZON_H, truth=left_out)
        return request, forecast, plan(scenario, request, planner=self.planner, forecast=forecast).composition


@dataclass(slots=True)
class Scripted:
    """An operator of tests: answers by a function of the question and of how often it was asked.

    Attributes
    ----------
    answers : callable
        (question, time asked) to (delay in seconds, answer), or None for silence.
    now_s : callable
        The time.
    """

    answers: Callable[[str, int], tuple[float, str] | None]
    now_s: Callable[[], float]
    lines: list[str] = field(default_factory=list)
    interrupts: int = 0
    present: bool = True
    _asked: dict[str, int] = field(default_factory=dict)
    _due: deque[tuple[float, str]] = field(default_factory=deque)

    def tell(self, line: str) -> None:
        """Keep it."""
        self.lines.append(line)

    def ask(self, question: str) -> None:
        """Work out an answer."""
        self.lines.append(question)
        number = self._asked[question] = self._asked.get(question, 0) + 1
        answer = self.answers(question, number)
        if answer is not None:
            self._due.append((self.now_s() + answer[0], answer[1]))

    def next_input(self) -> Said | None:
        """Say what is due."""
        if self._due and self._due[0][0] <= self.now_s():
            return Said(self._due.popleft()[1])
        return None


class Stage:
    """The world of a story, and a supervisor that may be killed and begun again."""

    def __init__(self, story: Story, folder: Path, operator: Operator | None = None) -> None:
        self.story = story
        scenario, depart = story.scenario(), story.instant()
        self.scenario = scenario
        self.request, self.forecast, self.composition = story.plan()
        day = story.day()
        self.told = scenario.truth(day, depart - timedelta(seconds=EARLIER_S), HORIZON_H)
        wind = None if story.still else RecordedWind(scenario.truth(day, depart, HORIZON_H))
        self.world = World(
            epoch_s=depart.timestamp(), wind=wind, stations=scenario.network.stations, faults=story.faults
        )
        place = scenario.network.stations[scenario.network.index[story.start]]
        drone = scenario.drone(story.drone)
        self.craft = self.world.add(
            VehicleConfig(
                lat=place.lat,
                lon=place.lon,
                ground_m=place.elevation_m or 0.0,
                autopilot=story.autopilot,
                soc=story.soc if story.standing_soc is None else story.standing_soc,
                payload_kg=story.payload_kg,
                seed=story.seed,
                warm=True,
                airframe=Airframe(drone=drone),
                **story.vehicle,
            )
        )
        self.pads = Pads(self.world, scenario.load if story.traffic else None, seed=story.seed)
        self.lockstep = Lockstep(self.world)
        self.journal_path = folder / f"flight-{story.autopilot}-{story.seed}.jsonl"
        self.operator = operator or NobodyThere()
        self.supervisor: Supervisor | None = None
        self.forwarder: Forwarder | None = None
        self.system = GROUND_SYSTEM

    def reports(self, time_s: float) -> tuple[WindObservation, ...]:
        """Of each airport the newest report that is out: observed at minute 51 of its hour, out five minutes later."""
        truth = self.told
        hour = int((time_s - OUT_S - truth.start_s) // truth.slot_s)
        at_s = truth.start_s + hour * truth.slot_s + OBSERVED_S
        if not 0 <= hour < truth.north.shape[1]:
            return ()
        return tuple(
            WindObservation(at_s, float(lat), float(lon), float(north), float(east), REPORT_SD_MPS**2, truth.height_m)
            for lat, lon, north, east in zip(
                truth.site_lat, truth.site_lon, truth.north[0, hour], truth.east[0, hour], strict=True
            )
        )

    def job(self) -> DeliveryJob:
        return DeliveryJob(
            composition=self.composition,
            scenario=self.scenario,
            request=self.request,
            forecast=self.forecast,
            observed=self.reports if self.story.reports else nobody_observes,
            drag=drag_of(newyork().drone(self.story.drone), self.story.payload_kg),
            options=MissionOptions(release=self.request.release),
            replanning=self.story.supervised,
            dispatched=self.story.dispatched,
            asking="once" if self.operator.present else "never",
        )

    def board(self, *, resume: bool = False, on_tick: Callable[[Any], None] | None = None) -> Supervisor:
        """Connect, and put a supervisor in charge."""
        link = self.lockstep.connect(self.craft, self.story.impairment, seed=self.story.seed)
        key = self.story.vehicle.get("signing_key")
        signing = None if key is None else Signing(key)
        connection = Connection(
            link, self.lockstep.clock, signing=signing, forwarder=self.forwarder, system=self.system
        )
        vehicle = Vehicle(connection)
        journal = Journal(self.journal_path, self.lockstep.clock.posix_s, resume=resume)
        supervisor = self.supervisor = Supervisor(
            self.job(), vehicle, self.lockstep.clock, self.pads, self.operator, journal,
            resume=resume, on_tick=on_tick,
        )  # fmt: skip
        return supervisor

    def fly(self, **how: Any) -> Outcome:
        """Take the delivery to its end."""
        supervisor = self.board(**how)
        try:
            return supervisor.run()
        finally:
            supervisor.context.journal.close()
