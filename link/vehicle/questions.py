"""Requests to a vehicle: commands with their answers, telemetry, parameters and settings."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, TypeVar

from skyway.link.protocol.command import ACCEPTED, RESULTS, AskFor, Command, Place
from skyway.link.protocol.parameters import (
    PARAMETER_ERRORS,
    ListParameters,
    ParameterCheck,
    ParameterValue,
    ReadParameters,
    SetParameter,
    check_parameters,
    same_value,
)
from skyway.link.telemetry.live import RATES_HZ
from skyway.link.telemetry.vehicle_monitor import INTERVAL, VehicleMonitor
from skyway.missions.items.parameters import UNITS
from skyway.models.base.errors import (
    CommandRefusedError,
    Fault,
    InputError,
    LinkError,
    ParameterAbsentError,
    VehicleTimeoutError,
)

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from skyway.link.protocol.connection import Connection
    from skyway.link.protocol.exchange import Carrier, Exchange, Steps
    from skyway.missions.items.parameters import Parameter

E_ = TypeVar("E_", bound="Exchange")
_REQUEST_MESSAGE, _VERSION, _ANSWERS_S = 512, 148.0, 3.0
_LISTS = 3
"""Tries to read a list of parameters that changes meanwhile."""
SETS = 4
"""Tries to set a parameter before the value it keeps is its answer."""


class AskedVehicle(VehicleMonitor):
    """One vehicle on a connection that is asked; arguments and errors as of `VehicleMonitor`."""

    def __init__(self, connection: Connection, system: int | None = None, autopilot: str | None = None) -> None:
        super().__init__(connection, system, autopilot)
        self._runner: Carrier = connection
        self._asked_version = False
        self.own_names: dict[str, tuple[str, str]] = {}
        """Name and unit of settings, by their key, for firmware that calls them by a name that skyway does not know."""
        self.waited_s = 0.0
        """How long the last exchange took, all tries together, s; but for `answers`."""

    def _do(self, exchange: E_) -> E_:
        begun_s = self.connection.clock.now_s()
        self._perform(exchange)
        self.waited_s = self.connection.clock.now_s() - begun_s
        return exchange

    def _perform(self, exchange: Exchange) -> None:
        def steps() -> Steps[None]:
            yield exchange

        self._runner.perform(steps())

    def carry_out(self, exchange: E_) -> E_:
        """Carry one exchange with it out, and return it with what came of it."""
        return self._do(exchange)

    def answers(self) -> bool:
        """Ask whether it hears us: any answer to a request that changes nothing will do."""
        asked = Command(self.peer.target, _REQUEST_MESSAGE, _VERSION, give_up_s=_ANSWERS_S)
        self._perform(asked)
        return asked.result is not None

    def request_telemetry(self, rates_hz: Mapping[int, float] = RATES_HZ) -> tuple[int, ...]:
        """Ask for messages by their ids, or for those that telemetry is made of; returns the ids of those refused.

        A rate of 0 is the autopilot's own. Raises a `VehicleTimeoutError` if there was no answer; what was not asked
        for yet is requested again as long as it does not come.
        """
        wanted, refused = self.its_messages(rates_hz), []
        self.connection.keep_rates(wanted)
        for number, rate in wanted.items():
            asked = Command(self.peer.target, INTERVAL, float(number), 1e6 / rate if rate > 0.0 else 0.0)
            result = self._do(asked).result
            if result is None:
                self.rates.want({one: hz for one, hz in wanted.items() if hz > 0.0}, self.connection.clock.now_s())
                raise VehicleTimeoutError("its telemetry", self.waited_s)
            if result != ACCEPTED:
                refused.append(number)
        taken = {number: rate for number, rate in wanted.items() if number not in refused and rate > 0.0}
        self.rates.want(taken, self.connection.clock.now_s())
        return tuple(refused)

    def command(self, what: str, number: int, *parameters: float, place: Place | None = None) -> None:
        """Give a command.

        A `CommandRefusedError` has the vehicle's answer and what it said, a `VehicleTimeoutError` says that there was
        none.
        """
        said = self.peer.said
        given = Command(self.peer.target, number, *parameters, place=place)
        result = self._do(given).result
        if result is None:
            raise VehicleTimeoutError(what, self.waited_s)
        if result != ACCEPTED:
            self.connection.run_for(0.2)  # its reasons may come after the answer
            raise CommandRefusedError(what, RESULTS.get(result, f"answer {result}"), self.peer.texts_since(said)[-3:])

    def _bytewise(self) -> bool:
        """How its parameters are read; one that only resembles its family is asked first, once."""
        if self.resembles and not self._asked_version and "AUTOPILOT_VERSION" not in self.peer.latest:
            self._asked_version = True
            self._do(AskFor(self.peer.target, "AUTOPILOT_VERSION", int(_VERSION)))
        return self.bytewise_parameters

    def read_parameters(self, names: Sequence[str]) -> ReadParameters:
        """Read parameters by name, and tell which of them the vehicle does not have."""
        self.relied_on.update(names)
        return self._do(ReadParameters(self.peer.target, names, bytewise=self._bytewise()))

    def parameter(self, name: str) -> ParameterValue:
        """Read a parameter.

        Raises a `ParameterAbsentError` if the vehicle answers, and has none of that name; a `VehicleTimeoutError` if
        it does not answer.
        """
        read = self.read_parameters((name,))
        if name in read.found:
            return read.found[name]
        if name in read.absent:
            raise ParameterAbsentError((name,))
        raise VehicleTimeoutError(f"parameter {name}", self.waited_s)

    def set_parameter(self, name: str, value: float) -> ParameterValue:
        """Set a parameter, and read it back.

        A late answer to an earlier question has the old value, like a refusal: only one that is told after each of
        `SETS` tries is a refusal. A `CommandRefusedError` also states that the vehicle has set another value, such as its limit.
        """
        if not math.isfinite(value):
            raise InputError(Fault("not a finite number", field=name, value=value))
        before = self.parameter(name)
        kind = before.kind
        bytewise = self._bytewise()
        for _ in range(SETS):
            self.expect(f"parameter {name}")
            given = SetParameter(self.peer.target, name, value, kind, bytewise=bytewise)
            refused = self._do(given).refused
            after = self.parameter(name)
            if same_value(value, after.value, kind):
                return after
            if refused is not None:
                break
        reason = "" if refused is None else f" ({PARAMETER_ERRORS.get(refused, f'error {refused}')})"
        is_now = f"it is {after.value:.9g}"
        if not same_value(before.value, after.value, kind):
            is_now = f"it is {after.value:.9g} now, and was {before.value:.9g} before"
        raise CommandRefusedError(f"set {name} to {value:.9g}", f"{is_now}{reason}", self.texts()[-1:])

    def parameters(self) -> dict[str, ParameterValue]:
        """Read all parameters, by name; once more from the beginning if their number changes meanwhile."""
        before: dict[str, ParameterValue] = {}
        for _ in range(_LISTS):
            found = self._do(ListParameters(self.peer.target, bytewise=self._bytewise()))
            if not found.complete:
                raise VehicleTimeoutError(
                    f"all parameters: {len(found.found)} of {found.total or 'unknown'} came", self.waited_s
                )
            now = {value.name: value for value in found.found.values()}
            if found.consistent or now.keys() == before.keys():
                return now
            before = now
        raise LinkError("the vehicle's parameters change while they are read: run the command again")

    def check_required(self, wanted: Sequence[Parameter]) -> tuple[ParameterCheck, ...]:
        """Read the parameters that a mission relies on, under whichever of their names this firmware has.

        Raises a `VehicleTimeoutError` if the link is away: what did not come is not known to be absent.
        """
        wanted = [p.called(*self.own_names[p.key]) if p.key in self.own_names else p for p in wanted]
        read = self.read_parameters(tuple(dict.fromkeys(name for parameter in wanted for name in parameter.names)))
        checks = check_parameters(wanted, {name: found.value for name, found in read.found.items()}, read.absent)
        silent = [check.wanted.name for check in checks if check.actual is None and not check.absent]
        if silent and not self.answers():
            raise VehicleTimeoutError(f"parameter {', '.join(silent)}", self.waited_s)
        return checks

    def read_settings(self, keys: Sequence[str]) -> dict[str, float]:
        """Read settings by their keys (`missions.autopilots.settings`), in our units, as far as this firmware has them.

        Raises a `VehicleTimeoutError` if it did not tell one, and may have it.
        """
        settings = self.family.settings
        checks = self.check_required([settings[key].need("read", None, "") for key in keys])
        silent = [check.wanted.name for check in checks if check.actual is None and not check.absent]
        if silent:
            raise VehicleTimeoutError(f"parameters {', '.join(silent)}", self.waited_s)
        return {c.wanted.key: c.actual / UNITS[c.wanted.unit] for c in checks if c.actual is not None and c.ok}

    def refuse_other_supervisor(self) -> None:
        """Refuse to command what another skyway supervises, where we do not do so ourselves: a `CommandRefusedError`."""
        other = self.connection.stations.supervisor_of(self.system, self.connection.clock.now_s())
        if other is not None and self.connection.supervises != self.system:
            raise CommandRefusedError("be commanded by us", f"{other} supervises it; end that delivery first")

    def check_ground_station(self) -> None:
        """Make sure that the vehicle's failsafe counts our heartbeat: some count only that of one system.

        In newer versions it may be a range of systems. A vehicle that has no such parameter is taken as it is. Another
        station with our id is a `StationConflictError`, a vehicle that minds another one's heartbeat a
        `CommandRefusedError`, and one that does not tell whose it minds a `VehicleTimeoutError`.
        """
        self.connection.refuse_conflict()
        self.refuse_other_supervisor()
        if not self.family.ground_station_settings:
            return
        needs = [self.family.settings[key].need("read", None, "") for key in self.family.ground_station_settings]
        first, last = self.check_required(needs)
        if first.absent:
            return
        if first.actual is None:
            raise VehicleTimeoutError(f"parameter {' or '.join(first.wanted.names)}", self.waited_s)
        ours = self.connection.system
        highest = first.actual if last.actual is None else max(first.actual, last.actual)
        if not first.actual <= ours <= highest:
            mine = f"its failsafe counts only the heartbeat of system {first.actual:g} ({first.wanted.name}), ours is {ours}"
            raise CommandRefusedError("be watched by us", f"{mine}: use --gcs-system {first.actual:g}")
