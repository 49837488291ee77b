"""Energy models fitted to recorded flights, with their error on flights that were not fitted.

Only the time in the air with the motors turning counts: a recorder that runs before the take-off, or continues after the landing,
would otherwise make the drone seem to need little power.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.formatting import mass_text
from skyway.models.base.units import S_PER_MIN
from skyway.models.drones.energy_belief import EnergyBelief
from skyway.models.drones.power import M100_COEFFICIENTS, PHASES, EnduranceEnergy, EnergyModel, MomentumEnergy, Phase

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.drones.drone import Drone
    from skyway.models.drones.telemetry import TelemetryTrack

ModelName = Literal["endurance", "momentum"]
MODELS: tuple[ModelName, ...] = ("endurance", "momentum")
VERTICAL_MPS = 0.4
"""Climbing or sinking faster than this, smoothed, is a climb or a descent."""
SMOOTH_S = 2.0
MOTORS_ON = 0.3
"""Share of the median power with the motors on, smoothed, above which they turn."""
LONGEST_GAP_S, LONGEST_GAP_STEPS = 0.5, 2.0
"""A pause between samples counts as this long at most, or as so many usual steps of the log: what happened in it is unknown."""
MIN_MASS_SPREAD = 1.03
"""With masses closer together than this ratio an exponent, or an offset, cannot be fitted."""
DEFAULT_KAPPA = 1.5
LEAST_W_PER_KG, MOST_W_PER_KG = 20.0, 3000.0
"""Mean power in flight: of rotors that carry 10 N/m2, far below any multirotor's, and of a racing quadcopter at full throttle."""


@dataclass(frozen=True, slots=True)
class PowerRecord:
    """Energy record of one flight."""

    name: str
    """Of the log."""
    mass_kg: float
    """Take-off mass, with package."""
    time_s: dict[Phase, float]
    energy_j: dict[Phase, float]
    """Time and energy in each phase, in the air."""
    idle_s: float
    """Time left out: motors off, disarmed, or landed."""

    @property
    def total_s(self) -> float:
        """Time in the air."""
        return sum(self.time_s.values())

    @property
    def total_j(self) -> float:
        """Energy taken."""
        return sum(self.energy_j.values())

    def predicted_j(self, model: EnergyModel) -> float:
        """Modelled energy of these phases."""
        return sum(model.power_w(self.mass_kg, phase) * self.time_s[phase] for phase in PHASES)


@dataclass(frozen=True, slots=True)
class EnergyFit:
    """A model fitted to flights."""

    model: EnergyModel
    """Fitted to all of them."""
    left_out_error: tuple[float, ...]
    """Relative error of the energy of each flight by a model fitted to the others; NaN for a single flight."""

    @property
    def belief(self) -> EnergyBelief:
        """The energy belief for other flights of the same drone."""
        return EnergyBelief.calibrated(self.left_out_error)

    @property
    def worst(self) -> float:
        """Largest absolute error."""
        return max(abs(error) for error in self.left_out_error)

    @property
    def median(self) -> float:
        """Median absolute error."""
        return float(np.median(np.abs(self.left_out_error)))


def power_record(name: str, track: TelemetryTrack, mass_kg: float) -> PowerRecord:
    """Measure a flight from its track with power and vertical speed; the mass is that of drone, batteries and package.

    Where the log tells that the vehicle is disarmed or landed, the time does not count as flight. An `InputError`, which gives the
    name, means that power is unknown, or that the vehicle never flew.
    """
    power = track["power_w"]
    powered, rise = np.isfinite(power), _rise_mps(track)
    if powered.sum() >= 20 and not power[powered].max() > 1.0 and np.median(power[powered]) < -1.0:
        remedy = "count what is drawn from the battery as positive: factor = -1 in the file of --columns"
        raise InputError(Fault("has negative battery power", name, remedy=remedy))
    if powered.sum() < 20 or not power[powered].max() > 1.0:
        remedy = "a log with battery voltage and current, or a CSV with a column power_w"
        raise InputError(Fault("has no battery power", name, remedy=remedy))
    known = powered & np.isfinite(rise)
    if known.sum() < 20:
        remedy = "climb and cruise need different power: a log with vel_down_mps, height_m or alt_msl_m"
        raise InputError(Fault("has battery power, but neither vertical speed nor height with it", name, remedy=remedy))
    if not 0.0 < mass_kg < math.inf:
        raise InputError(Fault("is not a take-off mass", name, None, "mass", mass_kg, "kg, above 0"))
    track = track.part(known)
    time_s, power, rise = track.time_s, track["power_w"], rise[known]
    steps = np.diff(time_s)
    usual_s = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    duration = np.minimum(np.gradient(time_s), max(LONGEST_GAP_S, LONGEST_GAP_STEPS * usual_s))
    climb = smoothed(time_s, rise)
    on = _motors_on(smoothed(time_s, power), power) & (track["armed"] != 0.0) & (track["landed"] != 1.0)
    if not on.any():
        raise InputError(Fault("tells of no flight: the vehicle is disarmed or on the ground throughout", name))
    where: dict[Phase, NDArray[np.bool_]] = {
        "climb": on & (climb > VERTICAL_MPS),
        "cruise": on & (np.abs(climb) <= VERTICAL_MPS),
        "descent": on & (climb < -VERTICAL_MPS),
    }
    _refuse_impossible_power(name, float(np.average(power[on], weights=duration[on])), mass_kg)
    return PowerRecord(
        name,
        mass_kg,
        {phase: float(duration[chosen].sum()) for phase, chosen in where.items()},
        {phase: float((duration * power)[chosen].sum()) for phase, chosen in where.items()},
        float(duration[~on].sum()),
    )


def _rise_mps(track: TelemetryTrack) -> NDArray[np.float64]:
    """Vertical speed, upwards; from the height if the log has no vertical speed."""
    time_s, down = track.time_s, track["vel_down_mps"]
    if np.isfinite(down).any():
        return -down
    for name in ("height_m", "alt_msl_m"):
        known = np.isfinite(track[name])
        if known.sum() > 1:
            after, before = (
                np.interp(time_s + shift, time_s[known], track[name][known])
                for shift in (SMOOTH_S / 2.0, -SMOOTH_S / 2.0)
            )
            return np.asarray((after - before) / SMOOTH_S)
    return np.full(len(track), np.nan)


def _refuse_impossible_power(name: str, mean_w: float, mass_kg: float) -> None:
    """Raise an `InputError` if no multirotor of the mass flies on the power."""
    low, high = mass_kg * LEAST_W_PER_KG, mass_kg * MOST_W_PER_KG
    if not low <= mean_w <= high:
        problem = f"has {mean_w:.3g} W on average in flight, where a multirotor of {mass_kg:g} kg needs {low:,.0f} to {high:,.0f} W"
        remedy = "check the unit of its power and --mass"
        raise InputError(Fault(problem, name, remedy=remedy))


def fit_energy(records: Sequence[PowerRecord], name: ModelName, drone: Drone, air_density_kg_m3: float) -> EnergyFit:
    """Fit a model, ``endurance`` or ``momentum``, to one or more flights, and again without each of them.

    It is written for the masses and the battery of the drone; the air density is that during the flights. An `InputError` means that
    there is no flight, that two records are of one flight, or that power falls as the mass rises.
    """
    if not records:
        raise InputError("no flight to fit an energy model to")
    _refuse_repeated(records)
    _refuse_falling_power(records)
    errors = []
    for number, record in enumerate(records):
        others = [*records[:number], *records[number + 1 :]]
        if not others:
            errors.append(math.nan)
            continue
        model = _fit(others, name, drone, air_density_kg_m3)
        errors.append(record.predicted_j(model) / record.total_j - 1.0)
    return EnergyFit(_fit(records, name, drone, air_density_kg_m3), tuple(errors))


def published_errors(records: Sequence[PowerRecord], air_density_kg_m3: float) -> tuple[float, ...]:
    """Relative error of each flight's energy by the coefficients published for the DJI Matrice 100."""
    model = MomentumEnergy(M100_COEFFICIENTS, air_density_kg_m3)
    return tuple(record.predicted_j(model) / record.total_j - 1.0 for record in records)


def calibrated(drone: Drone, fit: EnergyFit) -> Drone:
    """Return the drone with a fitted model and its energy belief; its endurances follow from the model."""
    model = fit.model
    full_kg = drone.mass_kg + drone.max_payload_kg
    return replace(
        drone,
        endurance_empty_s=drone.battery_j / model.power_w(drone.mass_kg),
        endurance_full_s=drone.battery_j / model.power_w(full_kg),
        energy=model if isinstance(model, MomentumEnergy) else None,
        energy_belief=fit.belief,
    )


def drone_file(drone: Drone, notes: Sequence[str] = ()) -> str:
    """Write a drone as a fleet file that `models.drones.fleet.read_fleet` reads, with notes as comments."""
    lines = [*(f"# {note}" for note in notes), 'schema = "skyway.fleet/1"', "", "[[drone]]"]
    lines += [f"{key} = {_toml_text(getattr(drone, key))}" for key in ("id", "name", "provider")]
    figures = drone.figures | {"endurance_full_min": min(drone.endurance_full_s, drone.endurance_empty_s) / S_PER_MIN}
    if drone.price_per_km is not None:
        figures["price_per_km"] = drone.price_per_km
    lines += [f"{key} = {value!r}" for key, value in ((key, float(value)) for key, value in figures.items())]
    if isinstance(drone.energy, MomentumEnergy):
        lines += ['energy_model = "momentum"', "", "[drone.momentum]"]
        lines.append(f"air_density_kg_m3 = {float(drone.energy.air_density_kg_m3)!r}")
        for phase in PHASES:
            b1, b0 = drone.energy.coefficients[phase]
            lines += ["", f"[drone.momentum.{phase}]", f"b1 = {float(b1)!r}", f"b0 = {float(b0)!r}"]
    lines += ["", "[drone.energy_belief]"]
    lines += [f"{key} = {float(value)!r}" for key, value in asdict(drone.energy_belief).items()]
    return "\n".join(lines) + "\n"


def one_mass(records: Sequence[PowerRecord]) -> bool:
    """Whether the masses are too similar to find the effect of the load."""
    masses = [record.mass_kg for record in records]
    return max(masses) / min(masses) < MIN_MASS_SPREAD


def _refuse_repeated(records: Sequence[PowerRecord]) -> None:
    """Refuse a flight that is given twice: it would be predicted from itself."""
    first: dict[tuple[float, ...], str] = {}
    for record in records:
        measured = (*record.time_s.values(), *record.energy_j.values())
        if measured in first:
            problem = f"is the same flight as {first[measured]}"
            raise InputError(Fault(problem, record.name, remedy="give each flight once"))
        first[measured] = record.name


def _refuse_falling_power(records: Sequence[PowerRecord]) -> None:
    """Refuse masses with which the power would fall as the mass rises: no aircraft that hovers does that."""
    if one_mass(records) or _exponent(records) > 0.0:
        return
    light, heavy = (choose(records, key=lambda record: record.mass_kg) for choose in (min, max))
    told = ", ".join(f"{one.total_j / one.total_s:.0f} W at {mass_text(one.mass_kg)}" for one in (light, heavy))
    remedy = "give the package of each log in the order of the logs, and flights alike in speed and wind with loads further apart"
    raise InputError(Fault(f"power falls as the mass rises ({told})", field="--payload", remedy=remedy))


def _exponent(records: Sequence[PowerRecord]) -> float:
    """Exponent of the mass that the mean power of flights follows: least squares, weighted by time."""
    mass, power, weight = _mean_powers(records)
    return float(np.polyfit(np.log(mass), np.log(power), 1, w=weight)[0])


def _mean_powers(
    records: Sequence[PowerRecord],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Mass, mean power, and the weight of each flight: the root of its time."""
    mass = np.array([record.mass_kg for record in records])
    power = np.array([record.total_j / record.total_s for record in records])
    return mass, power, np.sqrt([record.total_s for record in records])


def _fit(records: Sequence[PowerRecord], name: ModelName, drone: Drone, density: float) -> EnergyModel:
    if name == "momentum":
        return MomentumEnergy({phase: _momentum(records, phase, density) for phase in PHASES}, density)
    mass, power, weight = _mean_powers(records)
    kappa = DEFAULT_KAPPA if one_mass(records) else max(_exponent(records), 0.0)
    level = float(np.average(np.log(power / mass**kappa), weights=weight**2))
    full_kg = drone.mass_kg + drone.max_payload_kg
    empty_s, full_s = (drone.battery_j / (math.exp(level) * kg**kappa) for kg in (drone.mass_kg, full_kg))
    if full_kg <= drone.mass_kg:
        full_s = empty_s
    return EnduranceEnergy(drone.battery_j, drone.mass_kg, full_kg, empty_s, full_s)


def _momentum(records: Sequence[PowerRecord], phase: Phase, density: float) -> tuple[float, float]:
    """b1 and b0 of one phase: weighted least squares; b0 is 0 if the masses are too similar to separate them."""
    flown = [record for record in records if record.time_s[phase] > 1.0]
    if not flown:
        return M100_COEFFICIENTS[phase]
    mass = np.array([record.mass_kg for record in flown])
    induced = mass**1.5 / math.sqrt(density)
    weight = np.sqrt([record.time_s[phase] for record in flown])
    power = np.array([record.energy_j[phase] / record.time_s[phase] for record in flown])
    if mass.max() / mass.min() >= MIN_MASS_SPREAD:
        table = np.stack([induced, np.ones(len(flown))], axis=1)
        (b1, b0), *_ = np.linalg.lstsq(table * weight[:, None], power * weight, rcond=None)
        if b1 > 0.0:
            return float(b1), float(b0)
    return float((weight**2 * induced * power).sum() / (weight**2 * induced**2).sum()), 0.0


def _motors_on(smooth: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Where the motors turn, however long they stood still: the threshold is a share of the median of exactly these samples.

    The search for this fixed point begins at the greatest power, smoothed.
    """
    on = smooth > MOTORS_ON * float(smooth.max())
    for _ in range(20):
        before, on = on, smooth > MOTORS_ON * float(np.median(power[on])) if on.any() else on
        if np.array_equal(before, on):
            break
    return on


def smoothed(time_s: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean over `SMOOTH_S` about each sample."""
    total = np.concatenate(([0.0], np.cumsum(values)))
    first = np.searchsorted(time_s, time_s - SMOOTH_S / 2.0, side="left")
    last = np.searchsorted(time_s, time_s + SMOOTH_S / 2.0, side="right")
    return np.asarray((total[last] - total[first]) / np.maximum(last - first, 1))


def _toml_text(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
