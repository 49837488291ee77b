"""Recently seen frames: distinguishes duplicates and echoes from new frames."""

from __future__ import annotations

_GENERATION_S = 0.4
"""A frame is remembered for one to two times this long. Heartbeats, which may be equal byte by byte, are a second apart."""
_MAX_FRAMES = 20_000


class SeenFrames:
    """Remembers frames for 0.4 to 0.8 s, in two generations."""

    def __init__(self) -> None:
        self._young: set[bytes] = set()
        self._old: set[bytes] = set()
        self._turned_s = -1e9

    def _turn(self, now_s: float) -> None:
        passed_s = now_s - self._turned_s
        if passed_s < _GENERATION_S and len(self._young) < _MAX_FRAMES:
            return
        self._old = self._young if passed_s < 2.0 * _GENERATION_S else set()
        self._young, self._turned_s = set(), now_s

    def holds(self, frame: bytes, now_s: float) -> bool:
        """Whether it was seen a moment ago."""
        self._turn(now_s)
        return frame in self._young or frame in self._old

    def fresh(self, frame: bytes, now_s: float) -> bool:
        """Remember it; returns whether it was not seen a moment ago."""
        if self.holds(frame, now_s):
            return False
        self._young.add(frame)
        return True
