"""How the online policy leaves a stop."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    from skyway.planner.online.turn_back_kernels import TurnBack


@dataclass(frozen=True)
class Departure:
    """How to leave a stop, until the wind is measured again or it is time to look again.

    Attributes
    ----------
    segments : tuple of int
        Flown without a landing between, if all goes well.
    charge : float
        Take-off with at least this charge.
    need : callable
        Charge without which the flight is not begun at a time, POSIX seconds.
    look_s : float
        Decide again then, POSIX seconds.
    turning : Turning or None
        How it may turn back on the first segment.
    """

    segments: tuple[int, ...]
    charge: float
    need: Callable[[float], float]
    look_s: float = math.inf
    turn_back: TurnBack | None = None
