"""PX4's parameters of calibrations: for each kind of sensor by the id of the sensor, 0 in an empty slot (``sensor_calibration``)."""

from __future__ import annotations

from skyway.missions.autopilots.calibration import Calibration

_KINDS = {"compass": "MAG", "accelerometer": "ACC", "gyro": "GYRO"}
CALIBRATIONS = tuple(
    Calibration(sensor, f"CAL_{name}{number}_ID", f"CAL_{name}{number}_PRIO")
    for sensor, name in _KINDS.items()
    for number in range(4)
)
