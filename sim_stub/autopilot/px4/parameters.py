"""Parameters of PX4 that matter for deliveries, with PX4's defaults."""

from skyway.sim_stub.autopilot.parameters import INT32, REAL32, ParameterStore

_TABLE = (
    ("BAT1_CAPACITY", REAL32, 15320.0),
    ("BAT1_N_CELLS", INT32, 6),
    ("BAT1_R_INTERNAL", REAL32, -1.0),
    ("BAT1_V_CHARGED", REAL32, 4.30),
    ("BAT1_V_EMPTY", REAL32, 3.60),
    ("BAT_CRIT_THR", REAL32, 0.07),
    ("BAT_EMERGEN_THR", REAL32, 0.05),
    ("BAT_LOW_THR", REAL32, 0.15),
    ("CAL_ACC0_ID", INT32, 1310988),
    ("CAL_ACC0_PRIO", INT32, 50),
    ("CAL_GYRO0_ID", INT32, 1310988),
    ("CAL_GYRO0_PRIO", INT32, 50),
    ("CAL_MAG0_ID", INT32, 197388),
    ("CAL_MAG0_PRIO", INT32, 50),
    ("COM_ARM_ODID", INT32, 0),
    ("COM_ARM_WO_GPS", INT32, 1),
    ("COM_DISARM_LAND", REAL32, 2.0),
    ("COM_DISARM_PRFLT", REAL32, 10.0),
    ("COM_DLL_EXCEPT", INT32, 0),
    ("COM_DL_LOSS_T", INT32, 10),
    ("COM_FAIL_ACT_T", REAL32, 5.0),
    ("COM_FLTMODE1", INT32, -1),
    ("COM_LOW_BAT_ACT", INT32, 0),
    ("COM_OBL_RC_ACT", INT32, 0),
    ("COM_OF_LOSS_T", REAL32, 1.0),
    ("COM_POSCTL_NAVL", INT32, 0),
    ("COM_POS_FS_DELAY", INT32, 1),
    ("COM_RCL_EXCEPT", INT32, 0),
    ("COM_RC_IN_MODE", INT32, 3),
    ("COM_RC_LOSS_T", REAL32, 0.5),
    ("COM_TAKEOFF_ACT", INT32, 0),
    ("EKF2_BCOEF_X", REAL32, 100.0),
    ("EKF2_BCOEF_Y", REAL32, 100.0),
    ("EKF2_DRAG_CTRL", INT32, 0),
    ("EKF2_GPS_CHECK", INT32, 245),
    ("EKF2_MCOEF", REAL32, 0.15),
    ("GF_ACTION", INT32, 2),
    ("GF_MAX_HOR_DIST", REAL32, 0.0),
    ("GF_MAX_VER_DIST", REAL32, 0.0),
    ("GF_PREDICT", INT32, 0),
    ("GF_SOURCE", INT32, 0),
    ("MAV_0_RATE", INT32, 0),
    ("MAV_COMP_ID", INT32, 1),
    ("MAV_PROTO_VER", INT32, 2),  # PX4 says 0; its own simulator sets 2, as do most boards
    ("MAV_SYS_ID", INT32, 1),
    ("MAV_TYPE", INT32, 2),
    ("MIS_DIST_1WP", REAL32, 10000.0),
    ("MIS_TAKEOFF_ALT", REAL32, 2.5),
    ("MIS_TKO_LAND_REQ", INT32, 0),
    ("MIS_YAW_ERR", REAL32, 12.0),
    ("MIS_YAW_TMT", REAL32, -1.0),
    ("MPC_ACC_HOR", REAL32, 3.0),
    ("MPC_LAND_ALT1", REAL32, 10.0),
    ("MPC_LAND_ALT2", REAL32, 5.0),
    ("MPC_LAND_SPEED", REAL32, 0.7),
    ("MPC_TILTMAX_AIR", REAL32, 45.0),
    ("MPC_TKO_SPEED", REAL32, 1.5),
    ("MPC_XY_CRUISE", REAL32, 5.0),
    ("MPC_XY_VEL_MAX", REAL32, 12.0),
    ("MPC_YAW_MODE", INT32, 0),
    ("MPC_Z_VEL_MAX_DN", REAL32, 1.5),
    ("MPC_Z_VEL_MAX_UP", REAL32, 3.0),
    ("MPC_Z_V_AUTO_DN", REAL32, 1.5),
    ("MPC_Z_V_AUTO_UP", REAL32, 3.0),
    ("NAV_ACC_RAD", REAL32, 10.0),
    ("NAV_DLL_ACT", INT32, 0),
    ("NAV_LOITER_RAD", REAL32, 80.0),
    ("NAV_MC_ALT_RAD", REAL32, 0.8),
    ("NAV_RCL_ACT", INT32, 2),
    ("PD_GRIPPER_EN", INT32, 0),
    ("PD_GRIPPER_TO", REAL32, 1.0),
    ("PD_GRIPPER_TYPE", INT32, 0),
    ("RTL_CONE_ANG", INT32, 45),
    ("RTL_DESCEND_ALT", REAL32, 30.0),
    ("RTL_LAND_DELAY", REAL32, 0.0),
    ("RTL_MIN_DIST", REAL32, 10.0),
    ("RTL_RETURN_ALT", REAL32, 60.0),
    ("RTL_TYPE", INT32, 0),
    ("SYS_AUTOCONFIG", INT32, 0),
    ("SYS_AUTOSTART", INT32, 4001),
    ("SYS_HAS_GPS", INT32, 1),
    ("SYS_HAS_MAG", INT32, 1),
    ("WV_EN", INT32, 0),
)
_GONE = {"COM_POS_FS_DELAY": (1, 16), "COM_POSCTL_NAVL": (1, 17), "COM_TAKEOFF_ACT": (1, 18), "PD_GRIPPER_EN": (1, 17)}
_SINCE = {"COM_DLL_EXCEPT": (1, 16)}


def store(version: tuple[int, int]) -> ParameterStore:
    """Parameters as a version of PX4 has them, with its defaults."""
    table = [
        entry
        for entry in _TABLE
        if version < _GONE.get(entry[0], (1000, 0)) and version >= _SINCE.get(entry[0], (0, 0))
    ]
    if version >= (1, 17):  # a gripper is one that has a kind
        table = [("PD_GRIPPER_TYPE", INT32, -1) if entry[0] == "PD_GRIPPER_TYPE" else entry for entry in table]
    if version >= (1, 18):
        table.append(("NAV_LTR_LAST_DL", INT32, 0))
    return ParameterStore(table)
