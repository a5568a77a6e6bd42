"""Scores of an estimate against the truth that it never saw: one metric, one file."""

from fdbench.metrics._example import example_outcome, example_segments
from fdbench.metrics._metric import Metric, Outcome, metrics

__all__ = ["Metric", "Outcome", "example_outcome", "example_segments", "metrics"]
