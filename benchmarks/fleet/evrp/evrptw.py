"""Instances of the electric vehicle routing problem with time windows and partial recharging, and their best known solutions."""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from skyway.planner.tours.problem import Arcs, Charging, Visits, alike, lay_out

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.search import Search

FOLDER = Path(__file__).resolve().parents[4] / "shared" / "data" / "evrp" / "evrptw"
BIG = tuple(f"{name}_21" for name in ("c101", "c103", "c201", "c204", "r101", "r105", "r201", "r208", "rc101", "rc105", "rc201", "rc208"))  # fmt: skip
SMALL = ("c101C5", "c103C5", "r104C5", "rc105C5", "c101C10", "r102C10", "rc108C10")


REFUSAL = 1e6
"""Cost of refusing a customer, so high that every customer is served."""


@dataclass(frozen=True)
class Instance:
    """An instance of its file; arrays have shape (places,), the depot first."""

    name: str
    ids: tuple[str, ...]
    kind: tuple[str, ...]
    """``d`` depot, ``f`` station, ``c`` customer."""
    place: NDArray[np.float64]
    """Shape (places, 2)."""
    demand: NDArray[np.float64]
    ready: NDArray[np.float64]
    due: NDArray[np.float64]
    service: NDArray[np.float64]
    battery: float
    capacity: float
    consumption: float
    """Energy per unit of distance."""
    refuelling: float
    """Charging time per unit of energy."""
    velocity: float

    @property
    def distance(self) -> NDArray[np.float64]:
        """Euclidean distances, shape (places, places)."""
        apart = self.place[:, None] - self.place[None]
        return np.hypot(apart[..., 0], apart[..., 1])


@dataclass(frozen=True)
class BestKnown:
    """A published solution."""

    vehicles: int
    distance: float
    routes: tuple[tuple[str, ...], ...]
    """Ids of stations and customers between the depots."""


def read(name: str) -> Instance:
    """Read an instance."""
    text = (FOLDER / f"{name}.txt").read_text(encoding="utf-8")
    rows = [line.split() for line in text.splitlines()[1:] if line.strip() and "/" not in line]
    rows.sort(key=lambda row: "dfc".index(row[1]))
    values = {line[0]: float(found[1]) for line in text.splitlines() if (found := re.search(r"/([\d.]+)/", line))}
    columns = np.array([[float(value) for value in row[2:]] for row in rows])
    demand, ready, due, service = columns[:, 2:].T
    return Instance(
        name, tuple(row[0] for row in rows), tuple(row[1] for row in rows), columns[:, :2], demand, ready, due, service,
        battery=values["Q"], capacity=values["C"], consumption=values["r"], refuelling=values["g"], velocity=values["v"],
    )  # fmt: skip


def tours_of(instance: Instance) -> tuple[Tours, list[str], list[str]]:
    """Return the problem for `planner.tours`, and the ids of its nodes and stations."""
    distance = instance.distance[None]
    refusal = np.full(len(instance.ids), REFUSAL)
    visits = Visits(
        instance.ready, instance.due, instance.service, instance.demand, refusal, np.full(len(refusal), -np.inf)
    )
    stations = np.array([place for place, kind in enumerate(instance.kind) if kind == "f"], dtype=np.int64)
    arcs = Arcs(distance, distance / instance.velocity, distance * instance.consumption, np.zeros_like(distance))
    customers = instance.kind.count("c")
    vehicles = alike(customers, 0.0, float(instance.due[0]), instance.battery, instance.capacity)
    charging = Charging(instance.refuelling, instance.battery, instance.battery)
    tours, nodes = lay_out(arcs, visits, stations, vehicles, charging)
    return tours, [instance.ids[node] for node in nodes], [instance.ids[station] for station in stations]


def routes_of(search: Search, nodes: Sequence[str], stations: Sequence[str]) -> list[list[str]]:
    """Return the routes of the best plan as ids, with their stations."""
    station = search.tours.ways.station
    routes = []
    for vehicle in np.flatnonzero(search.best.length):
        customers, ways = search.route(int(vehicle))
        route = []
        for way, customer in zip(ways, [*customers, 0], strict=True):
            route += [stations[one] for one in station[way] if one >= 0]
            route += [nodes[customer]] if customer else []
        routes.append(route)
    return routes


def best_known() -> dict[str, BestKnown]:
    """Return the best known solutions by the name of the instance."""
    found = {}
    with (FOLDER / "bks-evrptwpr_part.csv").open(encoding="utf-8") as file:
        for row in csv.DictReader(file, delimiter="\t"):
            routes: list[tuple[str, ...]] = []
            route: list[str] = []
            for one in row["CONFIGURATION"].split(";"):
                if one == "D0":
                    if route:
                        routes.append(tuple(route))
                    route = []
                else:
                    route.append(one)
            found[f"{row['INSTANCE'].lower()}_21"] = BestKnown(
                int(row["NUM_VEHICLES"]), float(row["TOTAL_DISTANCE"]), tuple(routes)
            )
    return found
