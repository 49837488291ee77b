"""Who is before a drone at a station, and who came after it."""

import pytest

from skyway.models.queues.pad_service import DroneOnPad, StationStatus


def told(busy, waiting, *drones):
    return StationStatus(
        station="bellevue", posix_s=0.0, pads=2, busy=busy, remaining_s=(), waiting=waiting, holding_spots=5, holding_free=5 - waiting,
        drones=drones,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("status", "before", "behind"),
    [
        (told(2, 3), 5, 0),
        (told(2, 3, DroneOnPad(drone="8", state="charging")), 5, 0),
        (told(2, 3, DroneOnPad(drone="7", state="absent")), 5, 0),
        (told(2, 3, DroneOnPad(drone="7", state="charging", soc=0.4)), 1, 3),
        (told(2, 0, DroneOnPad(drone="7", state="done", soc=1.0)), 1, 0),
        (told(2, 3, DroneOnPad(drone="7", state="waiting", place_in_line=0)), 2, 2),
        (told(2, 3, DroneOnPad(drone="7", state="waiting", place_in_line=2)), 4, 0),
    ],
)
def test_a_drone_does_not_stand_in_its_own_way(status, before, behind):
    assert status.others("7") == (before, behind)
