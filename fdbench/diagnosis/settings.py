"""Tuned numbers of the diagnosis, each with its meaning and origin.

Numbers that are definitions, sizes of arrays, or what a division needs so as not to be one by zero, stand where they
are used; defaults of [uncertainty] in a model file, in `Uncertainty`. docs/reference/settings.md has their effect.
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields
from typing import Any

from fdbench.errors import SpecError, did_you_mean

CHOSEN = "chosen, not derived"
CONVENTION = "convention"
LEARNED = "the probability models were learned with it"


def number(value: Any, meaning: str, origin: str = CHOSEN, zero: float = 0.0) -> Any:
    """Return the field of a number, in the unit that its name ends with; ``zero`` is what it is halved towards."""
    return field(default=value, metadata={"meaning": meaning, "origin": origin, "zero": zero})


@dataclass(frozen=True, kw_only=True)
class RecordsSettings:
    """How records become runs, and what their noise is."""

    same_command: float = number(1e-5, "largest difference between the commands of repeats, relative to their range")
    same_motion: float = number(1e-3, "the same between measured motions")
    sudden_bend: float = number(20.0, "times the next bend of a command that counts as a step of its rate")
    shortest_lap_s: float = number(0.5, "after which a command may repeat itself within a record")
    longest_lap: float = number(0.7, "share of a record that one lap may take", zero=1.0)
    start_samples: int = number(5, "first samples through which a line gives position and velocity of the start")
    held: float = number(5.0, "standard errors beyond which a force at rest is held by the controller")
    left_start: float = number(0.02, "share of its range by which a command has left where it began")
    settled: float = number(4.0, "time constants of a loop after that, until it has forgotten how it stood")
    longest_lead_in: float = number(0.2, "share of a record that may be left out for it", zero=1.0)
    assumed_quantile: float = number(0.25, "of the power of all pieces of a record, read as noise without repeats")
    piece_samples: int = number(256, "length of the pieces of a record that spectra of noise are means over")
    long_piece_samples: int = number(1024, "the same where repeats differ, if records are as long")
    beyond: float = number(5.0, "times the noise within a condition by which the force of another one differs")
    in_one: float = number(
        2.0,
        "times what the model leaves of one of two repeats is left of the other, where another force acts",
        "between 4.2 and 10 in three pairs of another's simulators with such a force, and 1.1 in one without",
        zero=1.0,
    )
    restless: float = number(0.1, "of its force, root mean square, by which laps differ that are no repeats")
    resting: float = number(1e-3, "share of the greatest speed below which friction has no sign")
    profile_bin_m: float = number(2e-4, "of the way, over which what repeats with the position is alike")
    fewest_visits: int = number(3, "of a place, in one direction, that tell what repeats there")
    neighbouring_frequencies: int = number(4, "on either side, over which an assumed spectrum of noise is smoothed")
    line: float = number(
        15.0, "times the noise at higher frequencies, above which the lowest ones hold a line", zero=1.0
    )


@dataclass(frozen=True, kw_only=True)
class PlausibleSettings:
    """When a record is refused, or warned of, before anybody explains it by physics."""

    largest_value: float = number(1e9, "that no column of a machine reaches in SI units")
    force_peak: float = number(50.0, "times the force that 99 % of the samples stay below")
    position_step: float = number(50.0, "times the distance between two samples at the velocity limit")
    unmoved: float = number(0.01, "share of the travel that a position may move under a command that stands still")
    motion: float = number(20.0, "times the noise of a position that is a motion")
    fewest_samples: int = number(256, "samples that a record must have")
    shortest_s: float = number(0.5, "time that a record must last")
    outside: float = number(1.5, "times the travel to both sides, or the velocity limit, that a command may reach")
    constant_speed: float = number(1e-3, "relative spread of a speed, below which only its mean tells its unit")
    other_unit: float = number(8.0, "ratio of two lengths or speeds that only a wrong unit gives")
    other_zero: float = number(0.5, "share of the command's range by which position and command may differ throughout")
    swapped: float = number(-0.5, "correlation below which a sign is swapped")
    unrelated: float = number(0.3, "correlation below which two columns do not belong together")
    alike: float = number(0.8, "correlation above which two forces have the same shape", zero=1.0)
    wrong_gain: float = number(2.0, "ratio of two forces of the same shape that is warned of")
    asked_Hz: float = number(30.0, "below which a force is compared with what the controller asks for")
    same_shape: float = number(0.98, "correlation above which the two are one, but for a factor", zero=1.0)
    other_scale: float = number(1.08, "such a factor that is worth a word: gains are off by less", zero=1.0)
    useless_gain: float = number(10.0, "ratio of two forces of the same shape that is refused")
    at_limit: float = number(0.3, "share of samples at the greatest force, which only an unstable loop reaches")
    longest_delay_s: float = number(1.0, "by which a channel may come late or early, where that is looked for")
    delayed: float = number(0.5, "share of the distance that a shift in time must remove")
    common_delay: float = number(0.02, "relative difference of two delays that are one, beside one sample")
    speed_samples: int = number(5, "samples that a speed is taken over, where delays are compared")
    impossible_force: float = number(20.0, "times the force that 99.9 % stay below, which a jump would need")
    bend_noise: float = number(12.0, "times the noise of a second difference of the position that is a jump")
    rare: float = number(0.01, "share of samples beyond which jumps are no damage but a wrong unit")
    encoder_steps: float = number(6.0, "steps of the encoder that are a jump")
    encoders_apart: float = number(0.1, "sampling times by which two encoders are read apart, which is worth a word")
    zeros_apart: float = number(3.0, "times all else that is left between two encoders, which is worth a word")
    frozen_samples: int = number(50, "samples without any change that a logger did not write")
    frozen_s: float = number(0.05, "time without any change that a logger did not write")
    frozen_jump: float = number(0.05, "share of the range by which the position jumps into such a stretch")
    frozen_command: float = number(0.02, "share of the range by which the command moves in such a stretch")
    copied_samples: int = number(50, "rows that no machine repeats to the last digit")
    spike: float = number(4.0, "times the force that 99.5 % of the samples stay below")
    spike_samples: int = number(3, "longest spike")
    unfelt: float = number(0.3, "share of its impulse that a real force would at least leave in the speed")
    beside_spike_samples: int = number(8, "samples before and after a spike that the speed is taken over")
    spike_shape: float = number(0.3, "of its height, by which what lies before and after a jump and back may differ")
    force_parts: int = number(8, "parts of a record, each with a slope between asked and logged force of its own")
    foreign_force: float = number(0.3, "share of the force that a motion asks for, below which it is another's")
    sure_foreign: float = number(3.0, "standard errors by which it has to be below that", CONVENTION)
    greatest_force: float = number(0.98, "share of its greatest size at which a force is limited", zero=1.0)
    limited_force: float = number(0.05, "share of samples with a limited force, of which nothing is asked")
    frozen_force_s: float = number(0.1, "time that no force stands still")
    frozen_force: float = number(0.5, "share of the range of a force that is asked for while it stands still")
    coarse_force: float = number(64.0, "steps of its resolution in the range of a force, below which it is coarse")
    cut_samples: int = number(3, "samples in a row at the greatest force that a limit or a logger cuts off")
    cut_force: float = number(0.005, "share of samples at the greatest force that is worth a word")


@dataclass(frozen=True, kw_only=True)
class ModelSettings:
    """Hypotheses, the effects that are tried, how they are simulated, and the virtual controller."""

    usual_speed_m_per_s: float = number(0.3, "fastest speed of an axis that the declared sizes of effects are for")
    usual_force_N: float = number(150.0, "root mean square of its force")
    usual_force_offset_N: float = number(2.0, "standard deviation of its force offset, where a model has none")
    usual_force_span: float = number(3.0, "factor either way within which a force is a usual one", zero=1.0)
    usual_speed_span: float = number(30.0, "the same for the speed of a linear axis", zero=1.0)
    smallest_ratio: float = number(0.05, "of the nominal mass or gain, below which re-calibration does not go")
    freedom: float = number(3.0, "degrees of freedom of Student's t of a nominal parameter: a few are far off")
    most_form: tuple[float, ...] = number(
        (0.5, 0.5, 0.5, 1.5),
        "deviations by which friction may exceed its nominal form at 0.1, 0.03, 0.01, 0.003 of the fastest speed",
        "between axes without a cause and with Stribeck friction, of 195 opened ones of tier G",
    )
    most_bristles: float = number(
        0.7, "of a known friction, that slips in place of its bristles may carry, and no more"
    )
    most_stiffness: float = number(1.5, "deviations by which the stiffness of a screw may be off, and no more")
    most_damping: float = number(4.0, "deviations by which its damping may be off, and no more")
    most_early: float = number(
        10.0, "deviations by which the position may be read before the force, half a sample, without a controller"
    )
    most_lag: float = number(3.0, "deviations by which the force may follow its command late, and no more")
    most_delay: float = number(2.0, "deviations by which the velocity's reference may be late or early, and no more")
    untold_delay: float = number(0.25, "sampling times by which a velocity's reference that is not logged may be late")
    zeros_apart_m: float = number(1e-5, "standard deviation of what the zeros of two encoders are still apart")
    at_bound: float = number(0.02, "relative distance to a bound at which a fitted parameter lies on it")
    hollow: float = number(0.05, "of a further amplitude, both in typical sizes, below which an amplitude is nothing")
    corner: float = number(
        2.0,
        "speeds over which friction turns its sign, below which another speed of it may be part of that",
        "between 20 false and 5 true Stribeck frictions of opened axes of tier G",
    )
    falls: float = number(
        0.08,
        "of the known friction, by which both together fall where it is none",
        "twice what a law that is straight up to its level asks for; 0.10 to 0.16 of three true ones of opened axes",
    )
    far_fetched: float = number(5.0, "deviations of a nominal parameter beyond which it stands in for an effect")
    changed: float = number(
        2.0, "the same of a value that no cause changes, on a machine that was calibrated on its own baseline"
    )
    line_step: float = number(1e-4, "relative step of a period in a fit", "a record holds hundreds of periods")
    step: float = number(0.1, "relative step of any other number of an effect in a fit")
    phase_step_rad: float = number(0.3, "step of a phase in a fit")
    another_period: float = number(
        0.02, "relative difference from which a period is another than that of a known effect"
    )
    least_replacement: float = number(0.1, "of a known effect that another one in its place must have in a linear fit")
    most_replacement: float = number(3.0, "of a known effect that another one in its place may have in a linear fit")
    largest_change: float = number(4.0, "times the tried size that one linear fit may make of an effect")
    highest_of_nyquist: float = number(0.8, "frequency of a mode or line that samples still show", zero=1.0)
    held_at_once: int = number(4_000_000, "readings of a channel, beyond which runs are simulated one after the other")
    coarser_substeps: tuple[int, ...] = number(
        (2, 3, 4, 5, 6, 8, 12, 20), "substeps that are tried where the model has more"
    )
    substeps_error: float = number(0.2, "of the noise, root mean square, by which coarser substeps may move a reading")
    slower: float = number(0.8, "factor of the bandwidth of a virtual controller that rings or is loud", zero=1.0)
    lowest_Hz: float = number(1.0, "bandwidth of a virtual controller that has to hold the axis")
    quietest_Hz: float = number(5.0, "bandwidth of a virtual controller that is slow enough for any noise")
    highest_peak: float = number(1.5, "of the complementary sensitivity of its loop")
    reaction: float = number(0.02, "of the measured force that the noise of the position may cause by it")
    smoothed: float = number(3.0, "times its bandwidth up to which a followed motion is kept", zero=1.0)


@dataclass(frozen=True, kw_only=True)
class BaselineSettings:
    """Standard deviations of nominal parameters of one machine, from one day to another; see `Uncertainty`."""

    mass: float = number(0.005, "relative")
    viscous: float = number(0.05, "viscous friction, relative")
    known_effects: float = number(0.04, "amplitudes of known effects, relative")
    controller_gains: float = number(0.003, "gains of the controller, relative: one that was set anew is far off")
    transition_velocity: float = number(0.2, "natural logarithm of the speed over which friction turns its sign")
    friction_side: float = number(0.02, "part of the known friction that acts on the motor instead of the table")
    friction_form: float = number(0.01, "form of friction at low speeds, relative to the known friction")
    force_offset: float = number(0.5, "force offset, relative to what the model has it in doubt by")


@dataclass(frozen=True, kw_only=True)
class EvidenceSettings:
    """What counts as evidence."""

    model_error: float = number(0.03, "of the gap, in the weights of segments", "chosen: 3 % of a response is none")
    explained_error: float = number(1e-3, "of what effects explain, which are not exactly of the library's form")
    segment_s: float = number(0.25, "stretches of time whose sums are weighted, and drawn whole by the bootstrap")
    limited: float = number(
        0.05,
        "share of the time at its limit from which a controller is left out of the model",
        "25 axes of tiers F and G with 0.15 or more: 24 are told rightly without it, 16 with it; six with less, alike",
    )
    swinging: float = number(0.5, "share of the time in which a force reaches both its limits, of a loop not stable")
    held_out: float = number(1.0 / 3.0, "share of a record that is judged on, without repeats, laps or other records")
    smallest_artefact: float = number(0.04, "mean square of a sensor artefact, in units of the noise, that is a cause")
    telling_grid: float = number(
        0.35,
        "mean square of the grid of an encoder, in units of the noise of a channel, where it is a cause",
        "between 13 planted grids of tiers B, D and F (0.45 or more) and fine ones of others (0.28 or less, one 0.9)",
    )
    same_phase: float = number(
        0.8, "length of the mean over its mean length, of a line in several motions, below which it is out of step"
    )
    steady_line: float = number(
        0.7,
        "of a line, in the quarter of a record that has least of it, from which it is a force that acts all the time",
        "between 6 such forces (0.86 or more) and 3 modes and loops that rang (0.57 or less) of tier F",
    )
    answer: float = number(5.0, "power of the position against its surroundings, from which it answers to a force")
    answered: float = number(0.99, "probability of a force out of step to which the position answers")
    unanswered: float = number(0.5, "probability of one of which the position would show no answer")
    held_moves: float = number(5.0, "times the noise that the model moves by where a repeated sample is no coincidence")
    grid_fewest: int = number(40, "differences of readings that show a grid")
    grid_nearest: float = number(0.25, "steps of a grid: smallest differences of readings that are looked at")
    grid_furthest: float = number(3.5, "steps of a grid: largest differences of readings that are looked at")
    grid_coarsest_m: float = number(1e-4, "coarsest step of an encoder that is tried")
    grid_ratio: float = number(1.015, "of neighbouring steps that are tried; bounds of the one found", zero=1.0)
    grid_steps: int = number(700, "steps that are tried")
    grid_cells: int = number(50, "for each step; of many differences in one cell one counts: a steady speed is no grid")
    on_grid: float = number(0.4, "distance from the grid, relative to that of numbers that know nothing of it")
    grid_slope: float = number(20.0, "of the logistic that makes a probability of that distance")
    coarse_log: float = number(4.0, "times the noise of the force, squared, that only steps in the loop would bring")
    wave_fewest: float = number(200.0, "waves over the travel that an error of interpolation has")
    wave_most: float = number(131072.0, "waves over the travel that are looked for")
    wave_of_turn: float = number(50.0, "such waves in a turn of the motor; longer ones may be true motion")
    wave_spread: float = number(0.2, "between halves of the runs, relative to the wave, within which it is there")
    usual_wave: float = number(
        0.6,
        "mean square of such a wave, in units of the noise, that is as often a cause as none",
        "between traces (0.43 or less) and causes (0.82 or more) of 440 axes of tier G",
    )
    wave_slope: float = number(6.0, "power of the mean square that the odds of a cause grow with")
    rounds: int = number(3, "in which changes from run to run and noise are separated")
    form_change: float = number(
        0.05, "of what a model's form leaves, relative, from one day to another: it grows with the friction"
    )
    assumed_change: float = number(0.02, "of friction from run to run, relative, where no repeats tell it")
    assumed_pairs: float = number(
        1.0, "pairs of repeats that this counts for beside those that were made, where a cause is unknown or noise"
    )
    smallest_change: float = number(0.1, "standard deviation over a whole run, in units of its noise, of a direction")


@dataclass(frozen=True, kw_only=True)
class SearchSettings:
    """The search for effects."""

    most_effects: int = number(4, "effects that are added at most")
    set_anew: float = number(0.05, "relative change of a gain since the baseline, from which somebody changed it")
    law_left: float = number(0.5, "of what the force is beside the law of a controller, left by gains that were set")
    steep: float = number(0.5, "deviations by which a friction turns its sign faster than on paper, and may stick")
    unseen_bend: float = number(
        1.0,
        "times the noise of the position, of repeats too: bristles that bend over less may only hold an axis at rest",
    )
    unseen_reading: float = number(
        20.0,
        "times the noise of the position at high frequencies, of which that holds besides",
        "between 8 axes that stick in PyBullet (13 or less) and one of tier D whose bristles bend (110)",
    )
    unseen_following: float = number(
        2.0,
        "the first of these two where a virtual loop makes a model follow a motion, by bending what sticks",
        "of five axes of another's simulator that stick, bristles bent over 0.7 to 1.8 times that noise",
    )
    oversized: float = number(5.0, "times the gap that the response to a tried effect may be before it is made smaller")
    rescaled: int = number(10, "classes that are simulated again at their fitted size")
    sizes: tuple[float, ...] = number((1.0, 0.5), "of that size: large effects are not proportional to it")
    starts: tuple[float, ...] = number((0.5, 0.25), "of that size: further starts, where it is worse than no effect")
    refined: int = number(3, "classes refined in closed loop, at most, by what is fitted and by what is held out")
    serious: float = number(0.2, "share of the best gain that makes a class worth refining")
    promising: float = number(0.25, "of ``smallest_gain``, that a linear fit of a class must show where it is held out")
    strained: float = number(2.0, "deviations of a nominal parameter that may hide an effect from a linear fit")
    tried_unhidden: int = number(8, "classes that are tried for it on all records, of those tried on the shortest")
    unhidden: int = number(2, "classes refined beside nominal parameters as given, where the base has strained ones")
    smallest_gain: float = number(0.04, "share of the excess misfit that an effect must remove")
    worth_adding: float = number(
        0.25, "probability that an effect is there, from which on it is added where it is no trace"
    )
    of_noise: float = number(0.5, "of a misfit below that of noise, which an effect may leave at most", zero=1.0)
    besides: float = number(0.2, "share of the excess misfit that an effect removes besides what a wrong value would")
    back: float = number(
        0.5, "of its deviation, below which a value has come back beside an effect that may be in its place"
    )
    longest_time: float = number(
        4.0,
        "longest time constant, in longest records, of an effect that may be in place of a value",
        "of four opened axes of tier A with a drift of 19 to 32 s in records of 8 s, a size of Coulomb friction was "
        "named besides in four at 1, in one at 4",
        zero=1.0,
    )
    stays: float = number(0.2, "of a known effect that stays beside one in its place, so that it is not gone")
    noise_alone: float = number(1.05, "misfit below which nothing is left to explain", zero=1.0)
    unexplained: float = number(2.0, "misfit from which on no class is passed over before its cause is called unknown")
    effective_samples: float = number(60.0, "independent samples that a misfit is worth at most, for probabilities")
    of_a_stretch: float = number(2.5, "such samples in a stretch of time that is judged on, 0.25 s long")
    paired: float = number(
        0.3,
        "of the standard errors by which look-alikes differ over stretches of time, that count: forms are not exact",
        "likeliest for 128 pairs of a lag and a dead time in opened trials A, B, F and G",
    )
    beside_traces: float = number(
        0.5,
        "the same where traces of all other effects are fitted beside them",
        "likeliest for 225 such pairs in opened trials A, B and G",
    )
    imitation: float = number(
        1.0,
        "log odds against one that imitates another then, as far as a bound lets it",
        "likeliest for the same pairs",
    )
    shapes: int = number(6, "points from one bound of a shape to the other, of which look-alikes have the best")
    imitates: float = number(
        0.1,
        "relative distance to a bound of its form, from which a look-alike imitates another one",
        "likeliest for the same pairs",
    )
    steps: int = number(12, "Gauss-Newton steps of a refinement at most")
    fine: float = number(0.1, "of the steps of numbers, with which a fit goes on where whole ones tell no slope")
    kept_promise: float = number(0.4, "share of the promised fall that a step must reach for its responses to serve on")
    reweighings: int = number(4, "of the priors, where values may be far from those on paper")
    other_form: float = number(0.5, "deviations by which forms of friction differ, of which one may hide an effect")
    near: float = number(
        1.0, "standard deviations of a nominal parameter, over which its response is taken for constant"
    )
    tangents: int = number(8, "points about which responses to nominal parameters are kept, if there is room for them")
    tangents_held: int = number(16_000_000, "responses to them in a channel, beyond which fewer points are kept")
    converged: float = number(1e-3, "fall of the objective, relative to its excess over noise, that ends a refinement")
    unnoticed: float = number(1e-3, "the same, relative to all that is left, noise too: 0.03 of a log evidence")
    smallest_fall: float = number(2.0, "fall of the objective that is no evidence of anything")
    dampings: tuple[float, ...] = number(
        (0.03, 0.3, 3.0), "of the diagonal of the normal matrix, tried together where a step without promises too much"
    )
    further_dampings: tuple[float, ...] = number((30.0, 300.0, 3000.0), "tried where none of those falls as promised")
    hopeless: float = number(
        3.0, "times what a step promises, after which a fit that is still far behind another one is given up"
    )
    far_behind: float = number(10.0, "of log evidence, that such a fit is behind: a closer one may look alike")
    quick: int = number(2, "steps after which a fit that creeps is slow, and longer steps are tried, too")
    creeping: float = number(0.05, "fall of the objective, relative to it, below which a fit creeps")
    lengths: tuple[float, ...] = number((2.0, 4.0), "of the best step, tried together where a fit is slow")
    tie: float = number(0.1, "log odds of a rival up to which an effect is not replaced by it")
    reviews: int = number(3, "rounds in which effects may be replaced by rivals or go")
    loops: tuple[int, ...] = number((2, 4, 8), "cycles of the controller in a sampling time that are tried")
    lines: int = number(3, "lines over time, and long waves over the way, that are tried")
    pitches: int = number(3, "short waves over the way that are tried")
    standing_out: int = number(16, "waves that stand out most, of which those are chosen")
    strong_wave: float = number(0.2, "share of the squares of a gap from which on a wave goes before its aliases")
    lowest_line_Hz: float = number(2.0, "slowest line")
    line_near: int = number(4, "bins beside a line that belong to it")
    line_far: int = number(24, "bins beside a line that are its surroundings")
    stands_out: float = number(15.0, "power of a line against the highest of its surroundings")
    shortest_wave_m: float = number(4e-4, "shortest wave over the way")
    fewest_waves: float = number(0.9, "waves over the travel, of the longest one")
    long_waves: float = number(10.0, "waves over the travel, below which a wave is long")
    longest_pitch_m: float = number(0.06, "of a motor, where the travel is below ten of it", "linear motors' magnets")
    bin_m: float = number(1e-4, "of the profile over the way")
    oversampling: int = number(8, "of its spectrum")
    orders: tuple[float, ...] = number((1.0, 2.0, 6.0, 12.0, 24.0), "of a turn, where screws, couplings, poles repeat")
    of_an_order: float = number(0.25, "waves over the travel, by which a long wave may miss a known order and be it")
    around: int = number(8, "resolved wavenumbers around a pitch that its power is compared with")
    above: float = number(3.0, "power above theirs that makes a known order worth a try")


@dataclass(frozen=True, kw_only=True)
class JudgeSettings:
    """What is said of what was found."""

    smallest_type: float = number(0.01, "probability of a type of cause that is worth a line")
    force_balance_Hz: float = number(60.0, "above which derivatives of the position are noise")
    force_balance_margin_s: float = number(0.05, "at either end of a run, which the filter does not know")
    sure_of_force: float = number(3.0, "standard deviations beyond which a process force is there", CONVENTION)
    force_line: float = number(0.25, "share of the squares of a process force at one frequency that is worth saying")
    force_periods: float = number(3.0, "periods of that frequency that a record must hold")
    force_points: int = number(400, "of the course of a process force that are handed on, at most")
    hidden: float = number(0.05, "of its typical size: standard deviation of an effect that is not named")
    resamples: int = number(1000, "draws of a bootstrap", CONVENTION)
    measurable: float = number(1.5, "mean squared gap, in units of the floor, that has an explained fraction")
    rest_speed: float = number(1e-3, "of the largest commanded speed, below which an axis rests")
    reversal_s: float = number(0.05, "time before and after a change of direction that belongs to it")
    steady: float = number(0.02, "of the largest commanded acceleration, below which a speed is steady")
    another_day: float = number(
        4.0, "deviations of what changes from run to run that a record of another day is off by"
    )
    beyond_doubt: float = number(1.5, "standard deviations of a nominal parameter below which it is no cause")
    small_share: float = number(0.1, "of what is left: an effect that explains no more may be a part of another cause")
    named: float = number(0.5, "probability above which causes stand first", "more likely than not")
    enough: float = number(0.5, "share of the gap that everything named must explain to be believed")
    worse: float = number(1.5, "times as large as without it, or as noise, is no channel's gap with what is a cause")
    unrepeated: float = number(10.0, "ratio to the floor of three repeats that one run may reach by chance")
    alike: float = number(
        0.75,
        "of what an effect removes, removed by a rival that shares its probability",
        "likeliest of 0.5 to 0.97 for opened trials: 600 axes of tiers A to D and 440 of G",
        zero=1.0,
    )
    fewest: float = number(0.01, "probability of a rival that is worth mentioning")
    level: float = number(0.9, "probability with which the cause is one of a set", CONVENTION, zero=1.0)
    rest_cells: int = number(24, "of a function that the rest may depend on")
    rest_shrinkage: float = number(50.0, "samples that such a cell counts for too few by")
    rest_smallest: float = number(0.02, "share of the rest that is worth mentioning")
    rest_noise: float = number(0.1, "mean square beyond the noise, in units of it, below which there is no rest")
    smallest_size: float = number(1e-3, "of an effect, where its logarithm is a feature", LEARNED)
    trace_size: float = number(0.25, "of an effect, up to which it is a trace such as every machine has", LEARNED)
    cause_size: float = number(1.25, "of an effect, from which it is no trace", LEARNED)
    large_size: float = number(10.0, "of an effect that every machine has, from which it is no trace", LEARNED)
    smallest_misfit: float = number(0.3, "where its logarithm is a feature", LEARNED)
    smallest_distance: float = number(0.1, "standard deviations, where their logarithm is a feature", LEARNED)


@dataclass(frozen=True, kw_only=True)
class ExperimentSettings:
    """The proposal of a next experiment."""

    sure: float = number(0.9, "probability from which on a verdict needs no further experiment", zero=1.0)
    smallest_gain: float = number(0.02, "probability that the truth must be expected to win")
    most_rivals: int = number(6, "rivals that compete at most")
    smallest_probability: float = number(0.02, "of a rival that competes")
    overlooked: float = number(0.1, "least probability of all causes that the records gave no reason to consider")
    price_per_s: float = number(3e-4, "probability that a second of machine time has to bring")
    split_log_odds: float = number(3.0, "expected log odds of two causes that a motion separates", "20 to 1")
    followed: float = number(0.1, "share of the stroke by which the simulated axis may miss the command")
    used_travel: float = number(0.5, "share of the travel that a stroke may take where the records do not show more")
    used_velocity: float = number(0.8, "share of the velocity limit that motions are made for", zero=1.0)
    used_force: float = number(0.5, "share of the greatest force that accelerates; friction and control have the rest")
    fade_s: float = number(0.25, "time in which multisines and sines begin and end")


RECORDS, PLAUSIBLE, MODEL, BASELINE = RecordsSettings(), PlausibleSettings(), ModelSettings(), BaselineSettings()
EVIDENCE, SEARCH, JUDGE, EXPERIMENT = EvidenceSettings(), SearchSettings(), JudgeSettings(), ExperimentSettings()
STAGES: Mapping[str, Any] = {
    "records": RECORDS,
    "plausible": PLAUSIBLE,
    "model": MODEL,
    "baseline": BASELINE,
    "evidence": EVIDENCE,
    "search": SEARCH,
    "judge": JUDGE,
    "experiment": EXPERIMENT,
}


@dataclass(frozen=True, kw_only=True)
class Setting:
    """One number: where it is, what it means and where it comes from."""

    stage: Any
    name: str
    meaning: str
    origin: str
    zero: float

    @property
    def value(self) -> Any:
        """The number as it is now."""
        return getattr(self.stage, self.name)

    def set(self, value: Any) -> None:
        """Set the number, which nothing else may do: see `changed`."""
        object.__setattr__(self.stage, self.name, value)


def settings() -> dict[str, Setting]:
    """Return every number by its name ``stage.number``.

    >>> settings()["search.smallest_gain"].meaning
    'share of the excess misfit that an effect must remove'
    """
    return {
        f"{name}.{item.name}": Setting(stage=stage, name=item.name, **item.metadata)
        for name, stage in STAGES.items()
        for item in fields(stage)
    }


@contextmanager
def changed(numbers: Mapping[str, Any]) -> Iterator[None]:
    """Diagnose with other numbers for a while, in all threads of this process but in no other process.

    Raises
    ------
    SpecError
        If there is no number of a name.

    >>> with changed({"search.smallest_gain": 0.02}):
    ...     SEARCH.smallest_gain
    0.02
    >>> SEARCH.smallest_gain
    0.04
    """
    known = settings()
    for name in numbers:
        if name not in known:
            raise SpecError(f"settings: there is no number {name!r}.{did_you_mean(name, known)}")
    before = {name: known[name].value for name in numbers}
    try:
        for name, value in numbers.items():
            known[name].set(value)
        yield
    finally:
        for name, value in before.items():
            known[name].set(value)
