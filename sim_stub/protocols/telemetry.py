"""Telemetry messages that a vehicle streams."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from skyway.models.wind import triangle as wind
from skyway.sim_stub.autopilot.mission_run import MissionState
from skyway.sim_stub.autopilot.modes import MANUAL_MODES, Mode
from skyway.sim_stub.faults import SENSORS
from skyway.sim_stub.wire.messages import classes, message, message_id

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.sim_stub.vehicle import Vehicle

_NAN = math.nan
_ID_FIELDS = ("mission_id", "fence_id", "rally_points_id")
STREAM_GROUPS = {
    # MAV_DATA_STREAM of REQUEST_DATA_STREAM
    1: ("RAW_IMU", "SCALED_PRESSURE"),
    2: ("SYS_STATUS", "POWER_STATUS", "MISSION_CURRENT", "GPS_RAW_INT", "NAV_CONTROLLER_OUTPUT", "FENCE_STATUS"),
    3: ("RC_CHANNELS",),
    6: ("GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"),
    10: ("ATTITUDE",),
    11: ("VFR_HUD",),
    12: ("SYSTEM_TIME", "BATTERY_STATUS", "WIND", "EKF_STATUS_REPORT", "EXTENDED_SYS_STATE"),
}
_SENSORS = 0x01 | 0x02 | 0x04 | 0x08 | 0x20 | 0x400 | 0x800 | 0x1000 | 0x2000 | 0x4000 | 0x8000 | 0x200000
_PREARM = 0x10000000
_FTP = 0x20
"""MAV_PROTOCOL_CAPABILITY_FTP."""
_BATTERY = 0x2000000
_GPS = 0x20
_WINCH_HEALTHY, _WINCH_IN, _WINCH_MOVES = 1, 2, 4
_RC = 0x10000
_FENCE = 0x100000


def _heartbeat(v: Vehicle) -> Any:
    pilot = v.autopilot
    manual = pilot.mode in MANUAL_MODES
    base = 1 | (128 if pilot.armed else 0) | (16 if not manual else 64)
    if pilot.mode in (Mode.MISSION, Mode.RTL, Mode.LAND, Mode.TAKEOFF, Mode.HOLD, Mode.GUIDED):
        base |= 8 | 4
    if pilot.ALWAYS_MANUAL_INPUT or manual:
        base |= 64
    if pilot.crashed or pilot.terminated:
        status = 6
    elif pilot.failsafes.battery_level >= 2 or pilot.failsafes.active:
        status = 5 if pilot.armed else 3
    else:
        status = 4 if pilot.armed and not pilot.landed else 3
    return _HEARTBEAT(2, pilot.AUTOPILOT_ID, base, pilot.custom_mode(), status, 3)


def _attitude(v: Vehicle) -> Any:
    b = v.body
    return _ATTITUDE(v.boot_ms, b.roll, b.pitch, b.yaw, b.roll_rate, b.pitch_rate, b.yaw_rate)


def _attitude_quaternion(v: Vehicle) -> Any:
    b = v.body
    cr, sr = math.cos(b.roll / 2), math.sin(b.roll / 2)
    cp, sp = math.cos(b.pitch / 2), math.sin(b.pitch / 2)
    cy, sy = math.cos(b.yaw / 2), math.sin(b.yaw / 2)
    return _QUATERNION(
        v.boot_ms,
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        b.roll_rate,
        b.pitch_rate,
        b.yaw_rate,
    )


def _global_position(v: Vehicle) -> Any:
    b = v.body
    heading = int(math.degrees(b.yaw) % 360.0 * 100.0) % 36000
    return _GLOBAL_POSITION(
        v.boot_ms,
        round(v.position.lat * 1e7),
        round(v.position.lon * 1e7),
        round(b.alt_m * 1e3),
        round((b.alt_m - v.autopilot.home_alt_m) * 1e3),
        round(b.north_mps * 100.0),
        round(b.east_mps * 100.0),
        round(-b.up_mps * 100.0),
        heading,
    )


def _local_position(v: Vehicle) -> Any:
    b = v.body
    north, east, down = v.local_ned()
    return _LOCAL_POSITION(v.boot_ms, north, east, down, b.north_mps, b.east_mps, -b.up_mps)


def _vfr_hud(v: Vehicle) -> Any:
    b, pilot = v.body, v.autopilot
    airspeed = b.ground_speed_mps if pilot.TELLS_AIRSPEED else _NAN
    throttle = min(100, int(50.0 * b.thrust_n / v.airframe.weight_n)) if pilot.armed else 0
    heading = int(math.degrees(b.yaw) % 360.0)
    return _VFR_HUD(airspeed, b.ground_speed_mps, heading, throttle, b.alt_m, b.up_mps)


def _gps_raw(v: Vehicle) -> Any:
    b, fixed = v.body, v.faults.positioning and v.since_boot_s > 2.0
    lat, lon = v.position.fix
    course = int(math.degrees(math.atan2(b.east_mps, b.north_mps)) % 360.0 * 100.0) % 36000
    return message(
        "GPS_RAW_INT",
        time_usec=int(v.posix_s * 1e6),
        fix_type=3 if fixed else 1,
        lat=round(lat * 1e7) if fixed else 0,
        lon=round(lon * 1e7) if fixed else 0,
        alt=round(b.alt_m * 1e3) if fixed else 0,
        eph=90 if fixed else 65535,
        epv=140 if fixed else 65535,
        vel=round(b.ground_speed_mps * 100.0) if fixed else 65535,
        cog=course if fixed else 65535,
        satellites_visible=14 if fixed else 0,
        h_acc=900,
        v_acc=1400,
    )


def _sys_status(v: Vehicle) -> Any:
    pilot = v.autopilot
    present = _SENSORS | _PREARM | _BATTERY | _RC
    if pilot.fence.areas:
        present |= _FENCE
    health = present | _FENCE  # a station that finds it unhealthy speaks of a breach
    if "fence" in pilot.failsafes.active:
        health &= ~_FENCE
    if not v.faults.positioning or v.since_boot_s < 2.0:
        health &= ~_GPS
    if "rc-loss" in v.faults.active:
        health &= ~_RC
    if pilot.failsafes.battery_level:
        health &= ~_BATTERY
    if (ill := v.faults.active.get("sensor-ill")) is not None:
        health &= ~SENSORS[ill.word]
    if not pilot.armed and pilot.arming_refusals():
        health &= ~_PREARM
    return message(
        "SYS_STATUS",
        onboard_control_sensors_present=present,
        onboard_control_sensors_enabled=present,
        onboard_control_sensors_health=health,
        load=180,
        voltage_battery=round(v.battery.voltage_v * 1e3),
        current_battery=round(v.battery.current_a * 100.0),
        battery_remaining=pilot.reported_percent(),
    )


def _battery_status(v: Vehicle) -> Any:
    battery, percent = v.battery, v.autopilot.reported_percent()
    cell, low = round(battery.voltage_v / 6.0 * 1e3), round(1e3 * v.faults.value("cell-low"))
    state = v.autopilot.failsafes.battery_level + 1
    left_s = 0
    if battery.power_w > 60.0 and percent > 0:
        left_s = int(percent / 100.0 * battery.capacity_j / battery.power_w)
    return message(
        "BATTERY_STATUS",
        current_consumed=round(v.counted_mah),
        energy_consumed=round(v.counted_mah * 3.6 * 22.8 / 100.0),
        temperature=2500,
        voltages=(max(cell - low, 0), *(cell,) * 5, *(65535,) * 4),
        current_battery=round(battery.current_a * 100.0),
        battery_function=1,
        type=1,
        battery_remaining=percent,
        time_remaining=left_s,
        charge_state=7 if v.charging is not None else state,
    )


_GYRO_SHAKES = 0.01
_SHAKES_MPS2 = 6.0


def _vibration(v: Vehicle) -> Any:
    """Make VIBRATION; the families fill its three fields differently."""
    turning = v.autopilot.armed
    shakes = v.faults.value("vibration", _SHAKES_MPS2 * v.autopilot.VIBRATION_SCALE) if turning else 0.05
    across = shakes if v.autopilot.VIBRATION_OF_ACCELERATION else _GYRO_SHAKES
    return message("VIBRATION", time_usec=v.boot_us, vibration_x=across, vibration_y=across, vibration_z=shakes)


def _esc_info(v: Vehicle) -> Any:
    ill = v.faults.active.get("motor-ill")
    flags = tuple(int(ill is not None and int(ill.value) == number) for number in range(1, 5))
    return message(
        "ESC_INFO",
        time_usec=v.boot_us,
        failure_flags=flags,
        temperature=(2500,) * 4,
        count=4,
        connection_type=3,
        info=0xF,
    )


def mission_current(v: Vehicle) -> Any:
    """Make MISSION_CURRENT; its total does not count home."""
    pilot = v.autopilot
    run = pilot.run
    state = int(MissionState.NO_MISSION if pilot.infeasible else run.state)
    in_mission = 2 if pilot.mode != Mode.MISSION else 1
    return message(
        "MISSION_CURRENT",
        seq=run.current,
        total=max(len(run.items) - pilot.HOME_ITEMS, 0),
        mission_state=state,
        mission_mode=in_mission,
        **(dict(zip(_ID_FIELDS, v.mission_ids, strict=True)) if pilot.TELLS_LIST_IDS else {}),
    )


def _home_position(v: Vehicle) -> Any:
    home = v.autopilot.home
    if home is None:
        return None
    north, east, down = v.local_ned_of(home.lat, home.lon, home.alt_m)
    return message(
        "HOME_POSITION",
        latitude=round(home.lat * 1e7),
        longitude=round(home.lon * 1e7),
        altitude=round(home.alt_m * 1e3),
        x=north,
        y=east,
        z=down,
        q=(1.0, 0.0, 0.0, 0.0),
        time_usec=v.boot_us,
    )


def _altitude(v: Vehicle) -> Any:
    b = v.body
    relative = b.alt_m - v.autopilot.home_alt_m
    return _ALTITUDE(v.boot_us, b.alt_m, b.alt_m, relative, relative, _NAN, _NAN)


def _wind(v: Vehicle) -> Any:
    estimate = v.autopilot.wind_estimate()
    speed, direction = wind.speed_from(*estimate) if estimate else (0.0, 0.0)
    return message("WIND", direction=float(direction), speed=float(speed))


def _winch_status(v: Vehicle) -> Any:
    """A Daiwa's line as it is out; by pulses nothing is measured, and its line is the one that was ordered."""
    winch = v.winch
    if not v.autopilot.tells_winch:
        return None
    measured = v.autopilot.parameters["WINCH_TYPE"] == 2.0
    line_m = winch.line_m if measured else winch.wanted_m
    flags = _WINCH_HEALTHY | (_WINCH_IN if line_m <= 0.0 else 0) | (_WINCH_MOVES if winch.moving else 0)
    return message("WINCH_STATUS", time_usec=v.boot_us, line_length=line_m, speed=abs(winch.speed_mps), status=flags)


def _wind_cov(v: Vehicle) -> Any:
    estimate = v.autopilot.wind_estimate()
    if estimate is None:
        return None
    north, east = estimate
    return message(
        "WIND_COV",
        time_usec=v.boot_us,
        wind_x=north,
        wind_y=east,
        var_horiz=0.4,
        wind_alt=v.body.alt_m,
        horiz_accuracy=0.6,
    )


def _nav_controller(v: Vehicle) -> Any:
    b = v.body
    behaviour = v.autopilot.run.behaviour
    distance = getattr(behaviour, "distance_m", 0.0)
    return message(
        "NAV_CONTROLLER_OUTPUT",
        nav_roll=math.degrees(b.roll),
        nav_pitch=math.degrees(b.pitch),
        nav_bearing=round(math.degrees(b.yaw)),
        target_bearing=round(math.degrees(b.yaw)),
        wp_dist=min(65535, int(distance)) if math.isfinite(distance) else 0,
    )


def _rc_channels(v: Vehicle) -> Any:
    raw = 65535 if "rc-loss" in v.faults.active else 1500
    values = {f"chan{n}_raw": raw if n <= 8 else 65535 for n in range(1, 19)}
    return message("RC_CHANNELS", time_boot_ms=v.boot_ms, chancount=8, rssi=200 if raw == 1500 else 0, **values)


def _filter_flags(v: Vehicle, glitch: int) -> int:
    return (0x33F if v.autopilot.ready else 0x0A7) | (glitch if v.position.glitching else 0)


def _ekf_status(v: Vehicle) -> Any:
    flags = _filter_flags(v, 0x8000)
    return message("EKF_STATUS_REPORT", flags=flags, velocity_variance=0.05, compass_variance=0.02)


def _estimator_status(v: Vehicle) -> Any:
    return message("ESTIMATOR_STATUS", time_usec=v.boot_us, flags=_filter_flags(v, 0x400), pos_horiz_accuracy=0.4)


def _fence_status(v: Vehicle) -> Any:
    failsafes = v.autopilot.failsafes
    breached = "fence" in failsafes.active
    return message(
        "FENCE_STATUS",
        breach_count=failsafes.breaches,
        breach_status=int(breached),
        breach_type=3 if breached else 0,
    )


def _scaled_pressure(v: Vehicle) -> Any:
    pressure = 1013.25 * (1.0 - 2.25577e-5 * max(-500.0, min(v.body.alt_m, 11_000.0))) ** 5.25588
    return message("SCALED_PRESSURE", time_boot_ms=v.boot_ms, press_abs=pressure, temperature=2200)


def _gps_origin(v: Vehicle) -> Any:
    lat, lon, alt = v.origin
    return message(
        "GPS_GLOBAL_ORIGIN",
        latitude=round(lat * 1e7),
        longitude=round(lon * 1e7),
        altitude=round(alt * 1e3),
        time_usec=v.boot_us,
    )


_HEARTBEAT, _ATTITUDE, _QUATERNION, _GLOBAL_POSITION, _LOCAL_POSITION, _VFR_HUD, _ALTITUDE = (
    classes()[name]
    for name in (
        *("HEARTBEAT", "ATTITUDE", "ATTITUDE_QUATERNION", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED", "VFR_HUD"),
        "ALTITUDE",
    )
)
"""Classes of the messages that are sent most often: made without a name to look up."""
BUILDERS: dict[int, Callable[[Vehicle], Any]] = {
    message_id(name): builder
    for name, builder in {
        "HEARTBEAT": _heartbeat,
        "ATTITUDE": _attitude,
        "ATTITUDE_QUATERNION": _attitude_quaternion,
        "GLOBAL_POSITION_INT": _global_position,
        "LOCAL_POSITION_NED": _local_position,
        "VFR_HUD": _vfr_hud,
        "GPS_RAW_INT": _gps_raw,
        "SYS_STATUS": _sys_status,
        "BATTERY_STATUS": _battery_status,
        "EXTENDED_SYS_STATE": lambda v: message("EXTENDED_SYS_STATE", landed_state=v.autopilot.landed_state),
        "MISSION_CURRENT": mission_current,
        "HOME_POSITION": _home_position,
        "ALTITUDE": _altitude,
        "SYSTEM_TIME": lambda v: message(
            "SYSTEM_TIME", time_unix_usec=int(v.autopilot.clock_of_day_s() * 1e6), time_boot_ms=v.boot_ms
        ),
        "WIND": _wind,
        "WIND_COV": _wind_cov,
        "NAV_CONTROLLER_OUTPUT": _nav_controller,
        "RC_CHANNELS": _rc_channels,
        "EKF_STATUS_REPORT": _ekf_status,
        "ESTIMATOR_STATUS": _estimator_status,
        "FENCE_STATUS": _fence_status,
        "VIBRATION": _vibration,
        "ESC_INFO": _esc_info,
        "RAW_IMU": lambda v: message("RAW_IMU", time_usec=v.boot_us, zacc=-1000, xmag=220, zmag=420),
        "SCALED_PRESSURE": _scaled_pressure,
        "GPS_GLOBAL_ORIGIN": _gps_origin,
        "POWER_STATUS": lambda v: message("POWER_STATUS", Vcc=5050 if v.battery.soc > 0 else 4600, Vservo=0, flags=1),
    }.items()
}
"""Each message that can be streamed or asked for, as it is now; None where there is nothing to say."""


def _version(v: Vehicle) -> Any:
    uid = 0x5A17_0000_0000_0000 | v.config.system
    return message(
        "AUTOPILOT_VERSION",
        capabilities=v.autopilot.CAPABILITIES & ~(_FTP if "no-ftp" in v.faults.active else 0),
        uid=uid,
        uid2=tuple(uid.to_bytes(8, "little")) + (0,) * 10,
        flight_sw_version=v.config.version_number,
        middleware_sw_version=v.config.version_number,
        board_version=1,
        vendor_id=0x1209,
        product_id=0x5741,
    )


def _aircraft(v: Vehicle) -> Any:
    """Make ADSB_VEHICLE of an aircraft that circles the vehicle, where there is one."""
    if "aircraft" not in v.faults.active:
        return None
    angle, away_m = 0.1 * v.sim_s, v.faults.value("aircraft")
    return message(
        "ADSB_VEHICLE",
        ICAO_address=0xABCDEF,
        lat=round((v.body.lat + away_m * math.cos(angle) / 111_000.0) * 1e7),
        lon=round((v.body.lon + away_m * math.sin(angle) / (111_000.0 * math.cos(math.radians(v.body.lat)))) * 1e7),
        altitude_type=1,
        altitude=round((v.body.alt_m + 100.0) * 1e3),
        callsign="N12345",
        tslc=1,
        flags=1 | 2 | 16,
    )


def _control_status(v: Vehicle) -> Any:
    return v.commands.control.status()


WINCH = message_id("WINCH_STATUS")
"""Sent where there is a winch that tells."""
STREAMED: dict[int, Callable[[Vehicle], Any]] = {
    **BUILDERS,
    message_id("CONTROL_STATUS"): _control_status,
    message_id("ADSB_VEHICLE"): _aircraft,
    WINCH: _winch_status,
    message_id("OPEN_DRONE_ID_ARM_STATUS"): lambda _: None,  # in the name of the module, not of the autopilot
}
"""The same, with those that nobody asks for."""
VERSION, PROTOCOL_VERSION, HOME = map(message_id, ("AUTOPILOT_VERSION", "PROTOCOL_VERSION", "HOME_POSITION"))
ON_REQUEST: dict[int, Callable[[Vehicle], Any]] = {
    **BUILDERS,
    VERSION: _version,
    WINCH: _winch_status,
    PROTOCOL_VERSION: lambda _: message("PROTOCOL_VERSION", version=200, min_version=100, max_version=200),
}
"""The same, with those that are only asked for."""
