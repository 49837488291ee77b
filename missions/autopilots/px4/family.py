"""PX4: commands and replies of its vehicles."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar

from skyway.missions.autopilots.family import Family
from skyway.missions.autopilots.px4.failsafes import FAILSAFES
from skyway.missions.autopilots.px4.missions import Px4Missions
from skyway.missions.autopilots.px4.modes import MODES
from skyway.missions.autopilots.px4.settings import FIRMWARES, RELEASED, SETTINGS

if TYPE_CHECKING:
    from collections.abc import Sequence

    from skyway.missions.autopilots.failsafes import Failsafes
    from skyway.missions.autopilots.modes import Modes
    from skyway.missions.autopilots.settings import Settings

_REFUSING = re.compile(
    r"mission reject|infeasible|not feasible|too far|geofence violat|no valid mission|mission (is )?invalid",
    re.IGNORECASE,
)
_NUMBER = re.compile(r"\b(?:WP|waypoint|item|at) #?(\d+)", re.IGNORECASE)


class Px4(Px4Missions, Family):
    """PX4."""

    settings: ClassVar[Settings] = SETTINGS
    firmwares = FIRMWARES
    released = RELEASED
    modes: ClassVar[Modes] = MODES
    failsafes: ClassVar[Failsafes] = FAILSAFES
    pauses_in_mission = False
    heeds_frames = False
    """PX4-Autopilot issues 10246 and 28257."""
    bytewise_parameters = True
    takes_uploads_whole = True
    judges_missions = True
    """After it has taken one over; it says so in texts, and newer versions in MISSION_CURRENT.mission_state."""
    lean_limits = ("lean-limit",)
    wind_message = 231
    crash_texts = re.compile(r"\bcrash|attitude failure", re.IGNORECASE)
    """It refuses to arm with ``Attitude failure (roll)``."""

    def refusals(self, texts: Sequence[str]) -> list[str]:
        """Those of a vehicle's texts that refuse the mission that it has taken."""
        return [text for text in texts if _REFUSING.search(text)]

    def items_refused(self, texts: Sequence[str]) -> tuple[int, ...]:
        """Numbers of the items that such texts concern, from 0: PX4 counts from 1 when it speaks."""
        found = (_NUMBER.search(text) for text in texts)
        return tuple(sorted({int(hit[1]) - 1 for hit in found if hit is not None and int(hit[1]) > 0}))
