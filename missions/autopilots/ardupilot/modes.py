"""ArduPilot's flight modes: one number, with a different meaning in each of its firmwares; live ones are Copter's."""

from __future__ import annotations

from functools import cache

from skyway.missions.autopilots.modes import Modes

_NUMBERS = {"mission": 3, "guided": 4, "position": 5, "return": 6, "land": 9, "hold": 17}
_NAMES = {number: name for name, number in _NUMBERS.items()} | {
    0: "stabilize",
    1: "acro",
    2: "altitude",
    7: "circle",
    16: "position hold",
    21: "smart return",
    27: "auto return",
}
_ON_ROTORS = (17, 18, 19, 20, 21, 22, 23)
"""ArduPlane's modes in which it flies on rotors: QSTABILIZE to QACRO."""


@cache
def _names_in_logs(kind: str) -> dict[int, str]:
    from pymavlink import mavutil

    names = {
        "multirotor": mavutil.mode_mapping_acm,
        "helicopter": mavutil.mode_mapping_acm,
        "fixed wing": mavutil.mode_mapping_apm,
        "VTOL": mavutil.mode_mapping_apm,
        "rover": mavutil.mode_mapping_rover,
        "boat": mavutil.mode_mapping_rover,
        "submarine": mavutil.mode_mapping_sub,
        "airship": mavutil.mode_mapping_blimp,
    }
    return dict(names.get(kind, {}))


MODES = Modes(
    _NUMBERS, _NAMES, lambda mode: (float(mode),), lambda kind, mode: _names_in_logs(kind).get(mode), _ON_ROTORS
)
