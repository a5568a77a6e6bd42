"""What an estimator is given, what it does and what it returns.

A researcher writes one class in one file; ``Context`` and ``Record`` are all that it can see, and the truth is
in neither of them.
"""

import inspect
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from fdbench.errors import PluginError, did_you_mean
from fdbench.plants._plant import LinearModel, Plant
from fdbench.record import Record
from fdbench.registry import Registry
from fdbench.regression import Regression, Sample, samples
from fdbench.specification import convert

FloatArray = NDArray[np.float64]

__all__ = [
    "BatchEstimator",
    "Context",
    "Estimate",
    "Estimator",
    "OnlineEstimator",
    "Regression",
    "Sample",
    "estimators",
    "samples",
]


@dataclass(frozen=True, kw_only=True)
class Context:
    """What a user of a real drive would know before the record is taken.

    The machine under the record is another one: its values lie about the nominal ones, as its data sheet says.

    Attributes
    ----------
    sampling_time_s : float
        Clock of the record.
    plant : Plant
        The nominal plant, with the nominal parameters.
    model : str
        Which linear model of the plant is to be identified, such as ``"velocity_loop"``.
    disturbance_period_s : float or None
        Nominal period of the spindle or shaker, where one runs; a spindle slips.
    disturbance_pitch_m : float or None
        Nominal pitch of the motor's magnets, where the disturbance repeats with the position.
    covariance : (n_parameters, n_parameters) array or None
        How far the parameters may be from their nominal values, in the order of ``nominal``; None where the data sheet
        does not say.
    """

    sampling_time_s: float
    plant: Plant
    model: str
    disturbance_period_s: float | None = None
    disturbance_pitch_m: float | None = None
    covariance: FloatArray | None = None

    @property
    def linear_model(self) -> LinearModel:
        """The linear model that is to be identified."""
        return self.plant.linear_model(self.model)

    @property
    def nominal(self) -> Mapping[str, float]:
        """Parameters of the model as they follow from the data sheet."""
        return self.linear_model.nominal_parameters(self.sampling_time_s)

    def regression(self, record: Record) -> Regression:
        """Return the nominal plant's linear model, filled with the samples of ``record``."""
        return self.linear_model.regression(record)


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What an estimator claims; every part is optional, and only what is claimed is scored.

    Attributes
    ----------
    parameters : mapping of str to float
        Named parameters, in the order of ``covariance``.
    covariance : (n_parameters, n_parameters) array or None
        Covariance of ``parameters``.
    disturbance_N : (n_rows,) array or None
        Disturbance force against positive motion, one value for each row of the regression.
    disturbance_variance_N2 : (n_rows,) array or None
        Its variance.
    output : (n_rows,) array or None
        Prediction of the regression's target.
    output_variance : (n_rows,) array or None
        Its variance, that of a new observation.
    """

    parameters: Mapping[str, float] = field(default_factory=dict)
    covariance: FloatArray | None = None
    disturbance_N: FloatArray | None = None
    disturbance_variance_N2: FloatArray | None = None
    output: FloatArray | None = None
    output_variance: FloatArray | None = None


class Estimator(ABC):
    """Common part of both kinds: registered by file name, every constructor argument has a default.

    Class attributes
    ----------------
    made_for : tuple of str or None
        What the method is for: models as ``Context.model`` names them, or kinds of plant; None: anything. On others it
        is only run where it is selected by name.
    """

    name: ClassVar[str]
    made_for: ClassVar[tuple[str, ...] | None] = None
    expected_failures: ClassVar[Mapping[str, str]] = {}

    def skip(self, context: Context) -> str | None:
        """Return why this estimator does not apply to the scenario, or None if it does."""
        return None

    @abstractmethod
    def fit(self, context: Context, record: Record) -> Estimate:
        """Estimate from a whole record."""

    def predict(self, context: Context, estimate: Estimate, command: Record) -> FloatArray | None:
        """Return the model's target for a command that was never tried, by a free run: nothing of it is measured.

        Parameters
        ----------
        context : Context
        estimate : Estimate
            What ``fit`` of this very estimator has just returned.
        command : Record
            The command's columns alone, such as ``reference_position_m``.

        Returns
        -------
        (n_rows,) array or None
            One value for each row that the regression of a record of this length has; None makes no claim. By default
            the plant's model with the estimated parameters, where ``estimate`` has them all.
        """
        if any(name not in estimate.parameters for name in context.nominal):
            return None
        return context.linear_model.free_run(command, estimate.parameters)


class BatchEstimator(Estimator):
    """An estimator that needs the whole record at once; implement ``fit``."""


class OnlineEstimator(Estimator):
    """An estimator that is recursive by nature: ``start``, then ``update`` for each sample, ``estimate`` any time.

    ``fit`` drives the three over a record. An estimator with a compiled loop may implement ``fit`` too; the
    shared checks hold both ways against each other.
    """

    @abstractmethod
    def start(self, context: Context) -> None:
        """Forget everything and prepare for a record of ``context``."""

    @abstractmethod
    def update(self, sample: Sample) -> None:
        """Take in one sample."""

    @abstractmethod
    def estimate(self) -> Estimate:
        """Return the estimate after the samples seen so far, with one row for each of them."""

    def fit(self, context: Context, record: Record) -> Estimate:
        """Stream the record through ``update``."""
        self.start(context)
        for sample in samples(context.regression(record)):
            self.update(sample)
        return self.estimate()


estimators: Registry[Estimator] = Registry("estimator", Estimator)  # type: ignore[type-abstract]


def construct(name: str, arguments: Mapping[str, Any]) -> Estimator:
    """Return an estimator made with some arguments; the others keep their defaults.

    Raises
    ------
    PluginError
        If it has no such argument; the message names the nearest one.
    SpecError
        If a value is of another type than the default. A default of None, or of none of TOML's plain types, says
        nothing of the type.
    """
    cls = estimators.get(name)
    return cls(**{key: checked_argument(name, key, value) for key, value in arguments.items()})


def checked_argument(name: str, argument: str, value: Any) -> Any:
    """Return the value of an argument of an estimator as its default's type; see `construct`."""
    allowed = inspect.signature(estimators.get(name)).parameters
    if argument not in allowed:
        raise PluginError(f"{name} has no argument '{argument}'.{did_you_mean(argument, allowed)}")
    kind = type(allowed[argument].default)
    return convert(kind, value, f"{name}.{argument}") if kind in (bool, int, float, str) else value
