"""Parameter names of PX4, 1.15 to main.

Read in PX4's sources, release notes and pull requests: COM_DLL_EXCEPT came in March 2025 (24507), PD_GRIPPER_EN went with
1.17 (25317), RTL_TYPE 5 got its final form together with NAV_LTR_LAST_DL in March 2026 (26774; 1.18).
"""

from skyway.missions.autopilots.settings import Name, Setting, Settings

FIRMWARES = ("1.15", "1.16", "1.17", "main")
RELEASED = "1.17"
_SPEED_MPS, _CLIMB_MPS, _HEIGHT_M, _LEAN_DEG = (0.0, 60.0), (0.0, 30.0), (-100.0, 9000.0), (0.0, 90.0)

SETTINGS = Settings(
    (
        Setting("speed-limit", "greatest ground speed", (Name("MPC_XY_VEL_MAX", "m/s"),), _SPEED_MPS),
        Setting("mission-speed", "ground speed of missions", (Name("MPC_XY_CRUISE", "m/s"),), _SPEED_MPS),
        Setting("climb-rate", "climb rate of missions", (Name("MPC_Z_V_AUTO_UP", "m/s"),), _CLIMB_MPS),
        Setting("descent-rate", "descent rate of missions", (Name("MPC_Z_V_AUTO_DN", "m/s"),), _CLIMB_MPS),
        Setting("return-height", "height of a return", (Name("RTL_RETURN_ALT", "m"),), _HEIGHT_M),
        Setting("lean-limit", "greatest lean", (Name("MPC_TILTMAX_AIR", "deg"),), _LEAN_DEG),
        Setting(
            "data-link-exceptions", "where a lost data link does not matter", (Name("COM_DLL_EXCEPT", since=(1, 16)),)
        ),
        Setting("data-link-action", "what it does without a data link", (Name("NAV_DLL_ACT"),)),
        Setting("data-link-timeout", "how long it waits for a data link, s", (Name("COM_DL_LOSS_T"),)),
        Setting("remote-control-exceptions", "where a lost remote control does not matter", (Name("COM_RCL_EXCEPT"),)),
        Setting("remote-control-action", "what it does without a remote control", (Name("NAV_RCL_ACT"),)),
        Setting("low-battery", "share of charge at low battery", (Name("BAT_LOW_THR"),)),
        Setting("low-battery-action", "what it does at critical battery", (Name("COM_LOW_BAT_ACT"),)),
        Setting("critical-battery", "share of charge at critical battery", (Name("BAT_CRIT_THR"),)),
        Setting("emergency-battery", "share of charge at emergency", (Name("BAT_EMERGEN_THR"),)),
        Setting("fence-action", "what it does at a breach of the fence", (Name("GF_ACTION"),)),
        Setting("fence-radius", "circle around home that it does not leave, m", (Name("GF_MAX_HOR_DIST"),)),
        Setting("fence-ceiling", "height above home that it does not leave, m", (Name("GF_MAX_VER_DIST"),)),
        Setting("return-type", "where a return goes", (Name("RTL_TYPE"),)),
        Setting(
            "hold-at-last-link",
            "whether it holds where the data link was last",
            (Name("NAV_LTR_LAST_DL", since=(1, 18)),),
        ),
        Setting("disarm-delay", "when it disarms after a landing, s", (Name("COM_DISARM_LAND"),)),
        Setting("gripper", "whether it has a gripper", (Name("PD_GRIPPER_EN", until=(1, 17)),)),
        Setting("gripper-kind", "which gripper it has", (Name("PD_GRIPPER_TYPE"),)),
    )
)
