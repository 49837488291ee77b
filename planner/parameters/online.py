"""Parameters of the online policy."""

from __future__ import annotations

from dataclasses import dataclass

from skyway.models.base.parameters import Parameters, parameter

_FAULTS = "deliveries through faults (`benchmarks.link.supervision`, decision 72)"
_ROLLING = "30 instead of 10 futures gained nothing in 500 deliveries (`benchmarks.online.bench_rolling`)"
_UPDATED = (
    "60 hours of the record above 9.5 m/s: CRPS 1 and 2 h after a measurement 1.07 and 1.45 m/s, with 8 members an hour after it and 6 h "
    "1.15 and 1.53 (decision 82)"
)


@dataclass(frozen=True)
class OnlineParameters(Parameters):
    """How careful `planner.online` is, in evaluations and in flights, and how long it thinks."""

    # Risk

    p_begin: float = parameter(
        0.25,
        "a watched leg is begun only where it is turned with no greater probability, and where each point has a station to which it is turned in time, with the risk of the request; what it costs to be turned is weighed besides",
        0,
        1,
    )
    p_unmeasured: float = parameter(
        0.01, "a drone that does not measure the wind on its way may land below the reserve with this probability, where less was asked for",
        0, 1, measured=_FAULTS,
    )  # fmt: skip
    turned_shares: tuple[float, ...] = parameter(
        (0.3, 0.15, 0.07, 0.03),
        "charges are compared with which a watched leg is turned with these probabilities",
        0,
        1,
    )
    p_hopeless: float = parameter(
        0.5, "it is flown on only while its end breaks the reserve with no greater probability: it becomes surer the further it has flown", 0, 1,
        measured=_FAULTS,
    )  # fmt: skip
    p_no_room: float = parameter(
        0.01, "probability of finding no place until it has hovered down to the reserve, with which a station is flown to: meanwhile it can turn to another",
        0, 1, measured=_FAULTS,
    )  # fmt: skip
    epsilon_later: float = parameter(
        0.1, "charges of later legs of the plan that is told may be too low in this share of the forecast", 0, 1
    )
    divert_share: float = parameter(
        0.5,
        "where nothing keeps the reserve, this share of it is kept first; a divert of a leg that is not watched lands above it",
        0,
        1,
    )
    p_closed: float = parameter(
        0.5, "a leg is not begun where the wind is above the limit with more than this probability", 0, 1
    )
    commitments: float = parameter(
        4.0, "landings that must find room, among which a delivery shares epsilon, about", 1, 100
    )
    energy_shares: float = parameter(
        4.0, "flights that are not watched and may need more than they were charged for, among which it does too: not many are begun with no more than "
        "what they need", 1, 100, measured="landings below the reserve in `benchmarks.online.rolling_risk`",
    )  # fmt: skip

    least_members: float = parameter(
        20.0, "members of the forecast that its weights are worth at least once the wind was measured in flight: else the few that "
        "fitted it best stand for all that may come", 1, 1000, measured=_UPDATED,
    )  # fmt: skip
    residual_tau_s: float = parameter(
        86_400.0, "time constant with which the difference between the wind measured in flight and the forecast fades", 60, 10**6, unit="s",
        measured=_UPDATED,
    )  # fmt: skip

    # Energy of watched flights

    wind_spread: float = parameter(
        0.06, "standard deviation of a watched flight's energy beside that of the energy belief, as a share: the wind of the hour is "
        "not known so well", 0, 1, measured="0.08 in all, 0.06 of it the belief's, 3 to 25 min before landings (decision 72)",
    )  # fmt: skip
    manoeuvres_s: float = parameter(
        25.0, "by which watched flights take longer than planned, whatever their length: to gain speed, to brake, the last "
        "metres of the descent", 0, 600, unit="s", measured="155 legs in strong wind",
    )  # fmt: skip
    turned_share: float = parameter(
        0.7, "a watched flight that would break the reserve is back where it began with this share of its charge used, on average",
        0, 1, measured="35 of 122 deliveries through faults (`benchmarks.link.supervision`): 0.62, 0.75 of those not turned within a minute",
    )  # fmt: skip
    doubt_sigmas: float = parameter(
        1.64, "a watched flight is turned with so many standard deviations of its energy unknown: 5 % then break the reserve", 0, 5
    )  # fmt: skip
    later_margin: float = parameter(
        0.02,
        "share of the energy of later flights that they are charged more, for they are not begun without a margin",
        0,
        1,
    )
    later_sigmas: float = parameter(
        2.33, "and so many standard deviations of what differs from flight to flight: 1 % take more", 0, 5
    )

    # Futures

    futures: int = parameter(10, "futures drawn for each decision on the ground", 1, 1000, measured=_ROLLING)
    flight_futures: int = parameter(4, "the same in the air, where every option is followed in each", 1, 1000)
    large_labels: int = parameter(
        200, "labels in which the best way on is looked for in a future on large networks (`robust.large_network`)", 1, 10**9,
        measured="`benchmarks.online.bench_decisions`: with a proof of the best, decisions took minutes",
    )  # fmt: skip
    near_stations: int = parameter(
        60, "in the air, stations near the straight way over which a way on is looked for on dense networks", 2, 10**6,
        measured="`benchmarks.online.bench_decisions`: 120 take twice as long",
    )  # fmt: skip
    hours: float = parameter(
        12.0, "how far ahead the wind of a future is looked at; its last hour holds on", 1, 168, unit="h"
    )
    careful_sigmas: float = parameter(
        1.0,
        "later flights count on a mean gust against them of so many standard deviations: they will be charged for it",
        0.1,
        5,
    )
    hold_slots: int = parameter(
        12, "slots of wind for which a flight may be held up, as it is followed in a future", 0, 1000
    )
    phase_s: float = parameter(
        600.0,
        "what a flight needs depends on how soon the wind changes, looked at in steps of this",
        1,
        86_400,
        unit="s",
    )
    steps: int = parameter(5, "flights that are compared: those that are best in the most futures", 1, 1000)
    charge_quantiles: tuple[float, ...] = parameter(
        (0.0, 0.25, 0.5, 0.75, 1.0),
        "of the charges that the best ways in the futures begin with: these are compared",
        0,
        1,
    )
    sure_quantiles: tuple[float, ...] = parameter(
        (0.5, 0.7, 0.8, 0.9, 1.0), "the same of the charges that a watched flight needs in the futures", 0, 1
    )
    told_soc: float = parameter(0.01, "charge told in whole percent may be less by so much", 0, 1)
    stuck_s: float = parameter(
        21_600.0, "what a future counts for in which a step ends where no way leads on", 0, 10**6, unit="s"
    )
    stop_s: float = parameter(60.0, "the same for a stop more", 0, 86_400, unit="s")
    min_gain_s: float = parameter(
        120.0, "to land or to stay must gain so much: in a future everything is known that is not known yet when it has landed",
        0, 86_400, unit="s",
    )  # fmt: skip
    far_s: float = parameter(
        1200.0, "who is seen at a station that is further away says little about who will be there", 0, 86_400, unit="s"
    )

    # Plans in force, and waits

    margin_s: float = parameter(
        180.0, "the next leg of a plan in force is left for one that delivers earlier by this", 0, 10**6, unit="s"
    )
    margin_share: float = parameter(0.05, "and by this share of the time left", 0, 1)
    return_share: float = parameter(
        0.25, "a station that it has left is gone back to for an arrival earlier by this share of the time left", 0, 1,
        measured="to and fro between two stations while the wind was waited for, an hour's charge each time (decision 72)",
    )  # fmt: skip
    charge_step: float = parameter(0.02, "charge targets closer than this are the same", 0, 1)
    look_s: float = parameter(
        300.0, "who waits for a pad, for room elsewhere or for the wind looks again after so long", 1, 86_400, unit="s"
    )
    later_s: tuple[float, ...] = parameter(
        (1800.0, 3600.0, 7200.0, 10_800.0, 14_400.0, 21_600.0, 32_400.0, 43_200.0, 64_800.0, 86_400.0),
        "where no leg can be begun, how much later that is looked at: where none can be begun then either, it stops",
        0, 10**6, unit="s",
    )  # fmt: skip
    max_closed: int = parameter(8, "steps whose legs the gate closes that are tried before it waits", 1, 1000)
    more_soc: float = parameter(0.05, "where divert stations are lacking, so much more charge is looked at", 0.001, 1)
    told_queues: int = parameter(4, "sampled queues that each member flies the plan with that is told", 1, 1000)

    # In the air

    confirm: int = parameter(3, "looks in a row that must say the same before a flight is diverted", 1, 1000)
    speed_step_mps: float = parameter(
        0.5, "the ground speed is sent again when it changed by so much", 0, 100, unit="m/s"
    )
    speed_every_s: float = parameter(30.0, "and no oftener than this", 0, 10**6, unit="s")
    better_every_s: float = parameter(60.0, "how often in flight a better station is looked for", 0, 10**6, unit="s")
    ahead_s: float = parameter(
        45.0, "a landing in danger is not given up as long as from a point so far ahead another station keeps the reserve: wind and "
        "energy are known the better the further it has flown", 0, 86_400, unit="s",
    )  # fmt: skip
    committed_s: float = parameter(
        60.0,
        "a flight with less than this to go is flown to its end unless the battery says otherwise",
        0,
        86_400,
        unit="s",
    )
    clearly: float = parameter(0.5, "a risk is clearly smaller below this share of another", 0, 1)
    max_probable: float = parameter(0.5, "above this probability an empty battery is expected", 0, 1)
    empty_soc: float = parameter(0.03, "below this charge nothing is sure to fly", 0, 1)
    weigh_again_s: float = parameter(
        60.0,
        "where flying on was the best that could be done, it is thought of again after so long",
        0,
        86_400,
        unit="s",
    )
    weigh_again: float = parameter(1.5, "or where the risk has grown by this", 1, 100)
    airspeed_shares: tuple[float, ...] = parameter(
        (0.8, 0.9, 1.1), "of the planned airspeed that are looked at beside it", 0.1, 10
    )
    min_airspeed_mps: float = parameter(8.0, "least airspeed that is looked at", 0.1, 100, unit="m/s")
    never_s: float = parameter(
        172_800.0,
        "a delivery of which no way is known that it arrives counts as one that takes so much longer",
        0,
        10**7,
        unit="s",
    )
    point_every_m: float = parameter(
        500.0, "distance between the points of a leg at which divert stations are looked for", 10, 10**5, unit="m"
    )
    max_diverts: int = parameter(16, "most divert stations of a leg", 1, 1000)
    beside_m: float = parameter(
        1500.0, "stations so near to a way are beside it: a drone may recharge there", 0, 10**5, unit="m"
    )

    # In evaluations

    site_variance: float = parameter(
        0.05, "of a component of the hourly wind that an evaluation measures at a site", 0, 100, unit="m2/s2"
    )
