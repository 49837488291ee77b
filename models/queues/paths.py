"""Queue paths: the queue that a drone meets at a station in one realization of the other drones, one by one or many packed.

Given the others, our drone joins the same line and is served first come, first served: when it arrives after
the first k of them it gets the pad that is free after k assignments. A path keeps these times for every k, so
that any time of arrival has its answer and no drone overtakes. (Independent draws per arrival would let a
later arrival start earlier.) Paths are sampled by `models.queues.sampling`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True, eq=False)
class QueuePath:
    """Queue that our drone meets at one station, for any time of arrival.

    Attributes
    ----------
    arrival_s : ndarray, shape (k,)
        When the others arrive, POSIX seconds, ascending.
    pad_s : ndarray, shape (k + 1,)
        Earliest time a pad is free for a drone behind the first 0, 1, … of them; nondecreasing, -inf is
        always.
    land_s : ndarray, shape (k + 1,)
        Earliest time it can touch down, on a pad or a holding spot; nondecreasing and never after `pad_s`.
    delay_s : ndarray, shape (k + 1,)
        It gets no pad sooner than this long after its own arrival, in the interval before the first, between the
        first and the second of them, …; 0 by default. With it a path gives waits that are expected, not sampled.
        The pad's time must still be nondecreasing in the arrival.
    present : int
        Others on the pads and in line when the path begins.
    left_s : ndarray, shape (departures,)
        When others leave after that, ascending.
    """

    arrival_s: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    land_s: NDArray[np.float64]
    delay_s: NDArray[np.float64] = field(default_factory=lambda: np.zeros(1))
    present: int = 0
    left_s: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if self.delay_s.shape != self.pad_s.shape:
            object.__setattr__(self, "delay_s", np.broadcast_to(self.delay_s, self.pad_s.shape))

    def pad_time(self, arrival_s: ArrayLike) -> NDArray[np.float64]:
        """Time at which our drone gets a pad if it arrives at POSIX seconds `arrival_s`; nondecreasing in it.

        An arrival at the same time as another drone's is placed behind it. Before the start of the path the
        answer is that of a drone behind all drones present at the start.
        """
        arrival, interval = self._at(arrival_s)
        return np.maximum(arrival + self.delay_s[interval], self.pad_s[interval])

    def land_time(self, arrival_s: ArrayLike) -> NDArray[np.float64]:
        """Time at which it can touch down if it arrives at POSIX seconds `arrival_s`; never after `pad_time`."""
        arrival, interval = self._at(arrival_s)
        return np.maximum(arrival, self.land_s[interval])

    def latest_arrival(self, land_by_s: float) -> float:
        """Latest arrival with which it touches down by a time; -inf where no arrival from now on does."""
        served = int(np.searchsorted(self.land_s, land_by_s, side="right"))
        if served == 0:
            return -math.inf
        return min(land_by_s, float(self.arrival_s[served - 1])) if served <= len(self.arrival_s) else land_by_s

    def present_at(self, time_s: float) -> int:
        """Others on the pads and in line at a time, as seen from outside."""
        came = int(np.searchsorted(self.arrival_s, time_s, side="right"))
        return self.present + came - int(np.searchsorted(self.left_s, time_s, side="right"))

    def _at(self, arrival_s: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
        arrival = np.asarray(arrival_s, dtype=np.float64)
        return arrival, np.searchsorted(self.arrival_s, arrival, side="right")


def no_queue() -> QueuePath:
    """Return a path on which a pad is always free, as at a delivery target, where nobody recharges."""
    return QueuePath(np.empty(0), np.array([-math.inf]), np.array([-math.inf]))


def expected_paths(start_s: float, step_s: float, wait_s: NDArray[np.float64]) -> list[QueuePath]:
    """Make the paths of drones that wait as long as expected at their arrival, at several stations.

    Parameters
    ----------
    start_s, step_s : float
        The grid, POSIX seconds and seconds.
    wait_s : ndarray, shape (stations, times)
        Expected waits of arrivals at `start_s`, `start_s` + `step_s`, …

    Returns
    -------
    list of QueuePath
        One a station. Within a step the wait is the mean of its two ends, before the grid and after it that of its
        first and last time. Where that would let a later arrival have its pad earlier, it gets it with the last one
        before it. Landing needs no wait.
    """
    stations, times = wait_s.shape
    arrival = np.asarray(start_s + step_s * np.arange(times), dtype=np.float64)
    delay = np.empty((stations, times + 1))
    delay[:, 0], delay[:, 1:-1], delay[:, -1] = wait_s[:, 0], 0.5 * (wait_s[:, 1:] + wait_s[:, :-1]), wait_s[:, -1]
    pad = np.full(delay.shape, -math.inf)
    pad[:, 1:] = np.maximum.accumulate(arrival + delay[:, :-1], axis=1)
    always = np.full(times + 1, -math.inf)
    return [QueuePath(arrival, pad[number], always, delay[number]) for number in range(stations)]


@dataclass(frozen=True, eq=False)
class PackedPaths:
    """Paths laid end to end, as kernels read them."""

    offset: NDArray[np.int64]
    """Shape (paths + 1,). Entries of path i are ``offset[i] : offset[i + 1]``, at least one."""
    arrival_s: NDArray[np.float64]
    pad_s: NDArray[np.float64]
    land_s: NDArray[np.float64]
    delay_s: NDArray[np.float64]
    """Shape (entries,) each. An entry's times hold for our arrivals from its `arrival_s` (-inf in the first entry of a path) until before
    the next one's; see `QueuePath`."""
    present: NDArray[np.int64]
    """Shape (paths,). Others on the pads and in line when each path begins."""
    left_offset: NDArray[np.int64]
    left_s: NDArray[np.float64]
    """Departures of others after that from the station of path i are ``left_s[left_offset[i] : left_offset[i + 1]]``, ascending."""

    def __len__(self) -> int:
        return len(self.present)

    def __getitem__(self, number: int) -> QueuePath:
        low, high = self.offset[number], self.offset[number + 1]
        left = self.left_s[self.left_offset[number] : self.left_offset[number + 1]]
        return QueuePath(
            self.arrival_s[low + 1 : high], self.pad_s[low:high], self.land_s[low:high], self.delay_s[low:high],
            int(self.present[number]), left,
        )  # fmt: skip


def pack(paths: Sequence[QueuePath]) -> PackedPaths:
    """Lay paths end to end."""
    offset = np.zeros(len(paths) + 1, dtype=np.int64)
    np.cumsum([len(path.pad_s) for path in paths], out=offset[1:])
    arrival, pad, land, delay = (np.empty(offset[-1]) for _ in range(4))
    for i, path in enumerate(paths):
        low, high = offset[i], offset[i + 1]
        arrival[low] = -math.inf
        arrival[low + 1 : high] = path.arrival_s
        pad[low:high] = path.pad_s
        land[low:high] = path.land_s
        delay[low:high] = path.delay_s
    left_offset = np.cumsum([0, *(len(path.left_s) for path in paths)]).astype(np.int64)
    present = np.array([path.present for path in paths], dtype=np.int64)
    left = np.concatenate([np.empty(0), *(path.left_s for path in paths)])
    return PackedPaths(offset, arrival, pad, land, delay, present, left_offset, left)


def joined(parts: Sequence[PackedPaths]) -> PackedPaths:
    """Lay packed paths end to end, those of the first part first."""

    def after(offsets: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
        begins = np.cumsum([0, *(int(offset[-1]) for offset in offsets)])
        return np.concatenate([*(o[:-1] + begin for o, begin in zip(offsets, begins, strict=False)), begins[-1:]])

    def all_of(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(part, name) for part in parts])

    return PackedPaths(
        offset=after([part.offset for part in parts]),
        left_offset=after([part.left_offset for part in parts]),
        **{name: all_of(name) for name in ("arrival_s", "pad_s", "land_s", "delay_s", "present", "left_s")},
    )


def spliced(paths: PackedPaths, others: PackedPaths, chosen: NDArray[np.bool_]) -> PackedPaths:
    """Return packed paths with some of them, of shape (paths,), replaced by those of the same number among others."""
    offset, entries = _taken_from(paths.offset, others.offset, chosen)
    left_offset, departures = _taken_from(paths.left_offset, others.left_offset, chosen)

    def taken(name: str, numbers: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.asarray(np.concatenate([getattr(paths, name), getattr(others, name)])[numbers])

    return PackedPaths(
        offset=offset,
        present=np.where(chosen, others.present, paths.present),
        left_offset=left_offset,
        left_s=taken("left_s", departures),
        **{name: taken(name, entries) for name in ("arrival_s", "pad_s", "land_s", "delay_s")},
    )


def _taken_from(
    offset: NDArray[np.int64], other: NDArray[np.int64], chosen: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Offsets of parts taken from one of two arrays, and the numbers of their entries in both laid end to end."""
    first = np.where(chosen, other[:-1] + offset[-1], offset[:-1])
    count = np.where(chosen, np.diff(other), np.diff(offset))
    found = np.concatenate([[0], np.cumsum(count)])
    return found, np.repeat(first - found[:-1], count) + np.arange(found[-1])
