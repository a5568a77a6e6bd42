"""The pictures of one scenario: errors and stated bands of every estimator on one scale, spectrum; all of one seed."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fdbench.benchmark.oracle import NAME as ORACLE
from fdbench.benchmark.selection import NULL
from fdbench.benchmark.statistics import LEVEL
from fdbench.benchmark.store import Kept, RunKey, Store
from fdbench.metrics import Outcome
from fdbench.metrics._coverage import HALF_WIDTH
from fdbench.metrics._series import in_window
from fdbench.regression import FloatArray
from fdbench.report._figures import TRUTH, Band, Curve, Figure, Panel, Style, labelled, style_of
from fdbench.report._page import Block, Folded, Grid, note
from fdbench.report._series import POINTS_FOR_A_BOUND, envelope, gaps, peak, thinned
from fdbench.report._spectrum import spectrum
from fdbench.report._templates import Html
from fdbench.scenario import Scenario, Truth
from fdbench.wording import quantity, scaled, si_text

TIME = "time (s)"
SHOWN = 3  # estimators that are drawn at once; the others follow when opened
PANEL_PX, SMALL_PX = 90, 130
ROOM, SMALL_ROOM = 1.25, 1.7  # of a common scale beyond its values

# Part of the record that the detail of a disturbance shows.
DETAIL_PERIODS = 8.0
DETAIL_ROWS = 150
DETAIL_POINTS = 500  # of a series in it, on half of the width of a page


def pictures(
    store: Store,
    name: str,
    seed: int,
    scenario: Scenario | None,
    ranked: Mapping[str, Sequence[str]],
    n_points: int,
    is_crowded: bool,
) -> list[Block]:
    """Return the figures of a scenario, and what is missing in words.

    Parameters
    ----------
    ranked : mapping of str to sequence of str
        By track, all estimators, best first.
    n_points : int
        Of a series.
    is_crowded : bool
        Periods of the disturbance are drawn of the best estimators alone; errors always of all.
    """
    kept = {estimator: store.read_estimate(RunKey(name, estimator, seed)) for estimator in next(iter(ranked.values()))}
    estimates = {estimator: one for estimator, one in kept.items() if one is not None}
    if not estimates:
        return [note(f"No estimate of seed {seed} is kept, so there are no pictures.")]
    case = _Case(store, name, seed, scenario, estimates, ranked, n_points, is_crowded)
    blocks: list[Block] = [*case.remarks(), *case.disturbance(), *case.output()]
    if scenario is None:
        blocks.append(
            note("The file of this scenario is not installed under its name, or has changed since: no spectrum.")
        )
    else:
        unit, outputs = quantity(case.first.target_name)[1], list(case.outputs)
        hidden = [name for name in outputs[SHOWN:] if name != ORACLE]
        blocks += spectrum(scenario, {name: case.outcomes[name] for name in outputs}, unit, hidden, n_points)
    return blocks


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

    @property
    def half_width(self) -> FloatArray | None:
        """Of the stated interval."""
        return None if self.variance is None else HALF_WIDTH * np.sqrt(self.variance)


@dataclass(frozen=True)
class _Case:
    store: Store
    name: str
    seed: int
    scenario: Scenario | None
    kept: Mapping[str, Kept]
    ranked: Mapping[str, Sequence[str]]
    n_points: int
    is_crowded: bool

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

    def _ordered(self, track: str) -> Iterator[tuple[str, Kept]]:
        """Yield the kept estimates, the best of a track first, null and oracle last."""
        names = sorted(self.ranked[track], key=lambda name: name in (NULL, ORACLE))
        yield from ((name, self.kept[name]) for name in names if name in self.kept)

    @cached_property
    def outputs(self) -> dict[str, _Claim]:
        return {
            name: _Claim(one.time_s, one.estimate.output, one.target, one.estimate.output_variance)
            for name, one in self._ordered("output")
            if one.estimate.output is not None
        }

    @cached_property
    def true_disturbance_N(self) -> FloatArray | None:
        oracle = self.kept.get(ORACLE)
        return None if oracle is None else oracle.estimate.disturbance_N

    @cached_property
    def disturbances(self) -> dict[str, _Claim]:
        """Without their means over the rows that are scored; the right one is 0 where it is not known."""
        rows, truth = self.window, self.true_disturbance_N
        right = np.zeros_like(self.first.time_s) if truth is None else truth - truth[rows].mean()
        return {
            name: _Claim(
                self.first.time_s,
                one.estimate.disturbance_N - one.estimate.disturbance_N[rows].mean(),
                right,
                one.estimate.disturbance_variance_N2,
            )
            for name, one in self._ordered("disturbance")
            if one.estimate.disturbance_N is not None and name not in (NULL, ORACLE)
        }

    # ---- figures ----

    def remarks(self) -> Iterator[Html]:
        """Return what has to be known to read the figures."""
        if (np.diff(self.first.time_s) <= 0.0).any():
            yield note(
                "Several series share the time, such as the axes of a stage; each is a curve of the same colour."
            )

    def output(self) -> Iterator[Block]:
        """Return the measured output, and below it the error of each prediction."""
        if not self.outputs:
            return
        text, unit = quantity(self.first.target_name)
        factor, shown = scaled(unit, peak([self.first.target]))
        measured = self._curve("measured", factor * self.first.target, Style(colour=TRUTH), 1.5)
        above = Panel(y_title=labelled(f"measured {text}", shown), items=[measured], height_px=PANEL_PX)
        yield from self._errors("Output: error of each prediction", above, self.outputs, unit, slice(None))

    def disturbance(self) -> Iterator[Block]:
        """Return a few periods of the disturbance, one estimate a panel, then all of its errors."""
        if not self.disturbances:
            return
        truth = self.true_disturbance_N
        drawn = list(self.disturbances.items())[: SHOWN if self.is_crowded else None]
        small = [self._detail(name, claim) for name, claim in drawn]
        others = len(self.disturbances) - len(drawn)
        yield note(
            "Disturbance over a few of its periods, each without its mean over the rows that are scored; wide and "
            f"pale: truth; shaded: stated {LEVEL:.0%} interval; the best first, all on one scale."
            + (f" Of {others} more a page of so many estimates has the errors alone." if others else "")
        )
        yield Grid(small[:SHOWN])
        if small[SHOWN:]:
            yield Folded(f"The same of {len(small) - SHOWN} more", [Grid(small[SHOWN:])])
        if truth is not None:
            factor, unit = scaled("N", peak([truth]))
            curve = self._curve("truth", factor * truth, Style(colour=TRUTH), 1.5)
            above = Panel(y_title=labelled("true disturbance", unit), items=[curve], height_px=PANEL_PX)
            yield from self._errors("Disturbance: error of each estimate", above, self.disturbances, "N", self.window)

    def _curve(self, name: str, values: FloatArray, style: Style, width: float = 1.2) -> Curve | Band:
        time_s = self.first.time_s
        if len(values) > self.n_points:  # pairs of extremes would look like a slower wave
            x, lower, upper = envelope(time_s, values, values, self.n_points)
            return Band(name=name, x=x, lower=lower, upper=upper, style=style, is_dense=True)
        x, y = thinned(time_s, values, self.n_points)
        return Curve(name=name, x=x, y=y, style=style, width=width, listed=False)

    def _errors(
        self, title: str, above: Panel, claims: Mapping[str, _Claim], unit: str, rows: slice
    ) -> Iterator[Block]:
        """Yield the errors over ``rows`` on the scale of the better half of them, references apart."""
        sizes = sorted(peak([claim.error[rows]]) for name, claim in claims.items() if name not in (NULL, ORACLE))
        sizes = sizes or [peak([claim.error[rows]]) for claim in claims.values()]
        largest = ROOM * (sizes[(len(sizes) - 1) // 2] or 1.0)
        factor, shown = scaled(unit, largest)
        panels = [
            self._error(name, claim, labelled("error", shown), factor, factor * largest, unit, rows)
            for name, claim in claims.items()
        ]
        caption = (
            f"Truth minus estimate; shaded: stated {LEVEL:.0%} interval. All on one scale, that of the better half: "
            "what is larger is cut off, and its root mean square says how large it is. A broad line is the range of "
            "one that goes up and down more often than can be drawn."
        )
        yield Figure(title=title, panels=[above, *panels[:SHOWN]], x_title=TIME, caption=caption)
        if panels[SHOWN:]:
            others = Figure(title="", panels=panels[SHOWN:], x_title=TIME)
            yield Folded(f"The same of {len(panels) - SHOWN} more", [others])

    def _error(
        self, name: str, claim: _Claim, y_title: str, factor: float, limit: float, unit: str, rows: slice
    ) -> Panel:
        error, half = claim.error[rows], claim.half_width
        items: list[Curve | Band] = [self._curve(name, factor * claim.error, style_of(name).solid)]
        heading = f"{name}: {si_text(float(np.sqrt(np.mean(error**2))), unit)} rms"
        if half is not None:
            n_points = self.n_points // POINTS_FOR_A_BOUND
            x, lower, upper = envelope(claim.time_s, -factor * half, factor * half, n_points)
            items.insert(0, Band(name=name, x=x, lower=lower, upper=upper, style=style_of(name)))
            inside = float(np.mean(np.abs(error) <= half[rows]))
            heading += f", {inside:.1%} of {len(error)} rows inside"
        return Panel(y_title=y_title, items=items, heading=heading, y_range=(-limit, limit), height_px=PANEL_PX)

    def _detail(self, name: str, claim: _Claim) -> Figure:
        rows, time_s = self._detail_rows, self.first.time_s
        known = [claim.right] if claim.right.any() else [one.value for one in self.disturbances.values()]
        largest = SMALL_ROOM * (peak([one[rows] for one in known]) or 1.0)
        factor, unit = scaled("N", largest)
        items: list[Curve | Band] = []
        half = claim.half_width
        if half is not None:
            lower, upper = factor * (claim.value - half)[rows], factor * (claim.value + half)[rows]
            x = time_s[rows]
            if len(x) > DETAIL_POINTS:
                x, lower, upper = envelope(x, lower, upper, DETAIL_POINTS)
            items.append(Band(name=name, x=x, lower=lower, upper=upper, style=style_of(name)))
        if self.true_disturbance_N is not None:
            x, y = thinned(time_s[rows], factor * claim.right[rows], DETAIL_POINTS)
            items.append(Curve(name="truth", x=x, y=y, style=Style(colour=TRUTH), width=4.0, listed=False))
        x, y = thinned(time_s[rows], factor * claim.value[rows], DETAIL_POINTS)
        own = Curve(name=name, x=x, y=y, style=style_of(name).solid, width=1.5, listed=False)
        limit = factor * largest
        panel = Panel(y_title=labelled("force", unit), items=[*items, own], y_range=(-limit, limit), height_px=SMALL_PX)
        return Figure(title=name, panels=[panel], x_title=TIME)

    @cached_property
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
