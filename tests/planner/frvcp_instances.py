"""Instances of the fixed-route vehicle charging problem as frvcpy reads them, put to skyway."""

import numpy as np

from skyway.models.flight.kernels import Slots
from skyway.planner.fixed_route.charging_stops import FixedRoute
from skyway.planner.fixed_route.way_kernels import Hops


def as_fixed_route(instance, route, q_init=None):
    """The nodes of a route are the positions; who leaves one for a station goes on at the next one.

    Times stay in the unit of the instance, energies become shares of the greatest charge.
    """
    time, energy = np.array(instance["time_matrix"]), np.array(instance["energy_matrix"]) / instance["max_q"]
    process = np.array(instance["process_times"], dtype=float)
    nodes = [station["node_id"] for station in instance["css"]]
    kinds = {kind["cs_type"]: kind for kind in instance["breakpoints_by_type"]}
    curves = tuple(
        (np.array(kind["time"], dtype=float), np.array(kind["charge"], dtype=float) / instance["max_q"])
        for kind in (kinds[station["cs_type"]] for station in instance["css"])
    )
    at, on = np.array(route), np.array([*route[1:], route[-1]])
    hops = Hops(
        work_s=(time[at[:-1], at[1:]] + process[at[1:]])[None],
        work_soc=energy[at[:-1], at[1:]][None],
        to_s=time[at][:, nodes][None],
        to_soc=energy[at][:, nodes][None],
        from_s=(time[nodes][:, on].T + process[on][:, None])[None],
        from_soc=energy[nodes][:, on].T[None].copy(),
        between_s=time[np.ix_(nodes, nodes)][None],
        between_soc=energy[np.ix_(nodes, nodes)][None],
        resume=np.minimum(np.arange(len(route)) + 1, len(route) - 1),
    )
    hops = Hops(*(np.ascontiguousarray(values) for values in hops))
    can_leave = np.arange(len(route)) < len(route) - 1
    never = tuple(np.zeros((1, 2)) for _ in nodes)
    start = 1.0 if q_init is None else q_init / instance["max_q"]
    return FixedRoute(hops, Slots(0.0, 1.0, 1), can_leave, curves, never, float(process[route[0]]), start)
