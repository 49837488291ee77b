"""Position estimate of the vehicle: the receiver's fix, and the filtered estimate.

Both are the truth, until a glitch moves the fix. An estimator fuses a small jump and rejects a large one for as long
as its patience lasts; then it believes the receiver and the estimate jumps. So a short glitch is seen in GPS_RAW_INT
alone, a long one is flown; and when the receiver comes back to the truth, the estimate is as slow again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.sim_stub.plant.physics import metres_per_degree

if TYPE_CHECKING:
    from skyway.sim_stub.plant.physics import Body

_FUSED_M = 5.0
"""A jump up to here passes the innovation gates."""


@dataclass(slots=True)
class Positioning:
    """Fix and estimate of one vehicle."""

    body: Body
    """Where it truly is."""
    bearing_rad: float
    """Direction in which glitches go."""
    patience_s: float
    """Time for which the estimator rejects a fix that is far off."""
    fix_m: float = 0.0
    estimate_m: float = 0.0
    """`fix_m`, `estimate_m`: how far fix and estimate are off."""
    _apart_s: float | None = None

    @property
    def lat(self) -> float:
        """Estimated latitude, degrees."""
        return self.body.lat if self.estimate_m == 0.0 else self._moved(self.estimate_m)[0]

    @property
    def lon(self) -> float:
        """Estimated longitude, degrees."""
        return self.body.lon if self.estimate_m == 0.0 else self._moved(self.estimate_m)[1]

    @property
    def fix(self) -> tuple[float, float]:
        """Latitude and longitude of the receiver, degrees."""
        return self._moved(self.fix_m)

    @property
    def glitching(self) -> bool:
        """Whether the estimator rejects the fix."""
        return self._apart_s is not None

    @property
    def next_change_s(self) -> float:
        """Simulated instant at which the estimate gives in."""
        return math.inf if self._apart_s is None else self._apart_s + self.patience_s

    def update(self, fix_m: float, sim_s: float) -> bool:
        """Take a fix that is so far off; returns whether the estimate has jumped because its patience is over."""
        self.fix_m = fix_m
        if abs(fix_m - self.estimate_m) <= _FUSED_M:
            self.estimate_m, self._apart_s = fix_m, None
            return False
        if self._apart_s is None:
            self._apart_s = sim_s
        if sim_s < self.next_change_s:
            return False
        self.estimate_m, self._apart_s = fix_m, None
        return True

    def _moved(self, metres: float) -> tuple[float, float]:
        body = self.body
        north, east = metres_per_degree(body.lat)
        return (
            body.lat + metres * math.cos(self.bearing_rad) / north,
            body.lon + metres * math.sin(self.bearing_rad) / east,
        )
