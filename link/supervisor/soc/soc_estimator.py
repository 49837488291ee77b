"""Estimator of the charge: the accepted report of the vehicle, corrected by pad measurements and by the voltage."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from skyway.link.supervisor.journal.entries import GaugeNote
from skyway.link.supervisor.soc.pack_charges import PackCharges
from skyway.link.supervisor.soc.reported_soc import ReportedSoc
from skyway.link.supervisor.soc.voltage import VoltageWatch
from skyway.link.supervisor.states import IN_AIR
from skyway.models.base.formatting import percent
from skyway.models.drones.airspeed_load import BLADE_SHARE, INFLOW_MPS

if TYPE_CHECKING:
    from skyway.link.supervisor.context import Context
    from skyway.models.drones.telemetry import TelemetrySample

MIN_GAUGE_SOC = 0.08
"""A flight that used less charge is not compared."""
EVERY_S = 0.5
"""Battery messages come once a second; samples repeat them."""
CONFIRMING_S = 6.0
"""Time in which a report that the voltage is confirming is not also counted as a loss by the voltage, s."""


@dataclass(slots=True)
class SocEstimator:
    """The state of charge of one vehicle."""

    soc: float = math.nan
    """Estimate."""
    reported_soc: float = math.nan
    """Accepted report of the vehicle."""
    source: str = "unknown"
    """Source of `soc`, for a person."""
    lost_s: float = -math.inf
    """Time of the last sudden loss of charge, POSIX seconds."""
    _reported: ReportedSoc = field(default_factory=ReportedSoc)
    _packs: PackCharges = field(default_factory=PackCharges)
    _voltage: VoltageWatch = field(default_factory=VoltageWatch)
    _flown_from: tuple[float, float] = (math.nan, math.nan)
    """Charge at the first take-off after charging: as reported by the vehicle, and as estimated."""
    _received_s: float = -math.inf

    @property
    def lost_soc(self) -> float:
        """Return charge that was lost and that the vehicle does not count."""
        return self._voltage.lost

    def doubtful(self, *, affordable: bool = True) -> bool:
        """Whether only a momentary voltage indicates lost charge, see `VoltageWatch.doubtful`."""
        return self._voltage.doubtful(affordable=affordable)

    def hear(self, ctx: Context, sample: TelemetrySample) -> None:
        """Take a state of charge reported by the vehicle."""
        if sample.time_s < self._received_s + EVERY_S and sample.time_s >= self._received_s:
            return
        self._received_s = sample.time_s
        leg, report = ctx.delivery.leg, self._reported
        flies = leg is not None and ctx.state in IN_AIR
        modelled = None if leg is None or not ctx.in_air else leg.modelled
        rate = 0.0 if modelled is None else modelled.per_s * ctx.energy.belief.mean_ratio
        open_v = sample.voltage_v + sample.current_a * self._voltage.ohm
        was_contradicted, before = report.contradicted, self._reported_now(sample.time_s, rate)
        fell = report.hear(sample.time_s, sample.soc, open_v, rate, flies=ctx.in_air)
        packs = ctx.vehicle.batteries.fresh(ctx.vehicle.connection.clock.now_s())
        news = self._packs.hear(sample.time_s, packs, rate, flies=ctx.in_air)
        if not math.isfinite(report.soc):
            return
        self.reported_soc = self._reported_now(sample.time_s, rate)
        if report.contradicted and not was_contradicted and not self._packs:
            ctx.say(
                GaugeNote(),
                f"the drone reports {percent(sample.soc)}, but its voltage contradicts that: ignored",
            )
        change = before - self.reported_soc if news or fell != 0.0 else 0.0
        if leg is not None and flies and change != 0.0:
            number, soc = self._packs.emptiest(sample.time_s, rate)
            leg.lose_reported(change)
            self._lose(
                ctx,
                change,
                f"battery {number} reports {percent(soc)}: the emptiest battery decides"
                if soc <= self.reported_soc
                else f"{percent(change)} of charge lost at once: report and voltage fell together",
            )
        if report.contradicted or not sample.time_s < report.held_s + CONFIRMING_S:
            self._hear_voltage(ctx, sample, flies=flies)
        self.soc, self.source = max(self.reported_soc - self._voltage.lost, 0.0), "the vehicle"
        if leg is not None and math.isfinite(leg.soc_start) and (ctx.energy.gauge != 1.0 or self._voltage.lost > 0.0):
            self.soc = max(leg.soc_start - ctx.energy.gauge * (leg.reported_start - self.reported_soc), 0.0)
            self.source = "the vehicle, corrected"

    def _reported_now(self, time_s: float, rate_per_s: float) -> float:
        """Return the charge now by the accepted reports: the vehicle's, or that of its emptiest pack."""
        return min(self._reported.line(time_s, rate_per_s), self._packs.emptiest(time_s, rate_per_s)[1])

    def _hear_voltage(self, ctx: Context, sample: TelemetrySample, *, flies: bool) -> None:
        doubted = self._voltage.doubtful()
        given = (sample.time_s, sample.voltage_v, sample.current_a, self.reported_soc)
        fell = self._voltage.hear(*given, load=_load(ctx, sample), flies=flies and ctx.in_air)
        if doubted and self._voltage.lost > 0.0 and not self._voltage.doubtful():
            self.lost_s = ctx.now_s
        if flies and fell != 0.0:
            said = f"the {percent(sample.soc)} that the drone reports are ignored"
            self._lose(ctx, fell, f"the voltage fell as if {percent(fell)} of charge had been lost at once; {said}")

    def _lose(self, ctx: Context, fell: float, reason: str) -> None:
        """Subtract lost charge, which was not used, from the charge at the start of the flight. A loss that did not happen is added again."""
        if ctx.delivery.leg is not None:
            ctx.delivery.leg.lose(fell)
        self._flown_from = (math.nan, math.nan)
        if fell > 0.0:
            self.lost_s = ctx.now_s
        else:
            reason = f"the {percent(-fell)} of charge that seemed lost are there: the measurement was wrong"
        ctx.say(GaugeNote(fell_soc=fell), reason)

    # Flights and pads

    def begin_flight(self, *, charged: bool) -> None:
        """Store the charge at the start of a flight; after charging, the next pad is compared with it."""
        if charged or not math.isfinite(self._flown_from[0]):
            self._flown_from = (self.reported_soc, self.soc)

    def compare(self, ctx: Context, pad_soc: float) -> None:
        """Compare the use reported since charging with the charge that the pad finds missing."""
        said, used = self._flown_from[0] - self.reported_soc, self._flown_from[1] - pad_soc
        if not (said > MIN_GAUGE_SOC and math.isfinite(used)):
            return
        ctx.energy.measured(used, said)
        reason = f"the pad measures {percent(pad_soc)}, the drone reports {percent(self.reported_soc)}"
        ctx.note(GaugeNote(used_soc=used, said_soc=said, factor=ctx.energy.gauge), reason)

    def measured(self, pad_soc: float) -> None:
        """Take the measurement of a pad."""
        self.soc, self.source = pad_soc, "the pad"

    def counter_set(self, time_s: float, reported: float) -> None:
        """Take the vehicle's report after its counter was set."""
        self._reported.measured(time_s, reported)
        self._packs.forget()
        self.soc, self.reported_soc, self.source = reported, reported, "the vehicle"

    def forget(self) -> None:
        """Reset: the battery was measured or replaced, or the vehicle has restarted."""
        self._voltage.forget()
        self._reported.forget()
        self._packs.forget()

    def restore(self, *, lost_soc: float) -> None:
        """Restore the estimate from a journal."""
        self._voltage.restore(lost_soc)


def _load(ctx: Context, sample: TelemetrySample) -> float:
    """Power at the present airspeed and climb, relative to hover: momentum theory, constant blade power."""
    use = None if ctx.delivery.leg is None else ctx.delivery.leg.modelled
    wind = ctx.wind.here(sample)
    airspeed = math.hypot(sample.vel_north_mps - wind[0], sample.vel_east_mps - wind[1])
    level = 1.0 if use is None or use.load is None else float(use.load.factor(airspeed))
    half = -0.5 * sample.vel_down_mps / INFLOW_MPS
    return level * (BLADE_SHARE + (1.0 - BLADE_SHARE) * (half + math.sqrt(half * half + 1.0)))
