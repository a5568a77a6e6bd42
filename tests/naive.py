"""Slow twins, written independently of the package: plain equations, fourth-order Runge-Kutta, tiny steps."""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class TwoMassAxis:
    """Motor and table joined by a screw, LuGre friction and a constant force on the table, cascade on the motor side.

    SI units. The velocity of the loop is the true one of the motor.
    """

    motor_mass: float
    table_mass: float
    motor_viscous: float
    table_viscous: float
    stiffness: float
    damping: float
    coulomb: float
    static: float
    stribeck_velocity: float
    bristle_stiffness: float
    bristle_damping: float
    constant: float
    position_gain: float
    velocity_gain: float
    integral_gain: float
    velocity_feedforward: float
    force_limit: float

    def run(self, reference: FloatArray, period: float, step: float) -> FloatArray:
        """Return (n, 3): motor position, table position and motor force at the samples of the (n, 3) reference."""
        names = self.__dataclass_fields__
        return _run(np.array([getattr(self, name) for name in names]), reference, period, round(period / step))


@njit(cache=True)
def _rates(s, force, p):  # type: ignore[no-untyped-def]
    mm, mt, bm, bt, k, c, fc, fs, vs, s0, s1, f0 = p[:12]
    xm, vm, xt, vt, z = s
    screw = k * (xm - xt) + c * (vm - vt)
    g = fc + (fs - fc) * np.exp(-((vt / vs) ** 2))
    dz = vt - s0 * np.abs(vt) / g * z
    friction = s0 * z + s1 * dz + f0
    return np.array([vm, (force - bm * vm - screw) / mm, vt, (screw - bt * vt - friction) / mt, dz])


@njit(cache=True)
def _run(p, reference, period, steps):  # type: ignore[no-untyped-def]
    kx, kv, ki, ff, limit = p[12:]
    s = np.zeros(5)
    integral = 0.0
    h = period / steps
    out = np.empty((len(reference), 3))
    for k in range(len(reference)):
        error = ff * reference[k, 1] + kx * (reference[k, 0] - s[0]) - s[1]
        wanted = kv * error + ki * integral
        force = min(max(wanted, -limit), limit)
        if force == wanted:
            integral += error * period
        out[k] = s[0], s[2], force
        for _ in range(steps):
            a = _rates(s, force, p)
            b = _rates(s + 0.5 * h * a, force, p)
            c = _rates(s + 0.5 * h * b, force, p)
            d = _rates(s + h * c, force, p)
            s = s + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
    return out
