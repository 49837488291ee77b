"""What is expected of the flight under way: kept with its leg for the live view and the journal's tracks."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from skyway.link.supervisor.legs import cross_track_m

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.link.supervisor.context import Context


@dataclass(frozen=True, slots=True)
class Lookahead:
    """Expected against planned, as the last decision found it; None is not known.

    Attributes
    ----------
    destination : str
        Station id.
    left_s, late_s : float or None
        Flight time left, and how much later than planned at the take-off it lands.
    soc_land, planned_soc_land, p_below_reserve : float or None
        Charge at the landing: expected now, planned; probability that it is below the reserve.
    cross_track_m : float
        Distance from the way.
    commanded_mps : float
        Ground speed last sent.
    believed_north_mps, believed_east_mps : float or None
        Mean wind of the updated forecast, TOWARDS.
    energy_factor : float or None
        Energy against the model.
    limited : str or None
        What limits its speed.
    """

    destination: str
    left_s: float | None
    late_s: float | None
    soc_land: float | None
    planned_soc_land: float | None
    p_below_reserve: float | None
    cross_track_m: float
    commanded_mps: float
    believed_north_mps: float | None
    believed_east_mps: float | None
    energy_factor: float | None
    limited: str | None

    def as_data(self) -> dict[str, Any]:
        """Return it as a track of the journal has it."""
        return asdict(self)


def look_ahead(ctx: Context, figures: Mapping[str, Any]) -> None:
    """Keep with the leg what a decision expects of it."""
    leg, place = ctx.delivery.leg, ctx.place
    if leg is None or place is None:
        return
    left_s = figures.get("left_s")
    found = Lookahead(
        destination=leg.destination,
        left_s=left_s,
        late_s=None if left_s is None else ctx.now_s - leg.start_s + float(left_s) - leg.planned_s,
        soc_land=figures.get("soc_land"),
        planned_soc_land=leg.planned_soc,
        p_below_reserve=figures.get("p_below_reserve"),
        cross_track_m=cross_track_m(leg.mission.way, *place),
        commanded_mps=leg.commanded_mps,
        believed_north_mps=figures.get("wind_north_mps"),
        believed_east_mps=figures.get("wind_east_mps"),
        energy_factor=figures.get("energy_factor"),
        limited=ctx.lean.said(leg.commanded_mps) if ctx.lean.limited else None,
    )
    leg.expect(found)
