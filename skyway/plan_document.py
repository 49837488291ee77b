"""The output of a plan besides its schedule: JSON for machines, text for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from skyway.models.base.formatting import (
    about,
    between,
    duration,
    energy_text,
    later_text,
    minutes,
    money,
    percent,
    probability,
    promised,
    share,
    speed_text,
)
from skyway.models.base.units import J_PER_WH, iso
from skyway.models.base.views import counted
from skyway.models.composition.file import figure_json, to_json
from skyway.planner.uncertainties import ENERGY, GUSTS, PADS, WIND

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from datetime import datetime

    from skyway.models.composition.composition import Composition
    from skyway.planner.between_sites import BetweenSites
    from skyway.planner.evaluation.as_flown import AsFlown
    from skyway.planner.explain import StopReason
    from skyway.planner.report import PlanReport
    from skyway.planner.uncertainties import Uncertainty


def plan_document(report: PlanReport) -> dict[str, object]:
    """Return a plan for machines: the composition, and the requested extras."""
    found: dict[str, object] = to_json(report.result.composition)
    if report.bound is not None:
        told = vars(report.bound) | {"gap": report.bound.gap, "careful_gap": report.bound.careful_gap}
        found["bound"] = {name: value for name, value in told.items() if value is not None}
    if report.between_sites is not None:
        found["between_sites"] = _between_sites_json(report.between_sites)
    if report.as_flown is not None:
        found["as_flown"] = _as_flown_json(report.as_flown, report.result.problem.request.objective.deadline)
    if report.departures:
        found["departures"] = [
            {
                "depart": iso(one.depart),
                "delivery_mean_s": one.delivery_s,
                "delivery_mean": None if one.delivery is None else figure_json(one.delivery),
                "p_on_time": one.p_on_time,
            }
            for one in report.departures
        ]
    if report.alternatives is not None:
        found["alternatives"] = [to_json(plan.composition) for plan in report.alternatives[1:]]
    if report.reasons is not None:
        found["explanation"] = {
            "stops": [_reason_json(one) for one in report.reasons],
            "charges": [vars(one) for one in report.charges],
            "rests_on": [_uncertainty_json(one) for one in report.rests_on or ()],
            "not_counted": report.not_counted,
        }
    return found


def _between_sites_json(found: BetweenSites) -> dict[str, object]:
    turned = found.turned
    told = {
        "delivery_mean": turned.delivery,
        "delivery_p50": turned.delivery_quantile(0.5),
        "delivery_p95": turned.delivery_quantile(0.95),
    }
    named = {name: getattr(found, name) for name in ("sd_mps", "station", "p_below", "p_turned")}
    return named | {name: figure_json(figure) for name, figure in told.items()}


def _as_flown_json(found: AsFlown, deadline: datetime | None) -> dict[str, object]:
    outcome = found.outcome
    told = {
        "delivery_mean": outcome.delivery,
        "delivery_p50": outcome.delivery_quantile(0.5),
        "delivery_p95": outcome.delivery_quantile(0.95),
    }
    if deadline is not None:
        told["on_time"] = outcome.on_time(deadline.timestamp())
    counts = {name: getattr(found, name) for name in ("runs", "below_reserve", "on_the_ground")}
    return counts | {name: figure_json(figure) for name, figure in told.items()}


def as_flown_words(found: AsFlown, deadline: datetime | None, due: str) -> list[str]:
    """Return when deliveries arrive as `fly` flies them, a line each; `due` is the deadline for people."""
    outcome = found.outcome
    middle, late = promised(outcome.delivery_quantile(0.5), outcome.delivery_quantile(0.95))
    mean = outcome.delivery
    lines = [
        f"Flown with `skyway fly`, which decides again at each stop and in the air, in wind that no site measures ({found.runs:,} simulated deliveries):",
        f"{about(mean)} on average ({between(mean)}), half within {about(middle)}, 95 % within {about(late)} ({between(late)})",
    ]
    if deadline is not None:
        lines.append(f"On time, by {due}: {share(outcome.on_time(deadline.timestamp()))}")
    lines.append(f"{found.below_reserve} of {found.runs:,} landed below the reserve")
    if found.on_the_ground:
        lines.append(
            f"{found.on_the_ground} of {found.runs:,} stayed at a station: no later hour of the forecast allows them to continue"
        )
    return lines


def between_sites_words(found: BetweenSites, epsilon: float) -> list[str]:
    """Return how a plan fares in wind between the sites, line by line; nothing if the plan keeps its promise there."""
    if found.p_below <= epsilon:
        return []
    _, late = promised(found.turned.delivery_quantile(0.5), found.turned.delivery_quantile(0.95))
    unmeasured = f"No site measures the wind near {found.station} (error {speed_text(found.sd_mps)} per component)"
    turned = f"`skyway fly` measures the wind and turns back in time in {probability(found.p_turned)} of the deliveries"
    return [
        f"{unmeasured}: without turning back, {probability(1.0 - found.p_below, 1)} keep the reserve;",
        f"{turned}: {about(found.turned.delivery)} on average, 95 % within {about(late)}. An anemometer there would help",
    ]


def most_gained(found: Sequence[Uncertainty]) -> str:
    """Say which uncertainty, halved, gains most; `found` begins with those whose gain is clear."""
    first = found[0]
    if first.gain is None or first.gain.low <= 0.0:
        return "Halving any one of them makes no clear difference"
    remedy = f"; {first.remedy}" if first.remedy else ""
    name, gain = UNCERTAINTIES[first.name], f"{minutes(first.gain)} min on average{remedy}"
    if all(one.gain is not None and one.gain.value <= first.gain.value for one in found):
        return f"Halving the uncertainty of the {name} gains most: {gain}"
    return f"Only halving the uncertainty of the {name} makes a clear difference: {gain}"


def _reason_json(one: StopReason) -> dict[str, object]:
    found = {name: value for name, value in vars(one).items() if name != "later"}
    later = None if one.later is None else figure_json(one.later)
    return found | {"later_s": None if one.later is None else one.later.value, "later": later}


def _uncertainty_json(one: Uncertainty) -> dict[str, object]:
    return vars(one) | {"gain": None if one.gain is None else figure_json(one.gain)}


def spending_words(composition: Composition) -> list[str]:
    """Return what the delivery spends, a line each; none where it is not computed."""
    energy, costs = composition.energy, composition.costs
    lines = []
    if energy is not None:
        lines.append(
            f"Energy flown: {energy_text(energy.mean.value * J_PER_WH)} on average, 95 % within {energy_text(energy.p95.value * J_PER_WH)}"
        )
    if costs is not None:
        parts = {
            "energy": costs.energy, "pad fees": costs.pad_fees, "charge bought afterwards": costs.refill, "wear": costs.wear,
        }  # fmt: skip
        told = ", ".join(f"{name} {money(value)}" for name, value in parts.items() if value > 0.0)
        lines.append(
            f"Cost: {money(costs.mean.value)} {costs.currency} on average ({money(costs.mean.low)} to {money(costs.mean.high)}), "
            f"95 % within {money(costs.p95.value)}" + (f": {told}" if told else "")
        )
    if lines and composition.way_back is not None and composition.way_back.plan is not None:
        back = composition.way_back.plan
        charges = counted(sum(stop.recharge_s > 0.0 for stop in back.stops), "charge")
        lines.append(
            f"The way back is not counted in these: typically {energy_text(back.energy_j)} more, with {charges} before its end"
        )
    return lines


def why_here(one: StopReason) -> str:
    """Return why a stop is made."""
    if one.asked:
        return "asked for"
    if one.runner_up is None or one.later is None:
        return "without this stop there is no route"
    way = "the best route stops at " + ", ".join(one.runner_up) if one.runner_up else "the best route has no stop"
    safety = "" if one.later.value >= 0.0 else ", but is less safe"
    return f"without this stop {way}: {later_text(one.later)}{safety}"


def why_so_much(one: StopReason) -> str:
    """Return what the charge at a stop is for."""
    parts = (
        f"{percent(one.leaves)} on average: {percent(one.expected)} for the flight, {percent(one.margin)} margin for "
        f"stronger wind, gusts and a vehicle that uses more energy, {percent(one.reserve)} reserve on landing"
    )
    if one.idle >= 1.0 - 1e-9:
        return f"in the simulated deliveries the drone never charges here; it leaves with {parts}"
    if one.idle > 0.5:
        return f"{percent(one.idle)} of the deliveries leave at once; the others charge to {parts}"
    return f"the drone charges to {parts}"


UNCERTAINTIES = {WIND: "wind ahead", GUSTS: "gusts", ENERGY: "energy of the drone", PADS: "other drones at pads"}
"""What each is called."""
_SIZES: dict[str, Callable[[float], str]] = {
    WIND: lambda size: f"{speed_text(size)} a component",
    GUSTS: lambda size: f"{percent(size)} of the wind",
    ENERGY: lambda size: f"{percent(size)} of a flight's energy",
    PADS: lambda size: f"{duration(size)} of waiting",
}


def size_words(one: Uncertainty) -> str:
    """Return how uncertain it is."""
    return _SIZES[one.name](one.size)
