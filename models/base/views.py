"""Notebook views of scenarios and compositions: short text, HTML tables, DataFrames."""

from __future__ import annotations

from html import escape
from typing import TYPE_CHECKING, Any

from skyway.models.base.errors import InputError
from skyway.models.base.units import J_PER_WH

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

    import pandas as pd

    from skyway.models.composition.composition import Composition
    from skyway.models.network.network import Network


def counted(number: int, noun: str) -> str:
    """Return a number with its noun: ``1 drone``, ``2 drones``."""
    return f"{number:,} {noun}" + ("" if number == 1 else "s")


def how_often(number: int) -> str:
    """Return a number of times: ``once``, ``2 times``."""
    return "once" if number == 1 else f"{number:,} times"


def leg_rows(composition: Composition) -> list[dict[str, Any]]:
    """Return one row for each leg, in flying order, with the stop that follows it."""
    stops = {(stop.station, stop.arrive): stop for stop in composition.stops}
    rows = []
    for number, leg in enumerate(composition.services, 1):
        stop = stops.get((leg.destination, leg.arrive))
        rows.append(
            {
                "leg": number,
                "from": leg.origin,
                "via": ", ".join(leg.via),
                "to": leg.destination,
                "depart": leg.depart,
                "arrive": leg.arrive,
                "distance_km": leg.distance_m / 1000.0,
                "ground_speed_mps": leg.ground_speed_mps,
                "wind_mps": leg.wind.speed_mps,
                "wind_from_deg": leg.wind.from_deg,
                "energy_wh": leg.energy_j / J_PER_WH,
                "soc_depart": leg.soc_depart,
                "soc_arrive": leg.soc_arrive,
                "p_reserve": leg.p_reserve,
                "then_wait_s": 0.0 if stop is None else stop.wait_s,
                "then_recharge_s": 0.0 if stop is None else stop.recharge_s,
                "then_hold_s": 0.0 if stop is None else stop.hold_s,
            }
        )
    return rows


def station_rows(network: Network) -> list[dict[str, Any]]:
    """Return one row for each station."""
    fields = ("id", "name", "lat", "lon", "elevation_m", "pads", "holding_spots", "recharge_power_w")
    return [{field: getattr(station, field) for field in fields} for station in network.stations]


def frame(rows: Sequence[Mapping[str, Any]], index: str) -> pd.DataFrame:
    """Return rows as a pandas DataFrame; an `InputError` where pandas is not installed."""
    try:
        import pandas as pd
    except ImportError as error:
        raise InputError(
            "tables need pandas, which is not installed; pip install 'skyway-planner[notebook]'"
        ) from error
    return pd.DataFrame(list(rows)).set_index(index) if rows else pd.DataFrame(index=pd.Index([], name=index))


def html_table(caption: str, rows: Iterable[Mapping[str, Any]]) -> str:
    """Return rows as an HTML table; everything is escaped."""
    rows = list(rows)
    head = "".join(f"<th>{escape(name.replace('_', ' '))}</th>" for name in (rows[0] if rows else ()))
    body = "".join(
        "<tr>" + "".join(f"<td>{escape(_text(value))}</td>" for value in row.values()) + "</tr>" for row in rows
    )
    caption = f"<caption style='text-align:left'>{escape(caption)}</caption>"
    return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _text(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        return f"{value:.3g}" if abs(value) < 100.0 else f"{value:.0f}"
    return value.isoformat(" ", "seconds") if hasattr(value, "isoformat") else str(value)
