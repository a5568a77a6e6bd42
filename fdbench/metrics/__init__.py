"""Scores of an estimate against the truth that it never saw: one metric, one file."""

from fdbench.metrics._metric import Metric, Outcome, metrics

__all__ = ["Metric", "Outcome", "metrics"]
