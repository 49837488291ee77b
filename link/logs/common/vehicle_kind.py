"""Kind of the vehicle in a log: from its own reports, firmware and parameters.

Wind is estimated only from a multirotor's lean, and from the airspeed of a wing with an airspeed sensor; for any other, or an unknown
kind, there is no wind.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Literal, get_args

from skyway.models.base.json_text import HIDDEN

Kind = Literal["multirotor", "fixed wing", "VTOL", "helicopter", "rover", "boat", "submarine", "airship", "unknown"]
KINDS: tuple[Kind, ...] = get_args(Kind)
MAV_KINDS: dict[int, Kind] = {
    1: "fixed wing",
    **dict.fromkeys((2, 13, 14, 15, 29, 35, 43), "multirotor"),
    **dict.fromkeys((3, 4), "helicopter"),
    **dict.fromkeys((7, 8), "airship"),
    **dict.fromkeys((10, 46), "rover"),
    11: "boat",
    12: "submarine",
    **dict.fromkeys((19, 20, 21, 22, 23, 24, 25, 47), "VTOL"),
}
"""MAV_TYPE of HEARTBEAT, of PX4's parameter ``MAV_TYPE`` and its ``vehicle_status.system_type``."""
TILTING_TYPES = (19, 20, 21, 23, 24)
"""MAV_TYPE of a VTOL whose body or rotors tilt: its lean in a hover is not that of a multirotor."""
_FIRMWARE: tuple[tuple[re.Pattern[str], Kind], ...] = (
    (re.compile(r"\b(ArduCopter|APM:Copter|ArduHeli)\b", re.IGNORECASE), "multirotor"),
    (re.compile(r"\b(ArduPlane|APM:Plane)\b", re.IGNORECASE), "fixed wing"),
    (re.compile(r"\b(ArduRover|APM:Rover|APMrover2?)\b", re.IGNORECASE), "rover"),
    (re.compile(r"\b(ArduSub)\b", re.IGNORECASE), "submarine"),
    (re.compile(r"\b(Blimp)\b"), "airship"),
    (re.compile(r"\b(AntennaTracker|ArduTracker)\b", re.IGNORECASE), "unknown"),
)
_HELICOPTER_FRAME = re.compile(r"^(Frame: )?(\S+ )?HELI", re.IGNORECASE)
_SINGLE_FRAME = re.compile(r"^Frame: (SINGLE|COAX|TAILSITTER)", re.IGNORECASE)
_AIRFRAMES: dict[int, Kind] = {
    **dict.fromkeys((0, 8), "multirotor"),
    1: "fixed wing",
    **dict.fromkeys((2, 3, 4), "VTOL"),
    **dict.fromkeys((5, 6, 13), "rover"),
    7: "submarine",
    **dict.fromkeys((10, 11, 12), "helicopter"),
}
"""PX4's ``CA_AIRFRAME``."""
_FRAME_CLASSES: dict[int, Kind] = dict.fromkeys((6, 8, 9, 11, 13), "helicopter")
"""ArduCopter's ``FRAME_CLASS`` of other vehicles than multirotors: helicopters, and single and coaxial rotors with flaps."""
_PARAMETERS: tuple[tuple[Kind, tuple[str, ...]], ...] = (
    ("helicopter", ("H_RSC_MODE", "H_SWASH_TYPE", "H_SW_TYPE", "H_SV1_POS")),
    ("submarine", ("JS_GAIN_DEFAULT", "JS_BTN0_FUNCTION")),
    ("rover", ("CRUISE_THROTTLE", "STEER2SRV_P", "ATC_STR_RAT_P", "TURN_MAX_G")),
    ("fixed wing", ("RLL2SRV_RMAX", "RLL2SRV_P", "KFF_RDDRMIX", "ARSPD_FBW_MIN", "AIRSPEED_MIN", "TRIM_ARSPD_CM")),
    ("multirotor", ("MOT_THST_HOVER", "MOT_SPIN_ARMED", "RATE_RLL_P", "ATC_RAT_RLL_P", "MC_ROLLRATE_P")),
)
"""Parameters that only one firmware of ArduPilot has, the rarer first."""
WATCHED = frozenset(
    (
        *(name for _, names in _PARAMETERS for name in names),
        *("Q_ENABLE", "Q_TAILSIT_ENABLE", "Q_TILT_ENABLE", "Q_VFWD_GAIN", "Q_FWD_THR_USE", "Q_FRAME_CLASS"),
        *("FRAME_CLASS", "MAV_TYPE", "CA_AIRFRAME", "SYS_AUTOSTART", "VT_TYPE", "VT_FWD_THRUST_EN"),
    )
)
"""Parameters that are considered."""


@dataclass(frozen=True, slots=True)
class Vehicle:
    """Kind of a vehicle, with its source."""

    kind: Kind = "unknown"
    """One of `KINDS`."""
    told_by: str = "the log does not state the kind of vehicle"
    """The source, or the reason why it is unknown."""
    leans: bool = field(default=True, metadata=HIDDEN)
    """Whether it leans on its rotors as a multirotor does; a tail sitter, a tilt rotor and one that pushes forward in a
    hover do not."""


@dataclass(slots=True)
class KindEvidence:
    """Collects evidence in a log about the kind of one vehicle, in any order."""

    types: dict[int, None] = field(default_factory=dict)
    firmware: Kind | None = None
    banner: str = ""
    frame: Kind | None = None
    parameters: dict[str, float] = field(default_factory=dict)
    hovers: str = ""
    """Evidence that it can fly on rotors as well as on wings."""
    tails: bool = False
    """A PX4 log calls it a tail sitter."""
    rotary: set[int] = field(default_factory=set)
    """``vehicle_status.vehicle_type`` of PX4."""

    def text(self, text: str) -> None:
        """Take a text of the log."""
        for pattern, kind in _FIRMWARE:
            if self.firmware is None and pattern.search(text):
                self.firmware, self.banner = kind, text.split(" (", maxsplit=1)[0][:40]
        if _HELICOPTER_FRAME.match(text) or _SINGLE_FRAME.match(text):
            self.frame = "helicopter"

    def parameter(self, name: str, value: float) -> None:
        """Take a parameter."""
        if name in WATCHED and abs(value) < 1e6:  # false for NaN
            self.parameters[name] = value

    def vehicle(self) -> Vehicle:
        """Return the kind."""
        claims = self._claims()
        kinds = {kind for kind, _ in claims}
        leans = not (self.tails or self._tilts())
        for kind in ("VTOL", "helicopter"):
            if kind in kinds and not kinds & ({"rover", "boat", "submarine", "airship"}):
                return Vehicle(kind, next(by for one, by in claims if one == kind), leans)
        if len(kinds) > 1 and kinds == {"rover", "boat"}:
            return Vehicle("boat", next(by for one, by in claims if one == "boat"))
        if len(kinds) > 1:
            said = ", ".join(f"{kind} by {by}" for kind, by in claims)
            return Vehicle("unknown", f"the log contradicts itself: {said}")
        if claims:
            return Vehicle(*claims[0], leans)
        return Vehicle()

    def _claims(self) -> list[tuple[Kind, str]]:
        """Kinds according to each piece of evidence; parameters only if there is no clearer evidence."""
        found: list[tuple[Kind, str]] = []
        if self.parameters.get("Q_ENABLE", 0.0) >= 1.0:
            found.append(("VTOL", f"Q_ENABLE = {self.parameters['Q_ENABLE']:g}"))
        elif self.hovers:
            found.append(("VTOL", self.hovers))
        found += [(MAV_KINDS[number], f"MAV_TYPE {number}") for number in self.types if number in MAV_KINDS]
        if self.frame is not None:
            found.append((self.frame, "the frame it names"))
        if self.firmware not in (None, "unknown"):
            found.append((self._of_firmware(), self.banner))
        return found or self._by_parameters()

    def _of_firmware(self) -> Kind:
        number = int(self.parameters.get("FRAME_CLASS", 0.0))
        if self.firmware == "multirotor":
            return _FRAME_CLASSES.get(number, "multirotor")
        if self.firmware == "rover" and number == 2:
            return "boat"
        return self.firmware or "unknown"

    def _by_parameters(self) -> list[tuple[Kind, str]]:
        named = self.parameters
        by_type: dict[int, Kind] = {1: "multirotor", 2: "fixed wing", 3: "rover", 4: "airship"}
        told = [by_type[number] for number in sorted(self.rotary) if number in by_type]
        airframe = _AIRFRAMES.get(int(named.get("CA_AIRFRAME", -1.0)))
        if told == ["multirotor"] and airframe == "helicopter":
            told = ["helicopter"]
        if told:
            return [(kind, "vehicle_type") for kind in told]
        kind = MAV_KINDS.get(int(named.get("MAV_TYPE", 0.0)))
        if kind is not None:
            return [(kind, f"MAV_TYPE = {named['MAV_TYPE']:g}")]
        if airframe is not None:
            return [(airframe, f"CA_AIRFRAME = {named['CA_AIRFRAME']:g}")]
        for kind, names in _PARAMETERS:
            for name in names:
                if name in named:
                    return [(kind, f"the parameter {name}")]
        return []

    def _tilts(self) -> bool:
        """Whether it does not hover as a multirotor does."""
        named = self.parameters
        tilting = any(number in TILTING_TYPES for number in (*self.types, int(named.get("MAV_TYPE", 0.0))))
        pushing = any(named.get(name, 0.0) > 0.0 for name in ("Q_VFWD_GAIN", "Q_FWD_THR_USE", "VT_FWD_THRUST_EN"))
        turn_back = any(named.get(name, 0.0) > 0.0 for name in ("Q_TAILSIT_ENABLE", "Q_TILT_ENABLE"))
        standing = int(named.get("Q_FRAME_CLASS", 0.0)) == 10
        return tilting or pushing or turn_back or standing or (bool(self.hovers) and named.get("VT_TYPE") in (0.0, 1.0))
