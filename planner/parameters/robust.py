"""Parameters of the robust planner."""

from __future__ import annotations

import math
from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter


@dataclass(frozen=True)
class RobustParameters(Parameters):
    """Parameters of `planner.robust`: composing, comparing and calibrating routes, and the certainty of a leg's charge."""

    members: int = parameter(
        30, "maximum number of forecast members for simulating routes", 1, 1000,
        measured="ten New York requests, 22 November 2026: 60 members take a quarter longer; what it does to promises was not measured",
    )  # fmt: skip
    large_network: int = parameter(
        200, "networks above this number of stations use fewer mean-value problems and the first route found", 1, 10**9,
        measured="the proved best route arrives 3.9 % later on average at 1,000 stations (decision 15)",
    )  # fmt: skip
    speed_members: int = parameter(10, "members whose flight times are averaged on large networks", 1, 1000)
    speed_hours: float = parameter(16.0, "horizon of mean speeds; after it the last hour continues", 1, 48, unit="h")
    required_share: float = parameter(
        0.5, "share of epsilon for flights that need more charge than planned; the rest is for full stations", 0.01, 1
    )
    full_share: float = parameter(
        0.5, "a flight begins if the probability of a full station is below this multiple of epsilon", 0, 100
    )
    fuller: tuple[float, ...] = parameter(
        (0.005, 0.02, 0.1, 0.3, 1.0),
        "larger values of that probability, tried in turn if the drone would otherwise hardly ever leave",
        0,
        1,
    )
    margins: tuple[float, ...] = parameter(
        (1.0, 0.25, 0.06),
        "margins of each flight's energy that routes are composed with",
        0,
        3,
        measured="60 drawn requests: 55 min on average, 66 with 0.12 instead of 1; a city of 1,000 stations: 204 and 271 min (decision 138)",
    )
    dense_degree: float = parameter(
        30.0, "segments that leave a station on average, from which on a large network is dense", 0, 10**6
    )
    waits_matter: float = parameter(
        0.05,
        "in dense networks routes are composed with the first margin alone if deliveries wait for pads for a smaller share of their time",
        0,
        1,
    )
    first_route_labels: int = parameter(
        200, "label limit of the search for the first route at each of these margins on large networks", 1, 10**9
    )
    short_leg_margin: float = parameter(
        2.0,
        "margin that gives short flights: tried if the others give no route, or if the best route waits long in some winds",
        0,
        3,
    )
    short_leg_margin_large: float = parameter(0.45, "the same on large networks", 0, 3)
    long_wait: float = parameter(
        1.3, "the best route waits long if its mean delivery time exceeds this multiple of the median", 1, 10
    )
    short_leg_labels: int = parameter(
        200, "label limit of the search for short flights on large networks", 1, 10**9,
        measured="200 labels instead of 0.15 s: the same mean delivery, half the planning time (decision 15)",
    )  # fmt: skip
    few_free: float = parameter(
        0.1, "below this share of stations with probable free capacity, routes are not restricted to them", 0, 1
    )
    sampled_members: int = parameter(
        1, "members with sampled queues that routes are composed in on small networks", 0, 100
    )
    screen_members: int = parameter(12, "members used as the truth in the first comparison of routes", 1, 1000)
    screen_runs: int = parameter(120, "simulated deliveries per route in the first comparison", 1, 10**6)
    finalists: int = parameter(3, "best routes in the second comparison, with every member as the truth", 1, 100)
    finalist_runs: int = parameter(600, "simulated deliveries of each of them", 1, 10**6)
    finalist_runs_large: int = parameter(
        300, "the same on large networks", 1, 10**6,
        measured="400 requests in cities of 1,000 stations: mean of the plans 198.6 min, with 600 199.7; 0.03 s less (decision 139)",
    )  # fmt: skip
    bold_finalists: int = parameter(
        2, "additional routes that would be better but break the reserve before calibration", 0, 100
    )
    most_finalists: int = parameter(
        8,
        "routes in the second comparison at most, if without a margin they would be better than the best with it",
        1,
        100,
    )
    finished_routes: int = parameter(
        3, "routes whose margin is calibrated at most, if before they were better than the best one after; one on large networks", 1, 100
    )  # fmt: skip
    final_runs: int = parameter(
        3900, "simulated deliveries behind the figures of the answer", 10, 10**6,
        measured="60 requests that nothing was tuned on: the means of two seeds are within 2 % in 93 % of the pairs; in 84 % with 2,400 and the comparison of before (decision 111)",
    )  # fmt: skip
    final_runs_large: int = parameter(1000, "the same on large networks", 10, 10**6)
    hurried_runs: int = parameter(
        300, "the same where a time limit is over by then: its figures are told with a greater error", 10, 10**6
    )
    runs_per_queues: int = parameter(
        1, "simulated deliveries in different winds that share their sampled queues", 1, 10**4,
        measured="with a dozen, means of one route differed by 0.6 to 6 % (one standard deviation) between seeds (decision 111)",
    )  # fmt: skip
    runs_per_queues_large: int = parameter(2, "the same on large networks", 1, 10**4)
    idle_share: float = parameter(
        0.5, "the route is also tried without a stop at which a smaller share of runs charges", 0, 1
    )
    chance_runs: float = parameter(1.5, "number of runs below the reserve that may be due to chance", 0, 1000)
    min_arrival: float = parameter(
        0.5, "a route with a smaller probability of arriving within the horizon is the last resort", 0, 1
    )
    calibrations: int = parameter(
        2, "times the margin is calibrated, the second time with the first one's margin; once on large networks", 1, 100
    )
    margin_tolerance: float = parameter(
        0.003, "a margin that is greater by at most this does not require simulating all deliveries again", 0, 1,
        measured="ten New York requests, 22 November 2026: with 0 the same answers, a fifth slower",
    )  # fmt: skip
    bandwidth: float = parameter(
        1.5, "width of the kernel that smooths members, in standard deviations times members to the power -1/5", 0, 10,
        measured="calibrated on held-out days (docs/explanation/robust.md); 1.06 would do for normal data",
    )  # fmt: skip
    apart_days: int = parameter(2, "members of the record fewer days apart are not independent", 0, 365, unit="d")
    worst_members: int = parameter(
        12, "members with the strongest head wind whose flights are computed; the others need at most as much as the mildest", 1, 1000,
        measured="ten New York requests, 22 November 2026: with all 30 a quarter slower, mean delivery within 0.6 % of each request",
    )  # fmt: skip
    steady_sigmas: float = parameter(
        3.0,
        "number of standard deviations of an error at which its cost in time is computed; linear in between",
        0.1,
        10,
    )
    busy_hours: int = parameter(
        2,
        "a route may use a station if its busiest hour within this time after the earliest arrival allows it",
        1,
        48,
        unit="h",
    )
    usual_flight_s: float = parameter(
        900.0, "flight time assumed for judging stations before a route is known", 1, 86_400, unit="s"
    )
    sparing_routes: int = parameter(
        4,
        "routes with the least energy or cost in the mean-value problem, at each margin, if the objective includes these",
        1,
        100,
    )
    closing_late_s: float = parameter(
        900.0, "routes are also composed with arrivals this much later at stations that close", 0, 86_400, unit="s"
    )
    sparing_labels: int = parameter(4000, "label limit of the search for them", 1, 10**6)
    sparing_labels_large: int = parameter(400, "the same on large networks", 1, 10**6)
    reasons_s: float = parameter(
        0.05, "time limit of each exact search for a bound or a reason on large networks", 0, math.inf, unit="s"
    )

    def is_large(self, stations: int) -> bool:
        """Whether a network of so many stations is large."""
        return stations > self.large_network

    def is_dense(self, stations: int, segments: int) -> bool:
        """Whether a network of so many stations and segments is dense."""
        return self.is_large(stations) and segments >= self.dense_degree * stations

    def finalist_runs_of(self, stations: int) -> int:
        """Simulated deliveries of a route in the second comparison, in a network of so many stations."""
        return self.finalist_runs_large if self.is_large(stations) else self.finalist_runs

    def final_runs_of(self, stations: int) -> int:
        """Simulated deliveries behind the figures of an answer in a network of so many stations."""
        return self.final_runs_large if self.is_large(stations) else self.final_runs

    def runs_per_queues_of(self, stations: int) -> int:
        """Simulated deliveries that share their sampled queues in a network of so many stations."""
        return self.runs_per_queues_large if self.is_large(stations) else self.runs_per_queues
