"""Observed winds: read as published or typed, and forecasts conditioned on them."""
