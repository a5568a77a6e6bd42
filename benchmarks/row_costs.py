"""What each estimator of a folder of results costs: time a row, time of a fit, memory of its worker.

    python benchmarks/row_costs.py RESULTS

Of each scenario the median over the seeds, of which the least and the most are printed; of the memory the largest of
all runs, with Python and its libraries, which are some 80 MB, and machine code. Times are those of the machine of the
run and of what else it did, without compiling; they are no part of a rank.
"""

import argparse
from pathlib import Path

import pandas as pd

from fdbench.benchmark.store import OK, Store

TIME = "microseconds_per_sample"


def table(scores: pd.DataFrame) -> list[str]:
    """Return the table in Markdown."""
    ok = scores[scores.status == OK]
    lines = ["| estimator | us a row | s a fit | MB |", "| --- | --- | --- | --- |"]
    for name, own in ok[ok.metric == TIME].groupby("estimator", sort=True):
        row, fit = own.groupby("scenario").value.median(), own.groupby("scenario").seconds.median()
        spans = span(row.min(), row.max()), span(fit.min(), fit.max())
        lines.append(f"| `{name}` | {' | '.join(spans)} | {own.peak_memory_MB.max():.0f} |")
    return lines


def span(low: float, high: float) -> str:
    """Return a range with two digits, or one number.

    >>> span(0.386, 105.0), span(8.46, 8.46)
    ('0.39 to 105', '8.5')
    """
    words = [f"{value:.2g}" if value < 10.0 else f"{value:.0f}" for value in (low, high)]
    return words[0] if words[0] == words[1] else " to ".join(words)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("results", type=Path)
    print("\n".join(table(Store(parser.parse_args().results).scores())))


if __name__ == "__main__":
    main()
