"""Slot milling: how the resultant cutting force follows the feedrate."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import numpy as np

from fdbench.errors import RecordError, SpecError
from fdbench.plants import _slot_milling as milling
from fdbench.plants._linear_system import LinearSystem, continuous
from fdbench.plants._plant import LinearModel, Plant, TransferFunction
from fdbench.record import FloatArray, Record
from fdbench.regression import Regression
from fdbench.simulate.process import Process, SlotMillingSystem
from fdbench.simulate.system import Setup
from fdbench.specification import bounded, nonnegative, positive

MM_PER_M = 1e3
MODEL = "arx"
NAMES = ("a_1", "a_2", "b_0", "b_1")
COEFFICIENTS = ("c_1", "c_2", "c_3", "c_4")
FEWEST_SAMPLES = 3


@final
@dataclass(frozen=True, kw_only=True)
class SlotMilling(Plant):
    r"""Second-order force response of slot milling to feedrate changes, from rest.

    .. math::
        \ddot F + 2 \zeta \omega_n \dot F + \omega_n^2 F =
            K_s a^\beta \left( \omega_n^2 f^\alpha + 2 \zeta \omega_n \frac{d}{dt} f^\alpha \right)

    with depth a in mm and feedrate f in mm/s, and the force read, F plus the forces of effects on the table. About
    f_0 it is linear, with the gain :math:`g = K_s a^\beta \alpha f_0^{\alpha - 1}`:

    .. math::
        \frac{\Delta F}{\Delta f} = \frac{c_3 + c_4 s}{s^2 + c_1 s + c_2}, \quad
        c_1 = 2 \zeta \omega_n, \; c_2 = \omega_n^2, \; c_3 = g \omega_n^2, \; c_4 = 2 g \zeta \omega_n

    Model ``arx``: :math:`y_k = -a_1 y_{k-1} - a_2 y_{k-2} + b_0 u_{k-1} + b_1 u_{k-2} + e_k` with y = F - F_0 and
    u = f - f_0 after the settling time; the truth is exact for an input held over each sampling time. Parameters have
    the paper's names and SI units: c_1 1/s, c_2 1/s^2, c_3 N/(m s), c_4 N/m, a pure numbers, b N s/m.

    Source: Turkay and Ulsoy (1988), eqs. (2) to (9), the last term of (2) with the derivative that it lacks in print.

    Parameters
    ----------
    specific_cutting_force_N : float
        K_s, steady force at a depth of 1 mm and a feedrate of 1 mm/s.
    depth_exponent, feedrate_exponent : float
        beta and alpha.
    depth_of_cut_m : float
        a.
    damping_ratio, natural_frequency_rad_per_s : float
        zeta and omega_n.
    operating_feedrate_m_per_s : float
        f_0.
    settling_time_s : float
        Samples before this time are not used for estimation: the response from rest is still in them.
    feedrate_limit_m_per_s, force_limit_N : float
        Limits of the feed axis and of the dynamometer.
    linearised : bool
        Whether the process itself is linear about f_0.
    hold_input : bool
        Whether the commanded feedrate is held over each sampling time; else it varies within.
    """

    specific_cutting_force_N: float = positive()
    depth_exponent: float = positive()
    feedrate_exponent: float = bounded(0.01, 3.0)
    depth_of_cut_m: float = positive()
    damping_ratio: float = positive()
    natural_frequency_rad_per_s: float = positive()
    operating_feedrate_m_per_s: float = positive()
    settling_time_s: float = nonnegative()
    feedrate_limit_m_per_s: float = positive()
    force_limit_N: float = positive()
    linearised: bool
    hold_input: bool

    @property
    def force_at_1_mm_per_s_N(self) -> float:
        """Steady force at 1 mm/s, K_s a^beta."""
        return float(self.specific_cutting_force_N * (MM_PER_M * self.depth_of_cut_m) ** self.depth_exponent)

    @property
    def steady_force_N(self) -> float:
        """Force at the operating point, F_0."""
        feedrate = MM_PER_M * self.operating_feedrate_m_per_s
        return float(self.force_at_1_mm_per_s_N * feedrate**self.feedrate_exponent)

    @property
    def gain_N_s_per_m(self) -> float:
        """Change of the steady force with the feedrate, g."""
        return self.feedrate_exponent * self.steady_force_N / self.operating_feedrate_m_per_s

    @property
    def coefficients(self) -> tuple[float, float, float, float]:
        """Coefficients c_1 ... c_4 of the transfer function, in SI units."""
        c_1 = 2.0 * self.damping_ratio * self.natural_frequency_rad_per_s
        c_2 = self.natural_frequency_rad_per_s**2
        return c_1, c_2, self.gain_N_s_per_m * c_2, self.gain_N_s_per_m * c_1

    def system(self, setup: Setup, n_lanes: int = 1) -> SlotMillingSystem:
        """Return the process with the setup's effects added to the force that is read."""
        if setup.timing.duration_s <= self.settling_time_s:
            raise SpecError(
                f"timing.duration_s: {setup.timing.duration_s:g} s end before the plant's settling time of "
                f"{self.settling_time_s:g} s; nothing is left to estimate from."
            )
        c_1, c_2, _, _ = self.coefficients
        process = Process(
            c_1=c_1,
            c_2=c_2,
            force=self.force_at_1_mm_per_s_N,
            exponent=self.feedrate_exponent,
            operating_feedrate=MM_PER_M * self.operating_feedrate_m_per_s,
            steady_force=self.steady_force_N,
            linearised=self.linearised,
            feedrate_limit=MM_PER_M * self.feedrate_limit_m_per_s,
            force_limit=self.force_limit_N,
        )
        return SlotMillingSystem(process, setup, self.hold_input, n_lanes)

    def linear_system(self, sampling_time_s: float) -> LinearSystem:
        """Return the force for a feedrate, linear about the operating point; see `LinearisedPlant`."""
        c_1, c_2, c_3, c_4 = self.coefficients
        A, B, C = np.array([[-c_1, 1.0], [-c_2, 0.0]]), np.array([[c_4], [c_3]]), np.array([[1.0, 0.0]])
        return continuous(A, B, C, ["feedrate_m_per_s"], ["force_N"], sampling_time_s)

    def linear_models(self) -> tuple["Arx"]:
        """Return the one model, ``arx``."""
        return (Arx(process=self),)

    def settled(self, record: Record) -> tuple[int, FloatArray, FloatArray]:
        """Return the first settled sample, and u and y from there on."""
        first = math.ceil(self.settling_time_s / record.sampling_time_s - 1e-6)
        if record.n_samples - first < FEWEST_SAMPLES:
            raise RecordError(
                f"{record.source}: {record.n_samples} samples end within the settling time of {self.settling_time_s:g} "
                f"s; at least {first + FEWEST_SAMPLES} are needed."
            )
        u = record["feedrate_m_per_s"][first:] - self.operating_feedrate_m_per_s
        return first, u, record["force_N"][first:] - self.steady_force_N

    def transfer_function(self, record: Record) -> TransferFunction:
        """Return u, y and the orders of c_3 + c_4 s over s^2 + c_1 s + c_2."""
        _, u, y = self.settled(record)
        return TransferFunction(input=u, output=y, sampling_time_s=record.sampling_time_s, n_zeros=1, n_poles=2)

    def discretised(
        self, model: str, numerator: FloatArray, denominator: FloatArray, sampling_time_s: float
    ) -> Mapping[str, float]:
        """Return the parameters of ``arx`` for (c_3, c_4) and (c_2, c_1) under a held input."""
        self.linear_model(model)
        (c_3, c_4), (c_2, c_1) = numerator.tolist(), denominator.tolist()
        return dict(zip(NAMES, milling.discrete(c_1, c_2, c_3, c_4, sampling_time_s), strict=True))


@final
@dataclass(frozen=True, kw_only=True)
class Arx(LinearModel):
    """The model ``arx`` of slot milling; see `SlotMilling`."""

    process: SlotMilling
    name: str = MODEL

    def regression(self, record: Record) -> Regression:
        """Return y_k on the regressors -y_{k-1}, -y_{k-2}, u_{k-1}, u_{k-2} of the settled samples."""
        first, u, y = self.process.settled(record)
        return Regression(
            regressors=np.column_stack((-y[1:-1], -y[:-2], u[1:-1], u[:-2])),
            target=y[2:],
            names=NAMES,
            target_name="force_N",
            time_s=record["time_s"][first + 2 :],
            rows=np.arange(first + 2, record.n_samples),
            disturbance_gain=1.0,
        )

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return a_1, a_2, b_0, b_1 of the linearised process under a held input."""
        return dict(zip(NAMES, milling.discrete(*self.process.coefficients, sampling_time_s), strict=True))

    def physical_parameters(self, parameters: Mapping[str, float], sampling_time_s: float) -> Mapping[str, float]:
        """Return c_1 ... c_4 for discrete parameters, NaN where no second-order system has them."""
        a_1, a_2, b_0, b_1 = (parameters[name] for name in NAMES)
        values = milling.continuous(a_1, a_2, b_0, b_1, sampling_time_s)
        return dict(zip(COEFFICIENTS, values, strict=True))
