"""What tests of planners share."""

import pytest

from skyway.missions.examples import NEW_YORK
from skyway.models.scenario.file import read_scenario


@pytest.fixture(scope="session")
def newyork():
    """The built-in scenario."""
    return read_scenario(NEW_YORK)
