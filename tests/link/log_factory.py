"""Writes DataFlash logs and ULogs of any vehicle, and tlogs of any kind, from columns of telemetry."""

from __future__ import annotations

import math
import struct

import numpy as np
from tlog_factory import Recorder

BOOT_UTC_S = 1_700_000_000.0
_DATAFLASH = {"B": "B", "b": "b", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "Q": "Q", "N": "16s", "Z": "64s"}
_DATAFLASH |= {"n": "4s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B"}
_ULOG = {
    "uint64_t": "Q",
    "float": "f",
    "double": "d",
    "uint8_t": "B",
    "bool": "B",
    "int32_t": "i",
    "uint16_t": "H",
}
_FACTORS = {"c": 100.0, "C": 100.0, "e": 100.0, "E": 100.0, "L": 1e7}


class DataFlashWriter:
    """Packs messages as ArduPilot does, each type's format before its first message."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self._types: dict[str, tuple[int, str]] = {}
        self._format(0x80, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns")

    def _format(self, number: int, name: str, letters: str, columns: str) -> None:
        length = 3 + struct.calcsize("<" + "".join(_DATAFLASH[letter] for letter in letters))
        body = struct.pack("<BB4s16s64s", number, length, name.encode(), letters.encode(), columns.encode())
        self.parts.append(b"\xa3\x95\x80" + body)

    def add(self, name: str, letters: str, columns: str, *values) -> None:
        if name not in self._types:
            self._types[name] = 129 + len(self._types), letters
            self._format(self._types[name][0], name, letters, columns)
        packed = [
            value.encode()
            if isinstance(value, str)
            else round(value * _FACTORS[letter])
            if letter in _FACTORS
            else value
            for letter, value in zip(letters, values, strict=True)
        ]
        kinds = "".join(_DATAFLASH[letter] for letter in letters)
        self.parts.append(b"\xa3\x95" + bytes([self._types[name][0]]) + struct.pack("<" + kinds, *packed))

    @property
    def data(self) -> bytes:
        return b"".join(self.parts)


def plane(*, duration_s=240.0, wind=(-4.0, 3.0), airspeed_mps=18.0, seed=0, turn_back=True):
    """Columns of a fixed wing on circles in a wind, and what its sensors say, at 10 Hz; lean and wind have nothing in common."""
    generator = np.random.default_rng(seed)
    time_s = np.arange(0.0, duration_s, 0.1)
    yaw = (0.12 if turn_back else 0.0) * time_s
    air = airspeed_mps * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    velocity = air + np.array(wind) + generator.normal(0.0, 0.1, air.shape)
    return {
        "time_s": time_s,
        "roll_rad": np.full(len(time_s), 0.22) + generator.normal(0.0, 0.02, len(time_s)),
        "pitch_rad": np.full(len(time_s), 0.05) + generator.normal(0.0, 0.02, len(time_s)),
        "yaw_rad": (yaw + math.pi) % (2.0 * math.pi) - math.pi,
        "vel_north_mps": velocity[:, 0],
        "vel_east_mps": velocity[:, 1],
        "airspeed_mps": airspeed_mps + generator.normal(0.0, 0.2, len(time_s)),
    }


def multirotor(truth):
    """Columns of a flight of `drone_truth`."""
    track = truth.track(0)
    names = ("roll_rad", "pitch_rad", "yaw_rad", "vel_north_mps", "vel_east_mps")
    return {"time_s": track.time_s - track.time_s[0], **{name: track[name] for name in names}}


def dataflash(
    columns, banner="ArduCopter V4.5.7 (2a3dc4b7)", parameters=None, sensor=False, gps=None, estimate=None, modes=None
) -> DataFlashWriter:
    """A log of ArduPilot 4: attitude, receiver, estimate, in the air all the time.

    `gps` gives (fix, satellites, hdop) of each row, `estimate` (velocity ratio, position ratio, solution status), `modes`
    the number of the mode.
    """
    log = DataFlashWriter()
    for name, value in (parameters or {}).items():
        log.add("PARM", "QNff", "TimeUS,Name,Value,Default", 1_000_000, name, float(value), 0.0)
    if banner:
        log.add("MSG", "QZ", "TimeUS,Message", 1_000_000, banner)
    log.add("ARM", "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method", 1_500_000, 1, 0, 0, 0)
    for row, time_s in enumerate(columns["time_s"]):
        now = 2_000_000 + round(1e6 * float(time_s))
        angles = [math.degrees(float(columns[name][row])) for name in ("roll_rad", "pitch_rad", "yaw_rad")]
        north, east = (float(columns[f"vel_{name}_mps"][row]) for name in ("north", "east"))
        if modes is not None and (row == 0 or modes(row) != modes(row - 1)):
            log.add("MODE", "QMBB", "TimeUS,Mode,ModeNum,Rsn", now, modes(row), modes(row), 1)
        log.add("ATT", "Qccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw", now, 0, angles[0], 0, angles[1], angles[2])
        log.add("XKF1", "QBccfff", "TimeUS,C,Roll,Pitch,VN,VE,VD", now, 0, 0, 0, north, east, 0.0)
        log.add("XKF1", "QBccfff", "TimeUS,C,Roll,Pitch,VN,VE,VD", now, 1, 0, 0, 99.0, 99.0, 0.0)
        ratios = (0.1, 0.1, 0x33F) if estimate is None else estimate(row)
        log.add("XKF4", "QBccBHBI", "TimeUS,C,SV,SP,FS,TS,PI,SS", now, 0, ratios[0], ratios[1], 0, 0, 0, ratios[2])
        if sensor:
            speed = float(columns["airspeed_mps"][row])
            log.add("ARSP", "QBffBB", "TimeUS,I,Airspeed,DiffPress,U,H", now, 0, speed, 200.0, 1, 1)
        if row % 2 == 0:
            fix, satellites, hdop = (3, 14, 0.8) if gps is None else gps(row)
            log.add(
                "GPS",
                "QBBIHBcLLeffffB",
                "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
                *(now, 0, fix, 300_000_000 + round(1e3 * float(time_s)), 2300, satellites, hdop, 47.0, 8.0, 500.0),
                *(math.hypot(north, east), math.degrees(math.atan2(east, north)) % 360.0, 0.0, 0.0, 1),
            )
            log.add("POS", "QLLfff", "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt", now, 47.0, 8.0, 500.0, 60.0, 60.0)
    return log


def tlog(
    columns, kind=2, autopilot=3, *, first_version=True, sensors=0, parameters=None, modes=None, gps=None, log=None
):
    """A tlog of a vehicle of a MAV_TYPE in the air; `modes` gives the custom mode and `gps` fix, satellites, eph of a row."""
    log = log or Recorder()
    kinds = log.dialect
    for name, value in (parameters or {}).items():
        log.add(
            0.0, kinds.MAVLink_param_value_message(name.encode(), float(value), 9, 1, 0), first_version=first_version
        )
    for row, time_s in enumerate(float(value) for value in columns["time_s"]):
        roll, pitch, yaw = (float(columns[name][row]) for name in ("roll_rad", "pitch_rad", "yaw_rad"))
        north, east = (float(columns[f"vel_{name}_mps"][row]) for name in ("north", "east"))
        boot = round(1000.0 * time_s)
        messages = [
            kinds.MAVLink_attitude_message(boot, roll, pitch, yaw, 0, 0, 0),
            kinds.MAVLink_global_position_int_message(
                boot, 470000000, 80000000, 500000, 60000, round(100 * north), round(100 * east), 0, 0
            ),
        ]
        if row % 10 == 0:
            mode = 10 if modes is None else modes(row)
            fix, satellites, eph = (3, 14, 80) if gps is None else gps(row)
            speed = float(columns["airspeed_mps"][row]) if "airspeed_mps" in columns else 0.0
            messages += [
                kinds.MAVLink_heartbeat_message(kind, autopilot, 128 | 1, mode, 4, 3),
                kinds.MAVLink_gps_raw_int_message(
                    boot * 1000, fix, 470000000, 80000000, 500000, eph, eph, 0, 0, satellites
                ),
                kinds.MAVLink_sys_status_message(sensors, sensors, sensors, 500, 22000, 2500, 80, 0, 0, 0, 0, 0, 0),
                kinds.MAVLink_vfr_hud_message(speed, math.hypot(north, east), 0, 50, 500.0, 0.0),
            ]
        for message in messages:
            log.add(time_s, message, first_version=first_version)
    return log


class ULogWriter:
    """Packs topics as PX4 does."""

    def __init__(self) -> None:
        self.parts = [b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)]
        self._formats: dict[str, str] = {}
        self._ids: dict[str, int] = {}
        self._packs: dict[str, struct.Struct] = {}
        self._waiting: list[bytes] = []

    def _message(self, kind: str, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), ord(kind)) + body

    def topic(self, name: str, **fields: str) -> None:
        """Declare a topic by the types of its fields; the timestamp comes first."""
        types = {"timestamp": "uint64_t", **fields}
        text = name + ":" + "".join(f"{kind} {field};" for field, kind in types.items())
        self.parts.append(self._message("F", text.encode()))
        self._ids[name] = len(self._ids)
        self._packs[name] = struct.Struct("<" + "".join(_ULOG[kind] for kind in types.values()))
        self._waiting.append(self._message("A", struct.pack("<BH", 0, self._ids[name]) + name.encode()))

    def parameter(self, name: str, value: int) -> None:
        key = f"int32_t {name}".encode()
        self.parts.append(self._message("P", bytes([len(key)]) + key + struct.pack("<i", value)))

    def add(self, name: str, time_s: float, *values) -> None:
        self.parts += self._waiting
        self._waiting = []
        body = self._packs[name].pack(round(time_s * 1e6), *values)
        self.parts.append(self._message("D", struct.pack("<H", self._ids[name]) + body))

    def text(self, time_s: float, text: str) -> None:
        self.parts += self._waiting
        self._waiting = []
        self.parts.append(self._message("L", struct.pack("<BQ", ord("6"), round(time_s * 1e6)) + text.encode()))

    @property
    def data(self) -> bytes:
        return b"".join(self.parts)


def ulog(columns, *, status=None, parameters=None, sensor=False, gps=None, ratios=None, reset=None) -> ULogWriter:
    """A log of PX4 in the air; `status` gives (vehicle_type, is_vtol, in_transition_mode, system_type) of a row.

    `reset` gives how often the filter has reset its velocity, and by how much last.
    """
    log = ULogWriter()
    floats = {f"q[{number}]": "float" for number in range(4)}
    log.topic("vehicle_attitude", **{name.replace("[", "").replace("]", ""): kind for name, kind in floats.items()})
    log.parts[-1] = log._message("F", b"vehicle_attitude:uint64_t timestamp;float[4] q;")
    position = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz", "ref_alt"), "float")
    position |= {"ref_lat": "double", "ref_lon": "double", "xy_global": "bool", "v_xy_valid": "bool"}
    log.topic(
        "vehicle_local_position",
        **position,
        vxy_reset_counter="uint8_t",
        **{"delta_vxy[0]": "float", "delta_vxy[1]": "float"},
    )
    log.topic(
        "vehicle_gps_position", hdop="float", s_variance_m_s="float", fix_type="uint8_t", satellites_used="uint8_t"
    )
    log.topic("estimator_status", vel_test_ratio="float", pos_test_ratio="float", solution_status_flags="uint16_t")
    log.topic("vehicle_land_detected", landed="bool")
    log.topic(
        "vehicle_status",
        nav_state="uint8_t",
        arming_state="uint8_t",
        failsafe="bool",
        vehicle_type="uint8_t",
        is_vtol="bool",
        in_transition_mode="bool",
        system_type="uint8_t",
        system_id="uint8_t",
    )
    log.topic("airspeed", true_airspeed_m_s="float")
    for name, value in (parameters or {}).items():
        log.parameter(name, value)
    for row, time_s in enumerate(float(value) for value in columns["time_s"]):
        now = 2.0 + time_s
        north, east = (float(columns[f"vel_{name}_mps"][row]) for name in ("north", "east"))
        if row % 10 == 0:
            kind, vtol, turn_back, system_type = (1, 0, 0, 2) if status is None else status(row)
            log.add("vehicle_status", now, 3, 2, 0, kind, vtol, turn_back, system_type, 1)
            log.add("vehicle_land_detected", now, 0)
        fix, satellites, hdop = (3, 14, 0.8) if gps is None else gps(row)
        log.add("vehicle_gps_position", now, hdop, 0.2, fix, satellites)
        log.add("estimator_status", now, *((0.1, 0.1, 0x33F) if ratios is None else ratios(row)))
        half = [0.5 * float(columns[name][row]) for name in ("roll_rad", "pitch_rad", "yaw_rad")]
        (cr, sr), (cp, sp), (cy, sy) = ((math.cos(angle), math.sin(angle)) for angle in half)
        quaternion = (cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy)
        log.add("vehicle_attitude", now, *quaternion, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy)
        corrected = (0, 0.0, 0.0) if reset is None else reset(row)
        log.add("vehicle_local_position", now, 0.0, 0.0, -60.0, north, east, 0.0, 500.0, 47.0, 8.0, 1, 1, *corrected)
        if sensor:
            log.add("airspeed", now, float(columns["airspeed_mps"][row]))
    return log
