"""Telemetry of a log, restricted to what its kind of vehicle can measure."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.link.logs.common.vehicle_kind import KINDS, Vehicle
from skyway.models.base.errors import Fault, InputError
from skyway.models.drones.telemetry import COLUMN, NEITHER, TelemetryTrack

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from skyway.link.logs.common.log import LogSummary
    from skyway.link.logs.common.vehicle_kind import Kind

FLIES_BY_AIR: tuple[Kind, ...] = ("multirotor", "fixed wing", "VTOL")
"""Kinds whose flight tells the wind."""
SETTLED_S = 10.0
"""A VTOL hovers so long before its lean is that of a multirotor."""


def vehicle_of(summary: LogSummary, system: int | None, given: Kind | None = None, *, drag: bool = False) -> Vehicle:
    """Return what the vehicle of a log is.

    `given` is what a person says, for logs that do not say it themselves; a `drag` of a multirotor given with it says
    as much. Raises an `InputError` if the log says otherwise, or if there is no such kind.
    """
    found = summary.vehicle(system)
    if given is None:
        return Vehicle("multirotor", "the drag that was given") if drag and found.kind == "unknown" else found
    if given not in KINDS[:-1]:
        raise InputError(
            Fault("is not a kind of vehicle", field="--vehicle", value=given, remedy=", ".join(KINDS[:-1]))
        )
    if found.kind not in ("unknown", given):
        raise InputError(Fault(f"but the log is of a {found.kind} ({found.told_by})", field="--vehicle", value=given))
    return Vehicle(given, "--vehicle", found.leans)


def no_wind(vehicle: Vehicle) -> str:
    """Reason why a vehicle gives no wind; empty if it may."""
    if vehicle.kind in FLIES_BY_AIR:
        return ""
    if vehicle.kind == "unknown":
        return f"the kind of vehicle is unknown ({vehicle.told_by}), so its tilt does not measure the wind: give the kind with --vehicle"
    return f"a {vehicle.kind} ({vehicle.told_by}) does not measure the wind"


class VehicleView:
    """Telemetry of one vehicle, piece by piece, without what its kind cannot measure.

    `doubted` are the times, from and to, in which the log says that the position is not to be trusted.
    """

    def __init__(self, vehicle: Vehicle, doubted: tuple[tuple[float, float], ...] = ()) -> None:
        self.vehicle = vehicle
        self._doubted = doubted
        self._hovers_since_s = math.nan

    def see(self, track: TelemetryTrack) -> TelemetryTrack:
        """Return the next samples, not older than those before."""
        values = track.values.copy()
        for begin, end in self._doubted:
            first, last = np.searchsorted(track.time_s, (begin, end))
            values[first:last, COLUMN["ekf_ok"]] = 0.0
        hangs, kind = values[:, COLUMN["fixed_wing"]], self.vehicle.kind
        if kind == "multirotor":
            hangs[:] = np.where(hangs == 1.0, NEITHER, np.nan_to_num(hangs))
        elif kind == "fixed wing":
            hangs[:] = 1.0
        elif kind == "VTOL":
            hangs[:] = np.where(self._settled(track.time_s, hangs), 0.0, np.where(hangs == 1.0, 1.0, NEITHER))
        else:
            hangs[:] = NEITHER
        on_wings = (hangs == 1.0) & (values[:, COLUMN["airspeed_ok"]] != 0.0)
        on_wings &= np.isfinite(values[:, COLUMN["airspeed_mps"]])
        tells = on_wings | (hangs == 0.0)
        for name in ("wind_north_mps", "wind_east_mps", "airspeed_mps"):
            values[~tells, COLUMN[name]] = np.nan
        return TelemetryTrack(track.system, track.time_s, values)

    def _settled(self, time_s: NDArray[np.float64], hangs: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Where a VTOL has stood on its rotors for long enough, and leans as a multirotor does."""
        hovers = (hangs == 0.0) & self.vehicle.leans
        starts = np.where(hovers, np.nan, time_s)
        since = np.fmax.accumulate(np.concatenate([[self._hovers_since_s], starts]))[1:]
        if len(since):
            self._hovers_since_s = float(since[-1])
        return np.asarray(hovers & ~(time_s - since < SETTLED_S))
