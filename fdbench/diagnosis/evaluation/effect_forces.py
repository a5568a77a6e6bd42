"""Forces of the effects that a model knows, along a motion that is given."""

from typing import Any

from fdbench.effects import Effect, Port
from fdbench.plants.feed_drive import FeedDrive

FOLLOWED = (Port.COMMAND, Port.MOTOR_FORCE, Port.TABLE_FORCE, Port.TABLE_INERTIA)


class EffectForces:
    """The effects of a drive with their internal states, which advance with every sample.

    Parameters
    ----------
    drive : FeedDrive
    period_s : float
    """

    def __init__(self, drive: FeedDrive, period_s: float) -> None:
        self.period_s = period_s
        self._known = [item for item in drive.effects if is_followed(item)]
        self._known.sort(key=lambda item: type(item).rank)
        self._states: list[tuple[float, ...]] = [(0.0,) * len(type(item).states) for item in self._known]

    def _call(self, index: int, time_s: float, x: float, v: float, u: float, commanded: float) -> Any:
        effect = self._known[index]
        speed = commanded if type(effect).follows_command else v
        states = self._states[index]
        found = type(effect).kernel(time_s, self.period_s, x, speed, u, *effect.values(), *states)
        self._states[index] = tuple(found[len(found) - len(states) :])
        return found

    def delivered(self, time_s: float, x: float, v: float, command_N: float, commanded: float) -> float:
        """Return the force that the motor delivers for a command, N."""
        for index, effect in enumerate(self._known):
            if effect.port is Port.COMMAND:
                command_N = self._call(index, time_s, x, v, command_N, commanded)[0]
        return command_N

    def against(self, port: Port, time_s: float, x: float, v: float, u: float, commanded: float) -> tuple[float, float]:
        """Return force against motion (N) and its slope (N s/m, TABLE_INERTIA: kg) of all effects of a port."""
        force = slope = 0.0
        for index, effect in enumerate(self._known):
            if effect.port is port:
                found = self._call(index, time_s, x, v, u, commanded)
                force, slope = force + found[0], slope + found[1]
        return force, slope


def is_followed(effect: Effect) -> bool:
    """Return whether a given motion tells the force of an effect: not that of the screw, the sensors, the logger."""
    return effect.port in FOLLOWED and not type(effect).random
