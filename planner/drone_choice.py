"""Choice of the drones to plan for: those that lift the package and that no other dominates (the skyline).

Block nested loop; source: Börzsönyi, Kossmann, Stocker, "The skyline operator", ICDE 2001.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.errors import PayloadError
from skyway.models.flight.energy import FlightPower

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.models.drones.drone import Drone
    from skyway.models.scenario.scenario import Scenario
    from skyway.planner.problem.objective import Objective
    from skyway.planner.problem.request import Request


def qualities(drone: Drone, *, with_price: bool, spends: tuple[float, bool] | None = None) -> tuple[float, ...]:
    """Criteria for comparing drones, more is better: payload, range, airspeed, recharge rate, and minus the price.

    With `spends`, the mass of a package (kg) and whether the cost counts: also minus the power that carries it, and minus the wear.
    """
    values: tuple[float, ...] = (
        drone.max_payload_kg, drone.flight_range_m, drone.max_airspeed_mps, drone.recharge_rate_w,
    )  # fmt: skip
    if with_price:
        values = *values, -(drone.price_per_km or 0.0)
    if spends is not None:
        payload_kg, cost = spends
        power = FlightPower.of(drone, payload_kg)
        values = *values, -power.climb_w, -power.cruise_w, -power.descent_w
        if cost:
            values = *values, -drone.wear_per_flight_h, -drone.wear_per_cycle / drone.battery_j
    return values


def dominates(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    """Return whether qualities `a` are at least as good as `b` in all criteria and better in one."""
    return a != b and all(x >= y for x, y in zip(a, b, strict=True))


def _as_grams(payload_kg: float, most_kg: float) -> str:
    """Ask whether grams were meant, of a number that is one of grams rather than of kilograms."""
    return f"; {payload_kg:g} g are {payload_kg / 1000.0:g} kg" if 50.0 <= payload_kg <= 1000.0 * most_kg else ""


def skyline(drones: Sequence[Drone], payload_kg: float, objective: Objective | None = None) -> list[Drone]:
    """Drones that lift the package and are dominated by no other that does, in the order of the fleet.

    The price is compared only where every one of them has one, power and wear where the objective counts energy or cost. Raises a `PayloadError` if none lifts it.
    """
    able = [drone for drone in drones if drone.max_payload_kg >= payload_kg]
    if not able:
        most = max((drone.max_payload_kg for drone in drones), default=0.0)
        raise PayloadError(
            f"no drone lifts {payload_kg:g} kg: the fleet's heaviest payload is {most:g} kg{_as_grams(payload_kg, most)}"
        )
    with_price = all(drone.price_per_km is not None for drone in able)
    counts = objective is not None and objective.beside_time
    spends = (payload_kg, objective.counts_cost) if objective is not None and counts else None
    values = [qualities(drone, with_price=with_price, spends=spends) for drone in able]

    def beaten(number: int, other: int) -> bool:
        """Whether the other drone is as good in everything, and flies in all weather that this one does."""
        all_weather = able[other].limits.stricter(able[number].limits) == able[number].limits
        return all_weather and dominates(values[other], values[number])

    window: list[int] = []
    for number in range(len(able)):
        if any(beaten(number, other) for other in window):
            continue
        window = [other for other in window if not beaten(other, number)]
        window.append(number)
    return [able[number] for number in window]


def candidates(scenario: Scenario, request: Request, rejected: dict[str, str]) -> list[Drone]:
    """Drones to compose for: the named one, or the skyline; writes the reasons for excluding others to `rejected`."""
    if request.drone is not None:
        drone = scenario.drone(request.drone)
        if drone.max_payload_kg < request.payload_kg:
            others = [one.id for one in scenario.drones if one.max_payload_kg >= request.payload_kg]
            more = f"; {', '.join(others)} of the fleet can carry it" if others else ""
            grams = _as_grams(request.payload_kg, drone.max_payload_kg) if not others else ""
            message = f"{drone.id} lifts {drone.max_payload_kg:g} kg at most, not {request.payload_kg:g} kg"
            raise PayloadError(f"{message}{more}{grams}")
        return [drone]
    speed = request.airspeed_mps or 0.0
    able = [drone for drone in scenario.drones if drone.max_airspeed_mps >= speed - 1e-9]
    able = able or [max(scenario.drones, key=lambda drone: drone.max_airspeed_mps)]  # `Problem` refuses
    rejected |= {
        drone.id: f"flies {drone.max_airspeed_mps:g} m/s at most" for drone in scenario.drones if drone not in able
    }
    chosen = skyline(able, request.payload_kg, request.objective)
    for drone in able:
        if drone.max_payload_kg < request.payload_kg:
            rejected[drone.id] = f"lifts {drone.max_payload_kg:g} kg at most"
        elif drone not in chosen:
            rejected[drone.id] = "another drone is at least as good in every respect (skyline)"
    return chosen
