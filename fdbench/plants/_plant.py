"""What a plant is: the nominal system on paper, how it is simulated, and the linear models that estimators identify."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from fdbench.registry import Registry
from fdbench.simulate.system import Setup, System
from fdbench.specification import check_bounds, reads_plugins_of

if TYPE_CHECKING:
    from fdbench.estimator import Regression
    from fdbench.record import Record


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


plants: Registry[Plant] = Registry("plant", Plant)  # type: ignore[type-abstract]
reads_plugins_of(plants)
