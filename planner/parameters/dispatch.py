"""Parameters of the dispatcher."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class DispatchParameters(Parameters):
    """Weights of `planner.dispatch`, and its search."""

    refusal_s: float = parameter(86_400.0, "what an order of priority 0 that is not served costs", 3600, 1e7, unit="s")
    priority_factor: float = parameter(8.0, "how many times as much an order of the next priority costs", 1, 100)
    lateness: float = parameter(10.0, "what a second of lateness costs, in seconds of delivery", 0, 1000)
    max_late_s: float = parameter(
        1800.0, "an order that is not promised yet and would be later is refused", 0, 86_400, unit="s"
    )
    promised_late_s: float = parameter(
        14_400.0, "an order that was promised is delivered however late up to this", 0, 86_400, unit="s"
    )
    pad_gap_s: float = parameter(
        0.0,
        "time that is left between the windows of two of its drones on one pad",
        0,
        7200,
        unit="s",
        measured="16 days, 200 drones, 150 and 300 orders an hour: with 0, 300, 1200 and 3360 s 82, 81, 75, 66 and 59, 57, 52, 45 % came as promised (decision 127)",
    )
    change_s: float = parameter(
        1800.0,
        "what a promise costs that is changed when the fleet is replanned around what flies",
        0,
        1e7,
        unit="s",
    )
    energy_s: float = parameter(
        600.0, "what the energy of a full battery costs, in seconds of delivery", 0, 1e5, unit="s"
    )
    home: float = parameter(
        0.0, "what a second from a drone's last delivery until it is home costs, in seconds of delivery", 0, 100
    )
    ground_s: float = parameter(
        21.0,
        "time on the ground of each flight, beside waits and charging: handing it to a worker, the checks, the upload and its read-back, arming, and the end after the landing",
        0,
        3600,
        unit="s",
        measured="journals of four services with simulated vehicles: 12.2 s, and 8.5 s until a worker has the flight",
    )
    payload_classes: int = parameter(
        4, "packages count as the next of so many masses of equal steps, up to the heaviest that a drone carries", 1, 50
    )
    margin: float = parameter(0.12, "margin of each flight's energy for the wind", 0, 1)
    vehicles_tried: int = parameter(
        24, "drones that an order is tried with, those that could fetch it first", 2, 10_000
    )
    destroyed: int = parameter(6, "orders taken out at once, at most, of a small problem", 1, 1000)
    destroyed_share: float = parameter(0.3, "share of the orders taken out at once, at most", 0.01, 1)
    cooling: float = parameter(
        0.02, "at the beginning a change that costs this share of the mean cost of an order is accepted with 1/e", 0, 10
    )
    worlds: int = parameter(
        200, "worlds in which a plan is flown for the probabilities of its promises; with 0 it has none", 0, 10_000
    )
    members: int = parameter(30, "winds of the forecast in these worlds, at most", 1, 1000)
    pads_busy: float = parameter(
        1.0,
        "share of a station's pads that strangers and the fleet together may keep busy; the fleet plans with what is left",
        0.1,
        2,
        measured="New York, 200 drones, 300 orders in an hour, strangers at 0.7: with 0.9, 1.0 and 1.1 of what is promised 95, 95 and 92 % was delivered (23 November 2026)",
    )
