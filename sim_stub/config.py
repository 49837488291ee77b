"""Configuration of one simulated vehicle."""

from __future__ import annotations

from dataclasses import dataclass, field

from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError
from skyway.models.base.ranges import range_faults
from skyway.sim_stub.autopilot import NAMES
from skyway.sim_stub.autopilot.registry import FAMILIES
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.physics import STEP_S

_MAIN = (1, 19)


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleConfig:
    """Configuration of one vehicle."""

    lat: float
    lon: float
    """`lat`, `lon`: where it stands at the start, degrees."""
    ground_m: float = 0.0
    """Height of the ground there above mean sea level."""
    system: int = 1
    """MAVLink system id, 1-255."""
    autopilot: str = NAMES[0]
    """One of `sim_stub.autopilot.registry.FAMILIES`."""
    firmware: str = ""
    """Version of the autopilot, one of its family's `FIRMWARES`; empty is the usual one."""
    soc: float = 1.0
    """State of charge at the start."""
    payload_kg: float = 0.0
    """Package on board."""
    seed: int = 1
    """Seeds gusts and errors; together with the system id."""
    warm: bool = False
    """It has been on for two minutes: ready to arm at once."""
    power_error: float | None = None
    """Factor on the power drawn; None draws one within 5 % from the seed."""
    signing_key: bytes | None = None
    """32 bytes; None speaks unsigned."""
    operator_control: bool = False
    """It says which ground station is in control, and denies orders of others."""
    remote_id: bool = False
    """It has a Remote ID module."""
    airframe: Airframe = field(default_factory=Airframe)
    parameters: tuple[tuple[str, float], ...] = ()
    """Names and values set before the start."""
    step_s: float = STEP_S
    """Longest step of its physics; a longer one takes less time."""
    logs: tuple[int, ...] = ()
    """Bytes of the logs of earlier flights on its card, an hour apart."""
    log_room_bytes: int = 0
    """Room on its card for logs of its own flights; 0 writes none."""

    def __post_init__(self) -> None:
        faults = range_faults("system", self.system, 1, 255, "1 to 255")
        if self.autopilot not in FAMILIES:
            known = "one of " + ", ".join(FAMILIES)
            faults.append(Wrong("unknown autopilot", field="autopilot", value=self.autopilot, remedy=known))
        elif self.firmware and self.firmware not in FAMILIES[self.autopilot].FIRMWARES:
            known = f"{self.autopilot} is simulated as {', '.join(FAMILIES[self.autopilot].FIRMWARES)}"
            faults.append(Wrong("no such version", field="firmware", value=self.firmware, remedy=known))
        faults += range_faults("soc", self.soc, 0.0, 1.0, "0 to 1")
        faults += range_faults("step_s", self.step_s, 0.01, 0.2, "0.01 to 0.2 s")
        faults += range_faults("payload_kg", self.payload_kg, 0.0, 10.0, "0 to 10")
        if self.signing_key is not None and len(self.signing_key) != 32:
            faults.append(Wrong("not 32 bytes", field="signing_key"))
        if faults:
            raise InputError(faults)

    @property
    def version(self) -> tuple[int, int]:
        """Major and minor number of the firmware."""
        text = self.firmware or FAMILIES[self.autopilot].USUAL_FIRMWARE
        if text == "main":
            return _MAIN
        major, _, minor = text.partition(".")
        return int(major), int(minor)

    @property
    def version_number(self) -> int:
        """The same as AUTOPILOT_VERSION has it: a release, and main an unreleased state."""
        major, minor = self.version
        unreleased = self.firmware in FAMILIES[self.autopilot].UNRELEASED
        return major << 24 | minor << 16 | (0 if unreleased else 0xFF)
