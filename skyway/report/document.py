"""The document ``skyway.flight/1``: what was planned and what happened, from the journal of a flight.

Every figure is the journal's, or is computed from its figures; what it does not tell is None.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from skyway.report import fields as of
from skyway.report.series import series_of, wind_errors

if TYPE_CHECKING:
    from skyway.link.supervisor.journal import Record

SCHEMA = "skyway.flight/1"
END_WORDS = ("delivered", "stopped-safe", "landed-elsewhere", "crashed", "left-to-itself")
_QUIET = frozenset({"track", "truth"})
_MAX_ROWS = 20_000
_LANDING_S = 15.0


def flight_document(records: tuple[Record, ...], plan: dict[str, Any] | None = None) -> dict[str, Any]:
    """Return the document of a flight.

    Parameters
    ----------
    records : tuple of Record
        The journal, as `link.supervisor.read_journal` reads it.
    plan : dict, optional
        Composition to compare with; without it, the one that the journal begins with.
    """
    start = records[0].data
    planned = plan or of.table(start, "composition")
    series = series_of(records)
    legs = _legs(records, series)
    stops = _stops(records)
    return {
        "schema": SCHEMA,
        "delivery": _delivery(records, planned),
        "outcome": _outcome(records),
        "planned": _planned(planned),
        "totals": _totals(records, planned, legs, stops),
        "legs": legs,
        "stops": stops,
        "decisions": [_decision(at_s, record) for at_s, record in _of(records, "decision")],
        "plans": _plans(records),
        "preflights": [_preflight(at_s, record) for at_s, record in _of(records, "preflight")],
        "contingencies": _contingencies(records),
        "events": _events(records),
        "series": series,
    }


def _of(records: tuple[Record, ...], event: str) -> list[tuple[float, Record]]:
    return [(at_s, record) for at_s, record in of.timed(records) if record.event == event]


def _delivery(records: tuple[Record, ...], planned: dict[str, Any]) -> dict[str, Any]:
    """Return what was to be delivered, by what, and under which settings."""
    start = records[0].data
    met = next((record for record in records if record.event == "vehicle"), None)
    scenario = of.table(planned, "scenario")
    return {
        "from": of.text(planned, "from"),
        "to": of.text(planned, "to"),
        "drone": of.text(planned, "drone"),
        "drone_name": of.text(of.table(planned, "drone_parameters"), "name"),
        "vehicle": None if met is None else met.reason,
        "autopilot": None if met is None else of.text(met.data, "autopilot"),
        "payload_kg": of.number(planned, "payload_kg"),
        "reserve_soc": of.share(start, "reserve_soc"),
        "planner": of.text(start, "planner"),
        "supervised": of.truth(start, "supervised"),
        "asking": of.text(start, "asking"),
        "forecast": of.table(start, "forecast"),
        "scenario": {"path": of.text(scenario, "path"), "sha256": of.text(scenario, "sha256")},
    }


def _outcome(records: tuple[Record, ...]) -> dict[str, Any]:
    """Return how it ended, or that it has not."""
    last = records[-1]
    end = next((record for record in reversed(records) if record.event == "end"), None)
    ended = end is not None and end is last
    state = of.text(last.data, "outcome") if ended else None
    state = state or last.state
    return {
        "ended": ended,
        "state": state,
        "delivered": ended and state == "delivered",
        "reason": _reason(records, ended=ended),
        "station": of.text(last.data, "station") if ended else _last_station(records),
        "time": last.time,
        "flights": max((record.flight for record in records), default=0),
        "resumed": sum(1 for r in records if r.event == "resume" and r.data.get("last") is not None),
    }


def _reason(records: tuple[Record, ...], *, ended: bool) -> str | None:
    """Why it ended: the last sentence; where it has not ended, the last thing that happened."""
    if ended and records[-1].reason:
        return records[-1].reason
    return next((r.reason for r in reversed(records) if r.reason and r.event not in _QUIET), None)


def _last_station(records: tuple[Record, ...]) -> str | None:
    """Where it stood last; None where it has taken off since."""
    for record in reversed(records):
        if record.event == "leg":
            return None
        if record.event in ("landed", "plan"):
            return of.text(record.data, "station")
    return None


def _planned(planned: dict[str, Any]) -> dict[str, Any]:
    """Return the plan: legs, stops and stations, as numbers or None."""
    legs = [
        {
            "from": of.text(leg, "from"), "to": of.text(leg, "to"), "via": of.words(leg, "via"),
            "depart_s": of.instant_s(leg.get("depart")), "arrive_s": of.instant_s(leg.get("arrive")),
            "flight_s": of.number(leg, "flight_time_s"), "distance_m": of.number(leg, "distance_m"),
            "soc_depart": of.share(leg, "soc_depart"), "soc_arrive": of.share(leg, "soc_arrive"),
            "ground_speed_mps": of.number(leg, "ground_speed_mps"), "p_reserve": of.share(leg, "p_reserve"),
        }
        for leg in of.tables(planned, "legs")
    ]  # fmt: skip
    stops = [
        {
            "station": of.text(stop, "station"), "arrive_s": of.instant_s(stop.get("arrive")),
            "leave_s": of.instant_s(stop.get("leave")), "wait_s": of.number(stop, "wait_s"),
            "charge_s": of.number(stop, "recharge_s"), "soc_from": of.share(stop, "soc_from"),
            "soc_to": of.share(stop, "soc_to"),
        }
        for stop in of.tables(planned, "stops")
    ]  # fmt: skip
    stations = {}
    for name, station in of.table(planned, "stations").items():
        if isinstance(station, dict) and (at := of.place(station.get("lat"), station.get("lon"))) is not None:
            stations[str(name)[: of.LONGEST]] = {"lat": at[0], "lon": at[1], "name": of.text(station, "name")}
    keys = ("cruise_height_m", "climb_rate_mps", "descent_rate_mps", "airspeed_mps")
    return {"legs": legs, "stops": stops, "stations": stations} | {key: of.number(planned, key) for key in keys}


def _totals(
    records: tuple[Record, ...], planned: dict[str, Any], legs: list[dict[str, Any]], stops: list[dict[str, Any]]
) -> dict[str, Any]:
    """Return times and charges of the whole, planned and actual."""
    begun, last_s = of.instant_s(planned.get("depart")), of.instant_s(records[-1].time)
    took_off = next((leg["depart_s"] for leg in legs), None)
    flown = [leg["flight_s"] for leg in legs if leg["flight_s"] is not None]
    lowest = [leg["soc_land"] for leg in legs if leg["soc_land"] is not None]
    arrival = of.table(planned, "arrival")
    return {
        "planned": {
            "depart_s": begun, "delivery_s": of.number(planned, "delivery_time_s"),
            "flight_s": of.number(planned, "flight_time_s"), "wait_s": of.number(planned, "wait_time_s"),
            "charge_s": of.number(planned, "recharge_time_s"), "lowest_soc": of.share(planned, "min_soc"),
            "flights": len({stop["station"] for stop in of.tables(planned, "stops") if "station" in stop}) + 1
            if of.tables(planned, "legs") else None,
            "arrive_mean_s": of.instant_s(arrival.get("mean")),
            "arrive_p50_s": of.instant_s(arrival.get("p50")), "arrive_p95_s": of.instant_s(arrival.get("p95")),
        },
        "actual": {
            "depart_s": took_off,
            "delivery_s": None if took_off is None or last_s is None else last_s - took_off,
            "flight_s": sum(flown) if flown else None,
            "wait_s": sum(stop["wait_s"] for stop in stops),
            "charge_s": sum(stop["charge_s"] for stop in stops),
            "lowest_soc": min(lowest) if lowest else None,
            "flights": len(legs),
        },
    }  # fmt: skip


def _legs(records: tuple[Record, ...], series: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the flights: what was planned at the take-off, and what came of it."""
    legs: list[dict[str, Any]] = []
    for at_s, record in of.timed(records):
        data = record.data
        if record.event == "leg":
            legs.append(
                {
                    "flight": record.flight, "from": of.text(data, "origin"), "to": of.text(data, "destination"),
                    "via": of.words(data, "via"), "depart_s": at_s, "land_s": None, "landed_at": None,
                    "as_planned": None, "planned_s": of.number(data, "planned_s"), "flight_s": None,
                    "soc_depart": of.share(data, "soc"), "planned_soc": of.share(data, "planned_soc"),
                    "soc_land": None, "used_soc": None, "modelled_soc": None, "diverts": of.words(data, "diverts"),
                    "ground_speed_mps": of.number(data, "ground_speed_mps"), "way": of.places(data, "way"),
                    "forecast": {
                        "words": of.forecast_words(of.table(data, "wind"), ""), "origin": of.text(data, "wind_origin"),
                    },
                }
            )  # fmt: skip
        elif record.event == "landed" and legs and legs[-1]["land_s"] is None:
            legs[-1] |= {
                "land_s": at_s, "landed_at": of.text(data, "station"), "as_planned": of.truth(data, "planned"),
                "flight_s": of.number(data, "flight_s"), "soc_land": of.share(data, "soc"),
            }  # fmt: skip
        elif record.event == "energy" and legs and legs[-1]["flight"] == record.flight:
            legs[-1] |= {"used_soc": of.number(data, "used_soc"), "modelled_soc": of.number(data, "modelled_soc")}
    for leg in legs:
        leg["wind"] = {"forecast": leg.pop("forecast")} | wind_errors(series, leg["depart_s"], leg["land_s"])
        leg["most_cross_track_m"] = _largest(series["track"], "cross_track_m", leg["depart_s"], leg["land_s"])
    return legs


def _largest(track: dict[str, list[Any]], name: str, begin_s: float, end_s: float | None) -> float | None:
    found = [
        value
        for at_s, value in zip(track["time_s"], track[name], strict=True)
        if value is not None and begin_s <= at_s and (end_s is None or at_s <= end_s)
    ]
    return max(found, default=None)


def _stops(records: tuple[Record, ...]) -> list[dict[str, Any]]:
    """Return the times on the ground: how long it waited, how long it charged and to what.

    The start is one where it waited or charged; the customer is none where it was delivered.
    """
    times = [at_s for at_s, _ in of.timed(records)]
    if not times:
        return []
    stops = [_stop(of.text(of.table(records[0].data, "composition"), "from"), times[0], None)]
    entered: tuple[float, str] | None = None
    for at_s, record in of.timed(records):
        current = stops[-1] if stops[-1]["leave_s"] is None else None
        if record.event == "landed":
            stops.append(_stop(of.text(record.data, "station"), at_s, of.share(record.data, "soc")))
        elif record.event == "leg" and current is not None:
            current |= {"leave_s": at_s, "soc_to": of.share(record.data, "soc")}
        elif record.event == "state":
            _count(current, entered, at_s)
            entered = (at_s, record.state)
        elif record.event == "track" and current is not None and current["soc_from"] is None:
            current["soc_from"] = of.share(record.data, "soc")
    if stops[-1]["leave_s"] is None:
        _count(stops[-1], entered, times[-1])
        if len(stops) > 1 and _outcome(records)["delivered"]:
            stops.pop()
    first = stops[0]
    return stops if first["wait_s"] + first["charge_s"] > 0.0 else stops[1:]


def _stop(station: str | None, arrive_s: float, soc: float | None) -> dict[str, Any]:
    return {
        "station": station, "arrive_s": arrive_s, "leave_s": None, "wait_s": 0.0, "charge_s": 0.0, "soc_from": soc,
        "soc_to": None,
    }  # fmt: skip


def _count(stop: dict[str, Any] | None, entered: tuple[float, str] | None, until_s: float) -> None:
    """Add the time in a state to the stop it was spent at."""
    key = {"waiting-for-pad": "wait_s", "charging": "charge_s"}.get(entered[1]) if entered else None
    if stop is not None and entered is not None and key is not None:
        stop[key] += max(until_s - max(entered[0], stop["arrive_s"]), 0.0)


def _decision(at_s: float, record: Record) -> dict[str, Any]:
    figures = {
        key: value
        for key in record.data
        if key not in ("action", "where") and (value := of.number(record.data, key)) is not None
    }
    return {
        "time_s": at_s, "flight": record.flight, "state": record.state, "action": of.text(record.data, "action"),
        "where": of.text(record.data, "where"), "reason": record.reason, "new_plan": of.truth(record.data, "new_plan"),
        "figures": figures,
    }  # fmt: skip


def _plans(records: tuple[Record, ...]) -> list[dict[str, Any]]:
    """Return the plans that came into force, each as its route."""
    found = []
    for at_s, record in _of(records, "plan"):
        legs = of.tables(of.table(record.data, "plan"), "legs")
        route = [of.text(legs[0], "from") or "unknown"] if legs else []
        for leg in legs:
            route += [f"({name})" for name in of.words(leg, "via")] + [of.text(leg, "to") or "unknown"]
        found.append({"time_s": at_s, "reason": record.reason, "route": route})
    return found


def _preflight(at_s: float, record: Record) -> dict[str, Any]:
    checks = [
        {key: of.text(check, key) for key in ("name", "verdict", "said")} for check in of.tables(record.data, "checks")
    ]
    return {"time_s": at_s, "flight": record.flight, "reason": record.reason, "checks": checks}


def _contingencies(records: tuple[Record, ...]) -> list[dict[str, Any]]:
    """Return what was not meant to happen: diverts, lost links, foreign commands, reboots, resumes."""
    found = []
    landings = [at_s for at_s, record in of.timed(records) if record.event == "landed"]
    for at_s, record in of.timed(records):
        data, event = record.data, record.event
        foreign = event == "change" and of.truth(data, "ours") is False
        if foreign and data.get("after") == "disarmed" and any(abs(at_s - t) <= _LANDING_S for t in landings):
            continue  # an autopilot disarms itself when it has landed
        turned = event == "decision" and data.get("action") in ("divert", "land", "stop")
        entered = event == "state" and data.get("after") in ("lost-link", "holding", "diverting", *END_WORDS[1:])
        if foreign or turned or entered or event in ("turn", "reboot", "link", "resume"):
            found.append({"time_s": at_s, "flight": record.flight, "event": event, "reason": record.reason})
    return found[:_MAX_ROWS]


def _events(records: tuple[Record, ...]) -> list[dict[str, Any]]:
    return [
        {"n": record.n, "time_s": at_s, "state": record.state, "event": record.event, "flight": record.flight,
         "reason": record.reason}
        for at_s, record in of.timed(records) if record.event not in _QUIET
    ][:_MAX_ROWS]  # fmt: skip
