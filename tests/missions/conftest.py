"""Compositions for tests of missions."""

import pytest
import small_compositions


@pytest.fixture
def two_legs():
    """Two legs with a recharge between them, see `small_compositions.two_legs`."""
    return small_compositions.two_legs()
