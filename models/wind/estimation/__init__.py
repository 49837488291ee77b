"""Wind estimated from what vehicles tell."""
