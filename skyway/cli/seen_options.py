"""Options of a flight about other aircraft and Remote ID."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from skyway.models.base.errors import Fault, InputError
from skyway.models.base.fields import finite

if TYPE_CHECKING:
    from skyway.link.supervisor.flight.give_way import TrafficRule
    from skyway.models.scenario.remote_id import RemoteId

MAX_AWAY_M, MAX_HEIGHT_M = 50_000.0, 5_000.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Seen:
    """Other aircraft, and Remote ID."""

    traffic: Annotated[
        Literal["tell", "hold", "land"],
        typer.Option(
            help="When another aircraft (ADS-B) comes near: tell (only report it), hold in the air, or land at the nearest station; the drone continues when no aircraft is near."
        ),
    ] = "tell"
    traffic_within: Annotated[
        str, typer.Option(help="Distance and height difference within which an aircraft is near: M,HEIGHT_M.")
    ] = "3000,300"
    operator_id: Annotated[
        str | None,
        typer.Option(
            help="Remote ID: registration of the operator. The secret digits of European ones are checked, and not broadcast. "
            "Default: the scenario's."
        ),
    ] = None
    self_id: Annotated[
        str | None,
        typer.Option(help="Remote ID: purpose of the flight, up to 23 letters. Default: the scenario's."),
    ] = None
    operator_at: Annotated[
        str | None, typer.Option(help="Remote ID: position of the operator, LAT,LON. Default: the place of take-off.")
    ] = None

    def rule(self) -> TrafficRule:
        """Return what is done about other aircraft."""
        from skyway.link.supervisor.flight.give_way import OnTraffic, TrafficRule
        from skyway.link.telemetry.traffic import TrafficLimits

        away_m, height_m = _pair(self.traffic_within, "--traffic-within", "M,HEIGHT_M, such as 3000,300")
        if not (0.0 < away_m <= MAX_AWAY_M and 0.0 < height_m <= MAX_HEIGHT_M):
            remedy = f"up to {MAX_AWAY_M:g} m away and {MAX_HEIGHT_M:g} m higher or lower, above 0"
            raise InputError(Fault("out of range", field="--traffic-within", value=self.traffic_within, remedy=remedy))
        return TrafficRule(OnTraffic(self.traffic), TrafficLimits(away_m, height_m))

    def remote_id(self, own: RemoteId) -> RemoteId:
        """Return the operator's identity: from the scenario, overridden by typed options."""
        place = None
        if self.operator_at is not None:
            place = _pair(self.operator_at, "--operator-at", "LAT,LON, such as 40.7392,-73.9756")
            if not (abs(place[0]) <= 90.0 and abs(place[1]) <= 180.0):
                raise InputError(Fault("is not a place on Earth", field="--operator-at", value=self.operator_at))
        return own.changed(self.operator_id, self.self_id, place)


def _pair(text: str, field: str, remedy: str) -> tuple[float, float]:
    numbers = [finite(one) for one in text.split(",")]
    if len(numbers) != 2 or numbers[0] is None or numbers[1] is None:
        raise InputError(Fault("is not two numbers", field=field, value=text, remedy=remedy))
    return numbers[0], numbers[1]
