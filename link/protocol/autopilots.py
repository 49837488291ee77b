"""What differs between the autopilots when they are flown: modes, starting, pausing, numbers of parameters."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.errors import Fault, InputError

_AUTO = 4 << 16


@dataclass(frozen=True, slots=True)
class Family:
    """One autopilot's way of being commanded.

    Attributes
    ----------
    name : str
        ``px4`` or ``ardupilot``.
    firmware : int
        MAV_AUTOPILOT.
    modes : dict
        Custom mode by the name that both families share.
    bytewise : bool
        Whole numbers of parameters travel as the bytes of a float.
    pauses_in_mission : bool
        DO_PAUSE_CONTINUE; otherwise a mission is paused by holding.
    arms_in : str or None
        Mode to arm in before a mission is started; None arms in any.
    heeds_frames : bool
        A command's height counts from what its frame says; PX4 takes it as above mean sea level whatever that says
        (PX4-Autopilot issues 10246 and 28257).
    all_modes : dict
        Name of each custom mode, for a person.
    """

    name: str
    firmware: int
    modes: dict[str, int]
    bytewise: bool
    pauses_in_mission: bool
    arms_in: str | None
    heeds_frames: bool
    all_modes: dict[int, str]

    def mode_name(self, custom_mode: int) -> str:
        """Name of a mode, for a person."""
        return self.all_modes.get(custom_mode, f"mode {custom_mode}")


_PX4_MODES = {
    "hold": _AUTO | 3 << 24,
    "mission": _AUTO | 4 << 24,
    "return": _AUTO | 5 << 24,
    "land": _AUTO | 6 << 24,
    "position": 3 << 16,
    "guided": _AUTO | 3 << 24,
}
_PX4_ALL = {
    **{number: name for name, number in _PX4_MODES.items() if name != "guided"},
    1 << 16: "manual",
    2 << 16: "altitude",
    5 << 16: "acro",
    6 << 16: "offboard",
    7 << 16: "stabilized",
    _AUTO | 1 << 24: "ready",
    _AUTO | 2 << 24: "takeoff",
    _AUTO | 8 << 24: "follow",
    _AUTO | 9 << 24: "precision land",
}
_ARDUPILOT_MODES = {"mission": 3, "guided": 4, "position": 5, "return": 6, "land": 9, "hold": 17}
_ARDUPILOT_ALL = {number: name for name, number in _ARDUPILOT_MODES.items()} | {
    0: "stabilize",
    1: "acro",
    2: "altitude",
    7: "circle",
    16: "position hold",
    21: "smart return",
    27: "auto return",
}
PX4 = Family(
    "px4", 12, _PX4_MODES, bytewise=True, pauses_in_mission=False, arms_in=None, heeds_frames=False, all_modes=_PX4_ALL
)
ARDUPILOT = Family(
    "ardupilot",
    3,
    _ARDUPILOT_MODES,
    bytewise=False,
    pauses_in_mission=True,
    arms_in="guided",
    heeds_frames=True,
    all_modes=_ARDUPILOT_ALL,
)
FAMILIES = {family.name: family for family in (PX4, ARDUPILOT)}


def family_of(firmware: int) -> Family | None:
    """Family of a MAV_AUTOPILOT; None for one that we do not know."""
    return next((family for family in FAMILIES.values() if family.firmware == firmware), None)


def family_named(name: str) -> Family:
    """Family by name; an `InputError` for another name."""
    try:
        return FAMILIES[name]
    except KeyError:
        known = " or ".join(FAMILIES)
        raise InputError(Fault("is no autopilot that we know", field="autopilot", value=name, remedy=known)) from None
