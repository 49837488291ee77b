"""The vehicle's time as a clock, also in a simulation that runs faster than real time."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from skyway.link.telemetry.vehicle_monitor import VehicleMonitor
    from skyway.models.base.clock import Clock


_CATCHING_UP = 0.5


class VehicleTime:
    """A clock that follows the times of a vehicle's telemetry.

    Between samples, and without any, it continues at the rate of the wall clock. It never goes back, and never stands still: if it
    is ahead of the vehicle, as after a change of the simulation's speed, it runs at half speed until it is not. So a wait
    for an instant always ends. Time-outs use the wall clock.
    """

    def __init__(self, vehicle: VehicleMonitor, clock: Clock) -> None:
        self._vehicle, self._clock = vehicle, clock
        self._at = (clock.posix_s(), clock.now_s())
        self._sample_s = -1.0
        self._latest_s = clock.posix_s()
        self._asked_s = clock.now_s()
        self._known = False

    def posix_s(self) -> float:
        """The vehicle's present time, POSIX seconds."""
        sample = self._vehicle.live.sample
        wall = self._clock.now_s()
        if sample is not None and sample.time_s != self._sample_s and self._vehicle.live.clock.base.absolute:
            self._sample_s = sample.time_s
            self._at = (sample.time_s, wall)
            if not self._known:
                self._known, self._latest_s = True, sample.time_s
        slowly = self._latest_s + _CATCHING_UP * (wall - self._asked_s)
        self._latest_s, self._asked_s = max(slowly, self._at[0] + wall - self._at[1]), wall
        return self._latest_s

    def now_s(self) -> float:
        """Seconds since some start, by the wall clock: communication on the link does not run faster."""
        return self._clock.now_s()

    def sleep_until(self, instant_s: float) -> None:
        """Wait by the wall clock."""
        self._clock.sleep_until(instant_s)
