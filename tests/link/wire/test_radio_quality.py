"""Quality of radios: what is lost is counted by the numbers of packets, against a channel that is known to lose so much."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from wires import Scene

from skyway.link.vehicle.vehicle import Vehicle
from skyway.link.wire.messages import Message
from skyway.link.wire.radio_quality import RadioQuality
from skyway.sim_stub.transports.channel import Impairment


def frames(system=1, component=1, count=600):
    mav = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
    for _ in range(count):
        yield dialect.MAVLink_heartbeat_message(2, 12, 0, 0, 4, 3).pack(mav)
        mav.seq = (mav.seq + 1) % 256


@given(st.lists(st.booleans(), min_size=10, max_size=600))
def test_gaps_are_what_was_left_out_between_packets(kept):
    quality = RadioQuality("one")
    arrived = [number for number, here in enumerate(kept) if here]
    gaps = [after - before - 1 for before, after in itertools.pairwise(arrived)]
    for number, frame in enumerate(frames(count=len(kept))):
        if kept[number]:
            quality.count(frame, 0.01 * number)
    assert quality.received == len(arrived)
    assert quality.lost == sum(gap for gap in gaps if gap < 128)


def test_two_components_are_counted_apart():
    quality = RadioQuality("one")
    for first, second in zip(frames(), frames(component=236), strict=True):
        quality.count(first, 0.0)
        quality.count(second, 0.0)
    assert (quality.received, quality.lost) == (1200, 0)


@pytest.mark.parametrize("family", ["px4", "ardupilot"])
def test_loss_of_a_single_radio_is_measured(family):
    scene = Scene(family, impairment=Impairment(loss=0.2), seed=5)
    Vehicle(scene.connection, 1).request_telemetry()
    scene.connection.run_for(60.0)
    (quality,) = scene.connection.qualities
    assert quality.received > 1000
    assert quality.lost / (quality.lost + quality.received) == pytest.approx(0.2, abs=0.03)


def test_what_a_radio_tells_of_itself_is_shown_and_unknown_stays_unknown():
    quality = RadioQuality("/dev/ttyUSB0")
    fields = {"rssi": 180, "remrssi": 255, "txbuf": 100, "noise": 40, "remnoise": 255, "rxerrors": 0, "fixed": 0}
    quality.hear_status(Message("RADIO_STATUS", 51, 68, fields))
    assert (quality.signal, quality.noise, quality.remote_signal, quality.remote_noise) == (180, 40, None, None)
    assert "RSSI 180, noise 40" in str(quality)
    assert "vehicle" not in str(quality)
