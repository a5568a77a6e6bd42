"""The discrete model of a rigid drive in a proportional velocity loop.

Source: McPherson (2024), eqs. (2.2)-(2.6), corrected: the disturbance gain is (p_d - 1)/p for accelerations.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.plants._friction_curve import FrictionLine
from fdbench.plants._plant import LinearModel
from fdbench.record import FloatArray, Record
from fdbench.regression import Regression

DEAD_BAND_M_PER_S = 1e-3


@final
@dataclass(frozen=True, kw_only=True)
class VelocityLoopModel(LinearModel):
    r"""Continuous values and their discrete equivalents under a held command.

    .. math::
        v_{k+1} = \beta_1 v_{r,k} + \beta_2 v_k - \beta_3 s^+_k + \beta_4 s^-_k + f_k, \quad
        p = -B/m, \; K_v = K/m, \; p_d = e^{p T_s}, \; g = (p_d - 1)/p,

    .. math:: \beta_1 = K_v g, \quad \beta_2 = p_d - \beta_1, \quad \beta_3 = g F_c^+/m, \quad \beta_4 = g F_c^-/m

    with s+ = 1 for v > 1 mm/s and s- = 1 for v < -1 mm/s; the regressors are -s+ and +s-, so that beta_3 and beta_4
    are both positive.
    """

    mass_kg: float
    line: FrictionLine
    gain_N_s_per_m: float
    name: str = "velocity_loop"

    @property
    def pole(self) -> float:
        """p, 1/s."""
        return -self.line.viscous_N_s_per_m / self.mass_kg

    def disturbance_time_s(self, sampling_time_s: float) -> float:
        """Return g, the velocity that one m/s^2 of deceleration costs over a sample."""
        return held_time_s(self.pole, sampling_time_s)

    @property
    def has_friction(self) -> bool:
        """Whether the nominal model has a Coulomb part to be identified."""
        return abs(self.line.coulomb_N) > 1e-9

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return beta_1, beta_2 and, with friction, beta_3, beta_4."""
        g = self.disturbance_time_s(sampling_time_s)
        beta_1 = self.gain_N_s_per_m / self.mass_kg * g
        values = {"beta_1": beta_1, "beta_2": math.exp(self.pole * sampling_time_s) - beta_1}
        if self.has_friction:
            values["beta_3"] = g * (self.line.coulomb_N + self.line.offset_N) / self.mass_kg
            values["beta_4"] = g * (self.line.coulomb_N - self.line.offset_N) / self.mass_kg
        return values

    def physical_parameters(self, parameters: Mapping[str, float], sampling_time_s: float) -> Mapping[str, float]:
        """Return mass, viscous and Coulomb friction for discrete parameters, given the controller gain.

        NaN where the discrete pole beta_1 + beta_2 is not positive or beta_1 is zero.
        """
        discrete_pole = parameters["beta_1"] + parameters["beta_2"]
        pole = math.log(discrete_pole) / sampling_time_s if discrete_pole > 0.0 else math.nan
        g = held_time_s(pole, sampling_time_s)
        beta_1 = parameters["beta_1"]
        mass = self.gain_N_s_per_m * g / beta_1 if beta_1 != 0.0 else math.nan
        values = {"mass_kg": mass, "viscous_friction_N_s_per_m": -pole * mass}
        if "beta_3" in parameters:
            values["coulomb_friction_N"] = 0.5 * (parameters["beta_3"] + parameters["beta_4"]) * mass / g
        return values

    def regression(self, record: Record) -> Regression:
        """Return y = v_{k+1} on the regressors of row k, for k = 0 ... n - 2."""
        velocity, reference = record["velocity_m_per_s"], record["reference_velocity_m_per_s"]
        now = velocity[:-1]
        columns = [reference[:-1], now]
        if self.has_friction:
            columns += [-(now > DEAD_BAND_M_PER_S).astype(float), (now < -DEAD_BAND_M_PER_S).astype(float)]
        return Regression(
            regressors=np.column_stack(columns),
            target=velocity[1:],
            names=tuple(f"beta_{n + 1}" for n in range(len(columns))),
            target_name="velocity_m_per_s",
            time_s=record["time_s"][:-1],
            rows=np.arange(record.n_samples - 1),
            disturbance_gain=-self.disturbance_time_s(record.sampling_time_s) / self.mass_kg,
        )

    def free_run(self, command: Record, parameters: Mapping[str, float]) -> FloatArray:
        """Return the velocity v_1 ... v_{n-1} (n - 1,) from rest that parameters make of a commanded one (n,)."""
        reference = command["reference_velocity_m_per_s"]
        beta_1, beta_2 = parameters["beta_1"], parameters["beta_2"]
        beta_3, beta_4 = parameters.get("beta_3", 0.0), parameters.get("beta_4", 0.0)
        velocity = np.zeros(len(reference))
        with np.errstate(over="ignore", invalid="ignore"):
            for k in range(len(reference) - 1):
                now = velocity[k]
                friction = beta_3 if now > DEAD_BAND_M_PER_S else -beta_4 if now < -DEAD_BAND_M_PER_S else 0.0
                velocity[k + 1] = beta_1 * reference[k] + beta_2 * now - friction
        return velocity[1:]


def held_time_s(pole: float, sampling_time_s: float) -> float:
    """Return (e^{p T} - 1)/p, the sampling time T where p = 0."""
    x = pole * sampling_time_s
    return sampling_time_s * (math.expm1(x) / x if x != 0.0 else 1.0)
