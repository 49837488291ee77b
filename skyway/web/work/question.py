"""Requests of the pages plan and recharge, in the terms of the commands, and the equivalent command."""

from __future__ import annotations

import shlex
from contextlib import suppress
from typing import Any

import msgspec

from skyway.planner.problem.request import NEAREST_PAD
from skyway.planning import Conditions, Delivery, Pads
from skyway.web.work.weather_and_zones import given

ROBUST = "robust"
OF_SCENARIO = "scenario"
"""Pads of the scenario that the page was started with."""
MOST_PLANS = 4
"""Number of plans side by side."""
YES = "yes"
"""A box that is ticked, in an address."""
MOST_TYPED, MOST_PLACES = 300, 20_000
"""Characters of a value, and of all places of pads, in an address."""


class Question(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A delivery to be planned; every value as typed."""

    start: str = ""
    to: str = ""
    payload: str = "0.8"
    """Kilograms."""
    depart: str = ""
    """With UTC offset; empty is now."""
    window: str = ""
    """Choose the best departure within this time: 90min, 2h."""
    deadline: str = ""
    """With UTC offset: optimise the probability of arrival by then; empty optimises the mean arrival."""
    not_before: str = ""
    """With UTC offset: earliest arrival of the package; empty means any time."""
    aim: str = ""
    """Objective as on a command line; a deadline has precedence. Empty optimises the mean arrival."""
    drone: str = ""
    """Empty leaves the choice to the planner."""
    planner: str = ROBUST
    others: tuple[str, ...] = ()
    """Planners for comparison; the first three."""
    alternatives: int = 3
    """Largest number of plans by `robust`, the best one included."""
    reserve: str = "20"
    soc: str = "100"
    """Percent."""
    airspeed: str = ""
    """m/s; empty is the drone's."""
    wind: str = ""
    """One constant wind, m/s@degrees FROM; empty is the forecast."""
    return_to: str = ""
    """Destination of the drone after the delivery: home, none, a station; empty is the nearest pad."""
    dwell: str = ""
    """Time at the target: 5min."""
    if_undelivered: str = ""
    """Destination of a package that cannot be delivered: back, a station; empty keeps no reserve for it."""
    avoid: tuple[str, ...] = ()
    """Stations not to land at, and segments, as FROM:TO, not to fly."""
    stop_at: tuple[str, ...] = ()
    """Stations at which the drone must stop, in this order."""

    @classmethod
    def of_address(cls, query: dict[str, str]) -> Question:
        """Return the request in the address of the page; unknown fields are ignored."""
        usual = msgspec.to_builtins(cls())
        found: dict[str, Any] = {}
        for name, value in query.items():
            if name not in usual or len(value) > 500:
                continue
            if isinstance(usual[name], (list, tuple)):
                found[name] = [one for one in value.split(" ") if one]
            elif isinstance(usual[name], int):
                found[name] = int(value) if value.isdigit() and 1 <= int(value) <= MOST_PLANS else usual[name]
            else:
                found[name] = value
        return msgspec.convert(found, cls)

    def query(self) -> dict[str, str]:
        """Return the same request for the address of the page."""
        usual = Question()
        return {
            name: " ".join(value) if isinstance(value, tuple) else str(value)
            for name, value in msgspec.structs.asdict(self).items()
            if value != getattr(usual, name)
        }

    @property
    def complete(self) -> bool:
        """Whether there is something to plan."""
        return bool(self.start.strip() and self.to.strip())

    def delivery(self) -> Delivery:
        """Return the delivery. Raises an `InputError` naming values that are not numbers."""
        return Delivery(
            start=self.start.strip(), to=self.to.strip(), payload=number(self.payload, "--payload"),
            not_before=self.not_before.strip() or None, drone=self.drone or None, reserve=number(self.reserve, "--reserve"), soc=number(self.soc, "--soc"), stop_at=list(self.stop_at),
            airspeed=number(self.airspeed, "--airspeed") if self.airspeed.strip() else None,
            return_to=self.return_to.strip() or NEAREST_PAD, dwell=self.dwell.strip() or None, if_undelivered=self.if_undelivered.strip() or None,
        )  # fmt: skip

    def conditions(self) -> dict[str, Any]:
        """Return departure and wind: fields of `skyway.planning.Conditions`."""
        return {"depart": self.depart.strip() or None, "wind": self.wind.strip() or None, "avoid": list(self.avoid)}

    @property
    def objective(self) -> str:
        """In the form of ``--objective``."""
        return f"on-time {self.deadline.strip()}" if self.deadline.strip() else self.aim.strip() or "mean"

    def command(self, scenario: str | None, planner: str | None = None) -> str:
        """Return the equivalent planning command, for a shell."""
        words = ["skyway", "plan", *([] if scenario is None else [scenario])]
        words += ["--from", self.start.strip(), "--to", self.to.strip(), "--payload", _point(self.payload)]
        named = {
            "--depart": self.depart, "--depart-window": self.window, "--drone": self.drone, "--airspeed": _point(self.airspeed),
            "--wind": self.wind, "--not-before": self.not_before, "--return": self.return_to, "--dwell": self.dwell,
            "--if-undelivered": self.if_undelivered,
        }  # fmt: skip
        for option, value in named.items():
            words += [option, value.strip()] if value.strip() else []
        for option, value, usual in (("--reserve", self.reserve, "20"), ("--soc", self.soc, "100")):
            words += [option, _point(value)] if _point(value) != usual else []
        words += ["--objective", self.objective] if self.objective != "mean" else []
        words += [word for one in self.avoid for word in ("--avoid", one)]
        words += [word for one in self.stop_at for word in ("--stop-at", one)]
        words += given().words()
        chosen = planner or self.planner
        words += ["--planner", chosen] if chosen != ROBUST else []
        if chosen == ROBUST:
            words += ["--alternatives", str(self.alternatives)] if self.alternatives > 1 else []
            words += ["--explain"]
        return shlex.join(words)


class Put(msgspec.Struct, frozen=True):
    """A pad at a place chosen by a person."""

    id: str
    lat: float
    lon: float

    @property
    def is_place(self) -> bool:
        """Whether it is a place on the earth."""
        return abs(self.lat) <= 90.0 and abs(self.lon) <= 180.0


class Cut(msgspec.Struct, frozen=True, kw_only=True):
    """A mission to be cut; every value as typed, files by their paths."""

    mission: str = ""
    pads: str = ""
    """A file of stations, or `OF_SCENARIO`."""
    vans: str = ""
    put: tuple[Put, ...] = ()
    """Pads of the file that were moved, and new ones."""
    drone: str = ""
    autopilot: str = ""
    wind: str = ""
    depart: str = ""
    payload: str = "0"
    soc: str = "100"
    reserve: str = "20"
    swap: str = ""
    packs: str = ""
    chargers: str = ""
    laps: str = "1"
    home: str = ""
    home_elevation: str = ""
    level_ground: bool = False
    reorder: bool = False

    @classmethod
    def of_address(cls, query: dict[str, str]) -> Cut:
        """Return the request in the address of the page; unknown fields, and places that are none, are ignored."""
        usual = msgspec.structs.asdict(cls())
        found: dict[str, Any] = {}
        for name, value in query.items():
            if name == "put" and len(value) <= MOST_PLACES:
                with suppress(msgspec.DecodeError, RecursionError):
                    found[name] = tuple(one for one in msgspec.json.decode(value, type=tuple[Put, ...]) if one.is_place)
            elif isinstance(usual.get(name), bool):
                found[name] = value == YES
            elif isinstance(usual.get(name), str) and len(value) <= MOST_TYPED:
                found[name] = value
        return cls(**found)

    def query(self) -> dict[str, str]:
        """Return the same request for the address of the page."""
        usual, found = msgspec.structs.asdict(Cut()), {}
        for name, value in msgspec.structs.asdict(self).items():
            if value != usual[name]:
                places = name == "put"
                found[name] = msgspec.json.encode(value).decode() if places else YES if value is True else value
        return found

    def command(self, scenario: str | None, pads: str, folder: str) -> str:
        """Return the equivalent command; `pads` is the file in which the pads are saved."""
        words = ["skyway", "recharge", self.mission]
        named = {
            "--pads": (scenario or "newyork") if pads == OF_SCENARIO else pads, "--vans": self.vans, "--drone": self.drone,
            "--autopilot": self.autopilot, "--wind": self.wind, "--depart": self.depart, "--swap": self.swap, "--packs": self.packs, "--chargers": self.chargers, "--home": self.home,
            "--home-elevation": self.home_elevation,
        }  # fmt: skip
        for option, value in named.items():
            words += [option, value.strip()] if value.strip() else []
        for name, usual in (("payload", "0"), ("soc", "100"), ("reserve", "20"), ("laps", "1")):
            value = str(getattr(self, name)).strip().replace(",", ".")
            words += [f"--{name}", value] if value != usual else []
        words += ["--level-ground"] * self.level_ground + ["--reorder"] * self.reorder
        return shlex.join([*words, "-o", folder])


def number(text: str, option: str) -> float:
    """Return a number as typed, with a comma or a point; an `InputError` names the option."""
    from skyway.models.base.errors import InputError
    from skyway.models.base.fields import finite

    value = finite(_point(text))
    if value is None:
        raise InputError("is not a number", field=option, value=text)
    return value


def _point(text: str) -> str:
    """Return a number in the form of the command line: with a point."""
    return text.strip().replace(",", ".")


def pads() -> Pads:
    """Known state of the pads: given on the page, otherwise by the scenario."""
    return Pads(pads=given().pads or None)


def conditions(question: Question, scenario: str | None) -> Conditions:
    """Return time, place and wind."""
    from pathlib import Path

    return Conditions(
        scenario=None if scenario is None else Path(scenario), **(given().weather() | question.conditions())
    )
