"""Upper bound of the quality of any plan of the rebuilt Sydney set: prices of pads by roof and time (Lagrangian relaxation).

Each drone flies to its destination on the shortest way, then charges once up to its final charge, there or on another roof, on a pad that nobody else has. Let
the pads of roof r cost l_r(t) >= 0 for each second. Then the loss of quality, summed over the requests, is at least

    sum_i min(1, min over r and t of loss_i(r, t) + integral of l_r from t to t + p_ir) - sum_r pads_r * integral of l_r,

for any prices: the payments for pads are at most the cost of all of them. Prices are constant in steps of time, and a loss is concave in t between them, so
that the inner minimum lies where a charge begins or ends at the end of a step, begins at once, or ends just in time. Prices are improved by subgradients.
"""

from __future__ import annotations

import numpy as np

from benchmarks.fleet.sydney import FINALS, TAU_S, City, Request, alone

STEP_S, ITERATIONS = 240.0, 300
AFTER_S = 4.0 * 3600.0
"""Time after the last request is ready for which pads have prices, s."""


class Prices:
    """The requests that must charge, and the prices for their drones."""

    def __init__(self, town: City, given: list[Request]) -> None:
        at = np.array([(one.origin, one.destination) for one in given])
        final = np.array([FINALS[one.threshold] for one in given])
        left = 1.0 - town.need[at[:, 0], at[:, 1]]
        some = left < final
        self.count, self.pads = len(given), town.pads.astype(float)
        at, final, left = at[some], final[some], left[some]
        ready = np.array([one.ready_s for one in given])[some]
        self.expected_s, use = np.array([alone(town, one) for one in given])[some].T
        on_s, on = town.time_s[at[:, 1]], town.need[at[:, 1]]  # to each roof, from the destination
        on_s[np.arange(len(at)), at[:, 1]] = on[np.arange(len(at)), at[:, 1]] = 0.0
        self.come_s = ready[:, None] + town.time_s[at[:, 0], at[:, 1]][:, None] + on_s
        soc = np.maximum(left[:, None] - on, 0.0)
        self.charge_s = TAU_S * np.log(np.maximum((1.0 - soc) / (1.0 - final[:, None]), 1.0))
        self.flown = np.where(left[:, None] - on >= 0.0, 0.5 * on / use[:, None], np.inf)
        self.ready_s = ready
        self.at_s = np.arange(0.0, ready.max() + AFTER_S, STEP_S)

    def bound(self, price: np.ndarray) -> tuple[float, np.ndarray]:
        """Return a lower bound of the mean loss of any plan, and the subgradient; prices of a second have the shape (roofs, steps)."""
        total = np.concatenate((np.zeros((len(price), 1)), np.cumsum(price * STEP_S, axis=1)), axis=1)
        ends = np.append(self.at_s, self.at_s[-1] + STEP_S)
        best = np.full(len(self.ready_s), 1.0)
        chosen = np.full((len(best), 3), -1.0)
        for roof in range(len(price)):
            come, long = self.come_s[:, roof, None], self.charge_s[:, roof, None]
            steps = np.broadcast_to(self.at_s, (len(best), len(self.at_s)))
            in_time = (self.ready_s + self.expected_s)[:, None] - long
            begin = np.maximum(np.concatenate((steps, self.at_s - long, come, in_time), axis=1), come)
            late = np.maximum(begin + long - self.ready_s[:, None] - self.expected_s[:, None], 0.0)
            loss = self.flown[:, roof, None] + 0.5 * late / self.expected_s[:, None]
            paid = np.interp(begin + long, ends, total[roof]) - np.interp(begin, ends, total[roof])
            cost = loss + paid
            least = cost.argmin(axis=1)
            value = cost[np.arange(len(best)), least]
            better = value < best
            best[better] = value[better]
            chosen[better, 0] = roof
            chosen[better, 1] = begin[better, least[better]]
            chosen[better, 2] = long[better, 0]
        used = np.zeros_like(price)
        for roof, begin_s, long_s in chosen[chosen[:, 0] >= 0.0]:
            overlap = np.minimum(ends[1:], begin_s + long_s) - np.maximum(ends[:-1], begin_s)
            used[int(roof)] += np.maximum(overlap, 0.0)
        slack = used - self.pads[:, None] * STEP_S
        return float(best.sum() - (self.pads[:, None] * price * STEP_S).sum()) / self.count, slack


def most_quality(town: City, given: list[Request], reached: float, iterations: int = ITERATIONS) -> float:
    """Return an upper bound of the mean quality of any plan; `reached` is that of some plan, which determines the step size."""
    prices = Prices(town, given)
    price = np.zeros((len(town.pads), len(prices.at_s)))
    best, share, since = 0.0, 1.0, 0
    for _ in range(iterations):
        loss, slack = prices.bound(price)
        since = 0 if loss > best + 1e-6 else since + 1
        best = max(best, loss)
        if since >= 10:
            share, since = 0.6 * share, 0
        slack = np.where((price <= 0.0) & (slack < 0.0), 0.0, slack)
        step = share * max(1.0 - reached - loss, 1e-4) * prices.count / max(float((slack**2).sum()), 1e-12)
        price = np.maximum(price + step * slack, 0.0)
    return 1.0 - best
