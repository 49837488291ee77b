"""Seeded deliveries through faults: delivered, or safe on a station with a reason; none stranded, none crashed."""

import pytest

from benchmarks.supervision import tell


def check(seed, tmp_path):
    told = tell(seed, tmp_path, supervised=True)
    if told is None:
        pytest.skip("no plan for this request")
    assert not told.failed, told
    assert told.state in ("delivered", "stopped-safe"), told
    assert told.reason
    assert told.lowest_soc > 0.1, told


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(300))
def test_seeded_deliveries_end_safely(seed, tmp_path):
    check(seed, tmp_path)
