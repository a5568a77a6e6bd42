"""Foreign axes: apart from the library, stable, made again bit for bit, and true to formulae written here anew."""

import ast
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fdbench.diagnosis.evidence.prepare import aligned
from fdbench.diagnosis.judge.reduction import channel_gaps
from fdbench.diagnosis.model.hypothesis import start
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.effects import effects
from fdbench.record import FloatArray
from fdbench.specification import read
from fdbench.trials import make as making
from fdbench.trials.answer import answer
from fdbench.trials.make import listed_effects, make
from fdbench.trials.score import AnswerTable, per_kind, score, text
from fdbench.virtual_axes.bench import Detectability, Injected
from fdbench.virtual_axes.cases import Case, Tier
from fdbench.virtual_axes.foreign import bench as benches
from fdbench.virtual_axes.foreign import loops, mechanics
from fdbench.virtual_axes.foreign.bench import ForeignBench, draw_foreign_case, record_of
from fdbench.virtual_axes.foreign.kinds import FORMS, AxisKind, imperfections, kinds, model_of, space_of
from fdbench.virtual_axes.foreign.motions import RECIPES

FOLDER = Path(benches.__file__).parent
EVERY_KIND = pytest.mark.parametrize("kind", kinds(), ids=lambda kind: kind.name)
NONCE = "f0e1" * 8


def of_name(name: str) -> AxisKind:
    return next(kind for kind in kinds() if kind.name == name)


def exact_bench(kind: AxisKind, seed: int = 0) -> ForeignBench:
    """Return a machine whose data sheet is right."""
    bench = ForeignBench(kind, Tier.G, np.random.default_rng(seed))
    bench.errors = dict.fromkeys(bench.errors, 0.0)
    return bench


def marched(bench: ForeignBench, reference: FloatArray, force: FloatArray, steps: int = 40) -> FloatArray:
    """Return the readings of a machine under forces, without noise and delay."""
    axis, n = bench.axis({}), len(reference)
    loop = axis.loop._replace(form=FORMS["torque"], latency_s=0.0, force_limit_N=1e9, count_m=0.0)
    none = np.zeros(2)
    period = bench.kind.period_s
    command = np.column_stack((reference, force))
    return loops.march(  # type: ignore[no-any-return]
        axis.body, axis.wrong, loop, command, np.zeros(n), np.zeros((n, 3)), none, none, 1.0, period, steps
    )


# ---- apart from the library ----


def imported(path: Path) -> set[str]:
    tree = ast.parse(path.read_text("utf-8"))
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    return names | {node.module or "." for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}


def test_nothing_of_the_library_is_used() -> None:
    allowed = {"fdbench.compilation", "fdbench.specification", "fdbench.virtual_axes.foreign"}
    for name in ("mechanics", "loops", "motions", "kinds"):
        own = {found for found in imported(FOLDER / f"{name}.py") if found.startswith("fdbench")}
        assert {".".join(found.split(".")[:3]) for found in own} <= allowed, name
    own = {found for found in imported(FOLDER / "bench.py") if found.startswith("fdbench")}
    assert {found for found in own if "virtual_axes" not in found} == {"fdbench.record"}


def test_what_is_listed_is_in_the_library_and_what_is_not_is_not() -> None:
    names = listed_effects()
    beside_a_baseline = {name for name in effects.names() if effects.get(name).scales_every_value}
    assert {item.name for item in imperfections().listed} - set(names) == beside_a_baseline
    assert not {item.name for item in imperfections().unlisted} & set(effects.names())
    offered = {name for kind in kinds() for name in (*kind.unlisted, *kind.without)}
    assert offered <= {item.name for item in (*imperfections().listed, *imperfections().unlisted)}


@EVERY_KIND
def test_the_owners_model_is_one_that_can_be_read(kind: AxisKind) -> None:
    tables = model_of(kind, exact_bench(kind).value)
    tables["plant"].setdefault("controller", {"kind": "following"})
    drive = read(Nominal, tables, "model").drive
    assert drive.mass_kg == pytest.approx(exact_bench(kind).value["mass_kg"])
    assert (drive.screw is not None) == kind.is_elastic


# ---- physics ----


@EVERY_KIND
@pytest.mark.parametrize("tier", [Tier.F, Tier.G])
def test_axes_follow_their_commands_stably(kind: AxisKind, tier: Tier) -> None:
    for seed in range(3):
        bench = ForeignBench(kind, tier, np.random.default_rng(seed))
        space = space_of(kind, bench.value)
        reference = loops.as_used(FORMS[kind.form], RECIPES["hard"](space, np.random.default_rng(seed)), kind.period_s)
        found = bench.axis({}).readings(reference, np.random.default_rng(seed))
        late = found["motor_position_m"] - reference[:, 0]
        assert np.abs(late).max() < 0.05 * bench.value["travel_m"]
        rest = slice(-round(0.02 / kind.period_s), None)
        assert np.std(found["motor_position_m"][rest]) < 1e-4 * bench.value["travel_m"]


@EVERY_KIND
def test_steady_force_is_friction_and_weight(kind: AxisKind) -> None:
    bench = exact_bench(kind)
    value, period = bench.value, kind.period_s
    speed = 0.3 * value["speed_m_per_s"]
    t = np.arange(round(0.8 / period)) * period
    reference = np.column_stack((speed * t, np.full(len(t), speed), np.zeros(len(t))))
    found = bench.axis({}).readings(reference, None)["motor_force_N"][-round(0.1 / period) :].mean()
    ratio = speed / value["friction_width_m_per_s"]
    curve = {
        "tanh": np.tanh(ratio),
        "soft": min(ratio, 1.0),
        "arctan": 2.0 / np.pi * np.arctan(np.pi / 2.0 * ratio),
        "root": ratio / np.hypot(1.0, ratio),
        "bristle": 1.0,
    }[kind.law]
    expected = value["friction_N"] * curve + value["viscous_N_s_per_m"] * speed + value["weight_N"]
    assert found == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("name", ["linear_stage", "process_force", "counts_pid"])
def test_step_of_force_on_one_mass_is_that_of_scipy(name: str) -> None:
    bench = exact_bench(of_name(name))
    value, period, n = bench.value, bench.kind.period_s, 200
    mass, friction, viscous = value["mass_kg"], value["friction_N"], value["viscous_N_s_per_m"]
    width, push = value["friction_width_m_per_s"], 3.0 * value["friction_N"]

    def rate(_: float, y: FloatArray) -> list[float]:
        u = y[1] / width
        rub = np.clip(u, -1.0, 1.0) if bench.kind.law == "soft" else u / np.hypot(1.0, u)
        return [y[1], (push - viscous * y[1] - friction * rub) / mass]

    t = np.arange(n) * period
    expected = solve_ivp(rate, (0.0, t[-1]), [0.0, 0.0], t_eval=t, rtol=1e-10, atol=1e-13).y[0]
    found = marched(bench, np.zeros((n, 3)), np.full(n, push))[:, 0]
    # The proximal step is of first order.
    assert np.abs(found - expected).max() < 2e-3 * expected.max()


@pytest.mark.parametrize("name", ["two_mass", "belt_with_weight"])
def test_step_of_force_on_two_masses_is_that_of_scipy(name: str) -> None:
    bench = exact_bench(of_name(name))
    value, period, n = bench.value, bench.kind.period_s, 300
    mass, friction, viscous = value["mass_kg"], value["friction_N"], value["viscous_N_s_per_m"]
    width, push, stiffness = value["friction_width_m_per_s"], 5.0 * value["friction_N"], value["stiffness_N_per_m"]
    damping = 2.0 * 0.04 * np.sqrt(stiffness * mass * 0.35 * 0.65)

    def curve(v: float) -> float:
        return float(np.tanh(v / width) if bench.kind.law == "tanh" else v / np.hypot(v, width))

    def rate(_: float, y: FloatArray) -> list[float]:
        screw = stiffness * (y[0] - y[2]) + damping * (y[1] - y[3])
        motor = push - screw - 0.35 * viscous * y[1] - 0.3 * friction * curve(y[1])
        table = screw - 0.65 * viscous * y[3] - 0.7 * friction * curve(y[3]) - value["weight_N"]
        return [y[1], motor / (0.35 * mass), y[3], table / (0.65 * mass)]

    t = np.arange(n) * period
    solved = solve_ivp(rate, (0.0, t[-1]), np.zeros(4), t_eval=t, rtol=1e-9, atol=1e-12, method="LSODA").y
    found = marched(bench, np.zeros((n, 3)), np.full(n, push))
    assert np.abs(found[:, 0] - solved[0]).max() < 1e-5 * solved[0].max()
    stretch = solved[0] - solved[2]
    assert np.abs(found[:, 0] - found[:, 1] - stretch).max() < 1e-3 * np.abs(stretch).max()


@EVERY_KIND
def test_with_a_right_data_sheet_the_nominal_model_is_near(kind: AxisKind) -> None:
    bench = exact_bench(kind, seed=5)
    tables = model_of(kind, bench.value)
    tables["plant"].setdefault("controller", {"kind": "following"})
    sides = ("motor_position_m", "table_position_m")
    seen = sides if kind.columns == "both_positions" else sides[:1]
    rng, axis, space = np.random.default_rng(6), bench.axis({}), space_of(kind, bench.value)
    command = loops.as_used(FORMS[kind.form], RECIPES["hard"](space, rng), kind.period_s)
    records = [record_of(axis, "hard", command, seen, rng) for _ in range(2)]
    ready = aligned(read(Nominal, tables, "model"), records, [])
    force, *positions = np.sqrt(channel_gaps(ready.readings, ready.split, [start(ready.nominal)])[0])
    assert force < 6.0
    assert max(positions) < 15.0


def test_bristles_are_springs_before_they_slide() -> None:
    bench = exact_bench(of_name("presliding_stage"))
    value, n = bench.value, 2000
    # Dahl of power 1.5 at rest under a force f: 1 - (1 - f)^... is x = x_s 2 [(1 - f / F)^(-1/2) - 1].
    share = 0.5
    found = marched(bench, np.zeros((n, 3)), np.linspace(0.0, share, n) * value["friction_N"])[-1, 0]
    assert found == pytest.approx(value["presliding_m"] * 2.0 * ((1.0 - share) ** -0.5 - 1.0), rel=0.03)


def test_contact_of_a_gap() -> None:
    assert mechanics.contact(4e-6, 1e-5) == 0.0
    assert mechanics.contact(3e-6, 0.0) == 3e-6
    deep = 1e-3
    assert mechanics.contact(-deep, 1e-5) == pytest.approx(-(deep - 5e-6), rel=1e-3)


def test_deadband_of_counts_asks_for_no_force() -> None:
    bench = exact_bench(of_name("counts_pid"))
    loop = bench.axis({}).loop
    n, none = 50, np.zeros(2)
    command = np.zeros((n, 4))
    axis = bench.axis({})
    for counts, still in ((10.0, True), (12.0, False)):
        command[:, 0] = counts * loop.count_m
        quiet = np.zeros((n, 3))
        # The reading starts at the command and is moved off it by what stands for noise.
        quiet[:, 0] = -command[:, 0]
        force = loops.march(axis.body, axis.wrong, loop, command, np.zeros(n), quiet, none, none, 1.0, 1e-3, 5)[0, 2]
        expected = 0.0 if still else loop.velocity_gain_N_s_per_m * loop.position_gain_per_s * 2.0 * loop.count_m
        assert force == pytest.approx(expected)


def test_dead_time_delays_a_force_by_as_much() -> None:
    bench = exact_bench(of_name("open_loop"))
    n = 400
    force = np.where(np.arange(n) >= 50, 5.0, 0.0) * bench.value["friction_N"]
    prompt = marched(bench, np.zeros((n, 3)), force)[:, 0]
    bench.always["late_s"] = 3.0 * bench.kind.period_s
    assert marched(bench, np.zeros((n, 3)), force)[3:, 0] == pytest.approx(prompt[:-3], abs=1e-12)


@EVERY_KIND
def test_every_imperfection_can_show_and_stays_finite(kind: AxisKind) -> None:
    bench = ForeignBench(kind, Tier.G, np.random.default_rng(3))
    rng = np.random.default_rng(4)
    motions = [RECIPES[name](space_of(kind, bench.value), np.random.default_rng(5)) for name in kind.motions]
    seen = "motor_force_N", "motor_position_m" if kind.columns == "motor_only" else "table_position_m"

    def read(injected: Injected) -> list[FloatArray]:
        axis = bench.axis(injected)
        return [readings[name] for readings in (axis.readings(motion, None) for motion in motions) for name in seen]

    healthy = read({})
    for name in (*bench.names(listed=True), *bench.names(listed=False)):
        found = read({name: bench.draw(name, rng)})
        assert all(np.isfinite(values).all() for values in found), name
        assert any(not np.array_equal(values, own) for values, own in zip(found, healthy, strict=True)), name


def test_a_late_scale_is_late_to_the_motor_encoder() -> None:
    bench = exact_bench(of_name("two_mass"))
    motion = RECIPES["hard"](space_of(bench.kind, bench.value), np.random.default_rng(5))
    prompt = bench.axis({}).readings(motion, None)
    late = bench.axis({"scale_delay": {"scale_late_s": bench.kind.period_s}}).readings(motion, None)
    assert np.array_equal(late["motor_position_m"], prompt["motor_position_m"])
    assert late["table_position_m"][1:] == pytest.approx(prompt["table_position_m"][:-1], abs=1e-15)


def test_background_is_below_the_noise() -> None:
    kind = of_name("linear_stage")
    rng = np.random.default_rng(1)
    bench = ForeignBench(kind, Tier.F, rng)
    motions = [RECIPES[name](space_of(kind, bench.value), rng) for name in kind.motions]
    detectability, alone = (Detectability(bench, motions, ("motor_position_m",), rng) for _ in range(2))
    clean = bench.without_background()
    bench.add_background(detectability, rng)
    assert len(bench.background) == 3
    for name, drawn in bench.background.items():
        assert 0.0 < alone.mean_square(clean.axis({name: drawn}), beside_nominal_errors=True) < 0.31, name


# ---- records ----


def test_noise_is_as_stated() -> None:
    bench = exact_bench(of_name("open_loop"))
    value, n = bench.value, 20_000
    found = bench.axis({}).recorded(np.zeros((n, 3)), np.random.default_rng(0))
    assert np.std(found["motor_force_N"]) == pytest.approx(value["force_noise_share"] * value["friction_N"], rel=0.03)
    white = np.diff(found["motor_position_m"], 4) / np.sqrt(70.0)
    assert np.std(white) == pytest.approx(value["position_noise_m"], rel=0.03)
    process = benches.correlated(np.random.default_rng(0), 200_000)
    assert np.std(process) == pytest.approx(1.0, rel=0.02)
    assert np.mean(process[1:] * process[:-1]) == pytest.approx(0.9, rel=0.03)


def drawn_case(tier: Tier, number: int) -> Case:
    return draw_foreign_case(tier, number, listed_effects(), np.random.default_rng(7))


def test_a_case_is_drawn_again_bit_for_bit_and_tiers_differ() -> None:
    first, again, other = (drawn_case(tier, 1) for tier in (Tier.F, Tier.F, Tier.G))
    assert first.records == again.records
    assert first.holdouts == again.holdouts
    assert (first.truth, first.model) == (again.truth, again.model)
    low, high = (case.model["plant"]["motor"]["mass_kg"] for case in (other, first))
    bounds = of_name("linear_stage").ranges["mass_kg"]
    assert bounds[0] <= low <= np.sqrt(bounds[0] * bounds[1]) <= high <= bounds[1]


def test_trial_of_foreign_axes_from_making_to_the_sheet(tmp_path: Path) -> None:
    count = 3
    for name in ("a", "b"):
        make(tmp_path / name, tmp_path / f"{name}.json", Tier.G, count, NONCE)
    keys = [json.loads((tmp_path / f"{name}.json").read_text("utf-8")) for name in ("a", "b")]
    assert keys[0]["cases"] == keys[1]["cases"]
    manifests = [json.loads((tmp_path / name / "manifest.json").read_text("utf-8")) for name in ("a", "b")]
    assert manifests[0]["cases"] == manifests[1]["cases"]
    answer(tmp_path / "a", "random", tmp_path / "answers.json")
    sheet = score(tmp_path / "a", tmp_path / "answers.json", tmp_path / "a.json")
    assert [item["kind"] for item in sheet["kinds"]] == sorted(kind.name for kind in kinds()[:count])
    assert "kind of axis" in text(sheet)


def test_table_of_kinds_by_hand() -> None:
    table = AnswerTable(
        effects=["a", "b"],
        types=["x", "y"],
        chances=np.array([[0.9, 0.0], [0.8, 0.1], [0.0, 0.7]]),
        present=np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]),
        unknown=np.zeros(3),
        none=np.zeros(3),
        has_unknown=np.zeros(3),
        closure=np.full(3, np.nan),
        oracle_closure=np.full(3, np.nan),
    )
    opened = {"cases": {str(row): {"truth": {"kind": "x" if row < 2 else "y"}} for row in range(3)}}
    x, y = per_kind(table, {"cases": ["0", "1", "2"]}, opened)
    assert x == {
        "kind": "x",
        "cases": 2,
        "top_1": 0.5,
        "exact_set": 0.5,
        "false_alarms": None,
        "named_wrongly": {"a": 1},
    }
    assert (y["top_1"], y["exact_set"], y["false_alarms"]) == (None, 0.0, 1.0)


def test_an_axis_that_leaves_its_way_is_drawn_anew() -> None:
    """A constant force moves an axis without a loop; the first one of this case went 1.2 m on a way of 0.8 m."""
    nonce = "4d09003b1613131625b79ac3a9e6fd6f9dacbc02e15080a4dd92f3eb085516b7"
    drawn = making._case(Tier.F, listed_effects(), nonce, "274")
    assert drawn.truth["kind"] == "open_loop"
    travel_m = drawn.model["plant"]["travel_m"]
    assert all(np.ptp(record["position_m"]) <= travel_m for record in drawn.records.values())
