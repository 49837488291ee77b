"""Several rasters as one grid: their heights over a region, in metres above mean sea level, with voids filled from coarser files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from skyway.models.terrain.geoid import undulation_m

if TYPE_CHECKING:
    from collections.abc import Sequence

    from numpy.typing import NDArray

    from skyway.models.terrain.raster import Raster

Box = tuple[float, float, float, float]
"""South, west, north, east, degrees; east may be beyond 180."""
_ALIGNED = 1e-3
"""Grids whose heights coincide within this, in steps, are one grid."""
_GEOID_EVERY = 32
"""The geoid is computed at nodes this many apart, and is linear between them."""


@dataclass(frozen=True, slots=True, eq=False)
class Patch:
    """Heights of a region on the grid of one raster.

    Attributes
    ----------
    raster : Raster
        The raster whose grid it has.
    row, column : int
        Of its first height, counted from the raster's first; either may be below 0 where another tile lies there.
    height_m : ndarray of float32, shape (rows, columns)
        Above mean sea level; NaN if no file has a height.
    """

    raster: Raster
    row: int
    column: int
    height_m: NDArray[np.float32]

    def at(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(row, column) of places in the patch."""
        row, column = self.raster.at(lat, lon)
        return row - self.row, column - self.column

    def interpolated_m(self, lat: NDArray[np.float64], lon: NDArray[np.float64]) -> NDArray[np.float64]:
        """Height at places: bilinear between the four about it; NaN if one of them that counts is unknown."""
        row, column = self.at(lat, lon)
        rows, columns = self.height_m.shape
        row, column = _on_node(row), _on_node(column)
        inside = (row >= 0.0) & (row <= rows - 1.0) & (column >= 0.0) & (column <= columns - 1.0)
        row, column = np.where(inside, row, 0.0), np.where(inside, column, 0.0)
        i, j = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
        down, right = row - i, column - j
        i1, j1 = np.minimum(i + 1, rows - 1), np.minimum(j + 1, columns - 1)
        found = np.zeros(row.shape)
        for a, b, share in (
            (i, j, (1.0 - down) * (1.0 - right)), (i, j1, (1.0 - down) * right), (i1, j, down * (1.0 - right)), (i1, j1, down * right),
        ):  # fmt: skip
            found += np.where(share > 0.0, share * self.height_m[a, b], 0.0)
        return np.where(inside, found, np.nan)


def _on_node(place: NDArray[np.float64]) -> NDArray[np.float64]:
    """A place in a grid; one that is on a node except for rounding is moved to the node."""
    node = np.round(place)
    return np.where(np.abs(place - node) < 1e-6, node, place)


def patch_of(rasters: Sequence[Raster], box: Box) -> Patch | None:
    """Heights of a region, on the finest grid that covers a part of it; None if no file does."""
    reaching = sorted((one for one in rasters if _window(one, box, own=True) is not None), key=_fineness)
    groups: list[list[Raster]] = []
    for raster in reaching:
        group = next((found for found in groups if _aligned(found[0], raster)), None)
        if group is None:
            groups.append([raster])
        else:
            group.append(raster)
    filled: Patch | None = None
    for group in reversed(groups):  # each is filled from those that are coarser
        patch = _patch(group, box)
        if filled is not None:
            _fill(patch, filled)
        filled = patch
    return filled


def _fineness(raster: Raster) -> float:
    return raster.spacing_m()[0]


def _aligned(one: Raster, other: Raster) -> bool:
    """Whether two rasters have heights of one grid."""
    if one.crs != other.crs or not np.allclose(one.step, other.step, rtol=1e-6 / max(one.rows, one.columns), atol=0.0):
        return False
    return all(abs(off - round(off)) < _ALIGNED for off in _offset(one, other))


def _offset(one: Raster, other: Raster) -> tuple[float, float]:
    """(row, column) of the first height of another raster in the grid of one."""
    x = other.origin[0]
    if one.is_geographic:  # the nearer way around the Earth
        x += 360.0 * round((one.origin[0] - x) / 360.0)
    return (other.origin[1] - one.origin[1]) / one.step[1], (x - one.origin[0]) / one.step[0]


def _window(raster: Raster, box: Box, *, own: bool) -> tuple[int, int, int, int] | None:
    """Rows and columns [r0, r1) x [c0, c1) of a raster's grid that contain a region; of its own heights only, or beyond them."""
    south, west, north, east = box
    edge = np.linspace(0.0, 1.0, 9)
    lat = np.concatenate((south + (north - south) * edge,) * 2 + (np.full(9, south), np.full(9, north)))
    lon = np.concatenate((np.full(9, west), np.full(9, east)) + (west + (east - west) * edge,) * 2)
    row, column = raster.at(lat, lon)
    if not (np.isfinite(row).all() and np.isfinite(column).all()):
        return None
    r0, r1 = int(np.floor(row.min())) - 1, int(np.ceil(row.max())) + 2
    c0, c1 = int(np.floor(column.min())) - 1, int(np.ceil(column.max())) + 2
    if own:
        r0, r1, c0, c1 = max(r0, 0), min(r1, raster.rows), max(c0, 0), min(c1, raster.columns)
    return (r0, r1, c0, c1) if r0 < r1 and c0 < c1 else None


def _patch(group: Sequence[Raster], box: Box) -> Patch:
    """Heights of a region from rasters of one grid; where they overlap, the first one counts."""
    first = group[0]
    r0, r1, c0, c1 = _window(first, box, own=False) or (0, 0, 0, 0)
    height = np.full((r1 - r0, c1 - c0), np.nan, dtype=np.float32)
    for raster in group:
        off = [round(value) for value in _offset(first, raster)]
        a, b = max(r0 - off[0], 0), min(r1 - off[0], raster.rows)
        c, d = max(c0 - off[1], 0), min(c1 - off[1], raster.columns)
        if a >= b or c >= d:
            continue
        found = raster.heights_m((a, b), (c, d))
        if raster.datum == "ellipsoid":
            found = found - _geoid_m(raster, (a, b), (c, d))
        place = np.s_[a + off[0] - r0 : b + off[0] - r0, c + off[1] - c0 : d + off[1] - c0]
        known = height[place]
        height[place] = np.where(np.isnan(known), found, known) if not np.isnan(known).all() else found
    return Patch(first, r0, c0, height)


def _geoid_m(raster: Raster, rows: tuple[int, int], columns: tuple[int, int]) -> NDArray[np.float32]:
    """Height of the geoid over the ellipsoid at the heights of a window."""
    at_rows, at_columns = (
        np.unique(np.append(np.arange(*ends, _GEOID_EVERY), ends[1] - 1)) for ends in (rows, columns)
    )
    places = np.array([[raster.place(row, column) for column in at_columns] for row in at_rows])
    lat, lon = places[..., 0], places[..., 1]
    coarse = undulation_m(lat, lon) if raster.geoid is None else raster.geoid.bilinear_m(lat, lon)
    wide = np.array([np.interp(np.arange(*columns), at_columns, line) for line in coarse])
    share = np.interp(np.arange(*rows), at_rows, np.arange(len(at_rows)))
    above = np.minimum(share.astype(np.int64), len(at_rows) - 1)
    below = np.minimum(above + 1, len(at_rows) - 1)
    part = (share - above)[:, None]
    return np.asarray((1.0 - part) * wide[above] + part * wide[below], dtype=np.float32)


def _fill(patch: Patch, coarser: Patch) -> None:
    """Fill the voids of a patch from a coarser one, in place."""
    rows, columns = np.nonzero(np.isnan(patch.height_m))
    if not len(rows):
        return
    places = [patch.raster.place(row + patch.row, column + patch.column) for row, column in zip(rows.tolist(), columns.tolist(), strict=True)]  # fmt: skip
    lat, lon = np.array(places).T
    patch.height_m[rows, columns] = coarser.interpolated_m(lat, lon).astype(np.float32)
