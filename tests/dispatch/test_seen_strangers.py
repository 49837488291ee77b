"""Strangers as a dispatcher sees them: what pads report, without its own drones, and not asked too often."""

from skyway.dispatch.dispatcher.seen_strangers import SeenStrangers, strangers_in
from skyway.missions.examples import NEW_YORK
from skyway.models.queues.pad_service import DroneOnPad, PadServiceError, StationStatus
from skyway.models.queues.seen_pads import NOTHING_SEEN
from skyway.models.scenario.file import read_scenario


def status(station, busy, waiting=0, ours=()):
    drones = tuple(DroneOnPad(drone=f"d{number}", state=state) for number, state in enumerate(ours))
    return StationStatus(station=station, posix_s=0.0, pads=5, busy=busy, remaining_s=(), waiting=waiting, holding_spots=3, holding_free=3, drones=drones)  # fmt: skip


class Reporting:
    """Pads that report two drones everywhere, but for one station that does not answer."""

    def __init__(self, silent):
        self.silent, self.asked = silent, 0

    def status(self, station):
        self.asked += 1
        if station == self.silent:
            raise PadServiceError("no answer")
        return status(station, 2)


def test_own_drones_are_no_strangers():
    assert strangers_in(status("a", 4, 2, ours=("charging", "waiting", "done", "absent"))) == 3
    assert strangers_in(status("a", 1, ours=("charging",))) == 0


def test_all_stations_are_asked_now_and_then_and_who_is_silent_is_not_seen():
    scenario = read_scenario(NEW_YORK)
    names = [one.id for one in scenario.network.stations if one.pads]
    pads = Reporting(names[0])
    strangers = SeenStrangers(scenario, pads)
    assert strangers.at(1000.0).busy == dict.fromkeys(names[1:], 2)
    assert strangers.at(1100.0) is strangers.at(1000.0)
    assert pads.asked == len(names)
    strangers.at(1400.0)
    assert pads.asked == 2 * len(names)
    assert SeenStrangers(scenario, None).at(0.0) is NOTHING_SEEN
