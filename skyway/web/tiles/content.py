"""Contents of a tile: a picture, or vectors as Mapbox Vector Tiles."""

from __future__ import annotations

from dataclasses import dataclass

MAX_ZOOM = 24
MAX_BYTES = 2 * 2**20
"""Of one tile, as it is kept."""
PICTURES, VECTORS = "pictures", "vectors"
_PICTURES = ((b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp"))
"""How a picture begins."""
_GZIP = b"\x1f\x8b"
_LAYER = 0x1A
"""How vectors begin that are not compressed: field 3, a layer."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A tile as a browser gets it."""

    media_type: str
    content: bytes
    encoding: str | None = None
    """Of HTTP, where it is compressed."""

    @property
    def kind(self) -> str:
        """``pictures`` or ``vectors``."""
        return PICTURES if self.media_type.startswith("image/") else VECTORS


def recognized(content: object) -> Tile | None:
    """Return a tile from what a file holds; None where it is neither a picture nor vectors, or too large."""
    if not isinstance(content, bytes) or not content or len(content) > MAX_BYTES:
        return None
    picture = next((kind for begin, kind in _PICTURES if content.startswith(begin)), None)
    if picture is not None:
        return Tile(picture, content)
    if content.startswith(_GZIP) or content[0] == _LAYER:
        encoding = "gzip" if content.startswith(_GZIP) else None
        return Tile("application/vnd.mapbox-vector-tile", content, encoding)
    return None


def on_map(zoom: int, column: int, row: int) -> bool:
    """Whether there is such a tile in the world."""
    return 0 <= zoom <= MAX_ZOOM and 0 <= column < 1 << zoom and 0 <= row < 1 << zoom
