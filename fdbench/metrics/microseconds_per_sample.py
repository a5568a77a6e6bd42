"""How long the estimator takes."""

from typing import final

from fdbench.metrics._metric import Metric, Outcome


@final
class MicrosecondsPerSample(Metric):
    r"""Time of ``fit`` for one row of the regression.

    .. math:: 10^6 \, t_{fit} / n

    An online estimator can follow a drive if it stays below the sampling time; a batch estimator gives its total time.

    Validity: one run on one machine, which other work slows down; compile times are the runner's to keep out. Not a
    function of the seed: changes below ``practical_limit``, a fifth, are noise of the machine.

    ``worst`` is a second for each sample.

    Examples
    --------
    Four rows in 2 ms.

    >>> from fdbench.estimator import Estimate
    >>> from fdbench.metrics import example_outcome
    >>> MicrosecondsPerSample().score(example_outcome(Estimate(), target=[0.0] * 4, seconds=2e-3))
    500.0
    """

    unit = "us"
    worst = 1e6
    track = "speed"
    practical_limit = 0.2

    def skip(self, outcome: Outcome) -> str | None:
        return None

    def score(self, outcome: Outcome) -> float:
        return 1e6 * outcome.seconds / len(outcome.regression.target)
