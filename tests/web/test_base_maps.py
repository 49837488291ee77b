"""Base maps: files of the operator read as they were written by others, damaged ones refused, and another host only where it is named."""

from __future__ import annotations

import contextlib
import gzip
import http.server
import sqlite3
import struct
import threading
import zlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from skyway.cli.main import main
from skyway.models.base.errors import InputError
from skyway.web.guard import Guard
from skyway.web.tiles.base import BaseMap
from skyway.web.tiles.content import MAX_BYTES
from tests.web.browsing import chromium, person
from tests.web.conftest import ended, served

PICTURE = b"\x89PNG rest"
VECTORS = gzip.compress(b"\x1a\x00", mtime=0)
PLACE = (3, 2, 2)


def mbtiles(path, content):
    with contextlib.closing(sqlite3.connect(path)) as base:
        base.execute("CREATE TABLE metadata (name text, value text)")
        base.execute("INSERT INTO metadata VALUES ('attribution', '<b>me</b>')")
        base.execute("CREATE TABLE tiles (zoom_level integer, tile_column integer, tile_row integer, tile_data blob)")
        base.execute("INSERT INTO tiles VALUES (3, 2, 5, ?)", (content,))  # rows count from the south
        base.commit()
    return path


def pmtiles(path, content, more=0, **header):
    """Write a file as its package does; with many tiles it has directories within directories."""
    pytest.importorskip("pmtiles", reason="needs the extra web")
    from pmtiles.tile import Compression, TileType, zxy_to_tileid
    from pmtiles.writer import Writer

    first = zxy_to_tileid(*PLACE)
    with path.open("wb") as file:
        writer = Writer(file)
        writer.write_tile(first, content)
        for n in range(1, more + 1):
            writer.write_tile(first + 2 * n, content + str(n).encode())
        writer.finalize(
            {"tile_type": TileType.PNG, "tile_compression": Compression.NONE, "center_zoom": 3, "center_lon_e7": 0, "center_lat_e7": 0,
             "min_lon_e7": 0, "min_lat_e7": 0, "max_lon_e7": 0, "max_lat_e7": 0} | header,
            {"attribution": "<b>me</b>"},
        )  # fmt: skip
    return path


@pytest.mark.parametrize("write", [mbtiles, pmtiles])
@pytest.mark.parametrize(
    ("content", "kind", "media_type", "encoding"),
    [
        (PICTURE, "pictures", "image/png", None),
        (VECTORS, "vectors", "application/vnd.mapbox-vector-tile", "gzip"),
        (b"\x1a\x00", "vectors", "application/vnd.mapbox-vector-tile", None),
    ],
    ids=["picture", "packed", "plain"],
)
def test_a_file_says_what_it_covers_and_gives_its_tiles_rows_from_the_north(
    tmp_path, write, content, kind, media_type, encoding
):
    base = BaseMap(write(tmp_path / f"a.{write.__name__}", content)).checked()
    told = base.about()
    assert (told["low"], told["high"], told["kind"], told["attribution"]) == (3, 3, kind, "me")
    assert base.origin is None
    found = base.tile(*PLACE)
    assert (found.content, found.media_type, found.encoding) == (content, media_type, encoding)
    for nowhere in ((3, 2, 5), (3, -1, 2), (3, 8, 2), (99, 0, 0), (-1, 0, 0)):
        assert base.tile(*nowhere) is None


def test_a_large_file_has_directories_within_directories(tmp_path):
    from pmtiles.tile import tileid_to_zxy, zxy_to_tileid

    base = BaseMap(pmtiles(tmp_path / "a.pmtiles", PICTURE, more=20_000))
    first = zxy_to_tileid(*PLACE)
    for n in (0, 1, 7_777, 20_000):
        assert base.tile(*tileid_to_zxy(first + 2 * n)).content == PICTURE + (str(n).encode() if n else b"")
    assert base.tile(*tileid_to_zxy(first + 3)) is None


def test_what_is_no_base_map_is_refused_with_its_reason(tmp_path):
    from pmtiles.tile import Compression

    for ending in ("mbtiles", "pmtiles"):
        (tmp_path / f"b.{ending}").write_bytes(b"nonsense")
        (tmp_path / f"e.{ending}").write_bytes(b"")
    refused = {
        tmp_path / "b.mbtiles": "is not an MBTiles file", tmp_path / "b.pmtiles": "is not a PMTiles file", tmp_path / "e.pmtiles": "is not a PMTiles file",
        tmp_path / "none.pmtiles": "no such file", tmp_path: "no such file", mbtiles(tmp_path / "c.mbtiles", b"text"): "neither pictures nor",
        pmtiles(tmp_path / "c.pmtiles", b"text"): "neither pictures nor", mbtiles(tmp_path / "l.mbtiles", PICTURE + bytes(MAX_BYTES)): "neither",
        pmtiles(tmp_path / "z.pmtiles", PICTURE, tile_compression=Compression.ZSTD): "compressed in a way",
    }  # fmt: skip
    for path, why in refused.items():
        with pytest.raises(InputError, match=why):
            BaseMap(path).checked()
    (tmp_path / "a.png").write_bytes(PICTURE)
    with pytest.raises(InputError, match="is not a base map"):
        BaseMap(tmp_path / "a.png").checked()
    assert main(["serve", "--map", str(tmp_path / "b.pmtiles")]) == 2


def test_a_directory_that_unpacks_without_end_is_refused(tmp_path):
    path = pmtiles(tmp_path / "a.pmtiles", PICTURE)
    content = bytearray(path.read_bytes())
    bomb = gzip.compress(bytes(8 * 2**20))
    offset = len(content)
    content[8:24] = offset.to_bytes(8, "little") + len(bomb).to_bytes(8, "little")  # where the root directory is
    path.write_bytes(bytes(content) + bomb)
    with pytest.raises(InputError, match="larger than it may be"):
        BaseMap(path).checked()


@settings(max_examples=60)
@given(at=st.integers(0, 400), byte=st.integers(0, 255), cut=st.integers(0, 50))
def test_a_damaged_file_is_refused_or_has_no_tile_there(tmp_path_factory, at, byte, cut):
    path = pmtiles(tmp_path_factory.mktemp("damaged") / "a.pmtiles", PICTURE)
    content = bytearray(path.read_bytes())
    content[at % len(content)] = byte
    path.write_bytes(bytes(content[: len(content) - cut]))
    try:
        found = BaseMap(path).checked().tile(*PLACE)
    except InputError:
        return
    assert found is None or found.content


@pytest.mark.parametrize(
    ("server", "origin", "kind"),
    [
        ("https://tiles.example.org/{z}/{x}/{y}.png", "https://tiles.example.org", "pictures"),
        ("http://localhost:9000/t/{z}/{x}/{y}.pbf?key=a", "http://localhost:9000", "vectors"),
        ("https://example.org/t?z={z}&x={x}&y={y}", "https://example.org", "pictures"),
    ],
)
def test_a_tile_server_that_is_named_is_the_only_other_host_that_a_browser_may_ask(server, origin, kind):
    base = BaseMap(server=server).checked()
    assert (base.origin, base.kind, base.about()["url"]) == (origin, kind, server)
    assert base.tile(*PLACE) is None
    policy = dict(part.strip().split(" ", 1) for part in _policy(base).split(";"))
    directive = "img-src" if kind == "pictures" else "connect-src"
    assert policy.pop(directive).split()[-1] == origin
    assert not any("//" in sources for sources in policy.values())
    assert "//" not in _policy(BaseMap())


def _policy(base):
    import asyncio

    async def app(scope, receive, send):
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    sent = []

    async def send(message):
        sent.append(message)

    scope = {"type": "http", "method": "GET", "path": "/", "headers": [(b"host", b"127.0.0.1:8080")]}
    asyncio.run(Guard(app, tiles=base)(scope, None, send))
    return dict(sent[0]["headers"])[b"content-security-policy"].decode()


@pytest.mark.parametrize(
    "server",
    [
        "tiles.example.org/{z}/{x}/{y}.png", "ftp://example.org/{z}/{x}/{y}", "https://example.org/{z}/{x}.png", "https://example.org/{z}/{x}/{y}/{y}",
        "https://me:secret@example.org/{z}/{x}/{y}", "https://example.org;script-src */{z}/{x}/{y}", "https://*/{z}/{x}/{y}", "https:///{z}/{x}/{y}",
        "https://example.org:port/{z}/{x}/{y}", "https://exa mple.org/{z}/{x}/{y}", "javascript:alert(1)//{z}{x}{y}", "https://e.org'/{z}/{x}/{y}",
    ],
)  # fmt: skip
def test_an_address_that_is_none_or_would_widen_the_policy_is_refused(server):
    with pytest.raises(InputError, match="is not an address"):
        BaseMap(server=server).checked()


def test_one_base_map_is_drawn(tmp_path):
    with pytest.raises(InputError, match="one base map"):
        BaseMap(mbtiles(tmp_path / "a.mbtiles", PICTURE), "https://example.org/{z}/{x}/{y}.png").checked()


# In a browser


def _varint(number):
    found = b""
    while number > 127:
        found, number = found + bytes([number & 127 | 128]), number >> 7
    return found + bytes([number])


def _field(number, content):
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def vector_tile(name, kind, commands, extent=4096):
    """One layer with one feature: `kind` is 2 for lines and 3 for areas, `commands` pairs of a command and its moves."""
    words = b""
    for command, moves in commands:
        words += _varint(command | (len(moves) or 1) << 3)
        words += b"".join(_varint((v << 1) ^ (v >> 31)) for move in moves for v in move)
    feature = _varint(3 << 3) + _varint(kind) + _field(4, words)
    layer = (
        _varint(15 << 3) + b"\x02" + _field(1, name.encode()) + _field(2, feature) + _varint(5 << 3) + _varint(extent)
    )
    return _field(3, layer)


def named_tile(layer_name, places, extent=4096):
    """One layer with points: name, class and place of each."""
    keys = _field(3, b"name") + _field(3, b"class")
    values, features = b"", b""
    for number, (name, kind, x, y) in enumerate(places):
        values += _field(4, _field(1, name.encode())) + _field(4, _field(1, kind.encode()))
        tags = _varint(0) + _varint(2 * number) + _varint(1) + _varint(2 * number + 1)
        shape = b"".join(_varint(one) for one in (9, (x << 1) ^ (x >> 31), (y << 1) ^ (y >> 31)))
        features += _field(2, _field(2, tags) + _varint(3 << 3) + _varint(1) + _field(4, shape))
    head = _varint(15 << 3) + b"\x02" + _field(1, layer_name.encode())
    return _field(3, head + features + keys + values + _varint(5 << 3) + _varint(extent))


def picture(red, green, blue):
    """A picture of one colour."""
    rows = b"".join(b"\0" + bytes((red, green, blue)) * 16 for _ in range(16))

    def chunk(name, content):
        return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))

    head = struct.pack(">IIBBBBB", 16, 16, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b"")


SEE = """async ([lat, lon]) => { const m = window.skywayMap; m.state = { ...m.state, region: null, wind: null }; m.view.zoom = 5;
  const e = 256; m.view.cx = (lon / 360 + 0.5) * e; const s = Math.sin(lat * Math.PI / 180);
  m.view.cy = (0.5 - Math.log((1 + s) / (1 - s)) / (4 * Math.PI)) * e; m.changed(); }"""


def colour_around(tab, lat, lon):
    """The most frequent colour around a place: lines of the graticule cross it."""
    script = """([lat, lon]) => { const m = window.skywayMap; const [x, y] = m.view.toScreen(lat, lon); const r = window.devicePixelRatio;
      const data = m.context.getImageData(Math.round(x * r) - 20, Math.round(y * r) - 20, 40, 40).data; const counts = {};
      for (let i = 0; i < data.length; i += 4) { const key = [...data.slice(i, i + 3)]; counts[key] = (counts[key] || 0) + 1; }
      return Object.entries(counts).sort((a, b) => b[1] - a[1])[0][0].split(",").map(Number); }"""
    return tuple(tab.evaluate(script, [lat, lon]))


@pytest.mark.slow
def test_vectors_of_a_file_are_drawn_in_the_colours_of_the_page(tmp_path):
    west = [(1, [(0, 0)]), (2, [(2048, 0), (0, 4096), (-2048, 0)]), (7, [])]  # the western half is water
    base = pmtiles(tmp_path / "a.pmtiles", gzip.compress(vector_tile("water", 3, west)))
    page = served(tmp_path, "--map", str(base))
    try:
        with chromium() as browser, person(browser, page.address, "/", minds=False) as tab:
            tab.wait_for_function("window.skywayMap?.state.base?.kind === 'vectors' && window.skywayMap.state.region")
            for scheme in ("light", "dark"):
                tab.emulate_media(color_scheme=scheme)
                tab.evaluate(SEE, [55.0, -67.5])
                tab.wait_for_function("[...window.skywayMap.tiles.known.values()].some((one) => one.image)")
                tab.wait_for_timeout(200)
                water, land = (
                    tuple(int(tab.evaluate(f"window.skywayMap.colours.{name}")[i : i + 2], 16) for i in (1, 3, 5))
                    for name in ("water", "land")
                )
                assert water != land
                assert colour_around(tab, 56.3, -80.0) == water
                assert colour_around(tab, 56.3, -55.0) == land
    finally:
        ended(page)


@pytest.mark.slow
def test_names_of_places_are_told_the_greater_first_and_each_once(tmp_path):
    places = [
        ("Hamlet", "village", 100, 3000),
        ("<img src=x onerror=alert(1)>", "city", 2048, 2048),
        ("Beside", "city", 5000, 10),
    ]
    tile = named_tile("place", places) + named_tile("water_name", [("L" * 4000, "lake", 3000, 1000)])
    base = pmtiles(tmp_path / "a.pmtiles", gzip.compress(tile))
    page = served(tmp_path, "--map", str(base))
    try:
        with chromium() as browser, person(browser, page.address, "/", minds=False) as tab:
            tab.wait_for_function("window.skywayMap?.state.base?.kind === 'vectors' && window.skywayMap.state.region")
            tab.evaluate(SEE, [55.0, -67.5])
            tab.wait_for_function("window.skywayMap.tiles.names.length > 0")
            found = tab.evaluate("window.skywayMap.tiles.names.map((one) => [one.name, one.place])")
            assert [name for name, _ in found] == [places[1][0], "L" * 48, "Hamlet"]
            assert found[0][1] == pytest.approx([(PLACE[1] + 0.5) * 32.0, (PLACE[2] + 0.5) * 32.0])
            tab.evaluate(
                "window.skywayMap.view.zoomAt(640, 300, 2)"
            )  # a finer tile is not there: the coarser one tells its names once
            tab.evaluate("window.skywayMap.changed()")
            tab.wait_for_timeout(300)
            assert len(tab.evaluate("window.skywayMap.tiles.names")) <= 3
    finally:
        ended(page)


@pytest.mark.slow
def test_tiles_of_another_host_are_shown_where_it_is_named(tmp_path):
    asked, referrers = [], set()

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            referrers.add(self.headers["Referer"])
            self.send_response(200)
            self.send_header("Content-Type", "image/png")
            self.end_headers()
            self.wfile.write(picture(10, 200, 30))

        def log_message(self, *_):
            pass

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        host = f"http://127.0.0.1:{server.server_port}"
        page = served(tmp_path, "--tiles", f"{host}/t/{{z}}/{{x}}/{{y}}.png", "--attribution", "(c) me")
        try:
            with (
                chromium() as browser,
                person(browser, page.address, "/?start=bellevue", minds=False, also=host) as tab,
            ):
                tab.wait_for_function("window.skywayMap?.state.base?.url && window.skywayMap.state.region")
                tab.wait_for_function("[...window.skywayMap.tiles.known.values()].some((one) => one.image)")
                tab.wait_for_timeout(300)
                # the picture taints the canvas: another host's pixels cannot be read back, so what was asked for is what is judged
                assert tab.evaluate("window.skywayMap.state.base.attribution") == "(c) me"
                refused = tab.evaluate(
                    "fetch('http://127.0.0.1:9/').then(() => 'fetched', () => 'refused')"
                )  # the policy names one host
                assert refused == "refused"
        finally:
            ended(page)
            server.shutdown()
    assert asked
    assert all(path.startswith("/t/") for path in asked)
    assert referrers == {f"{page.address}/"}  # the page, and nothing of its question
