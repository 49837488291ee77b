"""Health records of vehicles in a file of the work folder: checks by day, and the vibration of the last flight."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import msgspec

from skyway.link.protocol.command import Command
from skyway.link.telemetry.vehicle_monitor import INTERVAL
from skyway.link.vehicle.health import HealthItem, Verdict, Vibration
from skyway.models.base.errors import InputError
from skyway.models.base.files import file_error
from skyway.models.base.units import from_posix, iso, parse_instant

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date, datetime, tzinfo
    from pathlib import Path

    from skyway.link.protocol.connection import Peer
    from skyway.link.vehicle.vehicle import Vehicle
    from skyway.link.wire.messages import Message

NAME = "vehicle-health.jsonl"
_MAX_BYTES = 20_000_000
_MOST_VALUES = 20_000
_EXCEEDED = 0.95
_VIBRATION, _EACH_US = 241, 1e6


class ItemKept(msgspec.Struct, frozen=True, kw_only=True):
    """One item of a check."""

    name: str
    verdict: Verdict
    said: str
    needed: bool = True


class CheckKept(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag="skyway.health-check/1"):
    """A check of a vehicle; `uid` its hardware id in hexadecimal digits, `time` UTC."""

    uid: str
    time: str
    ok: bool
    items: tuple[ItemKept, ...]


class ShakeKept(msgspec.Struct, frozen=True, kw_only=True, tag_field="schema", tag="skyway.health-flight/1"):
    """Vibration of a vehicle on a flight that ended at `time`."""

    uid: str
    time: str
    worst_mps2: float
    clips: int


Kept = CheckKept | ShakeKept


class HealthBook:
    """The file in a folder; a vehicle without a hardware id is not in it."""

    def __init__(self, folder: Path, zone: tzinfo | None = None) -> None:
        self.path, self._zone = folder / NAME, zone

    def passed_today(self, uid: int, now_s: float) -> CheckKept | None:
        """Return the last check of a vehicle, where it was today, by the clock of the zone, and found it good.

        One that is later than now is of another clock, as of a simulation, and does not count.
        """
        checks = [one for one in self._of(uid) if isinstance(one, CheckKept)]
        last = checks[-1] if checks else None
        if last is None or not last.ok:
            return None
        then, now = parse_instant(last.time), from_posix(now_s)
        return last if then <= now and self._day(then) == self._day(now) else None

    def last_flight(self, uid: int) -> Vibration | None:
        """Vibration of a vehicle on its last flight; None where none was monitored."""
        flights = [one for one in self._of(uid) if isinstance(one, ShakeKept)]
        return Vibration(flights[-1].worst_mps2, flights[-1].clips) if flights else None

    def add(self, uid: int, now_s: float, items: Sequence[HealthItem]) -> None:
        """Keep a check."""
        kept = tuple(ItemKept(name=one.name, verdict=one.verdict, said=one.said, needed=one.needed) for one in items)
        self._write(
            uid, CheckKept(uid=f"{uid:016x}", time=iso(from_posix(now_s)), ok=all(one.ok for one in items), items=kept)
        )

    def flew(self, uid: int, now_s: float, shook: Vibration) -> None:
        """Keep how it shook."""
        self._write(
            uid,
            ShakeKept(
                uid=f"{uid:016x}", time=iso(from_posix(now_s)), worst_mps2=round(shook.worst_mps2, 2), clips=shook.clips
            ),
        )

    def _day(self, instant: datetime) -> date:
        return instant.astimezone(self._zone).date()

    def _of(self, uid: int) -> list[Kept]:
        """What is kept of a vehicle; lines that make no sense are omitted."""
        if not uid:
            return []
        try:
            with self.path.open("rb") as stream:
                lines = stream.read(_MAX_BYTES).splitlines()
        except FileNotFoundError:
            return []
        except OSError as error:
            raise file_error("read", self.path, error) from error
        return [one for line in lines if (one := _kept(line)) is not None and one.uid == f"{uid:016x}"]

    def _write(self, uid: int, kept: Kept) -> None:
        if not uid:
            return
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with self.path.open("ab") as stream:
                stream.write(msgspec.json.encode(kept) + b"\n")
        except OSError as error:
            raise file_error("written", self.path, error) from error


def _kept(line: bytes) -> Kept | None:
    try:
        found: Kept = msgspec.json.decode(line, type=Kept)
        parse_instant(found.time)
    except (msgspec.DecodeError, UnicodeDecodeError, InputError):
        return None
    return found


class VibrationWatch:
    """Records the vibration of a vehicle while it is armed; requests VIBRATION once a second."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._values: list[float] = []
        self._clips: list[int] = []
        vehicle.connection.listeners.append(self._hear)
        vehicle.carry_out(Command(vehicle.peer.target, INTERVAL, float(_VIBRATION), _EACH_US))

    def end(self) -> Vibration | None:
        """Stop listening; returns how it shook, None where it did not tell."""
        self._vehicle.connection.listeners.remove(self._hear)
        if not self._values:
            return None
        ordered = sorted(self._values)
        worst = ordered[min(int(_EXCEEDED * len(ordered)), len(ordered) - 1)]
        return Vibration(worst, max(self._clips[-1] - self._clips[0], 0))

    def _hear(self, peer: Peer, message: Message) -> None:
        if message.name != "VIBRATION" or peer is not self._vehicle.peer or not self._vehicle.armed:
            return
        fields: dict[str, Any] = message.fields
        worst = max(abs(float(fields[name])) for name in self._vehicle.family.vibration_fields)
        if not math.isfinite(worst) or len(self._values) >= _MOST_VALUES:
            return
        self._values.append(worst)
        self._clips.append(sum(int(fields[f"clipping_{number}"]) for number in range(3)))
