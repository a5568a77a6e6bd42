"""What a plant is: the nominal system, how it is simulated, and the linear models that estimators identify."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import SpecError, did_you_mean
from fdbench.plants._spectra import Spectra
from fdbench.record import FloatArray, Record
from fdbench.registry import Registry
from fdbench.regression import Regression
from fdbench.simulate.system import Setup, System
from fdbench.specification import check_bounds, reads_plugins_of


class LinearModel(ABC):
    """A model of a plant that is linear in its parameters, for estimators.

    Attributes
    ----------
    name : str
        As a scenario's ``estimation.model`` names it.
    """

    name: str

    @abstractmethod
    def regression(self, record: Record) -> Regression:
        """Return the model filled with the samples of a record."""

    def nominal_parameters(self, sampling_time_s: float) -> Mapping[str, float]:
        """Return the parameters that follow from the nominal values; none by default."""
        return {}

    def physical_parameters(self, parameters: Mapping[str, float], sampling_time_s: float) -> Mapping[str, float]:
        """Return masses, frictions and so on that follow from the parameters; none by default."""
        return {}

    def free_run(self, command: Record, parameters: Mapping[str, float]) -> FloatArray | None:
        """Return the model's target (n_rows,) that parameters predict from a command alone, or None.

        None where the target cannot be told from the command, as that of an observer.
        """
        return None


class Plant(ABC):
    """A frozen specification of a nominal system; file name = ``kind`` in a scenario."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        check_bounds(self)

    @abstractmethod
    def linear_models(self) -> tuple[LinearModel, ...]:
        """Return the linear models that this plant offers to estimators."""

    def models(self) -> tuple[str, ...]:
        """Return the names of the linear models."""
        return tuple(model.name for model in self.linear_models())

    def linear_model(self, name: str) -> LinearModel:
        """Return the linear model of a name.

        Raises
        ------
        SpecError
            If the plant offers none of this name; the message gives the nearest one.
        """
        for model in self.linear_models():
            if model.name == name:
                return model
        raise SpecError(f"model '{name}' is not offered by this {type(self).name}.{did_you_mean(name, self.models())}")

    @property
    def table_limits(self) -> tuple[float, float] | None:
        """Travel (m, to either side) and velocity (m/s) of an axis that can begin anywhere; None for other plants."""
        return None

    @abstractmethod
    def system(self, setup: Setup, n_lanes: int = 1) -> System:
        """Return ``n_lanes`` instances of the plant as they are simulated."""


@runtime_checkable
class RespondingPlant(Protocol):
    """A plant whose nominal model predicts the measured output from the command alone."""

    def nominal_response(self, record: Record) -> FloatArray:
        """Return the predicted output (n_rows,), for the rows of the plant's regression."""
        ...


@runtime_checkable
class StateSpacePlant(Protocol):
    """A nominal plant as a linear state-space model for observers; see `StateSpace`."""

    def state_space(self, sampling_time_s: float) -> "StateSpace":
        """Return the model at a sampling time."""
        ...


@runtime_checkable
class NetworkPlant(StateSpacePlant, Protocol):
    """A plant whose outputs are read by nodes of their own, which tell their neighbours."""

    def neighbours(self) -> NDArray[np.bool_]:
        """Return which nodes hear each other, (n_outputs, n_outputs), symmetric and true on the diagonal."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    r"""Nominal continuous model :math:`\dot x = A x + B u + E F, \; y = C x` with disturbance force F.

    Attributes
    ----------
    A, B, E, C : (n, n), (n, n_inputs), (n,), (n_outputs, n) arrays
    inputs, outputs : tuple of str
        Columns of the record that u and y are; u is held over each sampling time. The first output is the target of
        the plant's regression ``state_space``, whose readings are u and y.
    input_variances, output_variances : (n_inputs,), (n_outputs,) arrays
        Variance of each reading, per sample; readings of different columns are independent.
    initial_variances : (n,) array
        How far from zero each state may start.
    process_variances : (n,) array
        What a sampling time adds to the variance of each state beside the force and the inputs.
    """

    A: FloatArray
    B: FloatArray
    E: FloatArray
    C: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_variances: FloatArray
    output_variances: FloatArray
    initial_variances: FloatArray
    process_variances: FloatArray


@runtime_checkable
class TransferFunctionPlant(Protocol):
    """A nominal plant as a rational transfer function of known orders; see `TransferFunction`."""

    def transfer_function(self, record: Record) -> "TransferFunction":
        """Return the orders and the measured signals."""
        ...

    def discretised(
        self, model: str, numerator: FloatArray, denominator: FloatArray, sampling_time_s: float
    ) -> Mapping[str, float]:
        """Return the parameters of ``model`` for coefficients in ascending powers of s, the leading 1 left out."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferFunction:
    r"""Structure :math:`G(s) = (q_0 + q_1 s + \dots + q_m s^m) / (p_0 + p_1 s + \dots + s^n)` and its signals.

    Attributes
    ----------
    input, output : (n_rows,) arrays
        Deviations from the operating point, over whole periods where the input is periodic.
    sampling_time_s : float
    n_zeros, n_poles : int
        m and n.
    """

    input: FloatArray
    output: FloatArray
    sampling_time_s: float
    n_zeros: int
    n_poles: int


@runtime_checkable
class SpectralPlant(Protocol):
    """A plant whose record is a series of segments, in which lines of vibration go with lines of a force."""

    def spectra(self, record: Record) -> Spectra:
        """Return the spectra of all segments; the force of those that are not for training is withheld."""
        ...


plants: Registry[Plant] = Registry("plant", Plant)  # type: ignore[type-abstract]
reads_plugins_of(plants)
