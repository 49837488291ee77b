"""Values that are wrong: any field of any message that the supervisor reads, for some packets, by the vehicle or by a forger."""

from __future__ import annotations

import math
from copy import copy
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import TYPE_CHECKING, Any

from branches import Branches

from benchmarks.link.deliveries import Scripted, Stage, Story
from skyway.link.supervisor import read_journal
from skyway.link.wire import frames
from skyway.link.wire.messages import Message
from skyway.sim_stub.wire.messages import Mavlink

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from skyway.sim_stub.wire.ports import Port

PACKETS = (1, 3, 10, 100)
KINDS = ("low", "high", "zero", "plausible", "frozen", "not-a-number")
_ANSWERS = ("COMMAND_ACK", "MISSION_ACK", "MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST", "MISSION_REQUEST_INT",
            "PARAM_VALUE", "STATUSTEXT", "TIMESYNC", "AUTOPILOT_VERSION")  # fmt: skip
"""Answers to questions of ours: what they do is tried by tests of the exchanges."""
PLAUSIBLE: dict[tuple[str, str], Callable[[Any], Any]] = {
    ("HEARTBEAT", "base_mode"): lambda mode: mode ^ 128,
    ("HEARTBEAT", "custom_mode"): lambda mode: 9 if mode < 100 else 6 << 24 | 4 << 16,
    ("HEARTBEAT", "type"): lambda _: 1,
    ("HEARTBEAT", "autopilot"): lambda family: 15 - family,
    ("HEARTBEAT", "system_status"): lambda _: 6,
    ("EXTENDED_SYS_STATE", "landed_state"): lambda state: 3 - state if state in (1, 2) else 1,
    ("EXTENDED_SYS_STATE", "vtol_state"): lambda _: 4,
    ("SYS_STATUS", "battery_remaining"): lambda percent: percent // 4,
    ("SYS_STATUS", "voltage_battery"): lambda millivolts: int(millivolts * 0.9),
    ("SYS_STATUS", "current_battery"): lambda centiamperes: int(centiamperes * 1.6),
    ("GLOBAL_POSITION_INT", "lat"): lambda lat: lat + 30_000,
    ("GLOBAL_POSITION_INT", "lon"): lambda lon: lon - 60_000,
    ("GLOBAL_POSITION_INT", "alt"): lambda alt: alt + 40_000,
    ("GLOBAL_POSITION_INT", "relative_alt"): lambda height: height - 30_000,
    ("GLOBAL_POSITION_INT", "vx"): lambda speed: speed + 1_500,
    ("GLOBAL_POSITION_INT", "vy"): lambda speed: speed - 1_500,
    ("GLOBAL_POSITION_INT", "vz"): lambda speed: speed + 500,
    ("GLOBAL_POSITION_INT", "time_boot_ms"): lambda time: time + 20_000,
    ("ATTITUDE", "roll"): lambda angle: angle + 0.35,
    ("ATTITUDE", "pitch"): lambda angle: angle - 0.35,
    ("ATTITUDE", "yaw"): lambda angle: angle + 1.5,
    ("ATTITUDE", "time_boot_ms"): lambda time: max(time - 60_000, 0),
    ("SYSTEM_TIME", "time_boot_ms"): lambda time: max(time - 60_000, 0),
    ("SYSTEM_TIME", "time_unix_usec"): lambda time: time + 3_600_000_000,
    ("MISSION_CURRENT", "seq"): lambda seq: seq + 1,
    ("WIND", "speed"): lambda speed: speed + 12.0,
    ("WIND", "direction"): lambda direction: direction + 120.0,
    ("WIND_COV", "wind_x"): lambda wind: wind + 12.0,
    ("WIND_COV", "wind_y"): lambda wind: wind - 12.0,
    ("HOME_POSITION", "latitude"): lambda lat: lat + 30_000,
    ("HOME_POSITION", "longitude"): lambda lon: lon + 30_000,
    ("HOME_POSITION", "altitude"): lambda alt: alt + 100_000,
}
"""Values that could be true, by message and field; a quarter more elsewhere."""


class Reading(dict):
    """Fields of a message that note which of them are read."""

    def __init__(self, name: str, fields: dict[str, Any], read: set[tuple[str, str]]) -> None:
        super().__init__(fields)
        self.name, self.read = name, read

    def __getitem__(self, key: str) -> Any:
        self.read.add((self.name, key))
        return super().__getitem__(key)

    def get(self, key: str, default: Any = None) -> Any:
        """As a dict's."""
        if key in self:
            self.read.add((self.name, key))
        return super().get(key, default)


def fields_read(story: Story, folder: Path, monkeypatch: Any) -> list[tuple[str, str]]:
    """Every field of every message that is read in a delivery without a question of ours, found by watching."""

    read: set[tuple[str, str]] = set()
    original = frames.unpack

    def unpack(kind: Any, payload: bytes) -> dict[str, Any]:
        return Reading(kind.name, original(kind, payload), read)

    monkeypatch.setattr(frames, "unpack", unpack)
    folder.mkdir(parents=True, exist_ok=True)
    outcome = Stage(story, folder).fly()
    monkeypatch.setattr(frames, "unpack", original)
    assert outcome.delivered, outcome
    assert Message is frames.Message
    addresses = ("target_system", "target_component")
    return sorted((name, key) for name, key in read if name not in _ANSWERS and key not in addresses)


@dataclass(frozen=True, order=True)
class Wrong:
    """What is wrong, from when on, and for how long.

    Attributes
    ----------
    message, name : str
        Message and field.
    kind : str
        One of `KINDS`, or ``times`` and a factor.
    packets : int
        How many.
    state : str
        From the first packet after `after_s` in this state on.
    forged : bool
        Sent besides the true ones by somebody else, unsigned; otherwise by the vehicle itself instead of them.
    """

    message: str
    name: str
    kind: str
    packets: int
    state: str = "flying"
    after_s: float = 60.0
    forged: bool = False


@dataclass
class Tamper:
    """Does it, at a port of the simulated vehicle.

    Attributes
    ----------
    done : int
        Packets so far.
    """

    wrong: Wrong
    stage: Stage
    port: Port
    done: int = 0
    _first: Any = None
    _since_s: float = math.nan
    _forger: Mavlink = field(default_factory=lambda: Mavlink(1))

    def due(self) -> bool:
        """Whether it is in the state, and long enough."""
        supervisor = self.stage.supervisor
        now = self.stage.lockstep.now_s
        if self.done:
            return self.done < self.wrong.packets
        if supervisor is None or str(supervisor.context.state) != self.wrong.state:
            self._since_s = math.nan
            return False
        self._since_s = now if math.isnan(self._since_s) else self._since_s
        return now >= self._since_s + self.wrong.after_s

    def __call__(self, message: Any) -> Any:
        """Message as it goes out."""
        if message.get_type() != self.wrong.message or not self.due():
            return message
        told = getattr(message, self.wrong.name)
        self._first = told if self._first is None else self._first
        false = copy(message)
        setattr(false, self.wrong.name, self.value(told))
        self.done += 1
        if not self.wrong.forged:
            return false
        self.port.send(self._forger.frame(false))  # just before the true one
        return message

    def value(self, value: Any) -> Any:
        """What is said instead of a value; a message that is packed clips what does not fit."""
        match self.wrong.kind:
            case "low" | "high" as end:
                return (-1.0 if end == "low" else 1.0) * (1e30 if isinstance(value, float) else 2**62)
            case "zero":
                return type(value)(0)
            case "frozen":
                return self._first
            case "not-a-number":
                return math.nan
        if self.wrong.kind.startswith("times "):
            return type(value)(float(self.wrong.kind[6:]) * value)
        told = PLAUSIBLE.get((self.wrong.message, self.wrong.name))
        return type(value)(0.75 * value) if told is None else told(value)


@dataclass(frozen=True)
class Ended:
    """How a delivery with a wrong value ended.

    Attributes
    ----------
    kind : str
        ``delivered``, ``held`` (and delivered on the operator's word), ``stopped`` (on a station, with a reason), else
        what went wrong.
    """

    kind: str
    state: str
    reason: str
    done: tuple[int, ...]


def staged(story: Story, folder: Path, key: bytes | None, tamper: Callable[[Stage, Port], Any]) -> Stage:
    """A stage whose vehicle says what `tamper` makes of it; the operator says go after two minutes of holding."""
    folder.mkdir(parents=True, exist_ok=True)
    story = story if key is None else replace(story, vehicle={**story.vehicle, "signing_key": key})
    stage = Stage(story, folder)
    stage.operator = Scripted(
        lambda question, _: (120.0, "go") if "sending no commands" in question else (0.0, "yes"),
        stage.lockstep.clock.now_s,
    )
    connect = stage.lockstep.connect

    def connected(*given, **how):
        link = connect(*given, **how)
        port = stage.craft.radio.ports[-1]
        told, frame = tamper(stage, port), port.mavlink.frame
        port.mavlink.frame = lambda sent, version: frame(told(sent), version)
        return link

    stage.lockstep.connect = connected
    return stage


def _flown(stage: Stage, tampers: list[Tamper]) -> Ended:
    outcome = stage.fly(on_tick=_bounded)
    stage.lockstep.run_for(0.0 if stage.craft.body.grounded else 1800.0)
    return Ended(_judged(stage, outcome), outcome.state, outcome.reason, tuple(tamper.done for tamper in tampers))


def fly_wrong(story: Story, folder: Path, *wrongs: Wrong, key: bytes | None = None) -> Ended:
    """Fly one delivery in which something is told that is not so."""
    tampers: list[Tamper] = []

    def tamper(stage: Stage, port: Port) -> Any:
        tampers.extend(Tamper(wrong, stage, port) for wrong in wrongs)
        return lambda message: reduce(lambda told, one: one(told), tampers, message)

    return _flown(staged(story, folder, key, tamper), tampers)


def fly_each_wrong(story: Story, folder: Path, wrongs: list[Wrong], *, key: bytes | None = None) -> dict[Wrong, Ended]:
    """How the delivery ends with each of these alone; what comes before them is flown once."""
    waiting: dict[Any, list[Wrong]] = {}
    for wrong in wrongs:
        waiting.setdefault((wrong.state, wrong.after_s), []).append(wrong)
    branches: Branches[Wrong] = Branches(waiting, folder)
    tampers: list[Tamper] = []

    def tamper(stage: Stage, port: Port) -> Any:
        clocks = {moment: Tamper(cases[0], stage, port) for moment, cases in waiting.items()}

        def told(message: Any) -> Any:
            for moment, clock in list(clocks.items()) if branches.mine is None else ():
                if clock.due():
                    del clocks[moment]
                    mine = branches.at(moment, stage)
                    if mine is not None:
                        tampers.append(Tamper(replace(mine, after_s=0.0), stage, port))
                        break
            return reduce(lambda said, one: one(said), tampers, message)

        return told

    stage = staged(story, folder, key, tamper)
    return branches.fly(lambda: _flown(stage, tampers))


def _bounded(ctx: Any) -> None:
    if ctx.clock.now_s() > 24 * 3600.0:
        raise AssertionError(f"no end: {ctx.state}")


def _judged(stage: Stage, outcome: Any) -> str:
    craft = stage.craft
    if craft.autopilot.crashed:
        return "crashed"
    if not craft.body.grounded:
        return "in the air half an hour later"
    if craft.station() is None:
        return "down away from a station"
    records = read_journal(stage.journal_path).records
    held = any(record.event == "state" and record.data["after"] == "holding" for record in records)
    if outcome.delivered:
        arrived = craft.station() == stage.story.to and craft.body.payload_kg == 0.0
        return ("held" if held else "delivered") if arrived else "said to be delivered, and is not"
    if outcome.state == "stopped-safe":
        return "stopped" if outcome.station == craft.station() else "said to stand where it does not"
    return outcome.state
