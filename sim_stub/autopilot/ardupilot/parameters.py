"""Parameters of ArduPilot Copter that matter for deliveries, with Copter's defaults."""

from skyway.sim_stub.autopilot.parameters import INT8, INT16, INT32, REAL32, ParameterStore

_STREAMS = ("ADSB", "EXTRA1", "EXTRA2", "EXTRA3", "EXT_STAT", "PARAMS", "POSITION", "RAW_CTRL", "RAW_SENS")
_TABLE = (
    ("ANGLE_MAX", INT16, 3000),
    ("ARMING_CHECK", INT32, 1),
    ("ARMING_MIS_ITEMS", INT32, 0),
    ("AUTO_OPTIONS", INT32, 0),
    ("BATT_ARM_VOLT", REAL32, 0.0),
    ("BATT_CAPACITY", INT32, 15320),
    ("BATT_CRT_MAH", REAL32, 0.0),
    ("BATT_CRT_VOLT", REAL32, 0.0),
    ("BATT_FS_CRT_ACT", INT8, 0),
    ("BATT_FS_LOW_ACT", INT8, 0),
    ("BATT_LOW_MAH", REAL32, 0.0),
    ("BATT_LOW_TIMER", INT8, 10),
    ("BATT_LOW_VOLT", REAL32, 10.5),
    ("BATT_MONITOR", INT8, 4),
    ("CIRCLE_RADIUS", REAL32, 1000.0),
    ("CIRCLE_RATE", REAL32, 20.0),
    ("COMPASS_DEV_ID", INT32, 97539),
    ("COMPASS_OFS_X", REAL32, 5.0),
    ("COMPASS_OFS_Y", REAL32, 13.0),
    ("COMPASS_OFS_Z", REAL32, -18.0),
    ("COMPASS_USE", INT8, 1),
    ("DID_ENABLE", INT8, 0),
    ("DID_OPTIONS", INT16, 0),
    ("DISARM_DELAY", INT8, 10),
    ("EK3_DRAG_BCOEF_X", REAL32, 0.0),
    ("EK3_DRAG_BCOEF_Y", REAL32, 0.0),
    ("EK3_DRAG_MCOEF", REAL32, 0.0),
    ("EK3_ENABLE", INT8, 1),
    ("FENCE_ACTION", INT8, 1),
    ("FENCE_ALT_MAX", REAL32, 100.0),
    ("FENCE_ALT_MIN", REAL32, -10.0),
    ("FENCE_AUTOENABLE", INT8, 0),
    ("FENCE_ENABLE", INT8, 0),
    ("FENCE_MARGIN", REAL32, 2.0),
    ("FENCE_OPTIONS", INT16, 1),
    ("FENCE_RADIUS", REAL32, 300.0),
    ("FENCE_TOTAL", INT8, 0),
    ("FENCE_TYPE", INT8, 7),
    ("FLTMODE1", INT8, 7),
    ("FLTMODE2", INT8, 9),
    ("FLTMODE3", INT8, 6),
    ("FLTMODE4", INT8, 3),
    ("FLTMODE5", INT8, 5),
    ("FLTMODE6", INT8, 0),
    ("FRAME_CLASS", INT8, 1),
    ("FRAME_TYPE", INT8, 0),
    ("FS_CRASH_CHECK", INT8, 1),
    ("FS_DR_ENABLE", INT8, 2),
    ("FS_EKF_ACTION", INT8, 1),
    ("FS_EKF_THRESH", REAL32, 0.8),
    ("FS_GCS_ENABLE", INT8, 0),
    ("FS_GCS_TIMEOUT", REAL32, 5.0),
    ("FS_OPTIONS", INT32, 16),
    ("FS_THR_ENABLE", INT8, 1),
    ("FS_VIBE_ENABLE", INT8, 1),
    ("GRIP_ENABLE", INT8, 0),
    ("GRIP_TYPE", INT8, 0),
    ("GUID_OPTIONS", INT32, 0),
    ("GUID_TIMEOUT", REAL32, 3.0),
    ("INS_ACCOFFS_X", REAL32, 0.001),
    ("INS_ACCOFFS_Y", REAL32, 0.001),
    ("INS_ACCOFFS_Z", REAL32, 0.001),
    ("INS_ACC_ID", INT32, 2753028),
    ("INS_GYR_CAL", INT8, 1),
    ("INS_GYR_ID", INT32, 2752772),
    ("INS_USE", INT8, 1),
    ("LAND_ALT_LOW", REAL32, 1000.0),
    ("LAND_SPEED", INT16, 50),
    ("LAND_SPEED_HIGH", INT16, 0),
    ("LOIT_SPEED", REAL32, 1250.0),
    ("MIS_OPTIONS", INT16, 0),
    ("MIS_RESTART", INT8, 0),
    ("MIS_TOTAL", INT16, 0),
    ("PILOT_SPEED_DN", INT16, 0),
    ("PILOT_SPEED_UP", INT16, 250),
    ("PSC_ANGLE_MAX", REAL32, 0.0),
    ("RALLY_INCL_HOME", INT8, 1),
    ("RALLY_LIMIT_KM", REAL32, 0.3),
    ("RALLY_TOTAL", INT8, 0),
    ("RTL_ALT", INT32, 1500),
    ("RTL_ALT_FINAL", INT16, 0),
    ("RTL_CLIMB_MIN", INT16, 0),
    ("RTL_LOIT_TIME", INT32, 5000),
    ("RTL_SPEED", INT16, 0),
    ("SERIAL0_PROTOCOL", INT8, 2),
    ("SYSID_ENFORCE", INT8, 0),
    ("SYSID_MYGCS", INT16, 255),
    ("SYSID_THISMAV", INT16, 1),
    ("TELEM_DELAY", INT8, 0),
    ("TERRAIN_ENABLE", INT8, 1),
    ("WINCH_RATE_MAX", REAL32, 1.0),
    ("WINCH_TYPE", INT8, 0),
    ("WPNAV_ACCEL", REAL32, 250.0),
    ("WPNAV_RADIUS", REAL32, 200.0),
    ("WPNAV_RFND_USE", INT8, 1),
    ("WPNAV_SPEED", REAL32, 1000.0),
    ("WPNAV_SPEED_DN", REAL32, 150.0),
    ("WPNAV_SPEED_UP", REAL32, 250.0),
    ("WP_YAW_BEHAVIOR", INT8, 2),
    *((f"SR0_{stream}", INT16, 0) for stream in _STREAMS),
)
_SI = {
    # What 4.7 calls them, and how many of the old unit are one of the new.
    "ANGLE_MAX": ("ATC_ANGLE_MAX", 100.0),
    "CIRCLE_RADIUS": ("CIRCLE_RADIUS_M", 100.0),
    "LAND_ALT_LOW": ("LAND_ALT_LOW_M", 100.0),
    "LAND_SPEED": ("LAND_SPD_MS", 100.0),
    "LAND_SPEED_HIGH": ("LAND_SPD_HIGH_MS", 100.0),
    "LOIT_SPEED": ("LOIT_SPEED_MS", 100.0),
    "PILOT_SPEED_DN": ("PILOT_SPD_DN", 100.0),
    "PILOT_SPEED_UP": ("PILOT_SPD_UP", 100.0),
    "RTL_ALT": ("RTL_ALT_M", 100.0),
    "RTL_ALT_FINAL": ("RTL_ALT_FINAL_M", 100.0),
    "RTL_CLIMB_MIN": ("RTL_CLIMB_MIN_M", 100.0),
    "RTL_SPEED": ("RTL_SPEED_MS", 100.0),
    "WPNAV_ACCEL": ("WP_ACC", 100.0),
    "WPNAV_RADIUS": ("WP_RADIUS_M", 100.0),
    "WPNAV_SPEED": ("WP_SPD", 100.0),
    "WPNAV_SPEED_DN": ("WP_SPD_DN", 100.0),
    "WPNAV_SPEED_UP": ("WP_SPD_UP", 100.0),
}
_RENAMED = {
    "SYSID_MYGCS": ("MAV_GCS_SYSID", 1.0),
    "SYSID_THISMAV": ("MAV_SYSID", 1.0),
    "TELEM_DELAY": ("MAV_TELEM_DELAY", 1.0),
    "WPNAV_RFND_USE": ("WP_RFND_USE", 1.0),
    **{f"SR0_{stream}": (f"MAV1_{stream}", 1.0) for stream in _STREAMS},
}
_NEW = (("ARMING_SKIPCHK", INT32, 0), ("MAV_GCS_SYSID_HI", INT16, 0), ("MAV_OPTIONS", INT32, 0))
_GONE = ("ARMING_CHECK", "SYSID_ENFORCE")
_SINCE_4_6 = ("FENCE_AUTOENABLE",)


def store(version: tuple[int, int]) -> ParameterStore:
    """Parameters as a version of Copter has them, with its defaults."""
    if version < (4, 7):
        return ParameterStore(entry for entry in _TABLE if version >= (4, 6) or entry[0] not in _SINCE_4_6)
    spelled = _SI | _RENAMED
    table = [_in_4_7(*entry) for entry in _TABLE if entry[0] not in _GONE]
    return ParameterStore([*table, *_NEW], spelled)


def _in_4_7(name: str, kind: int, value: float) -> tuple[str, int, float]:
    if name in _SI:
        new, scale = _SI[name]
        return new, REAL32, value / scale
    return _RENAMED.get(name, (name, 1.0))[0], kind, value
