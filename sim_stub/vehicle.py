"""One simulated vehicle: airframe, battery, autopilot, and its protocols."""

from __future__ import annotations

import math
import random
from typing import TYPE_CHECKING, NamedTuple

from skyway.models.base.errors import Fault as Wrong
from skyway.models.base.errors import InputError
from skyway.models.base.formatting import percent, place_text
from skyway.sim_stub import fault_effects as mishaps
from skyway.sim_stub.autopilot.registry import FAMILIES
from skyway.sim_stub.faults import FaultState
from skyway.sim_stub.plant.battery import Battery
from skyway.sim_stub.plant.physics import FINE_STEP_S, STEP_S, Body, Demand, offset_m
from skyway.sim_stub.plant.positioning import Positioning
from skyway.sim_stub.plant.power import PowerModel
from skyway.sim_stub.plant.winch import Winch
from skyway.sim_stub.plant.wind_truth import Gusts
from skyway.sim_stub.protocols.commands import CommandServer
from skyway.sim_stub.protocols.parameters import ParameterServer
from skyway.sim_stub.protocols.remote_id import RemoteIdModule
from skyway.sim_stub.protocols.services import LinkServices
from skyway.sim_stub.radio import Radio
from skyway.sim_stub.storage.card import Card, filler
from skyway.sim_stub.storage.flight_log import FlightLog
from skyway.sim_stub.storage.ftp import FtpServer
from skyway.sim_stub.storage.log_requests import LogServer

if TYPE_CHECKING:
    from skyway.sim_stub.autopilot.base import Autopilot
    from skyway.sim_stub.config import VehicleConfig
    from skyway.sim_stub.wire.ports import Port
    from skyway.sim_stub.world import World

_POWER_ERROR = 0.05
_IDLE_ARMED_W = 90.0
_AVIONICS_W = 15.0
_HOUSEKEEPING_S, _HOUSEKEEPING_ALONE_S = 1.0, 60.0
"""How often a vehicle that stands is looked after; and where nobody speaks with it."""
_WARM_S = 120.0
_REBOOT_DELAY_S = 0.2
_AT_STATION_M = 60.0


class Charge(NamedTuple):
    """Charging under way: its target, and the maximum power of the pad."""

    to_soc: float
    pad_power_w: float | None = None


class Vehicle:
    """One vehicle; `receive` takes bytes, ports take its packets, `advance` lets time pass."""

    def __init__(self, config: VehicleConfig, world: World) -> None:
        self.config, self.world = config, world
        self.airframe = config.airframe
        generator = random.Random(f"{config.seed}/{config.system}")  # noqa: S311  not for secrets
        error = 1.0 + generator.uniform(-_POWER_ERROR, _POWER_ERROR)
        self.power = PowerModel.of(self.airframe, config.power_error or error)
        self._wind_bias = (generator.gauss(0.0, 0.2), generator.gauss(0.0, 0.2))
        self.gusts = Gusts(generator)
        self._mishap_rad = generator.uniform(0.0, 2.0 * math.pi)
        self.body = Body(self.airframe, config.lat, config.lon, config.ground_m, config.payload_kg)
        self.battery = Battery.of(self.airframe.drone, config.soc)
        self.winch = Winch()
        self.faults = FaultState.of(world.faults, config.system)
        self.sim_s, self.wall_s = world.sim_s, world.wall_s
        self.stepped_s = self.tended_s = self.sim_s
        self.power_on_s = self.sim_s - (_WARM_S if config.warm else 0.0)
        self.reboot_at_s = math.inf
        self.counted_mah = 0.0
        self.ground_m = config.ground_m
        self.origin = (config.lat, config.lon, config.ground_m)
        self.charging: Charge | None = None
        self.ground_heard: dict[int, float] = {}
        self.mission_ids = [0, 0, 0]
        self._wind_mean = (0.0, 0.0)
        self._wind_now = (0.0, 0.0)
        self._wind_s = -math.inf
        self.step_s = config.step_s
        self.rests_until_s = -math.inf
        """Nothing happens to it until then, for nobody speaks with it; in the past where that is not known."""
        self._was_booting = not config.warm
        self.radio = Radio(self)
        family = FAMILIES[config.autopilot]
        self.position = Positioning(self.body, self._mishap_rad, family.GLITCH_PATIENCE_S)
        self.autopilot: Autopilot = family(self)
        for name in self.autopilot.SYSTEM_PARAMETERS:  # whichever this version has
            self.autopilot.parameters.set(name, float(config.system))
        for name, value in config.parameters:
            if not self.autopilot.parameters.set(name, value):
                raise InputError(Wrong("no such parameter, or not a number", field=name, value=value))
        if config.warm:
            self.autopilot.count_charge(config.soc)
        self.autopilot.home = self.autopilot.here
        self.card = self._card_of(config)
        self.flight_log: FlightLog | None = None
        if config.log_room_bytes:
            self.flight_log = FlightLog(self, self.autopilot.LOG_FORMAT(), config.log_room_bytes)
        self._make_services()

    def _card_of(self, config: VehicleConfig) -> Card:
        """The card, with logs of flights before."""
        card, pilot = Card(), self.autopilot
        for folder in pilot.CARD_FOLDERS:
            card.put(f"{folder}/x", b"")
            del card.files[f"{folder}/x"]
        for number, size in enumerate(config.logs):
            written_s = int(self.posix_s) - 3600 * (len(config.logs) - number)
            content = filler(size, pilot.LOG_HEAD, f"{config.seed}/{config.system}/{number}")
            card.put(pilot.log_path(number + 1, written_s), content, written_s)
        return card

    def _make_services(self) -> None:
        self.missions = self.autopilot.MISSION_SERVER(self)
        self.commands: CommandServer = CommandServer(self)
        self.parameter_server = ParameterServer(self)
        self.services = LinkServices(self)
        self.remote_id = RemoteIdModule(self)
        self.ftp, self.log_server = FtpServer(self), LogServer(self)
        self._timed = (self.missions, self.commands, self.parameter_server, self.ftp, self.log_server)
        for part in (*self._timed, self.services, self.remote_id):
            self.radio.serve(part.handlers())

    # Time

    @property
    def since_boot_s(self) -> float:
        """Seconds since the autopilot has come up; negative while it boots."""
        return self.sim_s - self.power_on_s - self.autopilot.BOOT_S

    @property
    def boot_ms(self) -> int:
        """Milliseconds since power-on, as the wire counts them."""
        return int((self.sim_s - self.power_on_s) * 1000.0) & 0xFFFFFFFF

    @property
    def boot_us(self) -> int:
        """Microseconds since power-on."""
        return int((self.sim_s - self.power_on_s) * 1e6)

    @property
    def posix_s(self) -> float:
        """POSIX seconds of the simulated instant."""
        return self.world.epoch_s + self.sim_s

    @property
    def active(self) -> bool:
        """Whether physics has to be stepped."""
        return self.autopilot.armed or not self.body.grounded

    def next_due_s(self) -> float:
        """Simulated instant of the next scheduled event."""
        if self.active:
            return self.stepped_s + self.step_s
        alone = not self.radio.ports and self.flight_log is None
        due = self.tended_s + (_HOUSEKEEPING_ALONE_S if alone else _HOUSEKEEPING_S)
        due = min(due, self.faults.next_change_s, self.reboot_at_s)
        due = min(due, self.position.next_change_s)
        if self._was_booting:
            return min(due, self.power_on_s + self.autopilot.BOOT_S)
        return max(min(due, self.radio.next_due_s()), self.sim_s)

    def next_wall_s(self) -> float:
        """Wall instant at which a protocol timer runs out."""
        return min(part.next_wall_s() for part in self._timed)

    def advance(self, sim_s: float, wall_s: float) -> None:
        """Advance the time: everything due up to an instant happens in order."""
        self.wall_s = wall_s
        if self.rests_until_s > sim_s:
            self.sim_s = sim_s
            return
        while (due := self.next_due_s()) <= sim_s:
            self.sim_s = due
            self._happen(due)
        self.sim_s = max(self.sim_s, sim_s)
        if not self._was_booting:
            for part in self._timed:
                if part.next_wall_s() <= wall_s:
                    part.tick()
        rests = not (self.active or self.radio.ports or self._was_booting) and self.next_wall_s() == math.inf
        self.rests_until_s = self.next_due_s() if rests else -math.inf

    def wake(self) -> None:
        """Look again when something happens to it next: somebody speaks with it, or something was done to it."""
        self.rests_until_s = -math.inf

    def _happen(self, now: float) -> None:
        """Do everything that is due now."""
        if self.faults.next_change_s <= now:
            mishaps.change(self, now)
            self._wind_s = -math.inf
        if self.position.next_change_s <= now:
            mishaps.locate(self)
        if self.reboot_at_s <= now:
            self._reboot()
        if self.active:
            if now >= self.stepped_s + self.step_s - 1e-9:
                self._step(now)
        elif now - self.tended_s >= _HOUSEKEEPING_S - 1e-9:
            self.tend()
            self.autopilot.failsafes.check(self.autopilot)
            if self.flight_log is not None:
                self.flight_log.step()
        if self._was_booting:
            if now < self.power_on_s + self.autopilot.BOOT_S:
                return
            self._was_booting = False
            self.event("autopilot is up")
        self.radio.send_due(now)

    def _step(self, now: float) -> None:
        """One step of physics."""
        if now - self._wind_s >= 1.0:
            self._look_around(now)
        north, east = self._wind_mean
        gust_north, gust_east = self.gusts.step(math.hypot(north, east), self.step_s)
        self._wind_now = (north + gust_north, east + gust_east)
        demand: Demand = self.autopilot.step()
        body = self.body
        body.step(demand, *self._wind_now, self.ground_m, self.step_s)
        if self.autopilot.armed and demand.motors:
            if body.grounded:
                watts = _IDLE_ARMED_W
            else:
                watts = self.power.electrical_w(body.thrust_n, body.airspeed_mps, body.up_mps, body.drag_w)
        else:
            watts = _AVIONICS_W
        self._draw(watts, self.step_s)
        self.winch.advance(self, self.step_s)
        self.stepped_s = self.tended_s = now
        self.autopilot.after_step()
        if self.flight_log is not None:
            self.flight_log.step()

    def _look_around(self, now: float) -> None:
        """Look up wind and ground where the vehicle is now, and how fine a step is requested."""
        self._wind_s = now
        self.step_s = FINE_STEP_S if self.radio.shortest_s < STEP_S else self.config.step_s
        body = self.body
        north, east = self.world.wind.at(self.posix_s, body.lat, body.lon, body.alt_m - self.ground_m)
        extra = self.faults.value("gust") + self.faults.value("wind-shift")
        self._wind_mean = (
            north + extra * math.cos(self._mishap_rad),
            east + extra * math.sin(self._mishap_rad),
        )
        self.ground_m = self.world.ground_m(body.lat, body.lon, self.origin[2])

    def _draw(self, watts: float, duration_s: float) -> None:
        self.battery.discharge(watts, duration_s)
        self.counted_mah += max(self.battery.current_a, 0.0) * duration_s / 3.6

    def tend(self) -> None:
        """Bring the battery of a standing vehicle up to now, in one step of any length."""
        duration = self.sim_s - self.tended_s
        if duration <= 0.0 or self.active:
            return
        self.tended_s = self.stepped_s = self.sim_s
        if self.charging is not None:
            self.battery.charge(duration, *self.charging)
        elif not self.battery.empty:
            self._draw(_AVIONICS_W, duration)

    def swap_battery(self, soc: float = 1.0) -> None:
        """Put in another battery, on the ground with the motors off; the autopilot restarts.

        Raises an `InputError` if the vehicle is armed or in the air.
        """
        if self.active:
            raise InputError(Wrong("a battery is swapped on the ground, disarmed", field="battery-swap"))
        self.tend()
        self.battery.soc = soc
        self.event(f"another battery with {percent(soc)}")
        self.reboot_at_s = self.sim_s
        self.wake()

    # Restart

    def reboot_soon(self) -> None:
        """Restart once the answer has gone out."""
        self.reboot_at_s = self.sim_s + _REBOOT_DELAY_S
        self.wake()

    def _reboot(self) -> None:
        """Restart: parameters and missions stay, everything else is forgotten; in the air it falls."""
        self.reboot_at_s = math.inf
        self.tend()
        old = self.autopilot
        self.event("autopilot restarts")
        self.power_on_s = self.sim_s
        self._was_booting = True
        self.autopilot = FAMILIES[self.config.autopilot](self)
        self.autopilot.parameters = old.parameters
        for kind, items in old.stores.items():
            self.autopilot.stores[kind][:] = items
        self.autopilot.landed = old.landed
        self.autopilot.grounded_s = old.grounded_s
        self.autopilot.home = self.autopilot.here
        self.autopilot.restarted()
        self.counted_mah = 0.0
        self.ground_heard.clear()
        if self.flight_log is not None:
            self.flight_log.restarted()
        for part in self._timed:
            part.forget()
        self.radio.restart()

    # Talking

    def receive(self, port: Port, data: bytes) -> None:
        """Take bytes that came in on a port."""
        if self._was_booting or "link-loss" in self.faults.active:
            return
        self.radio.receive(port, data)
        if self.active and self.stepped_s < self.sim_s - self.step_s:
            self.stepped_s = self.tended_s = self.sim_s

    def event(self, text: str) -> None:
        """Record an event in the log of the world."""
        self.world.log(self.config.system, text)

    # Orders to the autopilot

    def set_mission_current(self, index: int) -> bool:
        """Make an item the current one, by the family's own number."""
        run = self.autopilot.run
        if index >= len(run.items):
            return False
        run.jump(index)
        self.event(f"current item set to {index}")
        return True

    # Where

    def felt_wind(self) -> tuple[float, float]:
        """(north, east) towards, as estimated by the vehicle: the truth with a steady error."""
        return self._wind_now[0] + self._wind_bias[0], self._wind_now[1] + self._wind_bias[1]

    @property
    def true_wind(self) -> tuple[float, float]:
        """(north, east) towards, as it blows at the vehicle."""
        return self._wind_now

    def local_ned(self) -> tuple[float, float, float]:
        """Estimated position from the local origin, metres."""
        return self.local_ned_of(self.position.lat, self.position.lon, self.body.alt_m)

    def local_ned_of(self, lat: float, lon: float, alt_m: float) -> tuple[float, float, float]:
        """Position of a point from the local origin, metres."""
        north, east = offset_m(self.origin[0], self.origin[1], lat, lon)
        return north, east, self.origin[2] - alt_m

    def station(self) -> str | None:
        """Id of the station it is at, or None."""
        return self.world.station_near(self.body.lat, self.body.lon, _AT_STATION_M)

    def place(self) -> str:
        """Its position, in words."""
        near = self.station()
        return f"at {near}" if near else f"at {place_text(self.body.lat, self.body.lon)}"
