"""Parameter names of ArduPilot Copter, 4.5 to 4.8.

Version 4.7 renamed many, mostly to change their unit to SI (ArduPilot's page "Parameter Name Changes", and the Copter
4.7 sources); its builds of 2025 have some of these names and not others.
"""

from skyway.missions.autopilots.settings import Name, Setting, Settings, Version

SI: Version = (4, 7)
FIRMWARES = ("4.5", "4.6", "4.7", "4.8")
RELEASED = "4.7"
_SPEED_MPS, _CLIMB_MPS, _HEIGHT_M, _LEAN_DEG = (0.0, 60.0), (0.0, 30.0), (-100.0, 9000.0), (0.0, 90.0)


def _renamed(new: str, old: str, new_unit: str = "", old_unit: str = "") -> tuple[Name, ...]:
    return Name(new, new_unit, since=SI), Name(old, old_unit, until=SI)


SETTINGS = Settings(
    (
        Setting(
            "mission-speed", "ground speed of missions", _renamed("WP_SPD", "WPNAV_SPEED", "m/s", "cm/s"), _SPEED_MPS
        ),
        Setting(
            "climb-rate", "climb rate of missions", _renamed("WP_SPD_UP", "WPNAV_SPEED_UP", "m/s", "cm/s"), _CLIMB_MPS
        ),
        Setting(
            "descent-rate",
            "descent rate of missions",
            _renamed("WP_SPD_DN", "WPNAV_SPEED_DN", "m/s", "cm/s"),
            _CLIMB_MPS,
        ),
        Setting("return-height", "height of a return", _renamed("RTL_ALT_M", "RTL_ALT", "m", "cm"), _HEIGHT_M),
        Setting("lean-limit", "greatest lean", _renamed("ATC_ANGLE_MAX", "ANGLE_MAX", "deg", "cdeg"), _LEAN_DEG),
        Setting(
            "position-lean-limit",
            "greatest lean of the position controller",
            (Name("PSC_ANGLE_MAX", "deg"),),
            _LEAN_DEG,
        ),
        Setting(
            "ground-station", "the system that counts as the ground station", _renamed("MAV_GCS_SYSID", "SYSID_MYGCS")
        ),
        Setting(
            "ground-station-last",
            "the last system that counts as a ground station",
            (Name("MAV_GCS_SYSID_HI", since=SI),),
        ),
        Setting("failsafe-options", "what continues when a link is lost", (Name("FS_OPTIONS"),)),
        Setting("ground-station-failsafe", "what it does without a ground station", (Name("FS_GCS_ENABLE"),)),
        Setting("ground-station-timeout", "how long it waits for a ground station, s", (Name("FS_GCS_TIMEOUT"),)),
        Setting("remote-control-action", "what it does without a remote control", (Name("FS_THR_ENABLE"),)),
        Setting("low-battery-action", "what it does at low battery", (Name("BATT_FS_LOW_ACT"),)),
        Setting("low-battery", "charge at low battery, mAh", (Name("BATT_LOW_MAH"),)),
        Setting("low-battery-voltage", "voltage at low battery", (Name("BATT_LOW_VOLT"),)),
        Setting("critical-battery-action", "what it does at critical battery", (Name("BATT_FS_CRT_ACT"),)),
        Setting("critical-battery", "charge at critical battery, mAh", (Name("BATT_CRT_MAH"),)),
        Setting("critical-battery-voltage", "voltage at critical battery", (Name("BATT_CRT_VOLT"),)),
        Setting("battery-capacity", "capacity of the battery, mAh", (Name("BATT_CAPACITY"),)),
        Setting("fence", "whether the fence acts", (Name("FENCE_ENABLE"),)),
        Setting("fence-kinds", "which fences act", (Name("FENCE_TYPE"),)),
        Setting("fence-action", "what it does at a breach of the fence", (Name("FENCE_ACTION"),)),
        Setting("rally-limit", "how far a rally point may be, km", (Name("RALLY_LIMIT_KM"),)),
        Setting("mission-options", "how missions continue", (Name("MIS_OPTIONS"),)),
        Setting("disarm-delay", "when it disarms on the ground, s", (Name("DISARM_DELAY"),)),
        Setting("gripper", "whether it has a gripper", (Name("GRIP_ENABLE"),)),
        Setting("winch", "which winch it has", (Name("WINCH_TYPE"),)),
        Setting("winch-rate", "line a second of its winch", (Name("WINCH_RATE_MAX"),)),
    )
)
