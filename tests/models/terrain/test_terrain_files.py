"""Terrain files, refereed by rasterio (GDAL): pixels, places, voids, datums; and what is wrong with them."""

import gzip
import itertools
import shutil
import warnings
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.missions.examples import NEW_YORK
from skyway.models.base.errors import InputError
from skyway.models.terrain.contents import terrain_contents
from skyway.models.terrain.files import read_raster, read_terrain
from skyway.models.terrain.geoid import undulation_m

rasterio = pytest.importorskip("rasterio")
pytest.importorskip("rasterio.warp")
pytestmark = pytest.mark.filterwarnings(
    "ignore::PendingDeprecationWarning", "ignore::rasterio.errors.NotGeoreferencedWarning"
)
DATA = Path(__file__).parents[4] / "shared" / "data" / "terrain"
NOTHING = {"crs": "EPSG:4326"}


def written(
    path: Path, values: np.ndarray, *, west=149.0, north=-35.0, step=1 / 3600, crs="EPSG:4326", tags=None, **how
) -> Path:
    """A GeoTIFF as GDAL writes it."""
    transform = rasterio.transform.Affine(step, 0.0, west, 0.0, -step, north)
    profile = {"driver": "GTiff", "height": values.shape[0], "width": values.shape[1], "count": 1, "dtype": values.dtype, "crs": crs, "transform": transform}  # fmt: skip
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with rasterio.open(path, "w", **profile | how) as file:
            file.write(values, 1)
            file.update_tags(**(tags or {}))
    return path


def hills(rows: int, columns: int, seed: int = 1) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns]
    rough = np.random.default_rng(seed).normal(0.0, 3.0, (rows, columns))
    return 300.0 + 80.0 * np.sin(x / 9.0) * np.cos(y / 7.0) + rough


STORED = [
    *({"compress": c, "predictor": p, "dtype": d} for c, (d, p) in itertools.product(("deflate", "lzw"), (("int16", 1), ("int16", 2), ("uint16", 2), ("float32", 2), ("float32", 3), ("float64", 3), ("int32", 2)))),
    {"compress": None, "dtype": "int16"},
    {"compress": "packbits", "dtype": "int16"},
    {"compress": "deflate", "dtype": "uint8"},
]  # fmt: skip
LAID = [{"tiled": True, "blockxsize": 32, "blockysize": 16}, {"blockysize": 7}]
KINDS = [{}, {"BIGTIFF": "YES", "ENDIANNESS": "BIG"}]


def test_every_way_of_storing_is_read_as_gdal_reads_it(tmp_path):
    for number, (stored, laid, kind) in enumerate(itertools.product(STORED, LAID, KINDS)):
        how = {**stored, **laid, **kind}
        dtype = how.pop("dtype")
        path = written(tmp_path / f"{number}.tif", hills(61, 83).astype(dtype), **how)
        with rasterio.open(path) as file:
            expected = file.read(1).astype(np.float32)
        raster = read_raster(f"{path}")
        assert np.array_equal(raster.heights_m((0, 61), (0, 83)), expected), how
        assert np.array_equal(raster.heights_m((13, 40), (5, 37)), expected[13:40, 5:37]), how


def test_lzw_beyond_a_full_table_of_codes(tmp_path):
    noise = np.random.default_rng(0).integers(0, 9_000, (200, 300)).astype("int16")
    path = written(tmp_path / "noise.tif", noise, compress="lzw", tiled=True, blockxsize=256, blockysize=256)
    assert np.array_equal(read_raster(str(path)).heights_m((0, 200), (0, 300)), noise)


@pytest.mark.parametrize("point", ["Area", "Point"])
@pytest.mark.parametrize(("crs", "west", "north", "step"), [("EPSG:4326", 149.0, -35.0, 1 / 1200), ("EPSG:3035", 4_321_000.0, 3_210_000.0, 25.0), ("EPSG:32618", 583_000.0, 4_507_000.0, 30.0)])  # fmt: skip
def test_a_height_lies_where_gdal_says(tmp_path, point, crs, west, north, step):
    path = written(tmp_path / "dem.tif", hills(40, 50).astype("float32"), west=west, north=north, step=step, crs=crs, tags={"AREA_OR_POINT": point})  # fmt: skip
    raster = read_raster(str(path))
    assert raster.registration == ("node" if point == "Point" else "cell")
    with rasterio.open(path) as file:  # GDAL tells the middle of a pixel, whatever a pixel stands for
        x, y = file.xy(7, 31)
    lon, lat = rasterio.warp.transform(crs, "EPSG:4326", [x], [y])
    assert np.allclose(raster.at(lat, lon), [[7.0], [31.0]], atol=1e-5)
    assert np.allclose(raster.place(7, 31), (lat[0], lon[0]), atol=1e-9)


@pytest.mark.skipif(not DATA.exists(), reason="the shared data are not here")
def test_the_shared_tiles_are_read_as_gdal_reads_them(tmp_path):
    for name in ("canberra_srtm3_cog.tif", "sanfrancisco_elevation1.tif", "eudem_N2000000E3000000.tif"):
        with rasterio.open(DATA / name) as file:
            expected = file.read(1, masked=True).astype(np.float32).filled(np.nan)
        raster = read_raster(str(DATA / name))
        assert np.array_equal(raster.heights_m((0, raster.rows), (0, raster.columns)), expected, equal_nan=True)
    with zipfile.ZipFile(DATA / "S36E149.hgt.zip") as archive:
        archive.extractall(tmp_path)
    with rasterio.open(next(tmp_path.glob("*.hgt"))) as file:
        expected = file.read(1).astype(np.float32)
    for packed in (DATA / "S36E149.hgt.zip", next(tmp_path.glob("*.hgt"))):
        assert np.array_equal(read_raster(str(packed)).heights_m((0, 1201), (0, 1201)), expected)
    # heights that the READMEs of the missions tell
    terrain = read_terrain([str(DATA / "S36E149.hgt.zip"), str(DATA / "S28E151.hgt.zip")])
    for lat, lon, height in (
        (-35.363261, 149.165230, 584.85),
        (-35.28, 149.006, 579.6),
        (-27.274439, 151.290064, 343.0),
    ):
        assert terrain.ground_m(np.array([lat]), np.array([lon]))[0] == pytest.approx(height, abs=0.05)


@pytest.mark.parametrize(("rows", "columns"), [(1201, 1201), (3601, 1801)])
def test_hgt_packed_or_not_knows_voids_and_its_corner(tmp_path, rows, columns):
    values = np.arange(rows * columns, dtype=np.int64).reshape(rows, columns) % 900
    values[rows - 1, 0], values[5, 5] = 7, -32768
    plain = tmp_path / "N51W002.hgt"
    plain.write_bytes(values.astype(">i2").tobytes())
    with gzip.open(tmp_path / "N51W002.hgt.gz", "wb") as stream:
        stream.write(plain.read_bytes())
    with zipfile.ZipFile(tmp_path / "N51W002.SRTMGL1.hgt.zip", "w") as archive:
        archive.write(plain, "N51W002.hgt")
    for name in ("N51W002.hgt", "N51W002.hgt.gz", "N51W002.SRTMGL1.hgt.zip"):
        found = terrain_contents(str(tmp_path / name))
        assert (found.south, found.west, found.north, found.east) == pytest.approx((51.0, -2.0, 52.0, -1.0))
        assert (found.voids, found.datum, found.registration) == (1, "EGM96", "node")
        terrain = read_terrain([str(tmp_path / name)])
        assert (
            terrain.ground_m(np.array([51.0, 52.0 - 5.0 / (rows - 1)]), np.array([-2.0, -2.0 + 5.0 / (columns - 1)]))[0]
            == 7.0
        )


def test_tiles_side_by_side_are_one_ground_also_where_their_spacing_changes(tmp_path):
    """Copernicus GLO-30: cells about whole arc seconds, no shared edge, wider from 50 degrees on."""

    def plane(lat, lon):
        return 100.0 + 4_000.0 * (lat - 49.99) + 3_000.0 * (lon - 7.99)

    for name, north, west, step in (("N49E007", 50.0, 7.98, 1), ("N49E008", 50.0, 8.0, 1), ("N50E007", 50.02, 7.98, 1.5), ("N50E008", 50.02, 8.0, 1.5)):  # fmt: skip
        rows, columns = 72, round(0.02 * 3600 / step)
        lat = north - np.arange(rows) / 3600
        lon = west + np.arange(columns) * step / 3600
        transform = rasterio.transform.Affine(step / 3600, 0, west - step / 7200, 0, -1 / 3600, north + 1 / 7200)
        values = plane(lat[:, None], lon[None, :]).astype("float32")
        with rasterio.open(tmp_path / f"Copernicus_DSM_COG_10_{name}.tif", "w", driver="GTiff", height=rows, width=columns, count=1, dtype="float32", crs="EPSG:4326", transform=transform, compress="deflate", predictor=3) as file:  # fmt: skip
            file.write(values, 1)
    terrain = read_terrain([str(path) for path in sorted(tmp_path.glob("*.tif"))])
    assert {raster.datum for raster in terrain.rasters} == {"EGM2008"}
    lat, lon = (one.ravel() for one in np.meshgrid(np.linspace(49.981, 50.019, 60), np.linspace(7.981, 8.018, 60)))
    assert terrain.ground_m(lat, lon) == pytest.approx(plane(lat, lon), abs=0.05)


def test_tiles_meet_at_the_antimeridian(tmp_path):
    for west, base in ((179, 10), (-180, 20)):
        name = f"S17{'E' if west > 0 else 'W'}{abs(west):03d}.hgt"
        (tmp_path / name).write_bytes(np.full((1201, 1201), base, dtype=">i2").tobytes())
    terrain = read_terrain([str(path) for path in sorted(tmp_path.glob("*.hgt"))])
    assert terrain.ground_m(np.full(2, -16.5), np.array([179.99, -179.99])).tolist() == [10.0, 20.0]


@pytest.mark.parametrize(
    ("lat", "lon", "height_m"),
    [(38.628155, 269.779155, -31.628), (-14.621217, 305.021114, -2.969), (46.874319, 102.448729, -43.575),
     (-23.617446, 133.874712, 15.871), (38.625473, 359.9995, 50.066), (-0.466744, 0.0023, 17.329)],
)  # fmt: skip
def test_the_geoid_is_that_of_the_test_points_published_with_egm96(lat, lon, height_m):
    assert undulation_m(lat, lon) == pytest.approx(height_m, abs=0.15)


def test_heights_above_the_ellipsoid_and_in_feet_become_metres_above_the_sea(tmp_path):
    path = written(tmp_path / "dem.tif", np.full((40, 40), 200.0, dtype="float32"), west=149.1, north=-35.3)
    place = np.array([-35.305]), np.array([149.105])
    geoid_m = float(undulation_m(*place)[0])  # + 19 m at Canberra
    assert read_terrain([f"{path}@msl"]).ground_m(*place)[0] == pytest.approx(200.0)
    assert read_terrain([f"{path}@ellipsoid"]).ground_m(*place)[0] == pytest.approx(200.0 - geoid_m, abs=0.02)
    assert read_terrain([f"{path}@ellipsoid@ft"]).ground_m(*place)[0] == pytest.approx(60.96 - geoid_m, abs=0.02)
    assert "does not state its vertical datum" in read_terrain([str(path)]).notes[0]
    feet = written(
        tmp_path / "feet.tif", np.full((40, 40), 100.0, dtype="float32"), crs="EPSG:4326+6360"
    )  # NAVD88, US feet
    assert read_raster(str(feet)).unit_m == pytest.approx(0.3048006)
    above = written(tmp_path / "above.tif", np.full((40, 40), 100.0, dtype="float32"), crs="EPSG:4326+3855")
    assert read_raster(str(above)).datum == "EGM2008"
    with pytest.raises(InputError, match="counts from EGM2008 according to the file"):
        read_raster(f"{above}@ellipsoid")


@settings(max_examples=40)
@given(st.integers(0, 2**31), st.floats(0.0, 39.0), st.floats(0.0, 49.0))
def test_between_nodes_the_ground_is_bilinear(tmp_path_factory, seed, row, column):
    values = np.random.default_rng(seed).uniform(-50.0, 900.0, (40, 50)).astype("float32")
    path = tmp_path_factory.mktemp("dem") / "dem.tif"
    raster = read_raster(str(written(path, values, tags={"AREA_OR_POINT": "Point"})))
    lat, lon = raster.place(row, column)
    i, j = min(int(row), 38), min(int(column), 48)
    a, b = row - i, column - j
    four = values[i : i + 2, j : j + 2].astype(float)
    expected = (1 - a) * ((1 - b) * four[0, 0] + b * four[0, 1]) + a * ((1 - b) * four[1, 0] + b * four[1, 1])
    found = read_terrain([f"{path}@msl"]).ground_m(np.array([lat]), np.array([lon]))[0]
    assert found == pytest.approx(expected, abs=1e-2)


@settings(max_examples=25)
@given(st.integers(0, 2**31), st.floats(20.0, 400.0))
def test_the_highest_about_a_place_is_never_below_any_ground_within_the_radius(tmp_path_factory, seed, radius_m):
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("dem") / "dem.tif"
    terrain = read_terrain([f"{written(path, rng.uniform(0.0, 900.0, (60, 60)).astype('float32'))}@msl"])
    at = -35.0 - 30 / 3600, 149.0 + 30 / 3600
    radius_m = min(radius_m, 450.0)
    angle, reach = rng.uniform(0.0, 2 * np.pi, 300), radius_m * np.sqrt(rng.uniform(0.0, 1.0, 300))
    lat = at[0] + reach * np.cos(angle) / 110_950.0
    lon = at[1] + reach * np.sin(angle) / (111_320.0 * np.cos(np.radians(at[0])))
    top = terrain.top_m(np.array(at[:1]), np.array(at[1:]), radius_m)[0]
    assert top >= terrain.ground_m(lat, lon).max() - 1e-3
    wider = terrain.top_m(np.array(at[:1]), np.array(at[1:]), radius_m + 100.0)[0]
    assert np.isnan(wider) or wider >= top


def test_voids_are_never_heights(tmp_path):
    values = hills(40, 50).astype("int16")
    values[20, 20] = -32768
    path = written(tmp_path / "dem.tif", values, nodata=-32768, tags={"AREA_OR_POINT": "Point"})
    terrain, raster = read_terrain([f"{path}@msl"]), read_raster(str(path))
    places = np.array([raster.place(20.5, 20.5), raster.place(20, 21), raster.place(35, 40)]).T
    ground = terrain.ground_m(*places)
    assert np.isnan(ground[0])
    assert ground[1] == values[20, 21]  # on a node of its own
    assert np.isnan(terrain.top_m(*places, 60.0)[1])  # a void within the radius
    assert terrain.top_m(*places, 60.0)[2] > 0.0
    undeclared = values.copy()
    undeclared[20, 20], undeclared[30, 20] = -32767, -9999
    other = written(tmp_path / "other.tif", undeclared)  # no nodata: no ground is so low
    assert terrain_contents(str(other)).voids == 2
    coarse = written(
        tmp_path / "coarse.tif", np.full((30, 30), 77, dtype="int16"), step=1 / 1200, north=-34.999, west=148.999
    )
    filled = read_terrain([f"{path}@msl", f"{coarse}@msl"]).ground_m(*places)
    assert filled[0] == pytest.approx(
        (77.0 + sum(float(values[i, j]) for i, j in ((20, 21), (21, 20), (21, 21)))) / 4, abs=0.01
    )


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda p: p.write_bytes(p.read_bytes()[:900]), "truncated"),
        (lambda p: p.write_bytes(b"PNG" + p.read_bytes()), "is not a TIFF file; terrain is read from GeoTIFF"),
        (lambda p: p.write_bytes(b""), "truncated"),
        (lambda p: written(p, hills(9, 9).astype("float32"), crs=None), "position on the Earth"),
        (lambda p: written(p, hills(9, 9).astype("float32"), compress="zstd"), "ZSTD, which is not supported"),
        (lambda p: written(p, hills(9, 9).astype("float32"), west=-35.0, north=149.0), "latitude and longitude look swapped"),
        (lambda p: written(p, hills(9, 9).astype("float32"), step=0.05), "say nothing about the ground"),
        (lambda p: written(p, hills(9, 9).astype("complex64")), "of an unsupported type"),
        (lambda p: p.unlink(), "no such file"),
    ],
)  # fmt: skip
def test_what_cannot_be_read_is_said_in_one_line(tmp_path, spoil, expected):
    path = written(tmp_path / "dem.tif", hills(60, 60).astype("float32"), compress="deflate")
    spoil(path)
    with pytest.raises(InputError, match=expected) as caught:
        read_terrain([str(path)]).ground_m(np.array([-35.005]), np.array([149.005]))
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_truncated_or_misnamed_hgt_is_refused(tmp_path):
    (tmp_path / "N40W074.hgt").write_bytes(b"\0" * 1000)
    with pytest.raises(InputError, match="it is truncated"):
        read_raster(str(tmp_path / "N40W074.hgt"))
    (tmp_path / "hill.hgt").write_bytes(b"\0" * (2 * 1201 * 1201))
    with pytest.raises(InputError, match="by its south-west corner"):
        read_raster(str(tmp_path / "hill.hgt"))
    shutil.copy(tmp_path / "hill.hgt", tmp_path / "N40W074.hgt.zip")
    with pytest.raises(InputError, match="fetch it again"):
        read_raster(str(tmp_path / "N40W074.hgt.zip"))


def test_damaged_bytes_are_refused_or_read_and_never_a_traceback(tmp_path):
    sources = [
        written(tmp_path / "a.tif", hills(40, 50).astype("int16"), compress="lzw").read_bytes(),
        written(
            tmp_path / "b.tif", hills(40, 50).astype("float32"), compress="deflate", predictor=3, BIGTIFF="YES"
        ).read_bytes(),
    ]
    rng = np.random.default_rng(7)
    path = tmp_path / "damaged.tif"
    refused = 0
    for number in range(160):
        data = bytearray(sources[number % 2])
        for place in rng.integers(0, [64, 600, len(data)][number % 3], rng.integers(1, 8)):
            data[int(place)] = int(rng.choice([0, 1, 127, 255, rng.integers(256)]))
        path.write_bytes(data[: int(rng.integers(20, len(data)))] if number % 5 == 0 else data)
        try:
            terrain_contents(str(path))
        except InputError:
            refused += 1
    assert refused > 20


def test_a_geoid_of_ones_own_is_used_where_it_is_known_and_refused_where_it_is_not_needed(tmp_path):
    lat, lon = -35.0 - np.arange(61)[:, None] / 60.0, 149.0 + np.arange(61)[None, :] / 60.0
    geoid = written(tmp_path / "geoid.tif", (20.0 + 3.0 * (lat + 35.5) - 2.0 * (lon - 149.5)).astype("float32"), step=1 / 60, tags={"AREA_OR_POINT": "Point"}, west=149.0 - 0.5 / 60, north=-35.0 + 0.5 / 60)  # fmt: skip
    flat = np.full((40, 50), 200.0, dtype="float32")
    path = written(tmp_path / "dem.tif", flat, west=149.3, north=-35.3)
    place = np.array([-35.305]), np.array([149.306])
    here = 20.0 + 3.0 * (place[0] + 35.5) - 2.0 * (place[1] - 149.5)
    found = read_terrain([f"{path}@geoid={geoid}"])
    assert found.ground_m(*place) == pytest.approx(200.0 - here, abs=0.02)
    assert not found.notes
    away = written(tmp_path / "away.tif", flat, west=151.3, north=-35.3)
    assert np.isnan(read_terrain([f"{away}@geoid={geoid}"]).ground_m(np.array([-35.305]), np.array([151.306]))).all()
    with pytest.raises(InputError, match=r"no such file.*name a grid of the geoid"):
        read_raster(f"{path}@geoid={tmp_path / 'none.tif'}")
    with pytest.raises(InputError, match=r"counts from EGM96.*remove the geoid"):
        read_raster(f"{NEW_YORK.parent / 'hills' / 'terrain.tif'}@geoid={geoid}")
