"""An ensemble of wind series (members), each for all sites and times together.

A member is a complete course, so that strong wind persists for a realistic time,
at all sites at once. See `models.wind.marginal` for one slot and place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import views
from skyway.models.base.errors import InputError
from skyway.models.base.units import iso
from skyway.models.wind.interpolation import site_weights
from skyway.models.wind.triangle import height_factor

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from skyway.models.wind.felt_gust import FeltGust


def evenly(count: int, most: int) -> NDArray[np.int64]:
    """Return at most as many of the numbers below `count`, evenly chosen, ascending."""
    return np.arange(count) if count <= most else (np.arange(most) * 2 + 1) * count // (2 * most)


@dataclass(frozen=True, slots=True, eq=False)
class HourlyWeather:
    """Weather besides the wind over a region, hour by hour: the value that one member in ten exceeds at the worst place."""

    start_s: float
    slot_s: float
    """POSIX seconds at which the first slot begins, and the length of a slot."""
    values: dict[str, NDArray[np.float64]]
    """Shape (slots,) each, NaN if it is unknown: ``gust`` (m/s), ``rain`` (mm/h), ``visibility`` (m), ``coldest`` and ``warmest`` (K), ``icing`` (share of
    the members); ``gust_sd``: standard deviation of gusts as a share of the wind at the height of flight, the mean of places and members."""

    def between(self, name: str, begin_s: float, end_s: float) -> NDArray[np.float64]:
        """Known values in the slots that an interval touches, shape (n,)."""
        values = self.values.get(name, np.empty(0))
        first = max(math.floor((begin_s - self.start_s) / self.slot_s), 0)
        found = values[first : max(math.ceil((end_s - self.start_s) / self.slot_s), first)]
        return np.asarray(found[np.isfinite(found)])


@dataclass(frozen=True, slots=True, eq=False)
class WindEnsemble:
    """Possible courses of the wind with their probabilities.

    Attributes
    ----------
    site_lat, site_lon : ndarray, shape (sites,)
        Degrees, WGS-84.
    start_s, slot_s : float
        POSIX seconds at which slot 0 begins, and the length of a slot. The wind is constant within a slot;
        the last one continues.
    north, east : ndarray, shape (members, slots, sites)
        m/s TOWARDS, never NaN.
    probability : ndarray, shape (members,)
        Sums to 1.
    labels : tuple of str
        Name of each member, such as ``2013-07-04``.
    height_m : float
        Height of the wind above ground.
    lattice : tuple of int, optional
        (rows, columns) where the sites are the nodes of a lattice: then the wind between them is bilinear, else by the inverse square of the
        distance (`models.wind.interpolation.site_weights`).
    known_until_s : float
        POSIX seconds at which the forecast ends; infinite if unknown.
    then : str
        Source of the wind from then on, for people.
    weather : HourlyWeather, optional
        Other forecast quantities.
    notes : tuple of str
        Notes for a person.
    gust : FeltGust, optional
        Measured in the air just now; it is not in `north` and `east`.

    Raises
    ------
    InputError
        Arrays of other shapes, values that are not finite, probabilities that do not sum to 1.
    """

    site_lat: NDArray[np.float64]
    site_lon: NDArray[np.float64]
    start_s: float
    slot_s: float
    north: NDArray[np.float64]
    east: NDArray[np.float64]
    probability: NDArray[np.float64]
    labels: tuple[str, ...]
    height_m: float
    lattice: tuple[int, int] | None = None
    known_until_s: float = math.inf
    then: str = ""
    weather: HourlyWeather | None = None
    notes: tuple[str, ...] = ()
    gust: FeltGust | None = None

    def __repr__(self) -> str:
        members, slots, sites = self.north.shape
        begin = iso(datetime.fromtimestamp(self.start_s, UTC))
        hours = slots * self.slot_s / 3600.0
        counts = f"{views.counted(members, 'member')}, {views.counted(sites, 'site')}"
        return f"WindEnsemble({counts}, {hours:g} h from {begin}, at {self.height_m:g} m)"

    def __post_init__(self) -> None:
        shape = (len(self.labels), self.north.shape[1], len(self.site_lat))
        if self.north.shape != shape or self.east.shape != shape or self.probability.shape != shape[:1]:
            raise InputError("the arrays of a wind ensemble do not fit together")
        if not (np.isfinite(self.north).all() and np.isfinite(self.east).all() and self.north.size):
            raise InputError("a wind ensemble must be complete and finite")
        if not (np.all(self.probability >= 0.0) and math.isclose(self.probability.sum(), 1.0, rel_tol=1e-9)):
            raise InputError("the probabilities of a wind ensemble must sum to 1")
        for name, value, fits in (
            ("start_s", self.start_s, math.isfinite(self.start_s)),
            ("slot_s", self.slot_s, 0.0 < self.slot_s < math.inf),
            ("height_m", self.height_m, 0.0 < self.height_m < math.inf),
        ):
            if not fits:
                raise InputError("no time, length of time or height of a wind ensemble", field=name, value=value)
        if not (np.isfinite(self.site_lat).all() and np.isfinite(self.site_lon).all() and len(self.site_lat)):
            raise InputError("the sites of a wind ensemble must have places")
        if self.lattice is not None and self.lattice[0] * self.lattice[1] != len(self.site_lat):
            raise InputError("the lattice of a wind ensemble has another number of nodes than sites")

    def __len__(self) -> int:
        return len(self.labels)

    @property
    def slots(self) -> int:
        """Number of slots."""
        return int(self.north.shape[1])

    def slot_at(self, posix_s: float) -> int:
        """Slot that contains an instant; the first and the last extend without end."""
        return min(max(math.floor((posix_s - self.start_s) / self.slot_s), 0), self.slots - 1)

    def at_height(self, height_m: float, exponent: float) -> WindEnsemble:
        """Return the wind at a height above ground, by the power law of `models.wind.triangle.height_factor`."""
        if height_m == self.height_m:
            return self
        factor = height_factor(height_m, self.height_m, exponent)
        gust = None if self.gust is None else self.gust.times(factor)
        return replace(self, north=self.north * factor, east=self.east * factor, height_m=height_m, gust=gust)

    def at_sites(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> WindEnsemble:
        """Return the wind at places, degrees, as its sites; between these it is interpolated by their distance."""
        weight = self.weights(lat, lon)
        north, east = self.north @ weight.T, self.east @ weight.T
        return replace(self, site_lat=lat, site_lon=lon, north=north, east=east, lattice=None)

    def in_shorter_slots(self, parts: int) -> WindEnsemble:
        """Return the same wind with each slot divided into slots of one length."""
        if parts == 1:
            return self
        north, east = (np.repeat(values, parts, axis=1) for values in (self.north, self.east))
        return replace(self, slot_s=self.slot_s / parts, north=north, east=east)

    def member(self, number: int) -> WindEnsemble:
        """Return one member alone, certain."""
        return self._chosen(np.array([range(len(self))[number]]))

    def mean(self) -> WindEnsemble:
        """Return the mean wind vector of all members as one certain member; it is calmer than any of them."""
        north, east = (np.einsum("m,mts->ts", self.probability, values)[None] for values in (self.north, self.east))
        return replace(self, north=north, east=east, probability=np.ones(1), labels=("mean",))

    def weighted(self, weights: ArrayLike) -> WindEnsemble:
        """Return the members with probabilities times `weights`, shape (members,), scaled to sum to 1.

        Raises an `InputError` if a weight is negative or not finite, or if no member is left.
        """
        product = self.probability * np.asarray(weights, dtype=np.float64)
        total = float(product.sum())
        if product.shape != self.probability.shape or not np.all(product >= 0.0) or not 0.0 < total < math.inf:
            raise InputError("the weights of a wind ensemble must be 0 or more and leave a member")
        return replace(self, probability=product / total)

    def thinned(self, most: int) -> WindEnsemble:
        """Return at most that many members, evenly chosen in their order, their probabilities scaled to 1."""
        if most < 1:
            raise InputError("an ensemble needs a member", field="members", value=most)
        return self if len(self) <= most else self._chosen(evenly(len(self), most))

    def most_probable(self, most: int) -> WindEnsemble:
        """Return at most that many members, the most probable ones in their order, their probabilities scaled to 1."""
        if len(self) <= most:
            return self
        return self._chosen(np.sort(np.argsort(-self.probability, kind="stable")[:most]))

    def possible(self) -> WindEnsemble:
        """Return the members whose probability is above zero."""
        return self._chosen(np.flatnonzero(self.probability > 0.0))

    def _chosen(self, members: NDArray[np.int64]) -> WindEnsemble:
        probability = self.probability[members]
        total = probability.sum()
        even = np.full(len(members), 1.0 / len(members))
        return replace(
            self,
            north=self.north[members],
            east=self.east[members],
            probability=probability / total if total > 0.0 else even,
            labels=tuple(self.labels[number] for number in members),
        )

    def weights(self, lat: ArrayLike, lon: ArrayLike) -> NDArray[np.float64]:
        """Weights of the sites at points, degrees, shape (points, sites)."""
        return site_weights(lat, lon, self.site_lat, self.site_lon, self.lattice)

    def wind_at(self, lat: float, lon: float, slot: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Wind of every member at a place in a slot: (north, east), shape (members,) each."""
        weights = self.weights(lat, lon)[0]
        return self.north[:, slot] @ weights, self.east[:, slot] @ weights

    def at_times(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], time_s: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Wind of every member at places and times: (north, east), shape (members, n) each.

        Places have shape (n,), times (n,) or (members, n), POSIX seconds; a time that never comes counts as the first slot.
        """
        weight = self.weights(lat, lon)
        slot = np.floor((np.broadcast_to(time_s, (len(self), len(lat))) - self.start_s) / self.slot_s)
        chosen = np.clip(np.where(np.isfinite(slot), slot, 0.0), 0, self.slots - 1).astype(np.int64)
        member = np.arange(len(self))[:, None]
        north = np.einsum("mns,ns->mn", self.north[member, chosen], weight)
        east = np.einsum("mns,ns->mn", self.east[member, chosen], weight)
        return north, east
