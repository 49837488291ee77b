"""Heights of the legs of a plan: the ground, the highest in the corridor, and the flight path over them."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base.formatting import distance_text, height_text
from skyway.models.flight.clearance import Clearance

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import ArrayLike, NDArray

    from skyway.models.flight.way_heights import WayHeights
    from skyway.models.terrain.terrain import Terrain

MOST = 240
"""Points of a leg that a plan keeps; between them it keeps the highest."""


@dataclass(frozen=True, slots=True)
class TerrainUse:
    """Terrain that a plan was made over.

    Attributes
    ----------
    files : tuple of str
        Terrain models and obstacles, as they were named.
    clearance : Clearance
        Required clearance over them.
    """

    files: tuple[str, ...] = ()
    clearance: Clearance = field(default_factory=Clearance)

    @classmethod
    def of(cls, terrain: Terrain, clearance: Clearance) -> TerrainUse:
        """Return the record of a terrain model."""
        return cls(terrain.files, clearance)


@dataclass(frozen=True, slots=True)
class NearObstacle:
    """An obstacle in the corridor of a leg."""

    name: str
    along_m: float
    """Where it stands, along the leg."""
    top_m: float
    """Above mean sea level."""


@dataclass(frozen=True, slots=True)
class LegHeights:
    """Heights of a leg, metres above mean sea level, over the distance along it.

    Attributes
    ----------
    along_m : tuple of float
        Metres from its begin.
    ground_m, top_m : tuple of float
        There: the highest ground below nearby, and the highest ground or obstacle in the corridor.
    path_along_m, path_height_m : tuple of float
        Points of the flown way, straight lines between.
    least_m, least_along_m : float
        Least clearance of the flown way over `top_m`, and where it is.
    obstacles : tuple of NearObstacle
        Those in the corridor that are the highest somewhere.
    """

    along_m: tuple[float, ...]
    ground_m: tuple[float, ...]
    top_m: tuple[float, ...]
    path_along_m: tuple[float, ...]
    path_height_m: tuple[float, ...]
    least_m: float
    least_along_m: float
    obstacles: tuple[NearObstacle, ...] = ()

    @classmethod
    def of(cls, way: WayHeights, terrain: Terrain) -> LegHeights | None:
        """Return the record of the heights of a way over a terrain model; None over unknown ground."""
        if not len(way.along_m) or way.unknown is not None:
            return None
        begin = np.concatenate(([0.0], np.cumsum(way.segment_m)))
        path = [(begin[one.segment] + one.share * way.segment_m[one.segment], one.height_m) for one in way.knots]
        near = obstacles_told(way.along_m, way.obstacle, way.ground_m, terrain)
        return cls.sampled(way.along_m, way.ground_m, way.top_m, way.height_m, path, near)

    @classmethod
    def sampled(
        cls, along_m: NDArray[np.float64], ground_m: NDArray[np.float64], top_m: NDArray[np.float64],
        height_m: NDArray[np.float64], path: Sequence[tuple[float, float]], obstacles: tuple[NearObstacle, ...] = (),
    ) -> LegHeights:  # fmt: skip
        """Return the record of a densely sampled way, flown at `height_m` from point to point of `path`."""
        over = height_m - top_m
        least = int(np.argmin(over))
        blocks = np.unique(np.linspace(0, len(along_m), min(MOST, len(along_m)) + 1).astype(np.int64)[:-1])
        along = np.append(along_m[blocks], along_m[-1])
        ground, top = (np.append(np.maximum.reduceat(one, blocks), one[-1]) for one in (ground_m, top_m))
        return cls(
            _rounded(along), _rounded(ground), _rounded(top), _rounded([at for at, _ in path]),
            _rounded([height for _, height in path]), round(float(over[least]), 1), round(float(along_m[least]), 1), obstacles,
        )  # fmt: skip


def _rounded(values: ArrayLike) -> tuple[float, ...]:
    return tuple(np.round(np.asarray(values, dtype=np.float64), 1).tolist())


def obstacles_told(
    along_m: NDArray[np.float64], numbers: NDArray[np.int64], ground_m: NDArray[np.float64], terrain: Terrain
) -> tuple[NearObstacle, ...]:
    """Obstacles of `Terrain.obstacles_near` along a way that reach above the ground below it."""
    told: dict[str, NearObstacle] = {}
    for number in np.unique(numbers[numbers >= 0]).tolist():
        at = numbers == number
        name, top_m = terrain.obstacles.names[number], terrain.standing_m(number)
        if top_m > float(ground_m[at].max()) and (name not in told or top_m > told[name].top_m):
            told[name] = NearObstacle(name, round(float(along_m[at].mean()), 1), round(top_m, 1))
    return tuple(sorted(told.values(), key=lambda one: one.along_m))


def least_words(heights: LegHeights) -> str:
    """Least clearance of a leg and its location, in words."""
    at = f"{distance_text(heights.least_along_m)} along"
    if heights.least_m < 0.0:
        return f"{height_text(-heights.least_m)} below the highest ground or obstacle in the corridor, {at}"
    return f"least clearance {height_text(heights.least_m)} over ground and obstacles in the corridor, {at}"


def least_at_m(along_m: Sequence[float], heights_m: Sequence[float], place_m: float) -> float:
    """Height of a flown way at a distance along it; the lower one if it changes at once."""
    found = [
        min(h0, h1) if a1 == a0 else h0 + (place_m - a0) / (a1 - a0) * (h1 - h0)
        for (a0, h0), (a1, h1) in pairwise(zip(along_m, heights_m, strict=True))
        if a0 <= place_m <= a1
    ]
    return min(found, default=heights_m[0])
