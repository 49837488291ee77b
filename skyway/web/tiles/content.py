"""Contents of a tile: a picture, or vectors as Mapbox Vector Tiles."""

from __future__ import annotations

from dataclasses import dataclass

MAX_ZOOM = 24
MAX_BYTES = 2 * 2**20
"""Size limit of a stored tile."""
PICTURES, VECTORS = "pictures", "vectors"
_PICTURES = ((b"\x89PNG", "image/png"), (b"\xff\xd8\xff", "image/jpeg"), (b"RIFF", "image/webp"))
"""First bytes of a picture."""
_GZIP = b"\x1f\x8b"
_LAYER = 0x1A
"""First byte of uncompressed vectors: field 3, a layer."""


@dataclass(frozen=True, slots=True)
class Tile:
    """A tile in the form for a browser."""

    media_type: str
    content: bytes
    encoding: str | None = None
    """Content encoding of HTTP, if it is compressed."""

    @property
    def kind(self) -> str:
        """``pictures`` or ``vectors``."""
        return PICTURES if self.media_type.startswith("image/") else VECTORS


def recognized(content: object) -> Tile | None:
    """Return a tile from the contents of a file; None if it is neither a picture nor vectors, or too large."""
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
    """Whether such a tile exists in the world."""
    return 0 <= zoom <= MAX_ZOOM and 0 <= column < 1 << zoom and 0 <= row < 1 << zoom
