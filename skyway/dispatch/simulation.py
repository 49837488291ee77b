"""The simulated world of a service: its drones at the start, pads, other drones and wind, in a separate process."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from skyway import typed_values
from skyway.dispatch.records import ACTIVE, DroneRecord, ServiceRecord, read
from skyway.dispatch.region import Region
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.base.files import file_error, write_atomically
from skyway.models.base.units import from_posix
from skyway.models.ledger.desk import Desk
from skyway.models.ledger.opening import open_ledger
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.fleet import MAX_VEHICLES
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.wind_truth import ConstantWind, RecordedWind
from skyway.sim_stub.transports.shared_lockstep import SharedLockstep
from skyway.sim_stub.world import World

if TYPE_CHECKING:
    from skyway.sim_stub.plant.wind_truth import WindTruth

ADDRESS = "world.address"
"""File in the folder of the service with the address of the world."""
EVENTS = "world.log"
"""File there with what happens in the world; it marks the folder as that of a service."""
STEP_S = 0.1
"""Time step of each drone's physics, s: the interval at which a supervisor requests attitude."""


def claim_folder(folder: Path) -> None:
    """Take a folder for a new service; an `InputError` if it is another service's, whose flights have journals of the same names."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / EVENTS).open("x").close()
    except OSError as error:
        if (folder / EVENTS).exists():
            remedy = "name a new folder; a service is resumed with its own ledger and holder"
            problem = "has the journals of another service"
            raise InputError(problem, field="--folder", value=str(folder), remedy=remedy) from None
        raise file_error("made", folder, error) from error


def simulate(ledger: str, dispatcher: str) -> None:
    """Simulate the world of a service until it is ended; without its processes, until the service has ended, or none has come for long."""
    with open_ledger(ledger, create=False) as book:
        desk = Desk(book, dispatcher)
        found = desk.get("service", "service")
        if found is None:
            raise InputError(
                "the ledger has no service of this dispatcher",
                ledger,
                remedy="start one: skyway dispatch run --simulate",
            )
        service = read(found, ServiceRecord)
        drones = [read(one, DroneRecord) for one in desk.entries("drone")]
    folder = Path(service.folder)
    with (folder / EVENTS).open("a", encoding="utf-8") as log:
        world = build(service, drones, log=lambda line: print(line, file=log, flush=True))
        shared = SharedLockstep(world, over=lambda: _has_ended(ledger, dispatcher))
        host, port = shared.address
        write_atomically(folder / ADDRESS, f"{host}:{port}\n", force=True)
        shared.serve()


def _has_ended(ledger: str, dispatcher: str) -> bool:
    """Whether the service has ended, and all its flights."""
    try:
        with open_ledger(ledger, create=False) as book:
            desk = Desk(book, dispatcher)
            found, flies = desk.get("service", "service"), desk.count("flight", ACTIVE)
    except SkywayError:
        return False  # the database is unavailable: the service may go on
    return found is not None and found.state == "ended" and not flies


def build(service: ServiceRecord, drones: list[DroneRecord], *, log: object = None) -> World:
    """Build the world of a service."""
    if len(drones) > MAX_VEHICLES:
        raise InputError(
            "too many drones for one simulated world", field="fleet", value=len(drones), remedy=f"up to {MAX_VEHICLES}"
        )
    region = Region(service)
    scenario = region.base
    world = World(
        epoch_s=service.begin_s, wind=_wind(service, region), stations=scenario.network.stations,
        on_event=None if log is None else log,  # type: ignore[arg-type]
    )  # fmt: skip
    for one in drones:
        station = scenario.network.stations[scenario.network.index[one.place]]
        airframe = Airframe(drone=scenario.drone(one.vehicle.type))
        world.add(
            VehicleConfig(
                lat=station.lat, lon=station.lon, ground_m=station.elevation_m or 0.0, system=one.system, soc=one.soc, warm=True,
                airframe=airframe, seed=service.seed, step_s=STEP_S,
            )
        )  # fmt: skip
    Pads(world, scenario.load if service.strangers else None, seed=service.seed)
    return world


def _wind(service: ServiceRecord, region: Region) -> WindTruth:
    """Return the true wind: as given, else the forecast; calm with neither."""
    text = service.actual_wind or service.wind
    if text is None:
        return ConstantWind()
    if "@" in text:
        return ConstantWind.of(*typed_values.parse_wind(text))
    truth, _ = typed_values.true_wind(region.base, from_posix(service.begin_s), text)
    return ConstantWind() if truth is None else RecordedWind(truth)
