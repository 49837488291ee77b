"""Parameters of the robust planner."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class RobustParameters(Parameters):
    """Which routes `planner.robust` composes, how it compares and calibrates them, and how sure a leg's charge is."""

    members: int = parameter(
        30, "members of the forecast that routes are simulated in, at most", 1, 1000,
        measured="ten New York requests, 22 November 2026: 60 members take a quarter longer; what it does to promises was not measured",
    )  # fmt: skip
    large_network: int = parameter(
        200, "stations from which on fewer worlds are composed in and the first route found is taken", 1, 10**9,
        measured="the proved best route arrives 3.9 % later on average at 1,000 stations (decision 15)",
    )  # fmt: skip
    speed_members: int = parameter(10, "members whose flight times are averaged on large networks", 1, 1000)
    speed_hours: float = parameter(
        16.0, "how far ahead mean speeds are worked out; beyond, the last hour holds on", 1, 48, unit="h"
    )
    required_share: float = parameter(
        0.5, "share of epsilon for flights that need more than was charged for; the rest is for full stations", 0.01, 1
    )
    full_share: float = parameter(
        0.5, "a flight is begun when the chance to find its station full is below this multiple of epsilon", 0, 100
    )
    fuller: tuple[float, ...] = parameter(
        (0.005, 0.02, 0.1, 0.3, 1.0),
        "that chance where the drone would else hardly ever leave, one after the other",
        0,
        1,
    )
    margins: tuple[float, ...] = parameter(
        (0.12, 0.25, 0.06),
        "margins of each flight's energy that routes are composed with; large networks use the first",
        0,
        1,
    )
    short_leg_margin: float = parameter(
        0.45,
        "margin that gives short flights: tried where the others give no route or the best waits long in some winds",
        0,
        2,
    )
    long_wait: float = parameter(
        1.3, "such waits are looked for where a mean delivery takes more than so many times the median", 1, 10
    )
    short_leg_labels: int = parameter(
        200, "labels in which short flights are looked for on large networks", 1, 10**9,
        measured="200 labels instead of 0.15 s: the same mean delivery, half the planning time (decision 15)",
    )  # fmt: skip
    few_free: float = parameter(
        0.1, "below this share of stations with likely room, no route is looked for that keeps to them", 0, 1
    )
    sampled_members: int = parameter(
        3, "members with sampled queues that routes are composed in on small networks", 0, 100
    )
    screen_members: int = parameter(12, "members that are the truth when routes are compared first", 1, 1000)
    screen_runs: int = parameter(120, "simulated deliveries by which routes are compared first", 1, 10**6)
    finalists: int = parameter(3, "best routes that are compared again with every member as the truth", 1, 100)
    finalist_runs: int = parameter(600, "simulated deliveries of each of them", 1, 10**6)
    bold_finalists: int = parameter(
        2, "routes beside them that would be better but break the reserve before they are calibrated", 0, 100
    )
    final_runs: int = parameter(
        1500, "simulated deliveries behind the figures of the answer", 10, 10**6,
        measured="its figures are told with the error that remains (decision 62)",
    )  # fmt: skip
    hurried_runs: int = parameter(
        300, "the same where a time limit is over by then: its figures are told with a greater error", 10, 10**6
    )
    runs_per_queues: int = parameter(
        2, "simulated deliveries in different winds that share their sampled queues", 1, 10**4,
        measured="with a dozen, means of one route differed by 0.6 to 6 % (one standard deviation) between seeds (decision 111)",
    )  # fmt: skip
    idle_share: float = parameter(0.5, "a stop at which a smaller share of runs charges is tried without", 0, 1)
    chance_runs: float = parameter(1.5, "so many runs below the reserve may be chance", 0, 1000)
    min_arrival: float = parameter(
        0.5, "a route that arrives within the horizon with a smaller probability is the last resort", 0, 1
    )
    calibrations: int = parameter(
        2, "times the margin is calibrated, the second time with the first one's margin; once on large networks", 1, 100
    )
    margin_tolerance: float = parameter(
        0.003, "a margin greater by no more than this is not worth flying all deliveries again", 0, 1,
        measured="ten New York requests, 22 November 2026: with 0 the same answers, a fifth slower",
    )  # fmt: skip
    bandwidth: float = parameter(
        1.5, "width of the kernel that smooths members, in standard deviations times members to the power -1/5", 0, 10,
        measured="calibrated on held-out days (docs/explanation/robust.md); 1.06 would do for normal data",
    )  # fmt: skip
    apart_days: int = parameter(
        2, "members of the record fewer days apart are no evidence for each other", 0, 365, unit="d"
    )
    worst_members: int = parameter(
        12, "members with the strongest head wind whose flights are worked out; the others need no more than the mildest", 1, 1000,
        measured="ten New York requests, 22 November 2026: with all 30 a quarter slower, mean delivery within 0.6 % of each request",
    )  # fmt: skip
    steady_sigmas: float = parameter(
        3.0, "deviations of what is unsure at which the time that it costs is worked out, linear in between", 0.1, 10
    )
    busy_hours: int = parameter(
        2,
        "hours from its earliest arrival on of which the busiest decides whether a route may use a station",
        1,
        48,
        unit="h",
    )
    usual_flight_s: float = parameter(
        900.0, "flight for which stations are judged before a route is known", 1, 86_400, unit="s"
    )
    sparing_routes: int = parameter(
        4,
        "routes with the least energy or cost in the mean-value problem, at each margin, where the objective counts these",
        1,
        100,
    )
    closing_late_s: float = parameter(
        900.0, "routes are looked for with stations that close met so much later, too", 0, 86_400, unit="s"
    )
    sparing_labels: int = parameter(4000, "labels in which they are looked for", 1, 10**6)
    sparing_labels_large: int = parameter(400, "the same on large networks", 1, 10**6)
    reasons_s: float = parameter(
        0.05, "time for each exact search of a bound or a reason on large networks", 0, math.inf, unit="s"
    )
