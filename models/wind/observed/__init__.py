"""Observed winds: read as published or typed, and a forecast conditioned on them."""
