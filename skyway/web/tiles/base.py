"""The base map of a page: its extent, its tiles, and their source."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from skyway.models.base.errors import InputError
from skyway.web.tiles.content import PICTURES, VECTORS, Tile, on_map
from skyway.web.tiles.mbtiles import MBTiles
from skyway.web.tiles.pmtiles_file import PMTiles

if TYPE_CHECKING:
    from pathlib import Path

READERS: dict[str, type[MBTiles | PMTiles]] = {".mbtiles": MBTiles, ".pmtiles": PMTiles}
"""By the ending of the file."""
OWN = "/api/tile?z={z}&x={x}&y={y}"
PARTS = ("{z}", "{x}", "{y}")
SERVER_ZOOM = 19
"""Greatest zoom requested from a tile server; most have no more."""
VECTOR_ENDINGS = (".pbf", ".mvt")
_HOST = re.compile(r"(?:[a-z0-9](?:[a-z0-9-]*[a-z0-9])?)(?:\.[a-z0-9](?:[a-z0-9-]*[a-z0-9])?)*")


@dataclass(frozen=True, slots=True)
class BaseMap:
    """Source of a base map; with neither a file nor a server there is none.

    Attributes
    ----------
    file : Path or None
        MBTiles or PMTiles.
    server : str or None
        Address of tiles on another host, with ``{z}``, ``{x}`` and ``{y}``. Browsers ask it by themselves.
    attribution : str
        Attribution; empty means that of the file, or the name of the server.
    """

    file: Path | None = None
    server: str | None = None
    attribution: str = ""

    def checked(self) -> BaseMap:
        """Return the same, or raise an `InputError`."""
        if self.file is not None and self.server is not None:
            raise InputError("one base map is drawn", field="--tiles", remedy="remove --map or --tiles")
        self.about()
        return self

    @property
    def origin(self) -> str | None:
        """The other host that browsers may contact, in the form of a content security policy; None if there is none."""
        if self.server is None:
            return None
        address = _address(self.server)
        return f"{address.scheme}://{address.netloc}"

    @property
    def kind(self) -> str:
        """``pictures`` or ``vectors``; empty without a base map."""
        return str(self.about().get("kind", ""))

    def about(self) -> dict[str, Any]:
        """Return its extent: `low` and `high` zoom, `kind`, `url` of its tiles, and attribution; empty if there is none."""
        if self.server is not None:
            address = _address(self.server)
            kind = VECTORS if address.path.lower().endswith(VECTOR_ENDINGS) else PICTURES
            high = 14 if kind == VECTORS else SERVER_ZOOM
            told = self.attribution or f"tiles of {address.hostname}"
            return {"low": 0, "high": high, "attribution": told, "kind": kind, "url": self.server}
        if self.file is None:
            return {}
        found = _opened(self.file)
        told = self.attribution or re.sub(r"<[^>]*>", "", found.attribution)
        kind = found.first.kind if found.first is not None else PICTURES
        return {"low": found.low, "high": found.high, "attribution": told, "kind": kind, "url": OWN}

    def tile(self, zoom: int, column: int, row: int) -> Tile | None:
        """Return a tile of the file, rows counted from the north; None if there is none."""
        return (
            None if self.file is None or not on_map(zoom, column, row) else _opened(self.file).tile(zoom, column, row)
        )


def _address(server: str) -> Any:
    """Return the parts of a server's address; an `InputError` describes its problem."""
    remedy = "such as https://tiles.example.org/{z}/{x}/{y}.png"
    try:
        address = urlsplit(server)
        host, _ = (address.hostname or "").lower(), address.port
    except ValueError as error:
        raise InputError(f"is not an address: {error}", field="--tiles", value=server, remedy=remedy) from error
    rest = address.path + address.query
    wrong = (
        address.scheme not in {"http", "https"} or address.username is not None or not _HOST.fullmatch(host)
        or any(rest.count(part) != 1 for part in PARTS) or re.search(r"\s", server) is not None
    )  # fmt: skip
    if wrong:
        raise InputError("is not an address of tiles", field="--tiles", value=server, remedy=remedy)
    return address


@lru_cache(maxsize=4)
def _opened(file: Path) -> MBTiles | PMTiles:
    if not file.is_file():
        raise InputError("no such file", str(file), field="--map")
    reader = READERS.get(file.suffix.lower())
    if reader is None:
        raise InputError("is not a base map", str(file), field="--map", remedy=f"a file {' or '.join(READERS)}")
    found = reader(file)
    if found.first is None:
        remedy = "tiles of PNG, JPEG or WebP, or of vectors (MVT)"
        raise InputError("has tiles that are neither pictures nor vectors", str(file), field="--map", remedy=remedy)
    return found
