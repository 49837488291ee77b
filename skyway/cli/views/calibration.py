"""Reports of calibrations, and their output."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import typer

from skyway.cli.views.sheet import Column, Sheet
from skyway.models.base.formatting import duration, percent, watt_hours, wind_text
from skyway.models.calibration.energy import one_mass

if TYPE_CHECKING:
    from skyway.models.calibration.energy import EnergyFit, ModelName, PowerRecord
    from skyway.models.drones.airspeed import AirspeedModel
    from skyway.models.drones.drag import DragModel
    from skyway.models.drones.drone import Drone


ONE_MASS = "the effect of the load is unknown: all flights have the same mass (within 3 %); its usual effect is assumed"


@dataclass(frozen=True, slots=True)
class Air:
    """Result of a drag and airspeed calibration."""

    drag: DragModel | None
    airspeed: AirspeedModel | None
    reason: str
    sigma: float = math.inf
    wind: tuple[float, float] = (math.nan, math.nan)
    course_spread_deg: float = 0.0

    @property
    def known(self) -> bool:
        """Whether either was found."""
        return self.drag is not None or self.airspeed is not None


class MeanWind(msgspec.Struct, frozen=True, kw_only=True):
    """Wind TOWARDS, on average over a flight."""

    north_mps: float
    east_mps: float


class Sensor(msgspec.Struct, frozen=True, kw_only=True):
    """An airspeed sensor."""

    factor: float
    heading_offset_deg: float
    sigma_mps: float
    slip_sigma_deg: float


class WindCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """The same as JSON: ``skyway.calibrate-wind/1``."""

    schema: str = "skyway.calibrate-wind/1"
    identified: bool
    reason: str
    relative_sigma: float
    course_spread_deg: float
    wind: MeanWind | None
    drag: DragModel | None
    airspeed: Sensor | None


def air_report(found: Air) -> WindCalibration:
    """Return the output of ``skyway calibrate wind --json``."""
    sensor, drag = found.airspeed, found.drag
    return WindCalibration(
        identified=found.known,
        reason=found.reason,
        relative_sigma=found.sigma,
        course_spread_deg=round(found.course_spread_deg, 1),
        wind=None
        if not math.isfinite(found.wind[0])
        else MeanWind(north_mps=round(found.wind[0], 3), east_mps=round(found.wind[1], 3)),
        drag=drag,
        airspeed=None
        if sensor is None
        else Sensor(
            factor=round(sensor.factor, 5),
            heading_offset_deg=round(math.degrees(sensor.heading_offset_rad), 3),
            sigma_mps=round(sensor.sigma_mps, 3),
            slip_sigma_deg=round(math.degrees(sensor.slip_sigma_rad), 3),
        ),
    )


def tell_air(found: Air) -> None:
    """Print drag and airspeed sensor."""
    if not found.known:
        typer.echo(f"drag and airspeed cannot be identified: {found.reason}")
        return
    typer.echo(found.reason)
    if found.drag is not None:
        drag = found.drag
        typer.echo(f"  drag: linear {drag.linear_per_s:.4f} 1/s, quadratic {drag.quadratic_per_m:.5f} 1/m")
        typer.echo(f"  level bias forward {drag.bias_forward_mps2:+.3f}, right {drag.bias_right_mps2:+.3f} m/s²")
        later = drag.another_flight()
        typer.echo(
            f"  on another flight of this aircraft the drag may differ by ± {percent(later.relative_sigma)}, the level by "
            f"± {later.bias_sigma_mps2:.2f} m/s² (written with the drag)"
        )
    if found.airspeed is not None:
        offset = math.degrees(found.airspeed.heading_offset_rad)
        typer.echo(
            f"  airspeed: the sensor times {found.airspeed.factor:.3f}; through the air {offset:+.1f}° off the nose"
        )
    if math.isfinite(found.sigma):
        from skyway.models.wind.triangle import speed_from

        speed, direction = (float(value) for value in speed_from(*found.wind))
        what = "drag" if found.airspeed is None else "airspeed"
        typer.echo(f"  uncertainty of the {what} in this flight ± {percent(found.sigma, 1)}")
        typer.echo(f"  mean wind of the whole flight {wind_text(speed, direction)}")


class FlightFit(msgspec.Struct, frozen=True, kw_only=True):
    """A flight: its energy, and the errors of its predictions."""

    log: str
    mass_kg: float
    time_s: float
    idle_s: float
    energy_wh: float
    left_out_error: dict[ModelName, float]
    published_error: float


class EnergyCalibration(msgspec.Struct, frozen=True, kw_only=True):
    """Fits of all models: ``skyway.calibrate-energy/1``."""

    schema: str = "skyway.calibrate-energy/1"
    flights: list[FlightFit]
    models: dict[ModelName, dict[str, float]]
    published: dict[str, float]
    load_effect_known: bool
    """Whether the flights differ in mass enough to find it; otherwise it is assumed."""
    written: str
    endurance_empty_min: float
    endurance_full_min: float


def energy_report(
    records: list[PowerRecord],
    fits: dict[ModelName, EnergyFit],
    published: tuple[float, ...],
    chosen: str,
    drone: Drone,
) -> EnergyCalibration:
    """Return the output of ``skyway calibrate energy --json``."""
    return EnergyCalibration(
        flights=[
            FlightFit(
                log=record.name,
                mass_kg=round(record.mass_kg, 4),
                time_s=round(record.total_s, 1),
                idle_s=round(record.idle_s, 1),
                energy_wh=round(record.total_j / 3600.0, 3),
                left_out_error={name: round(fit.left_out_error[number], 5) for name, fit in fits.items()},
                published_error=round(published[number], 5),
            )
            for number, record in enumerate(records)
        ],
        models={name: {"worst": round(fit.worst, 5), "median": round(fit.median, 5)} for name, fit in fits.items()},
        published={"worst": round(max(abs(error) for error in published), 5)},
        load_effect_known=not one_mass(records),
        written=chosen,
        endurance_empty_min=round(drone.endurance_empty_s / 60.0, 5),
        endurance_full_min=round(drone.endurance_full_s / 60.0, 5),
    )


def tell_energy(
    records: list[PowerRecord],
    fits: dict[ModelName, EnergyFit],
    published: tuple[float, ...],
    chosen: str,
    output: Path | None,
) -> None:
    """Print the errors of all models, flight by flight."""
    typer.echo("energy error of each flight, predicted by a fit to the others:")
    columns = [Column("flight", justify="left"), Column("mass", "kg"), Column("time", "s"), Column("energy", "Wh")]
    sheet = Sheet([*columns, Column("endurance"), Column("momentum"), Column("published")])
    for number, record in enumerate(records):
        errors = [fits[name].left_out_error[number] for name in fits] + [published[number]]
        cells = ["-" if math.isnan(error) else percent(error, 1, signed=True) for error in errors]
        figures = f"{record.mass_kg:.2f}", f"{record.total_s:.0f}", watt_hours(record.total_j)
        sheet.add(Path(record.name).name, *figures, *cells)
        if record.idle_s > 5.0:
            sheet.note(f"  {duration(record.idle_s)} on the ground or with the motors off are ignored")
    sheet.show()
    if len(records) > 1:
        for name, fit in fits.items():
            typer.echo(f"  {name}: worst {percent(fit.worst, 1)}, median {percent(fit.median, 1)}")
    else:
        typer.echo("  with one flight there is no other to check against: the error on unseen flights is unknown")
    if one_mass(records):
        typer.echo(f"  {ONE_MASS}")
    typer.echo(
        f"{chosen} model" + (" (use -o FILE to write a drone file)" if output is None else f" written to {output}")
    )
