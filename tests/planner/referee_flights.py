"""Flights as the referees see them: nothing here is shared with the planners or with `models.flight.kernels`.

Read from a problem is data only: network, drone, rules, request, wind series, queues. A segment's ground speeds give one
function of time, the distance that a drone flying along it forever would have covered. A segment entered at t is left
where that function has grown by its length, so a flight over many slots is a chain of look-ups in both directions and
there is no walk from slot to slot. Times are seconds after the departure.
"""

from __future__ import annotations

import math

import numpy as np

EDGE_S = 1e-6
"""A time this close below the boundary of a slot belongs to the next one (rule of `models.flight.rules`)."""
_CLOSED_MPS = 1e-7


def wind_triangle(wind_mps, wind_from_deg, course_deg, airspeed_mps):
    """Ground speed, equations 1 to 5 of the paper; 0 where the cross wind is too strong or below 1 m/s."""
    delta = math.radians(course_deg - wind_from_deg)
    along, across = wind_mps * math.cos(math.pi - delta), wind_mps * math.sin(math.pi - delta)
    if abs(across) >= airspeed_mps:
        return 0.0
    ground = along + math.sqrt(airspeed_mps**2 - across**2)
    return ground if ground >= 1.0 else 0.0


class Curve:
    """Charging from empty: constant to the knee, then a falling rate, in 24 chords (design/model.md, section 4)."""

    def __init__(self, full_s, pad_power_w, battery_j):
        q = 0.2
        for _ in range(200):
            q = 0.2 / (1.0 - 20.0 ** (-0.2 / q))
        unlimited = (0.8 + 0.2 * math.log(20.0)) / full_s
        rate = unlimited if pad_power_w is None else min(unlimited, pad_power_w / battery_j)
        tau, top = q / unlimited, 0.8 + q
        knee = min(1.0, top - q * rate / unlimited)
        if knee >= 1.0:
            self.time, self.soc = np.array([0.0, 1.0 / rate]), np.array([0.0, 1.0])
            return
        tail = tau * math.log((top - knee) / (top - 1.0))
        shrink = np.linspace(1.0, math.exp(-tail / (2.0 * tau)), 25)
        after = -2.0 * tau * np.log(shrink)
        self.time = np.concatenate(([0.0], knee / rate + after))
        self.soc = np.concatenate(([0.0], top - (top - knee) * shrink**2))

    def time_at(self, soc):
        return np.interp(soc, self.soc, self.time)

    def soc_at(self, time):
        return np.interp(time, self.time, self.soc)


class Flights:
    """Physics of one delivery.

    `speeds`, shape (slots, segments), takes the place of the wind where given.
    """

    def __init__(self, problem, *, speeds=None):
        request, drone, rules = problem.request, problem.drone, problem.scenario.rules
        self.network, wind = problem.network, problem.ensemble
        self.in_flight = request.state.position is not None
        self.climb_s = rules.cruise_height_m / rules.climb_rate_mps
        self.descent_s = rules.cruise_height_m / rules.descent_rate_mps
        self.begin_s = request.state.time.timestamp() - (self.climb_s if self.in_flight else 0.0)
        self.reserve = request.reserve_soc
        self.cost = self._consumption(drone, request.payload_kg)
        self.empty_cost = self._consumption(drone, request.payload_kg if request.undelivered_to else 0.0)
        self.dwell_s = request.dwell_s
        self.soc = request.state.soc + (self.cost * self.climb_s if self.in_flight else 0.0)
        n = self.network
        self.origin = len(n) - 1 if self.in_flight else n.index[request.state.station]
        self.destination = n.index[request.destination]
        if speeds is None:
            speeds = self._speeds(drone, rules, request, wind)
        first = wind.start_s - self.begin_s
        self.slot_s, self.first_s, self.slots = wind.slot_s, first, len(speeds)
        self.closed = speeds <= 0.0
        flown = np.where(self.closed, _CLOSED_MPS, speeds)
        ends = first + wind.slot_s * np.arange(1, len(speeds) + 1)
        # The first slot holds before the series and the last one after it.
        self.knots = np.concatenate(([min(first, 0.0) - 90_000.0], ends[:-1], [ends[-1] + 400_000.0]))
        lengths = np.diff(self.knots)
        covered = np.vstack((np.zeros(flown.shape[1]), np.cumsum(flown * lengths[:, None], axis=0)))
        self.covered = np.ascontiguousarray(covered.T)
        self.barred = np.vstack((np.zeros(flown.shape[1]), np.cumsum(self.closed, axis=0))).T
        self.boundaries = ends[:-1]
        self.horizon_s = float(ends[-1])
        self.curves = {}
        self.drone = drone
        self.needs_escape = request.escape and n.stations[self.destination].pads == 0

    @staticmethod
    def _consumption(drone, payload_kg):
        """SoC per second at constant power, by the two published endurances."""
        full = drone.mass_kg + drone.max_payload_kg
        kappa = math.log(drone.endurance_empty_s / drone.endurance_full_s) / math.log(full / drone.mass_kg)
        return ((drone.mass_kg + payload_kg) / drone.mass_kg) ** kappa / drone.endurance_empty_s

    def _speeds(self, drone, rules, request, wind):
        assert wind.north.shape[2] == 1
        factor = (rules.cruise_height_m / wind.height_m) ** rules.wind_profile_exponent
        airspeed = request.airspeed_mps or min(drone.max_airspeed_mps, drone.max_ground_speed_mps)
        out = np.zeros((wind.north.shape[1], len(self.network.head)))
        for slot in range(len(out)):
            north, east = factor * wind.north[0, slot, 0], factor * wind.east[0, slot, 0]
            blows, from_deg = math.hypot(north, east), math.degrees(math.atan2(-east, -north))
            if blows > drone.wind_limit_mps:
                continue
            for segment, schedule in enumerate(self.network.bearing_deg):
                ground = wind_triangle(blows, from_deg, float(schedule), airspeed)
                out[slot, segment] = min(ground, drone.max_ground_speed_mps)
        return out

    def curve(self, node):
        power = self.network.stations[node].recharge_power_w
        if power not in self.curves:
            self.curves[power] = Curve(self.drone.recharge_full_s, power, self.drone.battery_j)
        return self.curves[power]

    def slot(self, time):
        slot = np.floor((np.asarray(time) + EDGE_S - self.first_s) / self.slot_s).astype(np.int64)
        return np.clip(slot, 0, self.slots - 1)

    def over(self, segment, entered):
        """When a segment is left that is entered at some times."""
        line = self.covered[segment]
        return np.interp(np.interp(entered, self.knots, line) + self.network.distance_m[segment], line, self.knots)

    def entered(self, segment, left):
        """When a segment was entered that is left at some times."""
        line = self.covered[segment]
        return np.interp(np.interp(left, self.knots, line) - self.network.distance_m[segment], line, self.knots)

    def land(self, walk, off):
        """Touch-down of take-offs; infinite where a slot that is touched is closed for a segment of the walk."""
        now = np.asarray(off, dtype=np.float64) + self.climb_s
        for segment in walk:
            now = self.over(segment, now)
        down = now + self.descent_s
        first, last = self.slot(off), self.slot(down - 2.0 * EDGE_S)
        shut = np.zeros(np.shape(down), dtype=bool)
        for segment in walk:
            shut |= self.barred[segment, last + 1] > self.barred[segment, first]
        return np.where(shut, math.inf, down)

    def walks(self, a, b, longest=4):
        """Simple walks from node to node."""
        n, found, stack = self.network, [], [(a, ())]
        while stack:
            node, walk = stack.pop()
            for segment in range(n.first[node], n.first[node + 1]):
                other = int(n.head[segment])
                if other == b:
                    found.append((*walk, segment))
                elif len(walk) + 1 < longest and other != a and other not in {int(n.head[k]) for k in walk}:
                    stack.append((other, (*walk, segment)))
        return found

    def events(self, walk):
        """Take-offs at which anything about a flight over a walk can change, ascending."""
        found = [self.boundaries]
        later = self.boundaries  # over the node that ends the segments looked at so far
        for last in range(len(walk) + 1):
            later = self.boundaries - (self.descent_s if last == len(walk) + 1 else 0.0)
            for segment in reversed(walk[:last]):
                later = self.entered(segment, later)
            found.append(later - self.climb_s)
        down = self.boundaries - self.descent_s
        for segment in reversed(walk):
            down = self.entered(segment, down)
        found.append(down - self.climb_s)
        return np.unique(np.concatenate(found))

    def pieces(self, walk, low, high):
        """Flyable take-offs between two times, as rows (off, off, down, down) that are linear between."""
        events = self.events(walk)
        at = np.concatenate(([low], events[(events > low) & (events < high)], [high]))
        at = at[np.concatenate(([True], np.diff(at) > 1e-7))]
        begin, end = at[:-1], at[1:]
        inset = 1e-3 * np.minimum(end - begin, 1.0)
        d0, d1 = self.land(walk, begin + inset), self.land(walk, end - inset)
        ok = np.isfinite(d0) & np.isfinite(d1) & (end > begin)
        begin, end, inset, d0, d1 = (values[ok] for values in (begin, end, inset, d0, d1))
        slope = (d1 - d0) / (end - begin - 2.0 * inset)
        return np.column_stack((begin, end, d0 - slope * inset, d1 + slope * inset))

    @property
    def escapes(self):
        n, d = self.network, self.destination
        return [(s,) for s in range(n.first[d], n.first[d + 1]) if n.stations[int(n.head[s])].pads > 0]

    def escape_need(self, time, margin=0.0):
        """Charge that the way on from a target without pads takes, begun at some times or when the wind first allows."""
        time = np.asarray(time, dtype=np.float64) + self.dwell_s
        best = np.full(time.shape, math.inf)
        for walk in self.escapes:
            off = time.copy()
            down = self.land(walk, off)
            while np.any(np.isinf(down) & (self.slot(off) < self.slots - 1)):
                wait = np.isinf(down) & (self.slot(off) < self.slots - 1)
                off = np.where(wait, self.first_s + (self.slot(off) + 1) * self.slot_s, off)
                down = np.where(wait, self.land(walk, off), down)
            best = np.minimum(best, (self.empty_cost + margin) * (down - off))
        return best


class Queue:
    """One station's sampled or expected queue, in seconds after the departure."""

    def __init__(self, path, begin_s):
        self.others = path.arrival_s - begin_s
        self.pad, self.spot, self.delay = path.pad_s - begin_s, path.land_s - begin_s, path.delay_s

    def behind(self, arrive):
        return np.searchsorted(self.others, arrive, side="right")

    def spot_at(self, arrive):
        return np.maximum(arrive, self.spot[self.behind(arrive)])

    def pad_at(self, arrive):
        k = self.behind(arrive)
        return np.maximum(arrive + self.delay[k], self.pad[k])


def flown(problem, queues, itinerary):
    """Fly decisions: seconds until the delivery, and what is wrong with it (an empty text: nothing).

    Each take-off must be possible when it is decided for: waits and charging must be over, and the wind open.
    """
    f = Flights(problem)
    now, joined, soc, node = 0.0, 0.0, f.soc, f.origin
    for number, leg in enumerate(itinerary, 1):
        decided = leg.not_before_s - f.begin_s
        off = max(now, decided)
        if leg.charge_to is not None and leg.charge_to > soc and not (f.in_flight and number == 1):
            curve = f.curve(node)
            pad = max(now, float(Queue(queues[node], f.begin_s).pad_at(joined)))
            since = float(curve.time_at(soc))
            off = max(off, pad + float(curve.time_at(leg.charge_to)) - since)
            soc = float(curve.soc_at(since + off - pad))
        if off > max(decided, 0.0) + 0.02:
            return math.inf, f"leg {number} takes off {off - decided:.3f} s late"
        joined = float(f.land(leg.segments, off))
        if math.isinf(joined):
            return math.inf, f"leg {number} cannot be flown"
        node = int(f.network.head[leg.segments[-1]])
        now = float(Queue(queues[node], f.begin_s).spot_at(joined)) if f.network.stations[node].pads else joined
        soc -= f.cost * (now - off)
        if soc < f.reserve - 1e-6:
            return now, f"leg {number} lands {f.reserve - soc:.2e} below the reserve"
    if f.needs_escape and soc < f.reserve + float(f.escape_need(now)) - 1e-6:
        return now, "the way on from the destination breaks the reserve"
    return now, ""
