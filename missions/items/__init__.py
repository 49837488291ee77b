"""Mission items, fences and rally points."""
