"""ArduPilot: commands and replies of its vehicles."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, ClassVar

from skyway.missions.autopilots.ardupilot.failsafes import FAILSAFES
from skyway.missions.autopilots.ardupilot.missions import ArduPilotMissions
from skyway.missions.autopilots.ardupilot.modes import MODES
from skyway.missions.autopilots.ardupilot.settings import FIRMWARES, RELEASED, SETTINGS
from skyway.missions.autopilots.family import Family

if TYPE_CHECKING:
    from skyway.missions.autopilots.failsafes import Failsafes
    from skyway.missions.autopilots.modes import Modes
    from skyway.missions.autopilots.settings import Settings


class ArduPilot(ArduPilotMissions, Family):
    """ArduPilot."""

    settings: ClassVar[Settings] = SETTINGS
    firmwares = FIRMWARES
    released = RELEASED
    modes: ClassVar[Modes] = MODES
    failsafes: ClassVar[Failsafes] = FAILSAFES
    arms_in = "guided"
    pauses_in_mission = True
    bytewise_parameters = False
    takes_uploads_whole = False
    ground_station_settings = ("ground-station", "ground-station-last")
    """From 4.7 on a range of systems counts; before, one."""
    lean_limits = ("lean-limit", "position-lean-limit")
    taken_text = "Flight plan received"
    crash_texts = re.compile(r"\bcrash|\bleaning\b", re.IGNORECASE)
    """It says ``Crash: Disarming``, and refuses to arm with ``Leaning``."""
