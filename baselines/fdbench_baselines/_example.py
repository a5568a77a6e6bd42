"""Small machines and noise-free records whose answer is known, for the worked examples of estimators."""

from dataclasses import replace
from typing import NamedTuple, cast

import numpy as np

from fdbench.estimator import Context, FloatArray, Regression
from fdbench.plants import Plant
from fdbench.plants._controllers import VelocityLoop
from fdbench.plants._plant import LinearModel
from fdbench.plants._spectra import Spectra
from fdbench.plants._spindle_modal import ComplianceMode
from fdbench.plants._spindle_testbed_machine import HousingMode, SpindleTestbedMachine
from fdbench.plants._spindle_testbed_plan import SpindleSpeeds
from fdbench.plants.feed_drive import FeedDrive, LinearMotor, RotaryMotor
from fdbench.plants.sensor_network import NODES, Deviations, SensorNetwork
from fdbench.plants.slot_milling import SlotMilling
from fdbench.plants.spindle import Spindle
from fdbench.plants.spindle_testbed import SpindleTestbed
from fdbench.record import Record


class Example(NamedTuple):
    """What an estimator's ``fit`` takes."""

    context: Context
    record: Record


def example_drive(
    mass_ratio: float = 1.0, force_N: float = 0.0, wave_N: float = 0.0, period_s: float | None = None
) -> Example:
    r"""Return a drive of 10 kg on its data sheet, beta_1 = beta_2 = 0.5, in a velocity loop of 10 ms.

    .. math:: v_{k+1} = v_k + \beta_1 (v_{r,k} - v_k - d_k / K), \qquad \beta_1 = K T_s / m, \quad K = 500 \text{ N s/m}

    Parameters
    ----------
    mass_ratio : float
        Of the machine under the record to the data sheet.
    force_N, wave_N : float
        Constant disturbance d, and the amplitude of a sine of ``period_s``.
    period_s : float, optional
        Which the context knows.

    >>> context, record = example_drive()
    >>> dict(context.nominal), record.n_samples
    ({'beta_1': 0.5, 'beta_2': 0.5}, 400)
    """
    n, sampling_time_s, mass_kg, gain = 400, 0.01, 10.0, 500.0
    drive = FeedDrive(
        motor=LinearMotor(mass_kg=mass_kg, viscous_friction_N_s_per_m=0.0),
        controller=VelocityLoop(gain_N_s_per_m=gain, force_limit_N=1e4),
        travel_m=10.0,
        velocity_limit_m_per_s=10.0,
    )
    context = Context(
        sampling_time_s=sampling_time_s, plant=drive, model="velocity_loop", disturbance_period_s=period_s
    )
    time_s = sampling_time_s * np.arange(n, dtype=np.float64)
    reference = np.array([0.1, -0.05, 0.05, -0.1])[np.arange(n) // 25 % 4]
    disturbance = force_N + wave_N * np.sin(2.0 * np.pi * time_s / (period_s or 1.0))
    beta_1, velocity = gain * sampling_time_s / (mass_kg * mass_ratio), np.zeros(n)
    for k in range(n - 1):
        velocity[k + 1] = velocity[k] + beta_1 * (reference[k] - velocity[k] - disturbance[k] / gain)
    columns = {"reference_velocity_m_per_s": reference, "velocity_m_per_s": velocity}
    return Example(context, Record({"time_s": time_s, **columns}))


def example_cogging(cogging_N: float, pitch_m: float = 0.02, told_m: float | None = None) -> Example:
    r"""Return the drive of `example_drive` on its data sheet, at other speeds over magnets.

    .. math:: d_k = A \sin(2 \pi x_k / \lambda), \qquad x_{k+1} = x_k + \tfrac12 T_s (v_k + v_{k+1})

    A noise of 1 um/s keeps its record from being exact.

    Parameters
    ----------
    cogging_N, pitch_m : float
        A and :math:`\lambda`.
    told_m : float, optional
        Pitch that the context knows.

    >>> example_cogging(cogging_N=0.0).record.n_samples
    1600
    """
    context, _ = example_drive()
    n, step_s, beta, gain = 1600, context.sampling_time_s, 0.5, 500.0
    time_s = step_s * np.arange(n, dtype=np.float64)
    reference = np.array([0.05, 0.02, -0.03, -0.04])[np.arange(n) // 200 % 4]
    noise = 1e-6 * np.random.default_rng(0).standard_normal(n)
    velocity, place = np.zeros(n), 0.0
    for k in range(n - 1):
        force = cogging_N * np.sin(2.0 * np.pi * (place + 0.5 * step_s * velocity[k]) / pitch_m)
        velocity[k + 1] = velocity[k] + beta * (reference[k] - velocity[k] - force / gain) + noise[k]
        place += 0.5 * step_s * (velocity[k] + velocity[k + 1])
    columns = {"reference_velocity_m_per_s": reference, "velocity_m_per_s": velocity}
    return Example(replace(context, disturbance_pitch_m=told_m), Record({"time_s": time_s, **columns}))


class GivenSpectra(LinearModel):
    """Stands for a plant that is measured in segments, and for its one linear model: the spectra are given."""

    def __init__(self, spectra: Spectra) -> None:
        self._spectra = spectra

    def spectra(self, record: Record) -> Spectra:
        """Return the given spectra, whatever the record."""
        return self._spectra

    def linear_model(self, name: str) -> "GivenSpectra":
        """Return this one."""
        return self

    def regression(self, record: Record) -> Regression:
        """Return the withheld samples as rows without regressors."""
        length, withheld = self._spectra.samples_per_segment, ~self._spectra.training
        rows = np.flatnonzero(np.repeat(withheld, length))
        return Regression(
            regressors=np.empty((len(rows), 0)),
            target=np.zeros(len(rows)),
            names=(),
            target_name="force_N",
            time_s=np.asarray(record.sampling_time_s * rows, dtype=np.float64),
            rows=rows,
            disturbance_gain=1.0,
        )


def example_spectra(power: int) -> Example:
    r"""Return segments of eight samples with one line, whose force is :math:`2 x^p`, x being the acceleration.

    The last segment is withheld: a line of 3 m/s^2 in the cosine, 0 in the sine.
    """
    x = np.array([*np.random.default_rng(0).uniform(-2.0, 2.0, (20, 2)), [3.0, 0.0]])
    training = np.arange(len(x)) < len(x) - 1
    targets = np.where(training[:, None], 2.0 * x**power, 0.0)
    plant = GivenSpectra(Spectra(features=x, targets=targets, training=training, samples_per_segment=8))
    context = Context(sampling_time_s=0.001, plant=cast(Plant, plant), model="inverse_frequency_response")
    return Example(context, Record({"time_s": 0.001 * np.arange(8 * len(x), dtype=np.float64)}))


def example_testbed() -> Example:
    r"""Return a spindle testbed at 10, 12, ... 20 Hz and 100, 200, 300 N, and 0.5 s of each; 14 Hz is withheld.

    The force is a pulse at the trigger, of equal cosines in all orders up to 80 Hz, on a housing that is nearly a
    spring; each order has 1 m/s^2 more, without force:

    .. math:: F = A \sum_m \cos m \Omega t, \qquad a = \sum_m \mathrm{Re} (1 + A H(m \Omega)) e^{j m \Omega t}
    """
    sampling_time_s, segment_s, bandwidth_Hz, levels_N = 0.005, 0.5, 80.0, np.array([100.0, 200.0, 300.0])
    speeds_Hz, withheld_Hz = np.linspace(10.0, 20.0, 6), 14.0
    machine = SpindleTestbedMachine(
        pulse_width_rad=0.01,
        harmonics=8,
        highest_frequency_Hz=bandwidth_Hz,
        modes=(
            HousingMode(frequency_Hz=1000.0, damping_ratio=0.05, mass_kg=0.1, frequency_change=0.0, damping_change=0.0),
        ),
        cage_depth=0.0,
        cage_order=0.5,
        nonlinear_acceleration_m_per_s2=1e9,
        angle_jitter_rad=0.0,
        force_deviation=0.0,
    )
    plant = SpindleTestbed(
        lowest_speed_rad_per_s=2.0 * np.pi * speeds_Hz[0],
        highest_speed_rad_per_s=2.0 * np.pi * speeds_Hz[-1],
        n_speeds=len(speeds_Hz),
        lowest_force_N=levels_N[0],
        highest_force_N=levels_N[-1],
        n_forces=len(levels_N),
        segment_s=segment_s,
        segments_per_condition=1,
        bandwidth_Hz=bandwidth_Hz,
        force_limit_N=1e4,
        acceleration_limit_m_per_s2=100.0,
        withheld=SpindleSpeeds(speeds_rad_per_s=(2.0 * np.pi * withheld_Hz,)),
        machine=machine,
    )
    n = round(segment_s / sampling_time_s)
    time_s, conditions = sampling_time_s * np.arange(n), []
    for speed_Hz in speeds_Hz:
        omega = 2.0 * np.pi * speed_Hz * np.arange(1, int(bandwidth_Hz / speed_Hz) + 1)
        response, waves = machine.accelerance(omega, speed_Hz / speeds_Hz[-1]), np.exp(1j * np.outer(time_s, omega))
        measured = np.full(n, float(speed_Hz != withheld_Hz))
        for level_N in levels_N:
            acceleration = (waves @ (1.0 + level_N * response)).real
            conditions.append((acceleration, measured * level_N * waves.real.sum(axis=1), measured))
    columns = dict(zip(("acceleration_m_per_s2", "force_N", "training_sample"), np.hstack(conditions), strict=True))
    columns["time_s"] = sampling_time_s * np.arange(len(columns["force_N"]), dtype=np.float64)
    context = Context(sampling_time_s=sampling_time_s, plant=plant, model="inverse_frequency_response")
    return Example(context, Record(columns))


def example_network(force_N: float) -> Example:
    """Return a spindle and a motor of 10 kg, each read by a node, and 0.2 s under a constant force."""
    n, sampling_time_s, mass_kg, lead_m = 2000, 1e-4, 10.0, 0.01
    # As many modes as in the scenarios: filters are compiled for a number of states.
    modes = tuple(
        ComplianceMode(frequency_Hz=frequency_Hz, damping_ratio=0.05, modal_gain_per_kg=40.0)
        for frequency_Hz in (800.0, 1000.0, 1200.0)
    )
    spindle = Spindle(modes=modes, sensor_noise_m=1e-7, displacement_limit_m=1e-3, feedrate_limit_m_per_s=0.1)
    inertia = mass_kg * (lead_m / (2.0 * np.pi)) ** 2
    plant = SensorNetwork(
        spindle=spindle,
        motor=RotaryMotor(inertia_kg_m2=inertia, lead_m=lead_m, viscous_friction_N_s_per_m=0.0),
        velocity_noise_m_per_s=1e-5,
        position_noise_m=1e-7,
        travel_m=10.0,
        velocity_limit_m_per_s=10.0,
        links=((NODES[0], NODES[1]), (NODES[1], NODES[2])),
        initial=Deviations(displacement_m=1e-6, velocity_m_per_s=1e-3, position_m=1e-4),
        process=Deviations(displacement_m=1e-11, velocity_m_per_s=1e-9, position_m=1e-11),
    )
    time_s = sampling_time_s * np.arange(n, dtype=np.float64)
    acceleration = -force_N / mass_kg
    columns: dict[str, FloatArray] = {
        NODES[0]: np.full(n, sum(mode.compliance_m_per_N for mode in modes) * force_N),
        NODES[1]: acceleration * time_s,
        NODES[2]: 0.5 * acceleration * time_s**2,
    }
    context = Context(sampling_time_s=sampling_time_s, plant=plant, model="state_space")
    return Example(context, Record({"time_s": time_s, **columns}))


def example_milling() -> Example:
    """Return slot milling on its data sheet and its force for a feedrate of five waves about the operating point."""
    plant = SlotMilling(
        specific_cutting_force_N=150.0,
        depth_exponent=1.0,
        feedrate_exponent=1.0,
        depth_of_cut_m=0.002,
        damping_ratio=0.5,
        natural_frequency_rad_per_s=20.0,
        operating_feedrate_m_per_s=1e-3,
        settling_time_s=0.0,
        feedrate_limit_m_per_s=1e-2,
        force_limit_N=1e3,
        linearised=True,
        hold_input=False,
    )
    n, sampling_time_s = 200, 0.01
    time_s = sampling_time_s * np.arange(n, dtype=np.float64)
    omega = 2.0 * np.pi * np.arange(1, 6) / (n * sampling_time_s)
    c_1, c_2, c_3, c_4 = plant.coefficients
    response = (c_3 + 1j * c_4 * omega) / (c_2 - omega**2 + 1j * c_1 * omega)
    waves = 1e-5 * np.exp(1j * np.outer(time_s, omega))
    columns = {
        "feedrate_m_per_s": plant.operating_feedrate_m_per_s + waves.real.sum(axis=1),
        "force_N": plant.steady_force_N + (waves * response).real.sum(axis=1),
    }
    context = Context(sampling_time_s=sampling_time_s, plant=plant, model="arx")
    return Example(context, Record({"time_s": time_s, **columns}))
