"""Parameters of the online policy."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter

_FAULTS = "deliveries through faults (`benchmarks.link.supervision`, decision 72)"
_ROLLING = "30 instead of 10 futures gained nothing in 500 deliveries (`benchmarks.online.bench_rolling`)"
_STORMS = "storms of more than 12 h (`benchmarks.online.bench_rolling`, decision 135)"
_UPDATED = (
    "60 hours of the record above 9.5 m/s: CRPS 1 and 2 h after a measurement 1.07 and 1.45 m/s, with 8 members an hour after it and 6 h "
    "1.15 and 1.53 (decision 82)"
)


@dataclass(frozen=True)
class OnlineParameters(Parameters):
    """Risk of `planner.online`, in evaluations and in flights, and its computing time."""

    # Risk

    p_begin: float = parameter(
        0.25,
        "a supervised leg begins only if its probability of a divert is at most this, and if each of its points has a divert station that is reached in time with the risk of the request; the cost of a divert is weighed in addition",
        0,
        1,
    )
    p_unmeasured: float = parameter(
        0.01, "a drone that does not measure the wind in flight may land below the reserve with this probability, even if the request allows less",
        0, 1, measured=_FAULTS,
    )  # fmt: skip
    turned_shares: tuple[float, ...] = parameter(
        (0.3, 0.15, 0.07, 0.03),
        "charges are compared that give these probabilities of a divert of a supervised leg",
        0,
        1,
    )
    p_hopeless: float = parameter(
        0.5, "a leg continues only while the probability of breaking the reserve at its end is at most this; the uncertainty falls along the flight", 0, 1,
        measured=_FAULTS,
    )  # fmt: skip
    p_no_room: float = parameter(
        0.01, "accepted probability that a station has no free place until the drone has hovered down to the reserve; meanwhile it can divert to another",
        0, 1, measured=_FAULTS,
    )  # fmt: skip
    epsilon_later: float = parameter(
        0.1, "charges of later legs of the printed plan may be too low in this share of the forecast", 0, 1
    )
    divert_share: float = parameter(
        0.5,
        "if no option keeps the reserve, options that keep this share of it come first; a divert of an unsupervised leg lands above it",
        0,
        1,
    )
    p_closed: float = parameter(
        0.5, "a leg does not begin if the wind is above the limit with more than this probability", 0, 1
    )
    commitments: float = parameter(
        4.0, "approximate number of landings per delivery that share epsilon for free capacity", 1, 100
    )
    energy_shares: float = parameter(
        4.0, "number of unsupervised flights per delivery that share epsilon for the required charge; few begin with no more than that", 1, 100, measured="landings below the reserve in `benchmarks.online.rolling_risk`",
    )  # fmt: skip

    least_members: float = parameter(
        20.0, "minimum effective number of members after wind measurements in flight; otherwise a few well-fitting members would stand for all", 1, 1000, measured=_UPDATED,
    )  # fmt: skip
    residual_tau_s: float = parameter(
        86_400.0, "time constant with which the difference between the wind measured in flight and the forecast fades", 60, 10**6, unit="s",
        measured=_UPDATED,
    )  # fmt: skip

    # Energy of watched flights

    wind_spread: float = parameter(
        0.06, "standard deviation of a supervised flight's energy in addition to the energy belief, as a share, for the uncertain wind", 0, 1, measured="0.08 in all, 0.06 of it the belief's, 3 to 25 min before landings (decision 72)",
    )  # fmt: skip
    manoeuvres_s: float = parameter(
        25.0, "extra time of supervised flights of any length: acceleration, braking, the last metres of the descent", 0, 600, unit="s", measured="155 legs in strong wind",
    )  # fmt: skip
    turned_share: float = parameter(
        0.7, "mean share of the charge of a supervised flight that is used when it returns to its origin after a divert",
        0, 1, measured="35 of 122 deliveries through faults (`benchmarks.link.supervision`): 0.62, 0.75 of those not turned within a minute",
    )  # fmt: skip
    later_margin: float = parameter(
        0.02,
        "share of energy that later flights charge in addition, since they do not begin without a margin",
        0,
        1,
    )
    later_sigmas: float = parameter(
        2.33, "and this many standard deviations of the variation from flight to flight: 1 % take more", 0, 5
    )

    # Futures

    futures: int = parameter(10, "futures drawn for each decision on the ground", 1, 1000, measured=_ROLLING)
    flight_futures: int = parameter(4, "the same in the air, with every option followed in each future", 1, 1000)
    large_labels: int = parameter(
        200, "label limit of the search for the best route in a future on large networks (`robust.large_network`)", 1, 10**9,
        measured="`benchmarks.online.bench_decisions`: with a proof of the best, decisions took minutes",
    )  # fmt: skip
    near_stations: int = parameter(
        60, "number of stations near the straight way for routes in the air on dense networks", 2, 10**6,
        measured="`benchmarks.online.bench_decisions`: 120 take twice as long",
    )  # fmt: skip
    weighed_options: int = parameter(
        3, "options in the air whose arrival is computed on large networks: the first by what they could arrive at", 1, 10**6,
        measured="1,000 stations on 60 km, 92 decisions: the best was the first in 88, the second in 3, the third in 1 (decision 99)",
    )  # fmt: skip
    hours: float = parameter(
        24.0, "horizon of the wind of a future; after it the last hour continues", 1, 168, unit="h", measured=_STORMS,
    )  # fmt: skip
    careful_sigmas: float = parameter(
        1.0,
        "later flights assume a mean gust against them of this many standard deviations, since they will be charged for it",
        0.1,
        5,
    )
    hold_slots: int = parameter(12, "maximum number of wind slots that a flight may wait in a future", 0, 1000)
    phase_s: float = parameter(
        600.0,
        "step in the time to the next change of the wind, for the required charge of a flight",
        1,
        86_400,
        unit="s",
    )
    steps: int = parameter(5, "number of compared flights: those that are best in the most futures", 1, 1000)
    charge_quantiles: tuple[float, ...] = parameter(
        (0.0, 0.25, 0.5, 0.75, 1.0),
        "quantiles of the initial charges of the best routes in the futures; these charges are compared",
        0,
        1,
    )
    sure_quantiles: tuple[float, ...] = parameter(
        (0.5, 0.7, 0.8, 0.9, 1.0), "the same for the charges that a supervised flight needs in the futures", 0, 1
    )
    told_soc: float = parameter(0.01, "rounding error of a charge reported in whole percent", 0, 1)
    stuck_s: float = parameter(
        21_600.0, "a future in which a step has no onward route delivers this long after the horizon of its wind, a flight that fails in the air this much later", 0, 10**6, unit="s",
        measured=_STORMS,
    )  # fmt: skip
    stop_s: float = parameter(60.0, "penalty of an additional stop", 0, 86_400, unit="s")
    min_gain_s: float = parameter(
        120.0, "minimum gain of landing or staying, since a future has more information than a real flight",
        0, 86_400, unit="s",
    )  # fmt: skip
    far_s: float = parameter(1200.0, "busy pads of stations farther away than this are ignored", 0, 86_400, unit="s")

    # Plans in force, and waits

    margin_s: float = parameter(
        180.0, "the next leg of the current plan is replaced by one that delivers earlier by this", 0, 10**6, unit="s"
    )
    margin_share: float = parameter(0.05, "and by this share of the remaining time", 0, 1)
    return_share: float = parameter(
        0.25, "returning to a station that the drone has left requires an arrival earlier by this share of the remaining time", 0, 1,
        measured="flights back and forth between two stations while waiting for the wind, an hour's charge each time (decision 72)",
    )  # fmt: skip
    charge_step: float = parameter(0.02, "charge targets closer than this are the same", 0, 1)
    look_s: float = parameter(
        300.0, "time between decisions while waiting for a pad, for free capacity or for the wind", 1, 86_400, unit="s"
    )
    later_s: tuple[float, ...] = parameter(
        (1800.0, 3600.0, 7200.0, 10_800.0, 14_400.0, 21_600.0, 32_400.0, 43_200.0, 64_800.0, 86_400.0),
        "if no leg can begin, delays after which the policy checks again; if none can begin then either, it stops",
        0, 10**6, unit="s",
    )  # fmt: skip
    max_closed: int = parameter(8, "number of steps refused by the departure gate before the policy waits", 1, 1000)
    more_soc: float = parameter(0.05, "step of additional charge if divert stations are missing", 0.001, 1)
    told_winds: int = parameter(
        5,
        "groups of members of the forecast, by wind speed, in each of which the charges of later legs of the printed plan are asked for",
        1,
        100,
    )
    told_queues: int = parameter(
        4, "simulated deliveries per member of the forecast for the figures of the printed plan", 1, 1000
    )

    # In the air

    confirm: int = parameter(3, "number of consecutive equal checks before a divert", 1, 1000)
    speed_step_mps: float = parameter(0.5, "the ground speed is sent again when it changes by this", 0, 100, unit="m/s")
    speed_every_s: float = parameter(30.0, "and at most this often", 0, 10**6, unit="s")
    better_every_s: float = parameter(60.0, "time between searches for a better station in flight", 0, 10**6, unit="s")
    ahead_s: float = parameter(
        45.0, "the drone keeps a doubtful landing while another station still keeps the reserve this much later; uncertainty falls along the flight", 0, 86_400, unit="s",
    )  # fmt: skip
    committed_s: float = parameter(
        60.0,
        "a flight with less than this remaining is flown to its end unless the battery forbids it",
        0,
        86_400,
        unit="s",
    )
    clearly: float = parameter(0.5, "a risk is clearly smaller below this share of another", 0, 1)
    max_probable: float = parameter(0.5, "above this probability an empty battery is expected", 0, 1)
    empty_soc: float = parameter(0.03, "below this charge no flight is certain", 0, 1)
    weigh_again_s: float = parameter(
        60.0,
        "time until options are compared again if flying on was the best",
        0,
        86_400,
        unit="s",
    )
    weigh_again: float = parameter(1.5, "or when the risk has grown by this factor", 1, 100)
    airspeed_shares: tuple[float, ...] = parameter(
        (0.8, 0.9, 1.1), "multiples of the planned airspeed that are compared with it", 0.1, 10
    )
    min_airspeed_mps: float = parameter(8.0, "minimum airspeed that is considered", 0.1, 100, unit="m/s")
    never_s: float = parameter(
        172_800.0,
        "extra delivery time of an option without a known route to the destination",
        0,
        10**7,
        unit="s",
    )
    point_every_m: float = parameter(
        500.0, "distance between the points of a leg that need a divert station", 10, 10**5, unit="m"
    )
    max_diverts: int = parameter(16, "maximum number of divert stations of a leg", 1, 1000)
    beside_m: float = parameter(
        1500.0,
        "a station within this distance of a way is beside it, and a drone may recharge there",
        0,
        10**5,
        unit="m",
    )
