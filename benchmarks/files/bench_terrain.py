"""How fast terrain is read: a tile of 1 degree at 1 arc second, whole and cut to a region, beside rasterio by the book.

The tile is made as Copernicus GLO-30 is published: float32, deflate, predictor 3, tiles of 1,024. By the book: `rasterio.open`, the window of
the bounds, `read(1)`. Each is the best of three; rasterio has read the file once before, so that both find it in memory.
"""

from __future__ import annotations

import tempfile
import time
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.tables.figure import Figure
from skyway.models.flight.clearance import Clearance
from skyway.models.flight.way_heights import Over, segment_heights
from skyway.models.terrain.files import read_terrain

if TYPE_CHECKING:
    from collections.abc import Callable

ROWS = 3600
NORTH, WEST = 47.0, 8.0
BOX = (46.3, 8.4, 46.6, 8.8)
"""South, west, north, east of the region wanted: 33 by 31 km."""
TARGET_S = 1.0


def measure() -> list[Figure]:
    """Read the tile whole and in part, and work out the heights of a network over it."""
    import rasterio
    from rasterio.windows import from_bounds

    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        path = Path(folder) / "Copernicus_DSM_COG_10_N46_00_E008_00_DEM.tif"
        _write(path, rasterio)

        def ours(rows: tuple[int, int], columns: tuple[int, int]) -> Any:
            return read_terrain([str(path)]).rasters[0].heights_m(rows, columns)

        def theirs(window: Any) -> Any:
            with rasterio.open(path) as file:
                return file.read(1, window=window)

        south, west, north, east = BOX
        with rasterio.open(path) as file:
            window = from_bounds(west, south, east, north, file.transform).round_offsets().round_lengths()
        rows = int(window.row_off), int(window.row_off + window.height)
        columns = int(window.col_off), int(window.col_off + window.width)
        assert np.array_equal(ours(rows, columns), theirs(window))
        whole, book = _best(lambda: ours((0, ROWS), (0, ROWS))), _best(lambda: theirs(None))
        part, book_part = _best(lambda: ours(rows, columns)), _best(lambda: theirs(window))
        terrain = read_terrain([str(path)])
        rng = np.random.default_rng(3)
        lat, lon = rng.uniform(south, north, 200), rng.uniform(west, east, 200)
        pairs = np.array([(a, b) for a in range(200) for b in range(200) if a != b])
        pairs = pairs[
            np.hypot(lat[pairs[:, 0]] - lat[pairs[:, 1]], 0.69 * (lon[pairs[:, 0]] - lon[pairs[:, 1]])) < 0.08
        ]
        began = time.perf_counter()
        segment_heights(lat, lon, terrain.ground_m(lat, lon), pairs, Over(terrain, Clearance(), 60.0))
        heights_s = time.perf_counter() - began
    return [
        Figure("tile of 1 degree at 30 m, whole", whole, target=TARGET_S),
        Figure("the same by rasterio", book),
        Figure("ratio, at most", whole / book, "", 2.0),
        Figure("its part of 33 by 31 km", part, target=TARGET_S),
        Figure("the same by rasterio", book_part),
        Figure("ratio, at most", part / book_part, "", 2.0),
        Figure(f"heights of {len(pairs):,} segments of 200 stations", heights_s, note="tile read, corridor, steps"),
    ]


def _write(path: Path, rasterio: Any) -> None:
    """Mountains with rough ground."""
    y, x = np.mgrid[:ROWS, :ROWS].astype(np.float32)
    rough = np.random.default_rng(1).normal(0.0, 1.5, (ROWS, ROWS)).astype(np.float32)
    values = 1500.0 + 700.0 * np.sin(x / 210.0) * np.cos(y / 170.0) + 60.0 * np.sin(x / 23.0 + y / 31.0) + rough
    step = 1.0 / ROWS
    transform = rasterio.transform.Affine(step, 0.0, WEST - step / 2, 0.0, -step, NORTH + step / 2)
    with rasterio.open(
        path, "w", driver="GTiff", height=ROWS, width=ROWS, count=1, dtype="float32", crs="EPSG:4326", transform=transform,
        compress="deflate", predictor=3, tiled=True, blockxsize=1024, blockysize=1024,
    ) as file:  # fmt: skip
        file.write(values.astype(np.float32), 1)


def _best(work: Callable[[], Any]) -> float:
    times = []
    for _ in range(3):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


if __name__ == "__main__":
    for figure in measure():
        print(figure.line())
