"""Terrain models of arrays, for tests."""

import numpy as np

from skyway.models.terrain.obstacles import Obstacles
from skyway.models.terrain.raster import WGS84, Raster
from skyway.models.terrain.terrain import Terrain

NORTH, WEST = -35.0, 149.0


class Grid:
    """Heights in memory."""

    def __init__(self, values):
        self.values = np.asarray(values, dtype=np.float32)

    def read(self, rows, columns):
        """Read a window."""
        return self.values[slice(*rows), slice(*columns)].copy()


def terrain_of(values, step_deg=1 / 1200, obstacles=None):
    """A terrain model of heights, rows from north to south, with its north-west corner at (NORTH, WEST)."""
    values = np.asarray(values)
    raster = Raster("hills.tif", "array", *values.shape, (WEST, NORTH), (step_deg, -step_deg), WGS84, "node", "EGM96", 1.0, Grid(values), "float32")  # fmt: skip
    return Terrain([raster], obstacles or Obstacles(), ["hills.tif"])


def hills(seed, rows=160, columns=220, high_m=500.0):
    """Smooth random hills with rough ground, metres."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:rows, :columns]
    found = np.zeros((rows, columns))
    for _ in range(12):
        cy, cx, wide = rng.uniform(0, rows), rng.uniform(0, columns), rng.uniform(4.0, 40.0)
        found += rng.uniform(0.0, 1.0) * np.exp(-((y - cy) ** 2 + (x - cx) ** 2) / wide**2)
    return 200.0 + high_m * found / max(found.max(), 1e-9) + rng.normal(0.0, 2.0, found.shape)
