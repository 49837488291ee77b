"""The example "hills" flown in virtual time: its own forecast blows, its zones and its ground count."""

from skyway import flying
from skyway.calibration_flight import drag_of
from skyway.link.protocol.connection import Connection
from skyway.link.supervisor import DeliveryJob, Journal, NobodyThere, Supervisor
from skyway.link.vehicle.vehicle import Vehicle
from skyway.missions.builder.mission_options import MissionOptions
from skyway.models.scenario.air import fleet_in_air
from skyway.planner.problem.problem import HORIZON_H
from skyway.sim_stub.config import VehicleConfig
from skyway.sim_stub.pads import Pads
from skyway.sim_stub.plant.airframe import Airframe
from skyway.sim_stub.plant.wind_truth import RecordedWind
from skyway.sim_stub.transports.lockstep import Lockstep
from skyway.sim_stub.world import World


class HillsStage:
    """A plan of the example, prepared as ``skyway fly`` prepares it, and a vehicle in the mean wind of its forecast."""

    def __init__(self, composition, journal, *, autopilot="px4", faults=()):
        self.composition, self.journal, self.lines, self.track = composition, journal, [], []
        self.region = flying.scenario_of(composition, None)
        drone = self.region.drone(composition.drone)
        forecast = self.region.forecast(composition.depart, HORIZON_H)
        begin_s = composition.depart.timestamp()
        self.job = DeliveryJob(
            composition=composition, scenario=fleet_in_air(self.region, forecast, begin_s),
            request=flying.request_of(composition, self.region), forecast=forecast,
            options=MissionOptions(over=self.region.network.over), drag=drag_of(drone, composition.payload_kg), asking="never",
        )  # fmt: skip
        stations = self.region.network.stations
        self.world = World(epoch_s=begin_s, wind=RecordedWind(forecast.mean()), stations=stations, faults=faults)
        place = composition.stations[composition.origin]
        self.craft = self.world.add(
            VehicleConfig(
                lat=place.lat, lon=place.lon, ground_m=place.elevation_m, autopilot=autopilot, payload_kg=composition.payload_kg,
                seed=1, warm=True, airframe=Airframe(drone=drone),
            )
        )  # fmt: skip
        self.lockstep = Lockstep(self.world)

    def fly(self):
        """Take the delivery to its end; `track` has time, place and height above sea level in the air, second by second."""
        connection = Connection(self.lockstep.connect(self.craft, seed=1), self.lockstep.clock)
        journal = Journal(self.journal, self.lockstep.clock.posix_s)
        operator, pads = NobodyThere(show=self.lines.append), Pads(self.world, None, seed=1)
        supervisor = Supervisor(
            self.job, Vehicle(connection), self.lockstep.clock, pads, operator, journal, on_tick=self._watch
        )
        try:
            return supervisor.run()
        finally:
            journal.close()

    def _watch(self, context):
        sample = context.observed.sample
        if context.place is not None and sample is not None and self.craft.autopilot.armed:
            self.track.append((context.now_s, *context.place, sample.alt_msl_m))
