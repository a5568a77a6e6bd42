"""Commands of the foreign axes, sampled at the control period: strokes, laps, sines, chirps and forces."""

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
REST_S = 0.15
SHORTEST_SMOOTHING = 2  # samples; a trapezoid of velocity otherwise


class Space(NamedTuple):
    """What a machine allows: travel (m), speed (m/s), acceleration (m/s^2), control period (s), smoothing (s)."""

    travel_m: float
    speed_m_per_s: float
    acceleration_m_per_s2: float
    period_s: float
    smoothing_s: float


def strokes(space: Space, stops: Sequence[float], speeds: Sequence[float], rest_s: float = REST_S) -> FloatArray:
    """Return position, velocity and acceleration (n, 3) of strokes between stops, at speeds taken in turn.

    Trapezoids of velocity over whole samples, smoothed by a moving average where the machine has one.
    """
    period = space.period_s
    rest = np.zeros(max(1, round(rest_s / period)))
    rates = [rest]
    for index, (start, end) in enumerate(itertools.pairwise(stops)):
        distance, speed = end - start, speeds[index % len(speeds)]
        speed = min(speed, np.sqrt(abs(distance) * space.acceleration_m_per_s2))
        rise = max(2, int(np.ceil(speed / space.acceleration_m_per_s2 / period)))
        level = max(1, round(abs(distance) / speed / period) - rise)
        ramp = (np.arange(rise) + 0.5) / rise
        shape = np.concatenate((ramp, np.ones(level), ramp[::-1]))
        rates += [shape * distance / (shape.sum() * period), rest]
    velocity = np.concatenate(rates)
    width = round(space.smoothing_s / period)
    if width >= SHORTEST_SMOOTHING:
        velocity = np.convolve(np.concatenate((velocity, np.zeros(width))), np.full(width, 1.0 / width))[
            : len(velocity) + width
        ]
    return _from_velocity(stops[0], velocity, period)


def sines(space: Space, centre_m: float, size_m: float, band_Hz: tuple[float, float], lasts_s: float) -> FloatArray:
    """Return a sum of sines (n, 3) that starts and ends at rest; the squares of their frequencies are even."""
    t = _clock(lasts_s, space)
    frequencies = np.geomspace(*band_Hz, 11)
    phases = np.pi * np.arange(11) ** 2 / 11
    wave = sum(
        np.sin(2.0 * np.pi * f * t + p) / (f / band_Hz[0]) ** 1.2 for f, p in zip(frequencies, phases, strict=True)
    )
    return _from_position(centre_m + size_m * _fade(t, lasts_s) * wave / np.abs(wave).max(), space.period_s)


def chirp(space: Space, centre_m: float, size_m: float, band_Hz: tuple[float, float], lasts_s: float) -> FloatArray:
    """Return a sine (n, 3) whose frequency grows exponentially and whose acceleration stays about even."""
    t = _clock(lasts_s, space)
    rate = np.log(band_Hz[1] / band_Hz[0]) / lasts_s
    phase = 2.0 * np.pi * band_Hz[0] * (np.exp(rate * t) - 1.0) / rate
    size = size_m * np.exp(-1.5 * rate * t)
    return _from_position(centre_m + _fade(t, lasts_s) * size * np.sin(phase), space.period_s)


def swing(space: Space, size_m: float, frequency_Hz: float, turns: int) -> FloatArray:
    """Return the motion of one axis of a circle (n, 3), eased in and out over a turn."""
    t = np.arange(round((turns + 2) / frequency_Hz / space.period_s)) * space.period_s
    lasts_s = (turns + 2) / frequency_Hz
    eased = np.clip(np.minimum(t, lasts_s - t) * frequency_Hz, 0.0, 1.0)
    eased = eased**3 * (10.0 - 15.0 * eased + 6.0 * eased**2)
    return _from_position(size_m * eased * (1.0 - np.cos(2.0 * np.pi * frequency_Hz * t)) / 2.0, space.period_s)


def _clock(lasts_s: float, space: Space) -> FloatArray:
    return np.asarray(np.arange(round(lasts_s / space.period_s)) * space.period_s, dtype=np.float64)


def _fade(t: FloatArray, lasts_s: float) -> FloatArray:
    return np.asarray(np.sin(0.5 * np.pi * np.clip(np.minimum(t, lasts_s - t) / 0.25, 0.0, 1.0)) ** 2)


def _from_velocity(start_m: float, velocity: FloatArray, period: float) -> FloatArray:
    steps = 0.5 * (velocity + np.concatenate((velocity[1:], [0.0]))) * period
    position = start_m + np.concatenate(([0.0], np.cumsum(steps)[:-1]))
    return np.column_stack((position, velocity, np.gradient(velocity, period)))


def _from_position(position: FloatArray, period: float) -> FloatArray:
    velocity = np.gradient(position, period)
    return np.column_stack((position, velocity, np.gradient(velocity, period)))


Recipe = Callable[[Space, np.random.Generator], FloatArray]


def _about(rng: np.random.Generator, value: float) -> float:
    return value * float(rng.uniform(0.8, 1.2))


def _speeds(space: Space, rng: np.random.Generator) -> FloatArray:
    far, fast = _about(rng, 0.6 * space.travel_m), _about(rng, 0.5 * space.speed_m_per_s)
    stops = (0.0, far, 0.0, 0.15 * far, 0.0, 0.02 * far, 0.0)
    return strokes(space, stops, (fast, fast, 0.25 * fast, 0.25 * fast, 0.05 * fast, 0.05 * fast))


def _hard(space: Space, rng: np.random.Generator) -> FloatArray:
    far = _about(rng, 0.6 * space.travel_m)
    return strokes(space, (0.0, far, 0.1 * far, 0.7 * far, 0.0), (space.speed_m_per_s,))


def _small(space: Space, rng: np.random.Generator) -> FloatArray:
    size, centre = _about(rng, 0.01 * space.travel_m), _about(rng, 0.2 * space.travel_m)
    stops = (centre, *(centre + size * share for share in (1.0, 0.4, 0.8, 0.0, 0.1, 0.0)))
    return strokes(space, stops, (_about(rng, 0.03 * space.speed_m_per_s),), 0.1)


def _multisine(space: Space, rng: np.random.Generator) -> FloatArray:
    low = _about(rng, 0.7)
    size = min(0.1 * space.travel_m, 0.1 * space.speed_m_per_s / low)
    return sines(space, 0.3 * space.travel_m, size, (low, 40.0 * low), 4.0)


def _chirp(space: Space, rng: np.random.Generator) -> FloatArray:
    low = _about(rng, 0.8)
    return chirp(space, 0.3 * space.travel_m, 0.08 * space.speed_m_per_s / low, (low, 25.0), 4.0)


def _swing(space: Space, rng: np.random.Generator) -> FloatArray:
    size = _about(rng, 0.3 * space.travel_m)
    return swing(space, size, min(0.5, 0.3 * space.speed_m_per_s / size), 2)


def _laps(space: Space, rng: np.random.Generator) -> FloatArray:
    far, fast = _about(rng, 0.5 * space.travel_m), _about(rng, 0.5 * space.speed_m_per_s)
    lap = strokes(space, (0.0, far, 0.7 * far, 0.75 * far, 0.0), (fast, 0.2 * fast, 0.1 * fast, fast))
    return np.tile(lap, (3, 1))


def _other(space: Space, rng: np.random.Generator) -> FloatArray:
    far, fast = _about(rng, 0.5 * space.travel_m), _about(rng, 0.35 * space.speed_m_per_s)
    stops = (0.05 * far, 0.8 * far, 0.5 * far, 0.53 * far, 0.05 * far)
    return strokes(space, stops, (fast, 0.5 * fast, 0.1 * fast, 1.5 * fast))


RECIPES: Mapping[str, Recipe] = {
    "speeds": _speeds,
    "hard": _hard,
    "small": _small,
    "multisine": _multisine,
    "chirp": _chirp,
    "swing": _swing,
    "laps": _laps,
    "other": _other,
}
