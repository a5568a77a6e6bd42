"""How the diagnosis did on virtual machines like the measured one."""

from dataclasses import dataclass

from fdbench.diagnosis.answer.quantity import Pair


@dataclass(frozen=True, kw_only=True)
class VirtualMachines:
    """How the diagnosis did on virtual machines like the measured one, whose causes are known.

    Attributes
    ----------
    cases : int
    with_cause, named_rightly : int
        Those with a cause that the library has, and those of them of which the cause that was named first is there.
    rightly_ci95 : pair of float
        Interval of that share.
    without_cause, named_falsely : int
        Those with nothing, and those of them of which a cause was named.
    compared : int
        Those without a cause that the library lacks.
    likeness : float
        Conformal p-value of the measured machine among these, by what is left beside all effects.
    """

    cases: int
    with_cause: int
    named_rightly: int
    rightly_ci95: Pair
    without_cause: int
    named_falsely: int
    compared: int
    likeness: float
