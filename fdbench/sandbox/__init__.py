"""Estimators in processes of their own, which hold the record and the context, and from which nothing else is in reach.

A *fork server* (`fdbench.sandbox.server`) imports what estimators need once. It forks a *worker*
(`fdbench.sandbox.worker`) for each estimator, which confines itself (`fdbench.sandbox.confine`)
before it imports a plug-in. The process that holds the truth talks to workers through `fdbench.sandbox.parent`, and
never unpickles what they say (`fdbench.sandbox.message`).
"""

from fdbench.sandbox.claims import check_kinds
from fdbench.sandbox.confine import confinement
from fdbench.sandbox.parent import Sandbox, Worker
from fdbench.sandbox.terms import Declaration, FitResult, Misbehaved, Source, WorkerLimits, own_files

__all__ = [
    "Declaration",
    "FitResult",
    "Misbehaved",
    "Sandbox",
    "Source",
    "Worker",
    "WorkerLimits",
    "check_kinds",
    "confinement",
    "own_files",
]
