"""What a plant is: the nominal system on paper, how it is simulated, and the linear models that estimators identify."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

from fdbench.record import FloatArray, Record
from fdbench.registry import Registry
from fdbench.regression import Regression
from fdbench.simulate.system import Setup, System
from fdbench.specification import check_bounds, reads_plugins_of


class Plant(ABC):
    """A frozen specification of a nominal system; file name = ``kind`` in a scenario."""

    name: ClassVar[str]

    def __post_init__(self) -> None:
        check_bounds(self)

    @abstractmethod
    def models(self) -> tuple[str, ...]:
        """Return the names of the linear models that this plant offers to estimators."""

    @abstractmethod
    def regression(self, record: Record, model: str) -> Regression:
        """Return the linear model ``model`` filled with the samples of ``record``."""

    @abstractmethod
    def true_parameters(self, model: str, sampling_time_s: float) -> Mapping[str, float]:
        """Return the parameters of ``model`` that follow from the values on paper."""

    @abstractmethod
    def physical_parameters(
        self, model: str, parameters: Mapping[str, float], sampling_time_s: float
    ) -> Mapping[str, float]:
        """Return masses, frictions and so on that follow from the parameters of ``model``."""

    @abstractmethod
    def system(self, setup: Setup, n_lanes: int = 1) -> System:
        """Return ``n_lanes`` instances of the plant as they are simulated."""


@runtime_checkable
class RespondingPlant(Protocol):
    """A plant whose model on paper predicts the measured output from the command alone."""

    def nominal_response(self, record: Record) -> FloatArray:
        """Return the predicted output (n_rows,), for the rows of the plant's regression."""
        ...


@runtime_checkable
class StateSpacePlant(Protocol):
    """A plant on paper as a linear state-space model for observers; see `StateSpace`."""

    def state_space(self, sampling_time_s: float) -> "StateSpace":
        """Return the model at a sampling time."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class StateSpace:
    r"""Continuous model :math:`\dot x = A x + B u + E F, \; y = C x` with disturbance force F.

    Attributes
    ----------
    A, B, E, C : (n, n), (n, n_inputs), (n,), (n_outputs, n) arrays
    inputs, outputs : tuple of str
        Columns of the record that u and y are.
    output_variances : (n_outputs,) array
        Variance of each reading, per sample.
    """

    A: FloatArray
    B: FloatArray
    E: FloatArray
    C: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    output_variances: FloatArray


plants: Registry[Plant] = Registry("plant", Plant)  # type: ignore[type-abstract]
reads_plugins_of(plants)
