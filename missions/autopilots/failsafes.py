"""Failsafe behaviour derived from a vehicle's settings: lost ground station, lost pilot, low battery."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING

from skyway.models.base.formatting import duration

if TYPE_CHECKING:
    from collections.abc import Mapping

    from skyway.missions.autopilots.settings import Settings

_NOT_READ = "unknown: the parameters that decide it could not be read"


@dataclass(frozen=True, slots=True)
class LinkLoss:
    """Behaviour at a lost link, from the settings of a family."""

    action: str
    exceptions: str
    """Keys of the settings for the action, and of those for exceptions from it."""
    in_mission: int
    """Bit of the exceptions that stands for a mission."""
    words: Mapping[int, str]
    """Description of each action, for a person."""
    timeout: str = ""
    """Key of the delay; empty if there is none."""


class Failsafes(ABC):
    """The failsafes of one family; values are settings by key, in our units (`Settings.in_our_units`).

    The settings with these keys determine its automatic actions, `station` and `pilot` those at the loss of the link to
    us, and of the remote control.
    """

    def __init__(self, settings: Settings, keys: tuple[str, ...], station: LinkLoss, pilot: LinkLoss) -> None:
        self.settings, self.keys, self.station, self.pilot = settings, keys, station, pilot

    @abstractmethod
    def battery(self, values: Mapping[str, float]) -> list[str]:
        """Return its actions at each threshold of the battery, a line each."""

    @abstractmethod
    def battery_first(self, values: Mapping[str, float]) -> str:
        """Return its action at the first threshold with an action."""

    def by_itself(self, values: Mapping[str, float]) -> list[str]:
        """Return its automatic actions in a mission, a line for each cause, for the operator before a take-off."""
        if not values:
            return ["its behaviour without commands is unknown: its failsafe parameters could not be read"]
        return [
            f"link to skyway lost: {self.without_us(values)}",
            f"remote control lost: {self._without_pilot(values)}",
            *self.battery(values),
        ]

    def when_left(self, values: Mapping[str, float]) -> str:
        """Describe in one sentence its behaviour in its mission when our program ends, and with it its heartbeat."""
        if not values:
            return "its behaviour then is unknown: its failsafe parameters could not be read"
        return f"{self.without_us(values)}; {self.battery_first(values)}"

    def finishes_alone(self, values: Mapping[str, float]) -> bool | None:
        """Return whether it finishes its leg and lands without us; None if unknown.

        It continues if it does nothing, or nothing in a mission; without an exception, this is known only of the former.
        """
        loss = self.station
        if int(values.get(loss.action, -1)) == 0 or int(values.get(loss.exceptions, 0)) & loss.in_mission:
            return True
        return False if loss.action in values or loss.exceptions in values else None

    def without_us(self, values: Mapping[str, float]) -> str:
        """Return its behaviour in its mission without our heartbeat."""
        loss, alone = self.station, self.finishes_alone(values)
        if alone is None:
            return _NOT_READ
        if alone:
            excepted = int(values.get(loss.exceptions, 0)) & loss.in_mission
            why = self.name(loss.exceptions) if excepted else f"{self.name(loss.action)} 0"
            return f"it finishes its mission, lands and disarms there ({why})"
        wait = values.get(loss.timeout)
        after = "some time" if wait is None else duration(wait)
        return f"after {after} without skyway it {self.action(loss.action, loss.words, values)}"

    def _without_pilot(self, values: Mapping[str, float]) -> str:
        """Return its behaviour in its mission without its remote control."""
        loss = self.pilot
        if int(values.get(loss.exceptions, 0)) & loss.in_mission:
            return f"it continues its mission ({self.name(loss.exceptions)})"
        if loss.action not in values or (loss.exceptions not in values and values[loss.action] != 0):
            return _NOT_READ
        if values[loss.action] == 0:
            return f"it continues its mission ({self.name(loss.action)} 0)"
        return f"it {self.action(loss.action, loss.words, values)}"

    def name(self, key: str) -> str:
        """Name of a setting in the newest firmware."""
        return self.settings[key].names[0].name

    def action(self, key: str, words: Mapping[int, str], values: Mapping[str, float]) -> str:
        """Effect of a setting, with the name of its parameter."""
        name = self.name(key)
        if key not in values:
            return f"does what {name} says, which could not be read"
        value = int(values[key])
        return f"{words[value]} ({name})" if value in words else f"does what {name} {value} says"
