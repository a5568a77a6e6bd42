"""Self-contained HTML pages, with figures, that work offline."""

from fdbench.report.results import write_report

__all__ = ["write_report"]
