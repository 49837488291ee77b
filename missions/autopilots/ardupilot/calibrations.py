"""ArduPilot's parameters of calibrations: compasses, accelerometers and gyros (``AP_Compass.cpp``, ``AP_InertialSensor.cpp``, 4.3 to 4.8)."""

from __future__ import annotations

from skyway.missions.autopilots.calibration import Calibration

_NUMBERS = ("", "2", "3")
_LONGEST_MGAUSS = 1800.0
"""Default of COMPASS_OFFS_MAX, above which it does not arm."""


def _axes(head: str) -> tuple[str, ...]:
    return tuple(f"{head}_{axis}" for axis in "XYZ")


CALIBRATIONS = (
    *(
        Calibration(
            "compass",
            f"COMPASS_DEV_ID{n}",
            f"COMPASS_USE{n}",
            _axes(f"COMPASS_OFS{n}"),
            zero_is_none=True,
            most=_LONGEST_MGAUSS,
        )
        for n in _NUMBERS
    ),
    *(
        Calibration("accelerometer", f"INS_ACC{n}_ID", f"INS_USE{n}", _axes(f"INS_ACC{n}OFFS"), zero_is_none=True)
        for n in _NUMBERS
    ),
    *(Calibration("gyro", f"INS_GYR{n}_ID", f"INS_USE{n}") for n in _NUMBERS),
)
"""Gyros are calibrated each time the autopilot is switched on (except for INS_GYR_CAL = 0), and never otherwise: an id shows that one was."""
