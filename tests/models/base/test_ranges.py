"""What a number out of range may mean in another unit is itself in range."""

import re

from hypothesis import given
from hypothesis import strategies as st

from skyway.models.base.ranges import fraction_faults, percent_faults

HIGH = st.sampled_from([0.5, 0.95, 1.0])


def hinted(faults):
    found = re.search(r"did you mean (?:--soc )?([-+.e0-9]+)\?", str(faults[0].remedy)) if faults else None
    return None if found is None else float(found[1])


@given(st.one_of(st.floats(-10.0, 200.0), st.floats(1e-5, 0.01)), HIGH)
def test_what_is_hinted_at_for_a_fraction_is_taken(value, high):
    faults = fraction_faults("soc", value, high, "--soc", least=0.01)
    meant = hinted(faults)
    assert bool(faults) == (not (value == 0.0 or 0.01 <= value <= high))
    assert meant is None or not fraction_faults("soc", meant, high, "--soc")
    assert (meant is not None) == (1.0 < value <= 100.0 * high or 0.0 < value < 0.01)


@given(st.floats(-10.0, 200.0), HIGH)
def test_what_is_hinted_at_for_percent_is_taken(value, high):
    faults = percent_faults("--soc", value, 100.0 * high)
    meant = hinted(faults)
    assert bool(faults) == (not (value == 0.0 or 1.0 < value <= 100.0 * high))
    assert meant is None or 0.0 <= meant <= 100.0 * high
    assert (meant is not None) == (0.0 < value <= 1.0)
