"""The order of a mission's independent parts: what may be moved, which order ends first, and where its pictures are."""
