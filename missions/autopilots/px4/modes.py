"""PX4's flight modes: a main mode in byte 2 of ``custom_mode``, and a sub mode of AUTO in byte 3."""

from __future__ import annotations

from skyway.missions.autopilots.modes import Modes

_AUTO = 4
_MAIN = {
    1: "manual",
    2: "altitude",
    3: "position",
    5: "acro",
    6: "offboard",
    7: "stabilized",
    8: "rattitude",
    10: "termination",
    11: "altitude cruise",
}
_SUB = {
    1: "ready",
    2: "takeoff",
    3: "hold",
    4: "mission",
    5: "return",
    6: "land",
    8: "follow",
    9: "precision land",
    10: "VTOL takeoff",
}
_NAMES = {main << 16: name for main, name in _MAIN.items()} | {_AUTO << 16 | s << 24: name for s, name in _SUB.items()}
_SHARED = ("hold", "mission", "return", "land", "position")


def _command(custom_mode: int) -> tuple[float, float]:
    """Main and sub mode, each a parameter of its own."""
    return float(custom_mode >> 16 & 0xFF), float(custom_mode >> 24)


def _log_name(kind: str, custom_mode: int) -> str | None:  # noqa: ARG001  one table for all vehicles
    main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
    return _SUB.get(sub) if main == _AUTO else _MAIN.get(main)


_NUMBERS = {name: number for number, name in _NAMES.items() if name in _SHARED}
MODES = Modes(_NUMBERS | {"guided": _NUMBERS["hold"]}, _NAMES, _command, _log_name)
