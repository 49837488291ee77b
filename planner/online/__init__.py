"""One online policy: what to do next on a delivery under way, on the ground and in the air."""
