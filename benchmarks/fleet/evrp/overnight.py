"""Instances of electric vehicle routing and overnight charging scheduling on a multigraph, and their authors' solutions."""

from __future__ import annotations

import gzip
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as ET

import numpy as np

from skyway.planner.tours.problem import NO_PADS, Arcs, Charging, Depot, Visits, alike, lay_out

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.planner.tours.problem import Tours
    from skyway.planner.tours.search import Search

FOLDER = Path(__file__).resolve().parents[4] / "shared" / "data" / "evrp" / "overnight"
NAMES = (
    "C101-25", "C105-25", "C201-25", "R101-25", "R101-50", "R105-25", "R109-25", "R201-25", "RC101-25", "RC105-25", "RC108-25", "RC201-25",
)  # fmt: skip
PERIOD = 10.0
"""Times are in tenths of a minute, periods are minutes."""
REFUSAL = 1e7
"""Cost of refusing a customer, so high that every customer is served."""


@dataclass(frozen=True)
class Link:
    """An arc: its ends, cost, time with the service at its tail, and energy."""

    tail: int
    head: int
    cost: int
    time: int
    energy: int


@dataclass(frozen=True)
class Instance:
    """An instance of its file; node 0 is the depot, and so is the last."""

    name: str
    chargers: int
    window: tuple[tuple[int, int], ...]
    load: tuple[int, ...]
    links: tuple[Link, ...]
    """Links by their number in the file."""
    capacity: int
    battery: int
    first_period: int
    last_period: int
    periods: NDArray[np.int64]
    """Shape (energies,): periods that charge this energy."""


@dataclass(frozen=True)
class Charged:
    """A route of a solution: its links by number, the first and last period of its charge, and its departure (minutes)."""

    links: tuple[int, ...]
    first_period: int
    last_period: int
    departure: int


@dataclass(frozen=True)
class Solution:
    """A solution and its cost."""

    cost: float
    routes: tuple[Charged, ...]


def _number(element: ET.Element, path: str) -> int:
    found = element.findtext(path)
    if found is None:
        raise ValueError(f"no {path} in {element.tag}")
    return int(found)


def read(name: str) -> Instance:
    """Read an instance."""
    with gzip.open(FOLDER / f"{name}.xml.gz") as file:
        root = ET.fromstring(file.read())
    nodes = sorted(root.findall("network/nodes/node"), key=lambda node: int(node.attrib["id"]))
    links = sorted(root.findall("network/links/link"), key=lambda link: int(link.attrib["id"]))
    profile = root.find("fleet/vehicle_profile")
    if profile is None:
        raise ValueError(f"no vehicle_profile in {name}")
    points = profile.findall("custom/inverse_recharging_function/breakpoint")
    periods = np.zeros(len(points), dtype=np.int64)
    for point in points:
        periods[_number(point, "energy_level")] = _number(point, "periods")
    return Instance(
        name,
        _number(root, "info/num_chargers"),
        tuple((_number(node, "tw/start"), _number(node, "tw/end")) for node in nodes),
        tuple(_number(node, "load") for node in nodes),
        tuple(
            Link(int(link.attrib["tail"]), int(link.attrib["head"]), _number(link, "travel_cost"), _number(link, "travel_time"), _number(link, "custom/energy_consumption"))
            for link in links
        ),
        _number(profile, "capacity"),
        _number(profile, "custom/energy_capacity"),
        _number(profile, "custom/first_charging_period"),
        _number(profile, "custom/last_charging_period"),
        periods,
    )  # fmt: skip


def tours_of(instance: Instance) -> tuple[Tours, NDArray[np.int64]]:
    """Return the problem for `planner.tours`, and the number of the link of each of its arcs, shape (parallel, nodes, nodes)."""
    nodes = len(instance.window) - 1
    number = np.full((2, nodes, nodes), -1, dtype=np.int64)
    for index, link in enumerate(instance.links):
        head = 0 if link.head == nodes else link.head
        number[0 if number[0, link.tail, head] < 0 else 1, link.tail, head] = index
    cost, time, energy = (np.full(number.shape, np.inf) for _ in range(3))
    for key, found in np.ndenumerate(number):
        if found >= 0:
            link = instance.links[int(found)]
            cost[key], time[key], energy[key] = link.cost, link.time, link.energy
    window = np.array(instance.window[:-1], dtype=np.float64)
    load = np.array(instance.load[:-1], dtype=np.float64)
    visits = Visits(window[:, 0], window[:, 1], np.zeros(nodes), load, np.full(nodes, REFUSAL), np.full(nodes, -np.inf))
    tours, _ = lay_out(
        Arcs(cost, time, energy, np.zeros_like(energy)), visits, np.empty(0, dtype=np.int64),
        alike(nodes - 1, window[0, 0], window[0, 1], instance.battery, instance.capacity), Charging(1.0, instance.battery, instance.battery),
        NO_PADS, Depot(instance.chargers, instance.periods, PERIOD),
    )  # fmt: skip
    return tours, number


def solution_of(search: Search, number: NDArray[np.int64]) -> Solution:
    """Return the best plan as links of the file, with its charges; `number` is that of `tours_of`."""
    routes = []
    for vehicle, (begin, periods, by) in search.depot_charges().items():
        customers, ways = search.route(vehicle)
        ends = [0, *customers, 0]
        arcs = search.tours.ways.arc[ways, 0]
        links = tuple(int(number[arc, tail, head]) for arc, tail, head in zip(arcs, ends, ends[1:], strict=False))
        routes.append(Charged(links, begin + 1, begin + periods, by + 1))
    return Solution(search.cost / PERIOD, tuple(routes))


def published(name: str) -> Solution:
    """Read the authors' solution."""
    root = ET.parse(FOLDER / f"{name}.solution.xml").getroot()
    routes = []
    for route in root.findall("routes/route"):
        arcs = route.findtext("arcs_sequence") or ""
        routes.append(
            Charged(
                tuple(int(one) for one in arcs.split(",")),
                _number(route, "initial_charging_period"),
                _number(route, "last_charging_period"),
                _number(route, "departure_time"),
            )
        )
    return Solution(float(root.findtext("info/objective") or "nan"), tuple(routes))
