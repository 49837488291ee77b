"""State of the vehicle: its identity, its position, whether it flies.

Flight is detected from the reported state, the motion and the motor current, so that one wrong value decides nothing.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.observed.remote_id_watch import RemoteIdWatch

if TYPE_CHECKING:
    from skyway.models.drones.telemetry import TelemetrySample

MOVES_MPS, CLIMBS_MPS = 2.0, 0.7
DRAWS_A, RESTS_A = 10.0, 5.0
"""Motors in flight draw more than the first current, motors at rest less than the second, A."""
PLACE_FRESH_S = 10.0
"""Maximum age of a valid position, s: over poor radios many are lost."""


@dataclass(slots=True)
class VehicleState:
    """State reported by one vehicle."""

    sample: TelemetrySample | None = None
    uid: int = 0
    """Hardware id; 0 if unknown."""
    remote_id: RemoteIdWatch = field(default_factory=RemoteIdWatch)
    """Remote ID that the vehicle broadcasts."""
    _reboots: int = 0
    _position: tuple[float, float, float] = (math.nan, math.nan, -math.inf)

    def hear(self, sample: TelemetrySample) -> None:
        """Take a sample."""
        self.sample = sample
        if math.isfinite(sample.lat_deg) and math.isfinite(sample.lon_deg):
            self._position = (sample.lat_deg, sample.lon_deg, sample.time_s)

    # Identity

    def identify(self, uid: int) -> None:
        """Set the hardware id to which this delivery belongs."""
        self.uid = uid

    def is_another(self, uid: int) -> bool:
        """Whether a hardware id is known to be that of another vehicle."""
        return bool(self.uid and uid and uid != self.uid)

    def restarted(self, reboots: int) -> bool:
        """Whether the vehicle has restarted since the last call, by its boot counter."""
        changed, self._reboots = reboots != self._reboots, reboots
        return changed

    @property
    def system(self) -> str:
        """MAVLink system id, by which pads identify it; ``1`` until known."""
        return str(1 if self.sample is None else self.sample.system)

    # Place

    @property
    def on_ground(self) -> bool:
        """Whether the vehicle is known to stand disarmed on the ground."""
        s = self.sample
        return s is not None and s.armed == 0.0 and not flies(s)

    @property
    def in_air(self) -> bool:
        """Whether the vehicle flies, or is armed and not known to be on the ground."""
        s = self.sample
        known = None if s is None else flies(s)
        return s is not None and (s.armed == 1.0 if known is None else known)

    @property
    def place(self) -> tuple[float, float] | None:
        """Latitude and longitude; None if unknown."""
        lat, lon, time_s = self._position
        if self.sample is None or self.sample.time_s > time_s + PLACE_FRESH_S:
            return None
        return lat, lon


def flies(sample: TelemetrySample) -> bool | None:
    """Return whether it is in the air by most of its indications; None if they are even and its state is unknown."""
    witnesses = [_said(sample), _moves(sample), _draws(sample)]
    known = [one for one in witnesses if one is not None]
    up = sum(known)
    if 2 * up != len(known):
        return 2 * up > len(known)
    if known and witnesses[0] is not None:
        return witnesses[0]
    return None


def _said(sample: TelemetrySample) -> bool | None:
    return None if math.isnan(sample.landed) else sample.landed == 0.0


def _moves(sample: TelemetrySample) -> bool | None:
    speed, climb = sample.ground_speed_mps, abs(sample.vel_down_mps)
    return None if math.isnan(speed + climb) else speed > MOVES_MPS or climb > CLIMBS_MPS


def _draws(sample: TelemetrySample) -> bool | None:
    if sample.current_a > DRAWS_A:
        return True
    return False if sample.current_a < RESTS_A else None
