"""The demonstration: a whole delivery in a simulated New York, on a day that is not in the forecast."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import date, datetime, time
from typing import TYPE_CHECKING, Any
from zoneinfo import ZoneInfo

from skyway.missions.autopilots import NAMES
from skyway.models.base.files import make_folder
from skyway.models.base.formatting import distance_text, duration, zone_clock
from skyway.models.base.units import from_posix
from skyway.models.base.views import how_often

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from skyway.link.supervisor import Outcome
    from skyway.link.supervisor.context import Context
    from skyway.models.composition.composition import Composition
    from skyway.models.scenario.scenario import Scenario
    from skyway.models.wind.ensemble import WindEnsemble
    from skyway.planner.problem.request import Request
    from skyway.sim_stub.world import World

START, DESTINATION = "siuh-north", "white-plains"
DRONE, PAYLOAD_KG = "m200", 0.8
DAY, HOUR = date(2013, 7, 10), time(14, 0)
TRUTH_EVERY_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DemoOptions:
    """Options of the demonstration."""

    folder: Path
    """Where plan, journal, recording and report go."""
    day: date = DAY
    """Whose wind blows; the forecast is made of other days of the season."""
    seed: int = 1
    """Of gusts, other drones and errors."""
    autopilot: str = NAMES[0]
    """Name of its family (`missions.autopilots.NAMES`)."""
    planner: str = ""
    """Of the plan and of replanning; empty is the default one."""


def run_demo(options: DemoOptions, say: Callable[[str], None]) -> Outcome:
    """Plan, calibrate, fly and report, in virtual time on one thread. Raises an `InfeasibleError` where there is no plan."""
    from skyway.calibration_flight import drag_of
    from skyway.link.supervisor import DeliveryJob, Journal, NobodyThere, Supervisor
    from skyway.models.composition.file import save
    from skyway.planner.registry import ROBUST
    from skyway.sim_stub.pads import Pads

    planner = options.planner or ROBUST
    scenario, request, forecast, composition = _plan(options, planner)
    make_folder(options.folder, "--output")
    save(composition, options.folder / "plan.json", force=True)
    stops = [stop.station for stop in composition.stops if stop.recharge_s > 0.0]
    say(f"plan ({planner}): {' > '.join(composition.route)}")
    say(
        f"  {duration(composition.delivery_time_s)}, {distance_text(composition.distance_m)}, recharges at {', '.join(stops)}"
    )
    say(f"  forecast: {len(forecast)} days of the season; simulated wind: {options.day}, which is not one of them")
    drag = drag_of(scenario.drone(DRONE), PAYLOAD_KG)
    say("found the drag of the drone in a calibration flight: its tilt now measures the wind")
    lockstep, world = _world(options, scenario, composition)
    path = options.folder / "journal.jsonl"
    path.unlink(missing_ok=True)
    vehicle, close = _aboard(options, lockstep, world)
    journal = Journal(path, lockstep.clock.posix_s)
    job = DeliveryJob(
        composition=composition,
        scenario=scenario,
        request=request,
        forecast=forecast,
        drag=drag,
        asking="never",
    )
    zone = ZoneInfo(scenario.timezone)
    operator = NobodyThere(show=lambda line: say(f"{zone_clock(from_posix(lockstep.clock.posix_s()), zone)}  {line}"))
    pads = world.pads or Pads(world, scenario.load, seed=options.seed)
    supervisor = Supervisor(job, vehicle, lockstep.clock, pads, operator, journal, on_tick=_truth_writer(world))
    try:
        return supervisor.run()
    finally:
        journal.close()
        close()


def plan_demo(options: DemoOptions) -> Composition:
    """Return the plan that would be flown."""
    from skyway.planner.registry import ROBUST

    return _plan(options, options.planner or ROBUST)[3]


def _plan(options: DemoOptions, planner: str) -> tuple[Scenario, Request, WindEnsemble, Composition]:
    """Plan for a departure on that day; its own wind is never a member of the forecast."""
    from skyway.models.composition.composition import State
    from skyway.planner.plan import plan
    from skyway.planner.problem.problem import HORIZON_H
    from skyway.planner.problem.request import Request
    from skyway.scenarios import load_scenario

    scenario = load_scenario(None)
    depart = datetime.combine(options.day, HOUR, ZoneInfo(scenario.timezone))
    state = State(depart, START)
    request = Request(state=state, destination=DESTINATION, payload_kg=PAYLOAD_KG, drone=DRONE, seed=options.seed)
    forecast = scenario.forecast(depart, HORIZON_H)
    answer = plan(scenario, request, planner=planner, forecast=forecast)
    return scenario, request, forecast, answer.composition


def _world(options: DemoOptions, scenario: Scenario, composition: Composition) -> tuple[Any, World]:
    """Make the world: the wind of that day with gusts, other drones at the pads, one vehicle at the start."""
    from skyway.planner.problem.problem import HORIZON_H
    from skyway.sim_stub.fleet import FleetOptions, build_world
    from skyway.sim_stub.plant.wind_truth import RecordedWind
    from skyway.sim_stub.transports.lockstep import Lockstep

    stations = scenario.network.stations
    place = stations[scenario.network.index[START]]
    asked = FleetOptions(
        stations=stations,
        places=(place,),
        autopilot=options.autopilot,
        drone=scenario.drone(DRONE),
        payload_kg=PAYLOAD_KG,
        seed=options.seed,
        warm=True,
        epoch_s=composition.depart.timestamp(),
        wind=RecordedWind(scenario.truth(options.day, composition.depart, HORIZON_H)),
        load=scenario.load,
    )
    world = build_world(asked)
    return Lockstep(world), world


def _aboard(options: DemoOptions, lockstep: Any, world: World) -> tuple[Any, Callable[[], None]]:
    """Connect to the vehicle, recording everything; returns it and what closes the connection."""
    from skyway.link.protocol.connection import Connection
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.link.wire.recorder import Recorder

    recorder = Recorder(options.folder, lockstep.clock, name="demo")
    craft = next(iter(world.vehicles.values()))
    connection = Connection(lockstep.connect(craft, seed=options.seed), lockstep.clock, recorder=recorder)
    return Vehicle(connection), connection.close


def _truth_writer(world: World) -> Callable[[Context], None]:
    """Write into the journal what truly blows at the vehicle, for the report; nothing else reads it."""
    from skyway.link.supervisor.journal.entries import Truth

    craft = next(iter(world.vehicles.values()))
    written = [float("-inf")]

    def write(ctx: Context) -> None:
        if ctx.in_air and ctx.now_s >= written[0] + TRUTH_EVERY_S:
            written[0] = ctx.now_s
            north, east = craft.true_wind
            ctx.note(Truth(wind_north_mps=north, wind_east_mps=east, soc=craft.battery.soc))

    return write


def tell_end(options: DemoOptions, outcome: Outcome) -> list[str]:
    """Return the last lines: how it ended, and where to look."""
    from skyway.link.supervisor import read_journal
    from skyway.report.report import write_report
    from skyway.scenarios import load_scenario

    scenario = load_scenario(None)
    zone = ZoneInfo(scenario.timezone)
    journal = options.folder / "journal.jsonl"
    records = read_journal(journal).records
    decided = [r for r in records if r.event == "decision"]
    turned = [r for r in decided if r.data.get("new_plan") or r.data.get("action") in ("station", "charge", "divert")]
    times = how_often(len(turned))
    lines = [f"replanned {times}, with measurements from the flight:"] if turned else []
    lines += [f"  {zone_clock(from_posix(r.time_s), zone)}  {r.data['action']}: {r.reason}" for r in turned]
    report = options.folder / "report.html"
    write_report(journal, report, scenario=scenario, force=True)
    seen = [str(report), str(options.folder / "plan.json"), str(journal)]
    word = "delivered" if outcome.delivered else outcome.state
    lines.append(f"{word}: {outcome.reason}")
    lines.append(f"see {', '.join(seen)}")
    return lines


def with_day(options: DemoOptions, text: str | None) -> DemoOptions:
    """Return the options with a day as typed."""
    from skyway.models.base.errors import InputError

    if text is None:
        return options
    try:
        return replace(options, day=date.fromisoformat(text))
    except ValueError:
        raise InputError("not a date", field="--day", value=text, remedy="a day of 2013: 2013-05-20") from None
