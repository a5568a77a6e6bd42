"""The pictures of one scenario: prediction and its error, disturbance, spectrum, stated bands; all of one seed."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.statistics import LEVEL
from fdbench.benchmark.store import Kept, RunKey, Store
from fdbench.errors import FdbenchError
from fdbench.metrics import Outcome
from fdbench.metrics._coverage import HALF_WIDTH
from fdbench.metrics._series import in_window
from fdbench.regression import FloatArray
from fdbench.report._figures import (
    FIRST_RANK,
    INK,
    LEGEND_ONLY,
    TRUTH,
    Panel,
    Style,
    band,
    labelled,
    line,
    stack,
)
from fdbench.report._page import Block, Figure, Trace, note
from fdbench.report._series import POINTS_FOR_A_BOUND, envelope, gaps, opening_range, peak, thinned
from fdbench.report._spectrum import spectrum
from fdbench.report._templates import Html
from fdbench.scenario import Scenario, Truth, load_scenario
from fdbench.wording import quantity, scaled

TIME = "time (s)"

# Part of the record that the detail of a disturbance shows.
DETAIL_PERIODS = 8.0
DETAIL_ROWS = 150


def known_scenario(name: str, digest: str) -> Scenario | None:
    """Return the scenario that results belong to, or None if it is not installed or has changed since."""
    try:
        scenario = load_scenario(name)
    except FdbenchError:
        return None
    return scenario if scenario.content_digest == digest else None


def pictures(
    store: Store, name: str, seed: int, scenario: Scenario | None, styles: Mapping[str, Style], n_points: int
) -> list[Block]:
    """Return the figures of a scenario, and what is missing in words."""
    kept = {estimator: store.read_estimate(RunKey(name, estimator, seed)) for estimator in styles}
    estimates = {estimator: one for estimator, one in kept.items() if one is not None}
    if not estimates:
        return [note(f"No estimate of seed {seed} is kept, so there are no pictures.")]
    case = _Case(store, name, seed, scenario, estimates, styles, n_points)
    blocks: list[Block] = [*case.remarks(), *case.output(), *case.disturbance()]
    if scenario is None:
        blocks.append(
            note("The file of this scenario is not installed under its name, or has changed since: no spectrum.")
        )
    else:
        unit = quantity(case.first.target_name)[1]
        blocks += spectrum(scenario, {name: case.outcomes[name] for name in case.outputs}, unit, styles)
    return [*blocks, *case.bands()]


@dataclass(frozen=True)
class _Claim:
    """What an estimator said of one quantity, beside what is right, over the same rows."""

    time_s: FloatArray
    value: FloatArray
    right: FloatArray
    variance: FloatArray | None

    @property
    def error(self) -> FloatArray:
        return self.right - self.value


@dataclass(frozen=True)
class _Case:
    store: Store
    name: str
    seed: int
    scenario: Scenario | None
    kept: Mapping[str, Kept]
    styles: Mapping[str, Style]
    n_points: int

    @cached_property
    def first(self) -> Kept:
        """Any estimate: time and target are the same in all."""
        return next(iter(self.kept.values()))

    @cached_property
    def outcomes(self) -> dict[str, Outcome]:
        """What the metrics were given, less the truth; empty without the scenario."""
        if self.scenario is None:
            return {}
        record = self.store.read_record(self.name, self.seed)
        regression = self.scenario.linear_model.regression(record)
        # A sealed run starts from another seed than the one of its row; the record has it.
        machine = self.scenario.drawn(int(record.provenance.get("seed", self.seed)))
        nothing = Truth(parameters={}, disturbance_N=None)
        return {
            name: Outcome(
                scenario=machine,
                record=record,
                regression=regression,
                truth=nothing,
                estimate=one.estimate,
                seconds=math.nan,
            )
            for name, one in self.kept.items()
        }

    @property
    def window(self) -> slice:
        """Rows in which the disturbance is scored."""
        outcome = next(iter(self.outcomes.values()), None)
        return slice(0, len(self.first.time_s)) if outcome is None else in_window(outcome)

    @cached_property
    def outputs(self) -> dict[str, _Claim]:
        return {
            name: _Claim(one.time_s, one.estimate.output, one.target, one.estimate.output_variance)
            for name, one in self.kept.items()
            if one.estimate.output is not None
        }

    @cached_property
    def true_disturbance_N(self) -> FloatArray | None:
        oracle = self.kept.get(ORACLE)
        return None if oracle is None else oracle.estimate.disturbance_N

    @property
    def disturbances(self) -> dict[str, FloatArray]:
        return {
            name: one.estimate.disturbance_N
            for name, one in self.kept.items()
            if one.estimate.disturbance_N is not None and name != ORACLE
        }

    # ---- figures ----

    def remarks(self) -> Iterator[Html]:
        """Return what has to be known to read the figures."""
        if (np.diff(self.first.time_s) <= 0.0).any():
            yield note(
                "Several series share the time, such as the axes of a stage; each is a curve of the same colour."
            )

    def output(self) -> Iterator[Figure]:
        """Return measured and predicted output, and below it the difference."""
        if not self.outputs:
            return
        errors = {name: one.error for name, one in self.outputs.items()}
        text, unit = quantity(self.first.target_name)
        factor, shown = scaled(unit, peak([self.first.target]))
        small, smaller = scaled(unit, peak(_visible(errors)))
        measured = _background("measured", *self._thinned(factor * self.first.target))
        predicted = self._curves({name: factor * one.value for name, one in self.outputs.items()})
        panels = [
            Panel(y_title=labelled(text, shown), traces=[measured, *predicted]),
            self._panel("prediction error", smaller, {name: small * error for name, error in errors.items()}),
        ]
        yield stack(
            "Output: measured and predicted",
            panels,
            TIME,
            "Above measured and predicted output, below measured minus predicted.",
        )

    def disturbance(self) -> Iterator[Figure]:
        """Return the disturbance over the whole record, and a few of its periods without the mean."""
        if not self.disturbances:
            return
        truth = self.true_disturbance_N
        factor, unit = scaled("N", peak(_visible(self.disturbances) if truth is None else [truth]))
        whole = self._panel("disturbance", unit, {name: factor * own for name, own in self.disturbances.items()})
        if truth is not None:
            whole = replace(whole, traces=[_background("truth", *self._thinned(factor * truth)), *whole.traces])
        states_variance = any(one.estimate.disturbance_variance_N2 is not None for one in self.kept.values())
        shaded = f" Shaded: stated {LEVEL:.0%} intervals." if states_variance else ""
        title = "Disturbance: estimated" if truth is None else "Disturbance: truth and estimates"
        yield stack(title, [replace(whole, height_px=300)], TIME)
        yield stack(
            "Disturbance: detail",
            [Panel(y_title=whole.y_title, traces=list(self._detail(factor)), height_px=300)],
            TIME,
            f"Each curve without its mean over the rows that are scored.{shaded}",
        )

    def _thinned(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        return thinned(self.first.time_s, values, self.n_points)

    def _panel(self, text: str, unit: str, series: Mapping[str, FloatArray]) -> Panel:
        return Panel(y_title=labelled(text, unit), traces=self._curves(series), y_range=opening_range(_visible(series)))

    def _curves(self, series: Mapping[str, FloatArray]) -> list[Trace]:
        """Return a line for each estimator: behind all the oracle, then restless before calm ones."""
        order = sorted(series, key=lambda name: (name != ORACLE, -float(np.std(series[name]))))
        return [self._curve(name, *self._thinned(series[name])) for name in order]

    def _curve(self, name: str, time_s: FloatArray, values: FloatArray) -> Trace:
        shown = {"visible": "legendonly"} if name in LEGEND_ONLY else {}
        rank = {"legendrank": FIRST_RANK + list(self.styles).index(name)}
        return line(name, time_s, values, self.styles[name]) | rank | shown

    def _detail(self, factor: float) -> Iterator[Trace]:
        rows, time_s = self._detail_rows(), self.first.time_s
        values = {name: factor * (own - own[self.window].mean())[rows] for name, own in self.disturbances.items()}
        for name, own in values.items():
            variance = self.kept[name].estimate.disturbance_variance_N2
            if variance is not None:
                half = factor * HALF_WIDTH * np.sqrt(variance[rows])
                yield from band(name, time_s[rows], own - half, own + half, self.styles[name])
        truth = self.true_disturbance_N
        if truth is not None:
            yield _background("truth", time_s[rows], factor * (truth - truth[self.window].mean())[rows])
        for name, own in values.items():
            points = {"mode": "lines+markers", "marker": {"size": 4, "color": self.styles[name].colour}}
            yield self._curve(name, time_s[rows], own) | points

    def _detail_rows(self) -> slice:
        """Return rows without a gap: in the middle of the window or, without a period, where the truth changes."""
        time_s, window = self.first.time_s, self.window
        period_s = None if self.scenario is None else self.scenario.estimation.disturbance_period_s
        centre = (window.start + window.stop) // 2
        if period_s is None:
            n_rows = DETAIL_ROWS
            if self.true_disturbance_N is not None:
                centre = window.start + int(np.argmax(np.abs(np.diff(self.true_disturbance_N[window]))))
        else:
            n_rows = math.ceil(DETAIL_PERIODS * period_s / float(np.median(np.diff(time_s))))
        cuts = gaps(time_s)
        number = int(np.searchsorted(cuts, centre, side="right"))
        first = 0 if number == 0 else int(cuts[number - 1])
        last = len(time_s) if number == len(cuts) else int(cuts[number])
        start = max(first, min(centre - n_rows // 2, last - n_rows))
        return slice(start, min(last, start + n_rows))

    def bands(self) -> Iterator[Figure]:
        """Return the errors of output and disturbance beside the intervals that estimators state for them."""
        unit = quantity(self.first.target_name)[1]
        yield from self._bands("Output", self.outputs, unit)
        truth, rows = self.true_disturbance_N, self.window
        if truth is None:
            return
        claims = {
            name: _Claim(
                self.first.time_s[rows],
                own[rows] - own[rows].mean(),
                truth[rows] - truth[rows].mean(),
                None if variance is None else variance[rows],
            )
            for name, own in self.disturbances.items()
            for variance in [self.kept[name].estimate.disturbance_variance_N2]
        }
        yield from self._bands("Disturbance without its mean", claims, "N")

    def _bands(self, text: str, claims: Mapping[str, _Claim], unit: str) -> Iterator[Figure]:
        panels = []
        for name, claim in claims.items():
            if claim.variance is None:
                continue
            half = HALF_WIDTH * np.sqrt(claim.variance)
            known = half[np.isfinite(half)]
            factor, shown = scaled(unit, peak([claim.error, known]))
            inside = float(np.mean(np.abs(claim.error) <= half))
            times, lower, upper = envelope(
                claim.time_s, -factor * half, factor * half, self.n_points // POINTS_FOR_A_BOUND
            )
            own = line(name, *thinned(claim.time_s, factor * claim.error, self.n_points), self.styles[name])
            panels.append(
                Panel(
                    y_title=labelled("error", shown),
                    heading=f"{name}: {inside:.1%} of {len(half)} rows inside",
                    traces=[
                        own | {"showlegend": False},
                        *band(name, times, lower, upper, Style(colour=INK), width=1.0),
                    ],
                    y_range=opening_range([factor * claim.error, factor * known, -factor * known]),
                    height_px=150,
                )
            )
        if panels:
            title = f"{text}: error and stated {LEVEL:.0%} interval"
            yield stack(title, panels, TIME, f"Right intervals hold {LEVEL:.0%} of the rows.")


def _background(name: str, time_s: FloatArray, values: FloatArray) -> Trace:
    """Return what is measured or true: a wide pale line that stays seen behind the estimates."""
    return line(name, time_s, values, Style(colour=TRUTH), width=4.0)


def _visible(series: Mapping[str, FloatArray]) -> list[FloatArray]:
    return [values for name, values in series.items() if name not in LEGEND_ONLY]
