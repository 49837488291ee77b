"""What every test of the link may rely on."""

import pytest


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    """Nobody else is there: a second and a half of listening for others at wall time is left out."""
    monkeypatch.setattr("skyway.link.telemetry.vehicle_monitor.ALONE_S", 0.0)
