"""The commands as functions, for scripts and notebooks: what they find comes back as tables, figures and cards.

``from fdbench import diagnose, run, compare``; the command line calls these same functions.
"""

from fdbench.api._diagnosis import DiagnosisResult, diagnose
from fdbench.api._runs import ComparisonResult, RunResult, compare, run

__all__ = ["ComparisonResult", "DiagnosisResult", "RunResult", "compare", "diagnose", "run"]
