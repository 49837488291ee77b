"""Terrain of a region: height of the ground at places, and the highest around them.

Heights are metres above mean sea level (the EGM96 or EGM2008 geoid, which files of either kind count from; they differ by
decimetres mostly). Files that count from the ellipsoid are converted.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.base import geodesy
from skyway.models.terrain.mosaic import patch_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.terrain.mosaic import Box, Patch
    from skyway.models.terrain.obstacles import Obstacles
    from skyway.models.terrain.raster import Raster

_M_PER_DEG = math.pi * geodesy.EARTH_RADIUS_M / 180.0
_AHEAD_M = 3_000.0
"""Additional extent that is read, so that neighbouring requests need no further reading."""
_ABOUT_M = 1_000.0
"""Additional extent around the radius that is read, for the cells that a radius is rounded up to."""
COARSEST_M = 1_000.0
"""Cells wider than this do not represent the ground below a leg."""


class Terrain:
    """Ground and obstacles of some files; only the region that is requested is read.

    Attributes
    ----------
    rasters : tuple of Raster
        Terrain models, the order of files; of those that overlap the finest counts.
    obstacles : Obstacles
        Obstacles on the ground.
    files : tuple of str
        All files, as named: with datum and unit if these were given.
    notes : tuple of str
        Notes on them for a person.
    """

    def __init__(
        self, rasters: Sequence[Raster], obstacles: Obstacles, files: Sequence[str] = (), notes: Sequence[str] = ()
    ) -> None:
        self.rasters, self.obstacles = tuple(rasters), obstacles
        self.files, self.notes = tuple(files), tuple(notes)
        self._box: Box | None = None
        self._patch: Patch | None = None
        self._tops: dict[tuple[int, int], NDArray[np.float32]] = {}
        self._standing_m = np.full(len(obstacles), np.nan)

    @property
    def spacing_m(self) -> float:
        """Least distance of neighbouring heights in any of the files."""
        return min(min(raster.spacing_m()) for raster in self.rasters)

    def raster_box(self) -> Box:
        """South, west, north and east of all terrain models together, degrees."""
        boxes = np.array([raster.bounds() for raster in self.rasters])
        return float(boxes[:, 0].min()), float(boxes[:, 1].min()), float(boxes[:, 2].max()), float(boxes[:, 3].max())

    def ground_m(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height of the ground at places, shape (places,): bilinear between those of the model; NaN if it has none."""
        patch = self._over(lat, lon, 0.0)
        return np.full(len(lat), np.nan) if patch is None else patch.interpolated_m(lat, lon)

    def top_m(self, lat: NDArray[np.float64], lon: NDArray[np.float64], radius_m: float) -> NDArray[np.float64]:
        """Highest ground or obstacle within a radius of places, shape (places,); NaN if the ground there is unknown throughout.

        Never lower than any ground within the radius; the ground of up to two cells more counts, and that of the corners of a
        square about the place.
        """
        patch = self._over(lat, lon, radius_m)
        if patch is None:
            return np.full(len(lat), np.nan)
        tops = self._highest(patch, radius_m)
        row, column = (np.round(one).astype(np.int64) for one in patch.at(lat, lon))
        inside = (row >= 0) & (row < tops.shape[0]) & (column >= 0) & (column < tops.shape[1])
        found = np.full(len(lat), np.nan)
        found[inside] = tops[row[inside], column[inside]]
        top, _ = self.obstacles_near(lat, lon, radius_m)
        return np.where(np.isnan(found), found, np.fmax(found, top))

    def obstacles_near(
        self, lat: NDArray[np.float64], lon: NDArray[np.float64], radius_m: float
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Top of the highest obstacle within a radius of places, and its number; NaN and -1 where there is none, shape (places,)."""
        near = self.obstacles.within(lat, lon, radius_m)
        new = near[np.isnan(self._standing_m[near])]
        if len(new):
            ground_m = self.ground_m(self.obstacles.lat[new], self.obstacles.lon[new])
            self._standing_m[new] = self.obstacles.tops_m(new, ground_m)
        return self.obstacles.highest(near, lat, lon, radius_m, self._standing_m)

    def standing_m(self, obstacle: int) -> float:
        """Top above mean sea level of an obstacle returned by `obstacles_near`."""
        return float(self._standing_m[obstacle])

    def _highest(self, patch: Patch, radius_m: float) -> NDArray[np.float32]:
        """Highest ground within a radius of each height of a patch; NaN if one of them is unknown."""
        from scipy.ndimage import maximum_filter1d

        south_m, east_m = patch.raster.spacing_m()
        reach = math.ceil(radius_m / south_m) + 1, math.ceil(radius_m / (0.98 * east_m)) + 1
        found = self._tops.get(reach)
        if found is None:
            known = np.where(np.isnan(patch.height_m), np.float32(np.inf), patch.height_m)  # unknown is the highest
            for axis in (0, 1):
                known = maximum_filter1d(known, 2 * reach[axis] + 1, axis, mode="constant", cval=np.inf)
            found = self._tops[reach] = np.where(np.isinf(known), np.float32(np.nan), known)
        return found

    def _over(self, lat: NDArray[np.float64], lon: NDArray[np.float64], radius_m: float) -> Patch | None:
        """The patch that contains places and their surroundings; it grows with requests."""
        if not len(lat) or not self.rasters:
            return None
        middle = float(lon[0]) if self._box is None else 0.5 * (self._box[1] + self._box[3])
        lon = geodesy.about(lon, middle)
        wanted = _wider((float(lat.min()), float(lon.min()), float(lat.max()), float(lon.max())), radius_m + _ABOUT_M)
        if self._box is None or not _holds(self._box, wanted):
            box = _wider(wanted, _AHEAD_M)
            if self._box is not None:
                both = (
                    min(box[0], self._box[0]),
                    min(box[1], self._box[1]),
                    max(box[2], self._box[2]),
                    max(box[3], self._box[3]),
                )
                if _area(both) <= 2.0 * (_area(box) + _area(self._box)):  # otherwise they are far apart
                    box = both
            self._box, self._patch, self._tops = box, patch_of(self.rasters, box), {}
        return self._patch


def _wider(box: Box, by_m: float) -> Box:
    south, west, north, east = box
    lat = by_m / _M_PER_DEG
    most = min(max(abs(south), abs(north)) + lat, 89.0)
    lon = lat / math.cos(math.radians(most))
    return south - lat, west - lon, north + lat, east + lon


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])


def _holds(box: Box, other: Box) -> bool:
    return box[0] <= other[0] and box[1] <= other[1] and box[2] >= other[2] and box[3] >= other[3]
