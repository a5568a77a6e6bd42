"""Closed-form maps between the continuous and discrete coefficients of slot milling."""

import math


def oscillation(c_1: float, c_2: float, dt: float) -> tuple[float, float, float]:
    r"""Return :math:`E = e^{-c_1 dt/2}`, :math:`C = \cos \omega' dt` and :math:`S = \sin(\omega' dt) / \omega'`.

    :math:`\omega'^2 = c_2 - c_1^2/4`; hyperbolic functions where it is negative.
    """
    square = c_2 - 0.25 * c_1**2
    root = math.sqrt(abs(square))
    E = math.exp(-0.5 * c_1 * dt)
    if square > 0.0:
        return E, math.cos(root * dt), math.sin(root * dt) / root
    return (E, math.cosh(root * dt), math.sinh(root * dt) / root) if square < 0.0 else (E, 1.0, dt)


def discrete(c_1: float, c_2: float, c_3: float, c_4: float, dt: float) -> tuple[float, float, float, float]:
    r"""Return a_1, a_2, b_0, b_1 of :math:`(c_3 + c_4 s)/(s^2 + c_1 s + c_2)` under an input held for dt.

    .. math::
        a_1 = -2 E C, \quad a_2 = E^2, \quad b_0 = \tfrac{c_3}{c_2} (1 - E (C + \tfrac{c_1}{2} S)) + c_4 E S, \quad
        b_1 = \tfrac{c_3}{c_2} E (E + \tfrac{c_1}{2} S - C) - c_4 E S

    Turkay and Ulsoy (1988), eq. (13), with the sign of a_1 and the bracket of b_0 put right.
    """
    E, C, S = oscillation(c_1, c_2, dt)
    gain, half = c_3 / c_2, 0.5 * c_1 * S
    return -2.0 * E * C, E * E, gain * (1.0 - E * (C + half)) + c_4 * E * S, gain * E * (E + half - C) - c_4 * E * S


def continuous(a_1: float, a_2: float, b_0: float, b_1: float, dt: float) -> tuple[float, float, float, float]:
    """Return c_1 ... c_4, the inverse of `discrete` for frequencies below half the sampling rate.

    NaN where no second-order system has these coefficients: a_2 or a real pole is not positive.
    """
    E = math.sqrt(a_2) if a_2 > 0.0 else math.nan
    C = -0.5 * a_1 / E
    if math.isnan(C) or C <= -1.0:
        return math.nan, math.nan, math.nan, math.nan
    root = math.acos(C) / dt if C < 1.0 else math.acosh(C) / dt
    c_1 = -math.log(a_2) / dt
    c_2 = 0.25 * c_1**2 + math.copysign(root**2, 1.0 - C)
    distance = 1.0 + a_1 + a_2
    gain = (b_0 + b_1) / distance if distance != 0.0 else math.nan
    _, _, S = oscillation(c_1, c_2, dt)
    c_4 = (gain * E * (E + 0.5 * c_1 * S - C) - b_1) / (E * S)
    return c_1, c_2, gain * c_2, c_4
