"""Draw the pictures of docs/papers: ``python docs/make_pictures.py [--paper NAME]``, with ``pip install -e .[docs]``.

Every picture is computed here from scenarios and estimators, with the functions behind ``fdbench reproduce``. One
function is one file, ``docs/papers/pictures/FUNCTION.svg``, and writes the same bytes whenever it is called.
"""

import argparse
import dataclasses
import re
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fdbench.estimator import Estimate, estimators
from fdbench.metrics import metrics
from fdbench.record import FloatArray
from fdbench.reproduce import chou, mcpherson, qu, salehi, turkay
from fdbench.scenario import Scenario, load_scenario

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FOLDER = Path(__file__).resolve().parent / "papers" / "pictures"
WIDTH_IN = 8.0
# Okabe and Ito's palette; styles of line differ as well.
BLACK, RED, BLUE, GREEN, ORANGE, GREY = "#222222", "#D55E00", "#0072B2", "#009E73", "#E69F00", "#8C8C8C"
TRUTH: dict[str, Any] = {"color": BLACK, "linewidth": 2.2, "alpha": 0.45}
FIRST: dict[str, Any] = {"color": RED, "linestyle": "--"}
SECOND: dict[str, Any] = {"color": BLUE, "linestyle": "-"}
THIRD: dict[str, Any] = {"color": GREEN, "linestyle": "-."}
PRINTED: dict[str, Any] = {
    "color": BLACK,
    "label": "as printed",
    "linestyle": "",
    "marker": "D",
    "markerfacecolor": "white",
    "markersize": 5,
}
STYLE: Any = {
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": 9.5,
    "figure.facecolor": "white",
    "font.sans-serif": ["DejaVu Sans", "Verdana"],
    "font.size": 9,
    "grid.color": "#E2E2E2",
    "legend.frameon": False,
    "lines.linewidth": 1.2,
    "path.simplify_threshold": 0.4,
    "svg.fonttype": "none",
    "svg.hashsalt": "fdbench",
}


# ---- what all pictures share ----


def panels(places: str, height_in: float, widths: Sequence[float] | None = None) -> tuple["Figure", list["Axes"]]:
    """Return an empty figure and its axes; ``"ab;ac"`` places three, the first beside the two others."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_IN, height_in), layout="constrained")
    axes = figure.subplot_mosaic(places, width_ratios=widths)
    return figure, [axes[letter] for letter in sorted(axes)]


def name(ax: "Axes", title: str, x: str, y: str) -> None:
    """Write title and labels."""
    ax.set_title(title, loc="left")
    ax.set_xlabel(x)
    ax.set_ylabel(y)


def key(figure: "Figure", *axes: "Axes", columns: int = 5) -> None:
    """Put one legend above the panels, from the lines of some of them."""
    found = {label: handle for ax in axes for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(list(found.values()), list(found), loc="outside upper center", ncols=min(len(found), columns))


def bars(ax: "Axes", groups: Sequence[str], series: dict[str, tuple[Sequence[float], str]]) -> FloatArray:
    """Draw groups of bars; return their places (n_series, n_groups)."""
    width = 0.8 / len(series)
    centres = np.arange(len(groups)) + width * (np.arange(len(series))[:, None] - 0.5 * (len(series) - 1))
    for places, (label, (values, color)) in zip(centres, series.items(), strict=True):
        ax.bar(places, values, 0.9 * width, label=label, color=color)
    ax.set_xticks(np.arange(len(groups)), groups)
    ax.grid(visible=False, axis="x")
    return np.asarray(centres)


def envelope(ax: "Axes", x: FloatArray, y: FloatArray, columns: int = 300, **style: Any) -> None:
    """Draw a long line by the least and the largest value in each of some columns."""
    parts = np.array_split(np.arange(len(x)), columns)
    kept = [place for part in parts for place in sorted((part[np.argmin(y[part])], part[np.argmax(y[part])]))]
    ax.plot(x[kept], y[kept], **style)


SHORTER = re.compile(r"(\.\d\d)\d+|\s+L(?= )")


def shorter(found: re.Match[str]) -> str:
    """Return a coordinate to a hundredth of a point; a line to the next point needs no letter."""
    return found[1] or ""


def draw(picture: Callable[[], "Figure"], file: Path) -> None:
    """Write a picture, the same bytes at every call."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        picture().savefig(file, metadata={"Date": None, "Creator": None})
    text = re.sub(
        r' (?:d|x|y|transform)="[^"]*"', lambda place: SHORTER.sub(shorter, place[0]), file.read_text("utf-8")
    )
    file.write_text("\n".join(line.rstrip() for line in text.splitlines()) + "\n", encoding="utf-8")


# ---- McPherson ----

KERNEL = {
    "least_squares": ("least squares", FIRST),
    "pl_lssvm": ("PL-LSSVM", SECOND),
    "krls_t": ("KRLS-T, one sample ahead", THIRD),
}


def mcpherson_disturbance() -> "Figure":
    """Draw the shaker's force and its estimates, where it starts and later."""
    figure, axes = panels("ab;cd", 4.2)
    scenario = load_scenario("ShakerConstant-v0")
    for column, (title, start_s, stop_s) in enumerate((("The shaker starts", 1.97, 2.09), ("Later", 6.0, 6.12))):
        force, wrong = axes[column], axes[2 + column]
        for row, (estimator, (label, style)) in enumerate(KERNEL.items()):
            estimate, outcome = mcpherson.fit(scenario, estimator, 0)
            t = outcome.regression.time_s
            seen = (t >= start_s) & (t <= stop_s)
            truth = np.asarray(outcome.truth.disturbance_N)[outcome.regression.rows]
            claim = np.asarray(estimate.disturbance_N)
            if not row:
                force.plot(t[seen], truth[seen], label="truth", **TRUTH)
            force.plot(t[seen], claim[seen], label=label, **style)
            wrong.plot(t[seen], (claim - truth)[seen], **style)
        name(force, title, "", "force, N")
        name(wrong, "", "time, s", "error, N")
        force.set_ylim(-1.9, 1.9)
        wrong.set_ylim(-1.9, 1.9)
    key(figure, axes[0])
    return figure


def mcpherson_spectrum() -> "Figure":
    """Draw the density of the prediction error under shaker and milling."""
    from scipy import signal

    figure, axes = panels("ab", 3.2)
    cases = (
        ("Shaker, 55 Hz", "ShakerConstant-v0", 55.0, range(1, 2)),
        ("Milling, two teeth at 50 Hz", "MillingUpDown-v0", 50.0, range(1, 10)),
    )
    for ax, (title, scenario, line_Hz, orders) in zip(axes, cases, strict=True):
        for estimator, (label, style) in KERNEL.items():
            estimate, outcome = mcpherson.fit(load_scenario(scenario), estimator, 0)
            error = outcome.regression.target - np.asarray(estimate.output)
            rate = 1.0 / outcome.scenario.setup.timing.sampling_time_s
            frequency, density = signal.welch(error, rate, nperseg=1024)
            ax.plot(frequency[2:-1], 10.0 * np.log10(density[2:-1]), label=label, linewidth=1.0, **style)
        noise = outcome.scenario.reality.noise.equation_velocity_m_per_s
        ax.axhline(10.0 * np.log10(2.0 * noise**2 / rate), label="noise of the drive", **TRUTH)
        ax.set_ylim(-190.0, -60.0)
        for order in orders:
            folded = abs(order * line_Hz - rate * round(order * line_Hz / rate))
            ax.annotate(f"{order}", (folded, -62.0), ha="center", va="top", fontsize=8)
        name(ax, title, "frequency, Hz", "density, dB of (m/s)²/Hz")
    key(figure, axes[0])
    return figure


def mcpherson_bias() -> "Figure":
    """Draw the shift of the first parameter over the shaker's amplitude and over the mass in milling."""
    figure, (shaker, milling) = panels("ab", 3.2)
    quiet, loud = load_scenario("ShakerControl-v0"), load_scenario("ShakerConstant-v0")
    amplitudes = (0.03, 0.06, 0.12, 0.3)
    air, cut = load_scenario("MillingAir-v0"), load_scenario("MillingUpDown-v0")
    masses = (3000.0, 1000.0, 300.0)
    found: dict[str, tuple[Sequence[float], str]] = {}
    for estimator in ("least_squares", "pl_lssvm"):
        label, style = KERNEL[estimator]
        start = mcpherson.mean_beta(quiet, estimator)[0]
        shifts = [
            abs(mcpherson.mean_beta(mcpherson.with_amplitude(loud, size), estimator)[0] - start) for size in amplitudes
        ]
        shaker.loglog(amplitudes, shifts, marker="o", label=label, **style)
        start = mcpherson.mean_beta(air, estimator, 2)[0]
        shifts = [mcpherson.mean_beta(mcpherson.with_mass(cut, mass), estimator, 2)[0] - start for mass in masses]
        found[label] = shifts, style["color"]
    square = np.array(amplitudes) ** 2
    shaker.plot(amplitudes, 0.55 * square, label="square of the amplitude", color=GREY, linestyle=":")
    shaker.set_xticks(amplitudes, [f"{size:g}" for size in amplitudes])
    shaker.minorticks_off()
    name(shaker, "Shaker", "amplitude, m/s² of the table", "|shift of β₁|")
    bars(milling, [f"{mass:.0f} kg" for mass in masses], found)
    milling.axhline(0.0, color=BLACK, linewidth=0.8)
    name(milling, "Milling", "mass of the table", "shift of β₁ from the air cut")
    key(figure, shaker)
    return figure


def mcpherson_period() -> "Figure":
    """Draw what becomes of PL-LSSVM if it is told another period."""
    figure, (bias, error) = panels("ab", 2.8)
    scenario = mcpherson.with_amplitude(load_scenario("ShakerConstant-v0"), 0.3)
    start = mcpherson.mean_beta(load_scenario("ShakerControl-v0"), "least_squares", 1)[0]
    share = metrics.get("disturbance_error")()
    told = np.arange(51.5, 58.6, 0.25)
    shifts, errors = [], []
    for frequency in told.tolist():
        estimate, outcome = mcpherson.fit(scenario, "pl_lssvm", 0, period_s=1.0 / frequency)
        shifts.append(estimate.parameters["beta_1"] - start)
        errors.append(share.score(outcome))
    estimate, outcome = mcpherson.fit(scenario, "least_squares", 0)
    bias.plot(told, shifts, label="PL-LSSVM", marker=".", **SECOND)
    bias.axhline(estimate.parameters["beta_1"] - start, label="least squares", **FIRST)
    error.plot(told, errors, marker=".", **SECOND)
    error.axhline(share.score(outcome), **FIRST)
    error.set_ylim(bottom=0.0)
    name(bias, "Parameter", "frequency it is told, Hz", "shift of β₁")
    name(error, "Force", "frequency it is told, Hz", "error over force, %")
    key(figure, bias)
    return figure


# ---- Turkay and Ulsoy ----

RUNOUT_200, RUNOUT_575 = "SlotMillingRunout200Rpm50N-v0", "SlotMillingRunout575Rpm50N-v0"
BIN_RAD_PER_S = 2.0 * np.pi / 5.12
SHORT = ("none", "240.86 rad/s\n50 N", "240.86 rad/s\n25 N", "41.89 rad/s\n50 N", "41.89 rad/s\n25 N")


@cache
def window(scenario: str) -> tuple[FloatArray, FloatArray]:
    """Return deviations of feedrate, mm/s, and force, N, in the window of 512 samples."""
    case = load_scenario(scenario)
    plant: Any = case.plant
    record = case.record(0)
    feedrate = record["feedrate_m_per_s"][turkay.WINDOW] - plant.operating_feedrate_m_per_s
    return 1e3 * feedrate, record["force_N"][turkay.WINDOW] - plant.steady_force_N


def amplitudes_of(values: FloatArray) -> FloatArray:
    """Return the amplitudes of the lines of the window, from bin 1 on."""
    return np.asarray(2.0 / len(values) * np.abs(np.fft.rfft(values))[1:-1])


def turkay_signals() -> "Figure":
    """Draw feedrate and force, in time and in bins."""
    figure, axes = panels("ab;cd", 4.6)
    t = 10.24 + 0.01 * np.arange(512)
    quiet, slow, fast = (window(case) for case in ("SlotMilling-v0", RUNOUT_200, RUNOUT_575))
    axes[0].plot(t, quiet[0], **SECOND)
    name(axes[0], "Schroeder-phased feedrate", "time, s", "deviation, mm/s")
    place = BIN_RAD_PER_S * np.arange(1, 256)
    axes[1].vlines(place[:24], 0.0, amplitudes_of(quiet[0])[:24], color=BLUE, linewidth=2.5)
    name(axes[1], "Its lines: 16 of one amplitude", "frequency, rad/s", "amplitude, mm/s")
    forces = (
        ("run-out at 240.86 rad/s", fast[1], THIRD),
        ("run-out at 41.89 rad/s", slow[1], FIRST),
        ("no run-out", quiet[1], SECOND),
    )
    for label, force, style in forces:
        axes[2].plot(t[:256], force[:256], label=label, **(style | {"linewidth": 0.9, "linestyle": "-"}))
        axes[3].semilogy(place[:220], amplitudes_of(force)[:220], label=label, **(style | {"linestyle": "-"}))
    axes[3].axvspan(
        BIN_RAD_PER_S * 0.5, BIN_RAD_PER_S * 14.5, color=ORANGE, alpha=0.3, linewidth=0.0, label="14 bins in use"
    )
    name(axes[2], "Force as it is read", "time, s", "deviation, N")
    name(axes[3], "Its lines: run-out leaks into the bins in use", "frequency, rad/s", "amplitude, N")
    key(figure, axes[3])
    return figure


def turkay_errors() -> "Figure":
    """Draw the errors of both methods for each run-out."""
    figure, (discrete, continuous) = panels("a;b", 5.2)
    quiet = load_scenario("SlotMilling-v0")
    truth = quiet.linear_model.nominal_parameters(quiet.setup.timing.sampling_time_s)
    exact_b_0 = truth["b_0"] / 1e3
    exact = turkay.continuous(quiet, truth)
    errors: dict[str, list[float]] = {turkay.TIME: [], turkay.FREQUENCY: []}
    of_c: list[FloatArray] = []
    for column in turkay.COLUMNS:
        for method, found in errors.items():
            estimate = turkay.estimate(load_scenario(column.scenario), method)
            found.append(100.0 * abs(turkay.discrete(estimate)[2] / exact_b_0 - 1.0))
        of_c.append(100.0 * (turkay.continuous(quiet, estimate.parameters) / exact - 1.0))
    places = bars(
        discrete,
        SHORT,
        {
            "time domain": (errors[turkay.TIME], RED),
            "frequency domain": (errors[turkay.FREQUENCY], BLUE),
        },
    )
    for place, column in zip(places.T, turkay.COLUMNS, strict=True):
        printed = [100.0 * abs(b_0 / exact_b_0 - 1.0) for b_0 in (column.table_2[2], column.table_3_discrete[2])]
        discrete.plot(place, printed, **(PRINTED | {"label": "as printed" if column is turkay.COLUMNS[0] else None}))
    discrete.set_yscale("log")
    name(discrete, "Both methods, b₀", "", "|error|, %")
    shades = (BLUE, "#56B4E9", GREEN, ORANGE)
    names = ("c₁", "c₂", "c₃", "c₄")
    table = np.array(of_c).T
    places = bars(continuous, SHORT, {n: (row, c) for n, row, c in zip(names, table, shades, strict=True)})
    printed_c = np.array([100.0 * (np.array(column.table_3) / exact - 1.0) for column in turkay.COLUMNS])
    continuous.plot(places.ravel(), printed_c.T.ravel(), **PRINTED)
    continuous.axhline(0.0, color=BLACK, linewidth=0.8)
    name(continuous, "Frequency domain, continuous parameters", "run-out: frequency and amplitude", "error, %")
    discrete.legend(loc="upper left")
    continuous.legend(loc="lower left", ncols=2)
    return figure


def turkay_response() -> "Figure":
    """Draw the response that each method identifies, beside the exact one and the bins."""
    figure, axes = panels("ab", 3.3)
    omega = np.geomspace(1.0, 300.0, 160)
    s, z = 1j * omega, np.exp(0.01j * omega)
    quiet = load_scenario("SlotMilling-v0")
    truth = quiet.linear_model.nominal_parameters(quiet.setup.timing.sampling_time_s)

    def response(c: FloatArray) -> FloatArray:
        return np.asarray(np.abs((c[2] + c[3] * s) / (s**2 + c[0] * s + c[1])))

    for ax, title, scenario in zip(axes, ("41.89 rad/s", "240.86 rad/s"), (RUNOUT_200, RUNOUT_575), strict=True):
        case = load_scenario(scenario)
        a_1, a_2, b_0, b_1 = turkay.discrete(turkay.estimate(case, turkay.TIME))
        frequency = turkay.continuous(quiet, turkay.estimate(case, turkay.FREQUENCY).parameters)
        feedrate, force = (np.fft.rfft(values)[1:15] for values in window(scenario))
        ax.loglog(omega, response(turkay.continuous(quiet, truth)), label="exact", **TRUTH)
        ax.plot(omega, np.abs((b_0 * z + b_1) / (z**2 + a_1 * z + a_2)), label="time domain", **FIRST)
        ax.plot(omega, response(frequency), label="frequency domain", **SECOND)
        bins = BIN_RAD_PER_S * np.arange(1, 15)
        ax.plot(bins, np.abs(force / feedrate), "o", color=ORANGE, markersize=4, label="ratio in the 14 bins")
        ax.axvline(float(title.split()[0]), color=GREY, linestyle=":", label="run-out, 50 N")
        name(ax, f"Run-out at {title}", "frequency, rad/s", "force over feedrate, N s/mm")
    key(figure, axes[0])
    return figure


# ---- Salehi ----


def salehi_spindle() -> "Figure":
    """Draw the force at the spindle from its displacement: a step, and milling at two sampling times."""
    figure, (step, fine, coarse) = panels("a;b;c", 6.6)
    filters = (
        ("filter, 0.1 ms", 1e-4, "van_loan", SECOND),
        ("filter, 1 ms, force drifts", 1e-3, "van_loan", THIRD),
        ("filter, 1 ms, force steps", 1e-3, "force_only", {"color": ORANGE}),
    )
    step.plot([-2.0, 0.0, 0.0, 20.0], [0.0, 0.0, 100.0, 100.0], label="truth", **TRUTH)
    for label, period, force_noise, style in filters:
        arguments: dict[str, Any] = {"q_N2_per_s": 1e4, "form": "steady", "force_noise": force_noise}
        case = salehi.scenario_of("SpindleStep-v0", sampling_time_s=period, substeps=round(period / 1e-5))
        response = salehi.step_response(case, 0.1, **arguments)[: round(0.02 / period) + 1]
        step.plot(1e3 * period * np.arange(len(response)), response, label=label, drawstyle="steps-post", **style)
        case = salehi.scenario_of("SpindleMilling-v0", sampling_time_s=period, substeps=round(period / 1e-5))
        record, _ = case.observe(0)
        t = 1e3 * record["time_s"]
        seen = (t >= 150.0) & (t <= 210.0)
        claim = np.append(0.0, salehi.force_of(salehi.estimate(case, record, **arguments)))
        if period == 1e-4:
            truth = salehi.force_at(case)
            for ax in (fine, coarse):
                ax.plot(t[seen], truth[seen], **TRUTH)
            plant: Any = case.plant
            static = record["displacement_m"] / plant.static_compliance_m_per_N
            fine.plot(t[seen], static[seen], label="displacement over compliance", **(FIRST | {"linewidth": 0.9}))
        (fine if period == 1e-4 else coarse).plot(t[seen], claim[seen], drawstyle="steps-post", **style)
    name(step, "A step of 100 N", "time after the step, ms", "force, N")
    name(fine, "Milling, sampled every 0.1 ms", "time, ms", "force, N")
    name(coarse, "Milling, sampled every 1 ms", "time, ms", "force, N")
    key(figure, step, fine, columns=3)
    return figure


def salehi_bandwidth() -> "Figure":
    """Draw the magnitude from true to claimed force over frequency, and the noise that it costs."""
    figure, (size, noise) = panels("ab", 3.2, (2.0, 1.0))
    strong, deviations = (1e2, 1e4, 1e6), []
    cases = [(q, 1e-4, style) for q, style in zip(strong, (THIRD, SECOND, {"color": ORANGE}), strict=True)]
    for q, period, style in (*cases, (1e4, 1e-3, FIRST)):
        case = salehi.scenario_of("SpindleStep-v0", sampling_time_s=period, substeps=round(period / 1e-5))
        arguments: dict[str, Any] = {"q_N2_per_s": q, "form": "steady", "force_noise": "van_loan"}
        weights = np.diff(salehi.step_response(case, 0.1, **arguments), prepend=0.0) / salehi.STEP_N
        frequency = np.geomspace(10.0, 0.499 / period, 150)
        response = salehi.transfer(weights, period, frequency)
        label = f"{1e3 * period:g} ms, q = 10{'²' if q == 1e2 else '⁴' if q == 1e4 else '⁶'} N²/s"
        size.semilogx(frequency, 20.0 * np.log10(np.abs(response)), label=label, **style)
        plant: Any = case.plant
        pulse = salehi.impulse_response(case, "displacement_m", plant.sensor_noise_m, **arguments)
        deviations.append(float(np.sqrt(np.sum(pulse**2))))
    size.axhline(-3.0, color=GREY, linestyle=":", label="-3 dB")
    size.set_ylim(-30.0, 6.0)
    name(size, "Claimed over true force", "frequency, Hz", "magnitude, dB")
    noise.bar(range(4), deviations, color=(GREEN, BLUE, ORANGE, RED))
    noise.set_xticks(range(4), ["10²", "10⁴", "10⁶", "10⁴\n1 ms"])
    noise.grid(visible=False, axis="x")
    name(noise, "Price: noise of the claim", "q, N²/s", "standard deviation, N")
    key(figure, size, columns=3)
    return figure


def salehi_drive() -> "Figure":
    """Draw the force at a drive from its current: the effect of q, and the loop that does not matter."""
    figure, axes = panels("ab;cd", 4.6)
    closed, opened = load_scenario("DriveCurrentClosed-v0"), load_scenario("DriveCurrentOpen-v0")
    record = closed.record(0)
    t = record["time_s"]
    first = slice(440, 700)
    axes[0].plot([t[first][0], 0.5, 0.5, t[first][-1]], [0.0, 0.0, 100.0, 100.0], label="truth", **TRUTH)
    for q, text, style in ((1e6, "10⁶", {"color": ORANGE}), (1e2, "10²", THIRD), (1e4, "10⁴", SECOND)):
        claim = np.append(0.0, salehi.force_of(salehi.estimate(closed, record, q_N2_per_s=q, form="steady")))
        axes[0].plot(t[first], claim[first], label=f"q = {text}", **(style | {"linewidth": 1.0}))
    name(axes[0], "Loop closed, q in N²/s", "time, s", "force, N")
    forces = []
    for label, case, style in (("loop closed", closed, SECOND), ("loop open", opened, FIRST)):
        record = case.record(0)
        forces.append(salehi.force_of(salehi.estimate(case, record, q_N2_per_s=1e4)))
        envelope(axes[1], t, 1e3 * record["velocity_m_per_s"], 150, label=label, **style)
        envelope(axes[2], t[1:], forces[-1], 250, label=label, **(style | {"linewidth": 0.9}))
    name(axes[1], "Speed of the table", "time, s", "speed, mm/s")
    name(axes[2], "Force, q = 10⁴ N²/s: the two lie on each other", "time, s", "force, N")
    envelope(axes[3], t[1:], 1e9 * (forces[1] - forces[0]), 250, color=BLACK)
    name(axes[3], "Difference of the two", "time, s", "difference, nN")
    key(figure, axes[0], axes[1], columns=6)
    return figure


def salehi_network() -> "Figure":
    """Draw the error of each node's force where three sensors are linked in a line."""
    figure, (nodes, series) = panels("a;b", 5.0)
    full, line = (salehi.scenario_of(f"SensorNetwork{kind}-v0", substeps=1) for kind in ("", "Line"))
    record, truth = full.observe(0)
    force = np.asarray(truth.disturbance_N)
    consensus = {f"DKFCF, S = {n}": ("kalman_consensus", {"gamma": 0.1, "exchanges": n}) for n in (1, 5, 20)}
    filters: dict[str, tuple[str, dict[str, Any]]] = {
        "DIF": ("kalman_distributed", {}),
        **consensus,
        "DKFWA": ("kalman_weighted", {}),
    }
    shades = (RED, "#56B4E9", GREEN, ORANGE, BLUE)
    found: dict[str, tuple[Sequence[float], str]] = {}
    for (label, (estimator, arguments)), shade in zip(filters.items(), shades, strict=True):
        errors = [
            salehi.network_error(line, [(record, force)], estimator, node=node, **arguments) for node in (1, 2, 3)
        ]
        found[label] = errors, shade
    bars(nodes, ["node 1: displacement", "node 2: motor speed", "node 3: motor angle"], found)
    central = salehi.network_error(full, [(record, force)], "kalman_central")
    nodes.axhline(central, label="all readings (CKF)", color=BLACK, linestyle=":")
    name(nodes, "Error of the force that each node claims", "", "root mean square, N")
    t = 1e3 * record["time_s"][1:]
    seen = (t >= 400.0) & (t <= 450.0)
    series.plot(t[seen], force[1:][seen], label="truth", **TRUTH)
    for label, style in (("DIF", FIRST), ("DKFWA", SECOND)):
        claim = salehi.force_of(salehi.estimate(line, record, filters[label][0], q_N2_per_s=1e5, node=3))
        series.plot(t[seen], claim[seen], **(style | {"linewidth": 1.0}))
    name(series, "Node 3, which sees the motor's angle and hears node 2", "time, ms", "force, N")
    key(figure, nodes, series, columns=4)
    return figure


# ---- Qu and Vogl ----

COLORS = (RED, BLUE, GREEN)
METHODS = dict(zip(qu.METHODS, (FIRST, SECOND, THIRD), strict=True))


@dataclasses.dataclass(frozen=True)
class Withheld:
    """Withheld segments of a case: spindle speed, rpm, true force, N, and claimed force by method."""

    speed_rpm: FloatArray
    truth: FloatArray
    claims: dict[str, FloatArray]

    def errors(self, method: str) -> FloatArray:
        """Return the mean absolute error of each segment, N."""
        return np.asarray(np.mean(np.abs(self.claims[method] - self.truth), axis=1))


@cache
def withheld(number: int) -> Withheld:
    """Return what the three methods claim in a case."""
    case = load_scenario(qu.CASES[number].scenario)
    record, truth = case.observe(0)
    context = case.context()
    rows = context.regression(record).rows
    shape = -1, qu.plant_of(case).spectra(record).samples_per_segment
    claims = {}
    for method in qu.METHODS:
        estimate: Estimate = estimators.get(method)().fit(context, record)
        claims[method] = np.asarray(estimate.disturbance_N).reshape(shape)
    speed = record["spindle_speed_rad_per_s"][rows].reshape(shape)[:, 0] * 30.0 / np.pi
    return Withheld(speed, np.asarray(truth.disturbance_N)[rows].reshape(shape), claims)


def qu_force() -> "Figure":
    """Draw the force of one segment of case 1 and one of case 3, as lines and in time."""
    figure, axes = panels("ab;cd", 5.0)
    for number, place in ((0, 0), (2, 2)):
        found = withheld(number)
        near = np.flatnonzero(np.abs(found.speed_rpm - 1503.0) < 150.0)
        order = np.argsort(found.errors(qu.LR)[near])
        segment = near[order[len(order) // 2]]
        lines, signal = axes[place], axes[place + 1]
        frequency, t = 2.0 * np.arange(1, 101), 2.0 * np.arange(50)
        drawn = {"truth": (found.truth[segment], TRUTH)}
        drawn |= {qu.TITLES[method]: (found.claims[method][segment], METHODS[method]) for method in qu.METHODS}
        for label, (force, style) in drawn.items():
            lines.plot(frequency, 2.0 / len(force) * np.abs(np.fft.rfft(force))[1:101], label=label, **style)
            signal.plot(t, force[:50], **style)
        title = f"Case {number + 1}, {found.speed_rpm[segment]:.0f} rpm"
        name(lines, f"{title}: lines", "frequency, Hz", "amplitude, N")
        name(signal, f"{title}: time", "time, ms", "force, N")
    key(figure, axes[0])
    return figure


def qu_errors() -> "Figure":
    """Draw errors by case, and by speed where no such speed was learnt."""
    figure, axes = panels("abc", 3.4, (1.0, 1.0, 1.3))
    found = [withheld(number) for number in range(3)]
    titles = ["case 1\nseen", "case 2\nforces", "case 3\nspeeds"]
    for metric, ax in enumerate(axes[:2]):
        values: dict[str, tuple[Sequence[float], str]] = {}
        for method, color in zip(qu.METHODS, COLORS, strict=True):
            of_cases = []
            for case in found:
                claim, truth = case.claims[method], case.truth
                size = np.sqrt(np.mean(claim**2, axis=1)) - np.sqrt(np.mean(truth**2, axis=1))
                of_cases.append(float(np.mean(np.abs(size if metric else claim - truth))))
            values[qu.TITLES[method]] = of_cases, color
        places = bars(ax, titles, values)
        printed = np.array([[entry[2 * metric] for entry in case.exponential] for case in qu.CASES])
        ax.plot(places.ravel(), printed.T.ravel(), **PRINTED)
        name(ax, "M-RMSE" if metric else "Mean absolute error", "", "error, N")
    speeds = np.unique(np.round(found[2].speed_rpm)).tolist()
    by_speed: dict[str, tuple[Sequence[float], str]] = {}
    for method, color in zip(qu.METHODS, COLORS, strict=True):
        errors = found[2].errors(method)
        by_speed[qu.TITLES[method]] = [errors[np.round(found[2].speed_rpm) == speed].mean() for speed in speeds], color
    bars(axes[2], [f"{speed:.0f}" for speed in speeds], by_speed)
    name(axes[2], "Case 3 by speed", "speed, rpm", "mean absolute error, N")
    key(figure, axes[0])
    return figure


def qu_phase() -> "Figure":
    """Draw the error over the jitter of the trigger."""
    figure, axes = panels("abc", 2.9)
    jitters = (0.0, 0.1, 0.2, qu.RANDOM_ANGLE_RAD)
    for ax, case in zip(axes, qu.CASES, strict=True):
        found: list[tuple[float, float]] = []
        for jitter in jitters:
            variant = qu.PhaseReference("", jitter, 1.0, (*case.linear, 0.0), (True, True, True))
            errors = qu.fits(qu.varied(load_scenario(case.scenario), variant), {qu.LR: {}, qu.NFB: {}})
            found.append((errors[qu.LR][0].mae, errors[qu.NFB][0].mae))
        linear, nonlinear = zip(*found, strict=True)
        ax.plot(range(4), linear, marker="o", label="LR", **FIRST)
        ax.plot(range(4), nonlinear, marker="s", label="LR-NFB", **SECOND)
        ax.set_xticks(range(4), ["0", "0.1", "0.2", "any"])
        ax.set_ylim(bottom=0.0)
        name(ax, case.title.capitalize(), "jitter of the trigger, rad", "mean absolute error, N")
    key(figure, axes[0])
    return figure


# ---- Chou, Duan, Okwudire ----

HYBRID = "hybrid_rls"
MODELS = (("physics model", "physics_model", FIRST), ("hybrid model", HYBRID, SECOND))


def in_um(scenario: Scenario, estimator: str, **arguments: Any) -> FloatArray:
    """Return prediction errors of an estimator with the scenario's settings, um, (n_axes, n_samples)."""
    settings = {**scenario.estimation.hyperparameters.get(estimator, {}), **arguments}
    return chou.UM_PER_M * chou.errors(scenario, estimator, 0, **settings)


def chou_staircase() -> "Figure":
    """Draw the staircase and the errors of both models."""
    figure, (position, error) = panels("a;b", 4.6)
    scenario = load_scenario("ServoStaircase-v0")
    record = scenario.record(0)
    t = record["time_s"]
    envelope(position, t, 1e3 * record["position_m"], **TRUTH)
    envelope(position, t, 1e3 * record["reference_position_m"], color=BLACK, linewidth=0.8)
    name(position, "Position", "", "position, mm")
    for label, estimator, style in MODELS:
        envelope(error, t, in_um(scenario, estimator)[0], label=label, **(style | {"linestyle": "-"}))
    error.axvspan(0.0, 0.3, color=ORANGE, alpha=0.3, linewidth=0.0, label="initialisation")
    name(error, "Measured less predicted position", "time, s", "error, µm")
    key(figure, error)
    return figure


def chou_look_ahead() -> "Figure":
    """Draw what the hybrid model foresees in its batches, and how its error grows with the distance ahead."""
    figure, (zoom, growth) = panels("ab", 3.2, (1.6, 1.0))
    scenario = load_scenario("ServoStaircase-v0")
    physics, hybrid = (in_um(scenario, estimator)[0] for estimator in ("physics_model", HYBRID))
    t = scenario.record(0)["time_s"]
    seen = (t >= 2.9) & (t < 3.5)
    zoom.plot(t[seen], physics[seen], label="error of the physics model", color=BLACK, linewidth=0.7, alpha=0.7)
    zoom.plot(t[seen], (physics - hybrid)[seen], label="foreseen by the hybrid model", color=GREEN, linewidth=1.6)
    for start in np.arange(2.9, 3.5, 0.1):
        zoom.axvline(start, color=BLACK, linewidth=0.6, linestyle=":")
    name(zoom, "One move; each batch of 100 ms is foreseen at once", "time, s", "error, µm")
    staircases = [chou.dwelling(scenario, dwell_s) for dwell_s in np.arange(0.81, 0.905, 0.01).tolist()]
    for label, estimator, style in MODELS:
        errors = [in_um(case, estimator)[0][300:] for case in staircases]
        batches = np.concatenate([error[: len(error) // 100 * 100].reshape(-1, 100) for error in errors])
        growth.plot(np.arange(1, 101), np.sqrt(np.mean(batches**2, axis=0)), label=label, **style)
    growth.set_ylim(bottom=0.0)
    name(growth, "Error by distance ahead", "samples ahead (1 ms each)", "root mean square, µm")
    key(figure, zoom, growth)
    return figure


def chou_spiral() -> "Figure":
    """Draw the spiral and the errors of both models on both axes."""
    figure, (path, upper, lower) = panels("ab;ac", 4.2, (1.0, 1.7))
    scenario = load_scenario("ServoSpiral-v0")
    record = scenario.record(0)
    t = record["time_s"]
    path.plot(1e3 * record["x_reference_position_m"][::8], 1e3 * record["y_reference_position_m"][::8], color=BLACK)
    path.set_aspect("equal")
    path.set_xticks(range(-20, 21, 10))
    path.set_yticks(range(-20, 21, 10))
    name(path, "Commanded path", "x, mm", "y, mm")
    for label, estimator, style in MODELS:
        for ax, error in zip((upper, lower), in_um(scenario, estimator), strict=True):
            envelope(ax, t, error, 200, label=label, **(style | {"linestyle": "-"}))
    name(upper, "x: measured less predicted", "", "error, µm")
    name(lower, "y: measured less predicted", "time, s", "error, µm")
    key(figure, upper)
    return figure


def chou_start_up() -> "Figure":
    """Draw both errors after a first dwell, of which the hybrid model learns nothing."""
    figure, axes = panels("ab", 2.9)
    for ax, dwell_s in zip(axes, (0.857, 0.7), strict=True):
        scenario = chou.dwelling(load_scenario("ServoStaircase-v0"), dwell_s, initial_dwell_s=dwell_s)
        t = scenario.record(0)["time_s"]
        seen = t < 2.4
        for label, estimator, style in MODELS:
            arguments = {"regularisation_m2": 1e-7} if estimator == HYBRID else {}
            error = in_um(scenario, estimator, **arguments)[0]
            envelope(ax, t[seen], error[seen], 200, label=label, **(style | {"linestyle": "-"}))
        ax.set_ylim(-200.0, 480.0)
        name(ax, f"First move after {dwell_s:g} s", "time, s", "error, µm")
    key(figure, axes[0])
    return figure


PICTURES: dict[str, tuple[Callable[[], "Figure"], ...]] = {
    "chou": (chou_staircase, chou_look_ahead, chou_spiral, chou_start_up),
    "mcpherson": (mcpherson_disturbance, mcpherson_spectrum, mcpherson_bias, mcpherson_period),
    "qu": (qu_force, qu_errors, qu_phase),
    "salehi": (salehi_spindle, salehi_bandwidth, salehi_drive, salehi_network),
    "turkay": (turkay_signals, turkay_response, turkay_errors),
}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description="Draw the pictures of docs/papers.")
    parser.add_argument("--paper", choices=sorted(PICTURES), help="one paper; without, all")
    chosen = parser.parse_args().paper
    FOLDER.mkdir(exist_ok=True)
    for paper in [chosen] if chosen else PICTURES:
        for picture in PICTURES[paper]:
            draw(picture, FOLDER / f"{picture.__name__}.svg")
