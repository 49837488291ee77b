"""Status of a flight, written each second to a file beside its orders: where the delivery is, and which commands are possible.

The journal tells what has happened. This file tells what is: it is replaced as a whole, and nothing is decided by it.
"""

from __future__ import annotations

import math
import os
import sys
import time
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.link.supervisor.command.orders import offered
from skyway.link.supervisor.command.request_file import ENDING
from skyway.link.supervisor.flight.known import information
from skyway.link.supervisor.journal.entries import Briefed, CheckDone, LegBegun, StateEntered
from skyway.link.supervisor.states import IN_AIR, TABLE, State
from skyway.models.base.errors import InputError, SkywayError
from skyway.models.base.files import read_bytes
from skyway.models.base.json_text import plain
from skyway.models.base.units import from_posix
from skyway.planner.online.information import FlightMemory

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from skyway.link.supervisor import Outcome, Record
    from skyway.link.supervisor.context import Context

LIVE = ".live"
SCHEMA = "skyway.live/1"
EVERY_S, REFUGES_S = 0.5, 10.0
"""It is written no more often, in seconds of this computer; and where else it could land is computed again, in those of the vehicle."""
MAX_BYTES = 4 * 1024 * 1024
_MEANING = {str(state): rule.meaning for state, rule in TABLE.items()}


class Live(msgspec.Struct, kw_only=True):
    """Status of a delivery. Times are POSIX seconds: `wall_s` of this computer, all others of the vehicle; None is unknown."""

    schema: str = SCHEMA
    pid: int = 0
    words: list[str] = []
    """The command, after ``skyway``."""
    journal: str = ""
    """Name of the journal, in the same folder."""
    wall_s: float = 0.0
    ended: bool = False
    problem: str = ""
    """Why the program ended before the delivery did."""
    time_s: float | None = None
    begun_s: float | None = None
    """When the state began."""
    state: str = "connecting"
    doing: str = ""
    """What the state means, for people."""
    offered: list[str] = []
    """The words that can be said now."""
    question: str | None = None
    question_n: int | None = None
    answers: list[str] = []
    paused: bool = False
    stays: bool = False
    holder: dict[str, str] | None = None
    asker: dict[str, str] | None = None
    """Who has command, and who asks for it: `id` and `name`."""
    origin: str = ""
    destination: str = ""
    """Of the delivery."""
    drone: str = ""
    vehicle: dict[str, Any] = {}
    """Place, height, speeds, charge, mode, radio."""
    wind: dict[str, Any] = {}
    """`measured` and `expected`: speed and direction, or None."""
    checks: list[dict[str, str]] = []
    """The list before the take-off: `name`, `verdict` and `said`."""
    brief: list[str] = []
    parameters: list[dict[str, Any]] = []
    """What a take-off answers to: in lines, and parameters that it sets."""
    leg: dict[str, Any] | None = None
    """The flight under way, or about to begin: its way, what was planned of it, and the spread of that."""
    expected: dict[str, Any] = {}
    """What the last decision expects of it."""
    refuges: list[dict[str, Any]] = []
    """Where else it could land now, and with what."""
    charge_to: float | None = None
    station: str | None = None
    reserve_soc: float | None = None


_DECODER = msgspec.json.Decoder(Live)


def requests_at(orders: Path) -> Path:
    """Check the name of a file of orders."""
    if orders.suffix != ENDING:
        raise InputError("is not a file of orders", field="--orders", value=orders, remedy=f"FILE{ENDING}")
    return orders


def read_live(path: Path) -> Live:
    """Read the state of a flight. Raises an `InputError` if the file is missing, or something else."""
    try:
        return _DECODER.decode(read_bytes(path, max_bytes=MAX_BYTES))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise InputError(f"is not a status of a flight: {error}", str(path)) from error


@contextmanager
def live_file(orders: Path | None) -> Iterator[LiveFile | None]:
    """Publish a flight in ``FILE.live`` beside its orders, to the end; None where no orders are taken from a file."""
    if orders is None:
        yield None
        return
    live = LiveFile(orders.with_suffix(LIVE))
    try:
        yield live
    except BaseException as error:
        live.end(str(error) if isinstance(error, SkywayError) else f"the program ended: {type(error).__name__}")
        raise
    live.end("")


class LiveFile:
    """Writes the status of a flight each second; see `Live`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.live = Live(pid=os.getpid(), words=sys.argv[1:])
        self._context: Context | None = None
        self._refuges_s = -math.inf
        self._written_s = -math.inf

    def doing(self, what: str) -> None:
        """Publish the current activity before there is a journal."""
        self.live.doing = what
        self._write()

    def take(self, record: Record) -> None:
        """Take a record of the journal."""
        live = self.live
        if entered := record.entry(StateEntered):
            live.state, live.begun_s = entered.after or record.state, record.time_s
            live.doing = record.reason or ""
            if live.state == State.PREFLIGHT:
                live.checks, live.brief, live.parameters = [], [], []
        elif check := record.entry(CheckDone):
            one = {"name": check.name or "", "verdict": check.verdict or "", "said": check.said or ""}
            live.checks = [*(other for other in live.checks if other["name"] != check.name), one]
        elif brief := record.entry(Briefed):
            live.brief, live.parameters = list(brief.lines), plain(list(brief.parameters))
        elif begun := record.entry(LegBegun):
            live.leg = {
                "origin": begun.origin, "to": begun.destination, "way": begun.way, "start_s": record.time_s, "soc": begun.soc,
                "planned_s": begun.planned_s, "planned_soc": begun.planned_soc, "planned_soc_sd": begun.planned_soc_sd,
            }  # fmt: skip
        if record.event not in ("track", "truth"):
            self._write()

    def tick(self, ctx: Context) -> None:
        """Take the latest state of the delivery."""
        self._context = ctx
        self.live.journal = ctx.journal.path.name
        if time.monotonic() < self._written_s + EVERY_S:
            return
        self._look(ctx)
        self._write()

    def _look(self, ctx: Context) -> None:
        live, talk, leg = self.live, ctx.conversation, ctx.delivery.leg
        live.time_s, live.offered = ctx.now_s, list(offered(ctx))
        live.state, live.paused, live.stays = str(ctx.state), talk.paused, talk.stays
        live.doing = live.doing or _MEANING.get(live.state, "")
        live.question, live.answers = talk.question, list(talk.answers)
        live.question_n = talk.question_n if talk.question else None
        holder, asker = talk.commander.holder, talk.commander.requester
        live.holder = None if holder is None else {"id": holder.id, "name": holder.name}
        live.asker = None if asker is None else {"id": asker.id, "name": asker.name}
        job = ctx.job
        live.origin, live.destination = job.composition.origin, job.composition.destination
        live.drone, live.reserve_soc = job.request.drone or "", job.request.reserve_soc
        live.charge_to, live.station = ctx.delivery.charge_to, ctx.delivery.station
        live.vehicle, live.wind = _vehicle(ctx), _wind(ctx)
        if ctx.state not in IN_AIR or leg is None:
            live.expected, live.refuges, self._refuges_s = {}, [], -math.inf
            if leg is None:
                live.leg = None
            return
        live.expected = {} if leg.lookahead is None else plain(leg.lookahead.to_json())
        live.leg = (live.leg or {}) | {"way": leg.mission.way, "to": leg.destination}
        if ctx.now_s >= self._refuges_s + REFUGES_S:
            self._refuges_s = ctx.now_s
            live.refuges = refuges(ctx)

    def end(self, problem: str) -> None:
        """Publish the end of the program, with the reason where it was not regular."""
        live = self.live
        live.ended, live.problem, live.offered, live.question = True, problem, [], None
        if self._context is not None:
            live.state = str(self._context.state)
        self._write()

    def outcome(self, outcome: Outcome) -> None:
        """Take how the delivery ended."""
        self.live.state, self.live.doing = outcome.state, outcome.reason

    def _write(self) -> None:
        self._written_s = time.monotonic()
        self.live.wall_s = time.time()
        part = self.path.with_name(f".{self.path.name}.part")
        with suppress(OSError):  # the flight does not depend on it
            part.write_bytes(msgspec.json.encode(plain(self.live)))
            part.replace(self.path)


def _vehicle(ctx: Context) -> dict[str, Any]:
    sample, place, vehicle = ctx.observed.sample, ctx.place, ctx.vehicle
    found: dict[str, Any] = {
        "system": vehicle.system, "autopilot": vehicle.family.name, "mode": vehicle.mode, "armed": vehicle.armed,
        "soc": ctx.battery.soc, "silent_s": round(vehicle.silent_s, 1), "loss": round(vehicle.live.loss, 3),
        "radios": [str(radio) for radio in vehicle.connection.qualities],
        "remote_id": str(ctx.remote_id.status(ctx)),
        "lat": None if place is None else place[0], "lon": None if place is None else place[1],
        "traffic": [str(one) for one in vehicle.traffic.near(vehicle.connection.clock.now_s())],
    }  # fmt: skip
    if sample is not None:
        course = math.degrees(math.atan2(sample.vel_east_mps, sample.vel_north_mps)) % 360.0
        found |= {
            "height_m": sample.height_m, "ground_speed_mps": sample.ground_speed_mps, "course_deg": course,
            "yaw_deg": math.degrees(sample.yaw_rad) % 360.0,
        }  # fmt: skip
    return found


def _wind(ctx: Context) -> dict[str, Any]:
    estimate, sample = ctx.wind.estimate if ctx.in_air else None, ctx.observed.sample
    found: dict[str, Any] = {"measured": None, "expected": None}
    if estimate is not None:
        found["measured"] = {
            "north_mps": estimate.north_mps, "east_mps": estimate.east_mps, "sigma_mps": estimate.sigma_mps,
            "source": estimate.source,
        }  # fmt: skip
    if sample is not None and ctx.place is not None:
        north, east = ctx.wind.expected(sample.time_s, *ctx.place)
        found["expected"] = {"north_mps": north, "east_mps": east}
    return found


def refuges(ctx: Context) -> list[dict[str, Any]]:
    """Other possible landing places now, with the charge there, by the newest forecast; their present queues are not requested."""
    known = information(ctx, FlightMemory(), {})
    if known is None:
        return []
    return [
        {
            "station": one.station, "left_s": one.lands_s - ctx.now_s, "soc_land": one.soc, "p_below_reserve": one.p_below,
            "p_empty": one.p_empty, "lands": from_posix(one.lands_s).isoformat(),
        }
        for one in ctx.policy().refuges(known)
    ]  # fmt: skip
