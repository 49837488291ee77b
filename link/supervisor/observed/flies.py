"""Whether a vehicle flies: by what it says, by how it moves and by what its motors draw, so that one wrong value decides nothing."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.models.drones.telemetry import TelemetrySample

MOVES_MPS, CLIMBS_MPS = 2.0, 0.7
DRAWS_A, RESTS_A = 10.0, 5.0
"""Motors that carry a vehicle draw more than one, those that stand still less than the other."""


def flies(sample: TelemetrySample) -> bool | None:
    """Tell whether it is in the air by most of its witnesses; None where they are even and its state is not known."""
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
