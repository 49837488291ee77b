"""A replay as JSON (``skyway.replay/1``) and as a table."""

from __future__ import annotations

import csv
import io
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from models.telemetry import QUANTITIES
from models.units import J_PER_WH, from_posix, iso
from models.wind import speed_from
from models.wind_filter import chi2_band

if TYPE_CHECKING:
    from link.replay import Leg, Replay

SCHEMA = "skyway.replay/1"
MAX_WINDS = 2000
WIND_EVERY_S = 5.0
MAX_EVENTS = 500


def instant(found: Replay, time_s: float) -> str | float | None:
    """Return a time as JSON has it: ISO 8601 where the log knows the date, else seconds of the log; None: unknown."""
    if not math.isfinite(time_s):
        return None
    if not found.summary.time_base.absolute or not 0.0 <= time_s < 4e9:
        return round(time_s, 3)
    return iso(from_posix(round(time_s, 3)))


def as_json(found: Replay) -> dict[str, Any]:
    """Return everything that was found; unknown numbers are None."""
    summary = found.summary
    return {
        "schema": SCHEMA,
        "format": summary.format,
        "messages": summary.messages,
        "by_type": summary.by_type,
        "skipped_bytes": summary.skipped_bytes,
        "systems": list(summary.systems),
        "other_systems": list(summary.others),
        "system": found.system,
        "start": instant(found, summary.start_s),
        "end": instant(found, summary.end_s),
        "time_base": {
            "source": summary.time_base.source,
            "absolute": summary.time_base.absolute,
            "doubts": list(summary.time_base.doubts),
        },
        "legs": [_leg(found, leg) for leg in found.legs],
        "wind": _winds(found),
        "wind_summary": _wind_summary(found),
        "drag": _drag(found),
        "energy": _energy(found),
        "events": [
            {"t": instant(found, event.time_s), "system": event.system, "text": event.text}
            for event in found.events[:MAX_EVENTS]
        ],
    }


def _known(value: float, digits: int = 3) -> float | None:
    return round(float(value), digits) if math.isfinite(value) else None


def _leg(found: Replay, leg: Leg) -> dict[str, Any]:
    return {
        "start": instant(found, leg.start_s),
        "end": instant(found, leg.end_s),
        "time_s": _known(leg.end_s - leg.start_s),
        "distance_m": _known(leg.distance_m, 1),
        "from": [_known(leg.from_lat, 7), _known(leg.from_lon, 7)],
        "to": [_known(leg.to_lat, 7), _known(leg.to_lon, 7)],
        "soc_start": _known(leg.soc_start),
        "soc_end": _known(leg.soc_end),
        "energy_wh": _known(leg.energy_j / J_PER_WH),
    }


def _winds(found: Replay) -> list[dict[str, Any]]:
    wind = found.wind
    if not len(wind):
        return []
    every = max(WIND_EVERY_S, float(wind.time_s[-1] - wind.time_s[0]) / MAX_WINDS)
    number = np.floor((wind.time_s - wind.time_s[0]) / every)
    rows = np.append(np.flatnonzero(np.diff(number)), len(wind) - 1)
    speed, direction = speed_from(wind.wind[rows, 0], wind.wind[rows, 1])
    return [
        {
            "t": instant(found, float(wind.time_s[row])),
            "speed_mps": _known(speed[place]),
            "from_deg": _known(direction[place], 1),
            "sigma_mps": _known(wind.sigma_mps[row]),
        }
        for place, row in enumerate(rows)
    ]


def _wind_summary(found: Replay) -> dict[str, Any]:
    wind = found.wind
    nis = wind.nis[np.isfinite(wind.nis)]
    mean = wind.wind.mean(axis=0) if len(wind) else np.full(2, np.nan)
    speed, direction = (float(value) for value in speed_from(*mean))
    forecast = found.forecast
    expected = None
    if forecast is not None:
        known_speed, known_from = (float(value) for value in speed_from(*forecast))
        expected = {
            "speed_mps": _known(known_speed),
            "from_deg": _known(known_from, 1),
            "vector_difference_mps": _known(float(np.hypot(*(mean - forecast)))),
        }
    sources, counts = np.unique(found.measured.source, return_counts=True)
    return {
        "mean_speed_mps": _known(speed),
        "mean_from_deg": _known(direction, 1) if len(wind) else None,
        "forecast": expected,
        "measurements": {str(name): int(count) for name, count in zip(sources, counts, strict=True)},
        "rejected": int((~wind.accepted).sum()),
        "nis_mean": _known(float(nis.mean())) if len(nis) else None,
        "nis_band_95": [_known(value) for value in chi2_band(len(nis))] if len(nis) else None,
    }


def _drag(found: Replay) -> dict[str, Any]:
    drag = found.drag
    return {
        "source": found.drag_source,
        "linear_per_s": None if drag is None else _known(drag.linear_per_s, 5),
        "quadratic_per_m": None if drag is None else _known(drag.quadratic_per_m, 6),
        "identified": found.drag_fit.identified,
        "reason": found.drag_fit.reason,
        "check_factor": _known(found.drag_check.factor),
        "check_sigma": _known(found.drag_check.sigma),
    }


def _energy(found: Replay) -> dict[str, Any]:
    soc = found.seconds["soc"]
    known = soc[np.isfinite(soc)]
    total = sum(phase.energy_j for phase in found.phases.values())
    return {
        "total_wh": _known(total / J_PER_WH),
        "soc_start": _known(float(known[0])) if len(known) else None,
        "soc_end": _known(float(known[-1])) if len(known) else None,
        "phases": {
            name: {
                "time_s": _known(phase.time_s, 1),
                "energy_wh": _known(phase.energy_j / J_PER_WH),
                "mean_power_w": _known(phase.energy_j / phase.time_s, 1) if phase.time_s > 0.0 else None,
            }
            for name, phase in found.phases.items()
        },
    }


def as_csv(found: Replay) -> str:
    """Return one row a second: the vehicle's own quantities, and the wind estimated."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(
        ["time_s", *QUANTITIES, "estimated_wind_north_mps", "estimated_wind_east_mps", "estimated_sigma_mps"]
    )
    times, wind = found.seconds.time_s, found.wind
    place = np.searchsorted(wind.time_s, times, side="right") - 1
    for row, time_s in enumerate(times):
        known = place[row] >= 0
        extra = [*wind.wind[place[row]], wind.sigma_mps[place[row]]] if known else [math.nan] * 3
        cells = [f"{value:.10g}" if math.isfinite(value) else "" for value in (*found.seconds.values[row], *extra)]
        writer.writerow([f"{time_s:.6f}", *cells])
    return out.getvalue()
