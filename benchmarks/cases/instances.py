"""Instances of the planner benchmark: a network, a load, and deliveries on days of the record. See docs/reference/benchmark.md."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, replace
from datetime import UTC, date, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.cases.loads import scaled_to
from benchmarks.cases.melbourne import melbourne
from benchmarks.cases.networks import geometric, new_york, random_pairs
from skyway.models.base.errors import Fault, InputError, refuse
from skyway.models.base.units import iso
from skyway.models.composition.composition import State
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.planner.evaluation.evaluate import Errors
from skyway.planner.problem.problem import HORIZON_H
from skyway.planner.problem.request import Request

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.scenario.scenario import Scenario

SCHEMA = "skyway.benchmark/1"
FOLDER = Path(__file__).parents[1] / "instances"
UTILISATIONS = (0.5, 0.7, 0.9)
NETWORKS = ("new-york", "melbourne", "geometric-100", "geometric-1000", "geometric-10000")
DELIVERIES = {"new-york": 12, "melbourne": 8, "geometric-100": 8, "geometric-1000": 6, "geometric-10000": 4}
MIN_M, MAX_M = 20_000.0, 60_000.0
PAYLOADS_KG = (0.4, 0.8, 1.2)
SEED = 1
RUNS = 20
LONG = ("new-york", 0.5, 125, 4)
"""Network, utilisation, deliveries and runs of the long instance: 500 deliveries on many days, for `benchmarks.online.bench_rolling`."""
LONG_FILE = FOLDER / f"{LONG[0]}-{LONG[1]:g}-{LONG[2]}.json"
HOLDING_SPOTS = 1000
ERRORS = Errors(energy=EnergyBelief(mean_ratio=1.0, sd_between=0.029, sd_within=0.0))
"""Of the energy: as much as evenly within 5 %, which these instances had first, and the same in all legs of a delivery."""


@dataclass(frozen=True)
class Delivery:
    """One request, and the day whose wind is the truth (its own date).

    Attributes
    ----------
    origin, destination : str
        Station ids.
    depart : str
        ISO 8601, UTC.
    truth : str
        Local date that the forecast leaves out.
    payload_kg : float
        Mass of the package.
    seed : int
        Of the planner's own sampling.
    """

    origin: str
    destination: str
    depart: str
    truth: str
    payload_kg: float
    seed: int


@dataclass(frozen=True)
class Instance:
    """A network under a load, deliveries, and what they are evaluated with.

    Attributes
    ----------
    name : str
        Such as ``new-york-0.7``.
    network : str
        ``new-york``, ``melbourne`` or ``geometric-<stations>``.
    network_seed : int
        Of a geometric network.
    network_sha256 : str
        Of its stations and segments, see `digest`; another digest is another network.
    utilisation : float
        Mean share of pads that other drones keep busy over the week, at every station; by day it is higher.
    holding_spots : int
        At every station. Many: as in the paper, who waits does so on the ground. With few, drones hover for a spot at
        busy stations until the battery is empty, which no planner of a fixed schedule can help.
    drone : str
        Drone of the fleet.
    reserve_soc, epsilon : float
        Of the requests.
    errors : Errors
        Gusts and errors of energy of the runs; planners are told them.
    runs, truth_seed : int
        Simulated runs of each delivery and their seed.
    deliveries : tuple of Delivery
        The requests.
    """

    name: str
    network: str
    network_seed: int
    network_sha256: str
    utilisation: float
    drone: str
    deliveries: tuple[Delivery, ...]
    holding_spots: int = HOLDING_SPOTS
    reserve_soc: float = 0.2
    epsilon: float = 1e-3
    errors: Errors = ERRORS
    runs: int = RUNS
    truth_seed: int = SEED

    def scenario(self) -> Scenario:
        """The network under its load, with drones whose energy is known as well as `errors` says.

        Raises
        ------
        InputError
            Its data are not here, or it is not the network that the instance was made on.
        """
        scenario = region(self.network, self.network_seed, self.utilisation, self.holding_spots)
        found = digest(scenario)
        if found != self.network_sha256:
            raise InputError(Fault("is another network than the instance's", self.name, field="network", value=found))
        energy = self.errors.energy
        if energy is None:
            return scenario
        return replace(scenario, drones=tuple(replace(drone, energy_belief=energy) for drone in scenario.drones))

    def request(self, delivery: Delivery, recharge: str) -> tuple[Request, date]:
        """A delivery as a request, and the day of its truth."""
        request = Request(
            state=State(datetime.fromisoformat(delivery.depart), delivery.origin),
            destination=delivery.destination,
            payload_kg=delivery.payload_kg,
            drone=self.drone,
            reserve_soc=self.reserve_soc,
            epsilon=self.epsilon,
            recharge="full" if recharge == "full" else "enough",
            seed=delivery.seed,
        )
        return request, date.fromisoformat(delivery.truth)

    def cut(self, deliveries: int, runs: int) -> Instance:
        """A smaller instance with the first deliveries."""
        return replace(self, deliveries=self.deliveries[:deliveries], runs=min(runs, self.runs))

    def to_json(self) -> str:
        """The instance as published."""
        return json.dumps({"schema": SCHEMA, **asdict(self)}, indent=1) + "\n"


def read_instance(path: Path) -> Instance:
    """Read a published instance.

    Raises
    ------
    InputError
        The file cannot be read or is no instance.
    """
    try:
        values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if values.pop("schema") != SCHEMA:
            raise InputError(Fault("is of another schema", str(path), field="schema", remedy=SCHEMA))
        errors = values["errors"]
        values["errors"] = Errors(**{**errors, "energy": EnergyBelief(**errors["energy"])})
        values["deliveries"] = tuple(Delivery(**one) for one in values["deliveries"])
        instance = Instance(**values)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(Fault(f"is no benchmark instance: {error}", str(path))) from None
    faults = [] if instance.deliveries else [Fault("has none", str(path), field="deliveries", remedy="at least one")]
    for name, least in (("runs", 1), ("truth_seed", 0), ("network_seed", 0)):
        number = getattr(instance, name)
        if not isinstance(number, int) or number < least:
            remedy = f"a whole number, {least} or more"
            faults.append(Fault("out of range", str(path), field=name, value=number, remedy=remedy))
    refuse(faults)
    return instance


def region(network: str, seed: int, utilisation: float, holding_spots: int = HOLDING_SPOTS) -> Scenario:
    """Scenario of a network's name, its load scaled, with so many holding spots at every station."""
    stations = network.removeprefix("geometric-")
    if stations != network and stations.isdecimal():
        base = geometric(int(stations), seed)
    elif network in {"new-york", "melbourne"}:
        base = new_york() if network == "new-york" else melbourne()
    else:
        raise InputError(Fault("no such network", field="network", value=network, remedy=", ".join(NETWORKS)))
    waiting = tuple(replace(station, holding_spots=holding_spots) for station in base.network.stations)
    load = scaled_to(base.load, utilisation, base.network.pads)
    return replace(base, network=replace(base.network, stations=waiting), load=load)


def digest(scenario: Scenario) -> str:
    """SHA-256 of lines ``id,lat,lon,pads`` of the stations and ``tail,head`` of the segments, degrees with 6 decimals."""
    network = scenario.network
    lines = [f"{s.id},{s.lat:.6f},{s.lon:.6f},{s.pads}" for s in network.stations]
    lines += [f"{a},{b}" for a, b in zip(network.tail.tolist(), network.head.tolist(), strict=True)]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


def make_instance(
    network: str, utilisation: float, *, seed: int = SEED, deliveries: int | None = None, runs: int = RUNS
) -> Instance:
    """Make an instance from its seed: the same everywhere. One of as many deliveries as asked for is named after that."""
    scenario = region(network, seed, utilisation)
    count = deliveries if deliveries is not None else DELIVERIES.get(network, 6)
    pairs = random_pairs(scenario.network, count, seed, least_m=MIN_M, most_m=MAX_M)
    rng = np.random.default_rng((seed, len(scenario.network), 7))
    made = []
    for origin, destination in pairs:
        depart, day = _departure(scenario, rng)
        payload_kg, own = float(rng.choice(PAYLOADS_KG)), int(rng.integers(2**31))
        made.append(Delivery(origin, destination, iso(depart), day.isoformat(), payload_kg, own))
    drone = "m200" if network == "new-york" else scenario.drones[0].id
    name = f"{network}-{utilisation:g}" + (f"-{count}" if deliveries is not None else "")
    return Instance(name, network, seed, digest(scenario), utilisation, drone, tuple(made), runs=runs)


def _departure(scenario: Scenario, rng: np.random.Generator) -> tuple[datetime, date]:
    """A departure by day on a day of the record whose wind is complete over the horizon."""
    from zoneinfo import ZoneInfo

    history = scenario.history
    if history is None:
        raise InputError(Fault("the scenario has no wind record", scenario.path))
    while True:
        second = rng.uniform(history.start_s, history.end_s)
        local = datetime.fromtimestamp(second, ZoneInfo(scenario.timezone))
        local = local.replace(hour=int(rng.integers(8, 17)), minute=0, second=0, microsecond=0)
        depart = local.astimezone(UTC)
        try:
            scenario.truth(local.date(), depart, HORIZON_H)
            scenario.forecast(depart, HORIZON_H, truth=local.date())
        except InputError:
            continue
        return depart, local.date()


def make_long(seed: int = SEED) -> Instance:
    """Make the long instance."""
    network, utilisation, deliveries, runs = LONG
    return make_instance(network, utilisation, seed=seed, deliveries=deliveries, runs=runs)


def make_all(networks: Sequence[str] = NETWORKS) -> tuple[list[Instance], list[str]]:
    """All instances whose data are here, and why others are not."""
    made, skipped = [], []
    for network in networks:
        for utilisation in UTILISATIONS:
            try:
                made.append(make_instance(network, utilisation))
            except InputError as error:
                skipped.append(f"{network}: {error}")
                break
    return made, skipped


def main() -> None:
    """Write the published instances."""
    FOLDER.mkdir(exist_ok=True)
    made, skipped = make_all()
    for instance in [*made, make_long()]:
        (FOLDER / f"{instance.name}.json").write_text(instance.to_json(), encoding="utf-8")
    for reason in skipped:
        print(reason)


if __name__ == "__main__":
    main()
