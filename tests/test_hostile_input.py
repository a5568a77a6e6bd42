"""Input that means harm, or was damaged: each case was once a traceback, a hang, or taken for something else."""

import json
import os
import re
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import REPOSITORY
from mutations import targets
from mutations.attack import outcome
from short_scenario import short_scenario
from typer.testing import CliRunner

from fdbench.benchmark.leaderboard import _failures
from fdbench.benchmark.run import run
from fdbench.benchmark.seal import read_seal
from fdbench.benchmark.statistics import Trouble
from fdbench.benchmark.store import KeptRun, RunKey, Store
from fdbench.cli import app
from fdbench.convergence import integration_doubt
from fdbench.effects import effects
from fdbench.errors import FdbenchError, RecordError, SpecError
from fdbench.plants._linear_system import continuous
from fdbench.plants.feed_drive import FeedDrive
from fdbench.reading import read_record
from fdbench.reading.formats.mdf import Mdf
from fdbench.reading.formats.sinumerik_trace import SinumerikTrace
from fdbench.reading.formats.twincat_scope import TwincatScope
from fdbench.record import Record
from fdbench.scenario import load_scenario
from fdbench.simulate import compose
from fdbench.trials import score, seal

MARKUP = "a | b\n<img src=x onerror=alert(1)> [click](http://x) `code` **bold** \x1b[31m"


# ---- messages ----


def test_a_message_shows_little_of_what_is_wrong_and_no_escapes() -> None:
    shown = str(FdbenchError(f"x.toml: '{100_000 * 'q'}' is \x1b[2J\r\n{5_000 * 'no '}\udcffnumber."))
    assert len(shown) <= 1600
    assert shown.isprintable()
    assert shown.startswith("x.toml: 'qqq")
    assert shown.endswith("\\udcffnumber.")


@pytest.mark.parametrize("name", ["...toml", "-x.toml", "a|b.toml", "<b>.toml", "a\x1b[31m.toml", 101 * "q" + ".toml"])
def test_the_id_of_a_scenario_is_a_name(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text('extends = "ShakerConstant-v2"')
    with pytest.raises(SpecError, match="is the id of the scenario; allowed"):
        load_scenario(tmp_path / name)


def test_no_message_of_a_run_is_markup_in_the_leaderboard() -> None:
    trouble = Trouble(scenario="S-v0", estimators="x", seeds="0", status="failed", reason=MARKUP)
    assert list(_failures([trouble]))[-1] == (
        r"| S-v0 | x | 0 | failed | a \| b \<img src=x onerror=alert(1)\> \[click\](http://x) \`code\` "
        r"\*\*bold\*\* \\x1b\[31m |"
    )


def test_names_of_files_write_no_escapes(tmp_path: Path) -> None:
    targets.record().save(tmp_path / "a\x1b[31mb.csv")
    result = CliRunner().invoke(app, ["import", str(tmp_path / "a\x1b[31mb.csv")])
    assert result.exit_code == 0, result.output
    assert "a\\x1b[31mb.csv: csv" in result.output
    assert "\x1b" not in result.output


# ---- records and logs ----


def test_a_pipe_is_called_a_pipe(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(RecordError, match="a pipe or a device, not a file"):
        read_record(tmp_path / "a.csv")


def test_a_name_that_is_not_utf_8_is_refused(tmp_path: Path) -> None:
    file = tmp_path / os.fsdecode(b"a\xff.csv")
    targets.record().save(tmp_path / "a.csv")
    (tmp_path / "a.csv").rename(file)
    with pytest.raises(RecordError, match=r"a\\udcff.csv: the name of the file is not UTF-8"):
        read_record(file)
    with pytest.raises(RecordError, match="the name is not UTF-8"):
        targets.record().save(file)


def test_many_columns_are_refused_at_once(tmp_path: Path) -> None:
    names = ",".join(f"c{number}_m" for number in range(50_000))
    (tmp_path / "a.csv").write_text("\n".join([f"time_s,{names}", *(["0," * 50_000 + "0"] * 3)]) + "\n")
    start = time.perf_counter()
    with pytest.raises(RecordError, match="50001 columns; at most 2000 are read"):
        read_record(tmp_path / "a.csv")
    assert time.perf_counter() - start < 3.0


@pytest.mark.parametrize("decimals", [3, None])
def test_a_file_cut_within_its_last_number_is_refused(decimals: int | None, tmp_path: Path) -> None:
    """A record of fdbench, whose every line has an end, and a table of others with as many decimals in each row."""
    file = tmp_path / "a.csv"
    if decimals is None:
        targets.record().save(file)
    else:
        file.write_text("time_s,position_m\n" + "".join(f"0.00{row},1.250\n" for row in range(5)))
        file.write_bytes(file.read_bytes()[:-1])
        assert read_record(file)["position_m"][-1] == 1.25  # an end is not asked for
    file.write_bytes(file.read_bytes()[:-2])
    with pytest.raises(RecordError, match=r"the last line has no end\. The file was cut there"):
        read_record(file)


def test_each_flipped_bit_of_a_page_is_found(tmp_path: Path) -> None:
    record = targets.record()
    record.save(tmp_path / "a.parquet")
    content = (tmp_path / "a.parquet").read_bytes()
    random, wrong = np.random.default_rng(5), 0
    for place in random.integers(4, len(content) - 8, 60):
        changed = bytearray(content)
        changed[place] ^= 1 << int(random.integers(8))
        (tmp_path / "a.parquet").write_bytes(changed)
        try:
            read = read_record(tmp_path / "a.parquet")
        except FdbenchError:
            continue
        wrong += not all(np.array_equal(read[name], column) for name, column in record.items() if name in read)
    assert wrong == 0


@pytest.mark.parametrize("step_s", [1e-300, 1e-12, 1e9])
def test_a_clock_that_no_machine_has_is_refused(step_s: float) -> None:
    with pytest.raises(RecordError, match=r"the sampling time is .* allowed: 1e-09 to 1e.06 s"):
        Record({"time_s": step_s * np.arange(5), "position_m": np.zeros(5)})


def test_provenance_without_end_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(f"# fdbench {'[' * 10_000}\ntime_s,position_m\n0,1\n1,2\n2,3\n")
    with pytest.raises(RecordError, match=r"provenance of fdbench is damaged .nested more than 64 deep"):
        read_record(tmp_path / "a.csv")


def trace(**changes: str) -> str:
    values = {"interval": "0.001", "stop": "0.003", "time": "0.001", "value": "1.0", **changes}
    return (
        '<traceSession><dataFrame><frameHeader stopInc="{stop}"/><dataSignal interval="{interval}" id="f1" name="a"/>'
        '<rec time="0.000" f1="0.5"/><rec time="{time}" f1="{value}"/></dataFrame></traceSession>'
    ).format(**values)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"interval": "1e-300"}, "outside 1e-07 to 1e.06"),
        ({"interval": "0"}, "outside 1e-07 to 1e.06"),
        ({"interval": "nan"}, "outside 1e-07 to 1e.06"),
        ({"stop": "1e300"}, "outside 0 to 1e.06"),
        ({"stop": "1e6", "interval": "1e-6"}, "more than 200000000 values"),
        ({"time": "nan"}, "outside"),
        ({"time": "-1"}, "before the one above"),
        ({"value": "1_0"}, "'1_0' is not a number"),
    ],
)
def test_a_trace_with_times_that_no_machine_has_is_refused(changes: dict[str, str], words: str, tmp_path: Path) -> None:
    file = tmp_path / "a.xml"
    file.write_text(trace())
    assert SinumerikTrace().read_all(file).columns["a"].tolist() == [0.5, 1.0, 1.0, 1.0]
    file.write_text(trace(**changes))
    with pytest.raises(RecordError, match=words):
        SinumerikTrace().read_all(file)


@pytest.mark.parametrize("text", ["x", "Name", "Name\t\nStarttime\nName\ta\nSampleTime[ms]\t1\n\n0\t1\n"])
def test_a_scope_export_without_what_it_needs_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    kind, words = outcome(lambda: str(TwincatScope().read_all(tmp_path / "a.csv") and ""))
    assert kind in ("refused", "accepted"), words


def test_elements_of_no_kind_are_refused(tmp_path: Path) -> None:
    """On the zeroed tags of such a file scipy ends the process."""
    names = targets._make_records(tmp_path)
    for name in (name for name in names if name in ("a.mat", "b.mat")):
        content = (tmp_path / name).read_bytes()
        assert read_record(tmp_path / name).n_samples == targets.N_SAMPLES
        for start, stop in ((128, 200), (600, len(content))):
            (tmp_path / "c.mat").write_bytes(content[:start] + bytes(stop - start) + content[stop:])
            with pytest.raises(RecordError, match="not a MAT file, or a damaged one"):
                read_record(tmp_path / "c.mat")


def test_a_reader_that_crashes_takes_nothing_with_it() -> None:
    """One bit is flipped, by which the machine code of asammdf 8 writes where it should not."""
    with pytest.raises(RecordError, match="not an MDF file, or a damaged one"):
        Mdf().read_all(REPOSITORY / "tests" / "proposal" / "crashes_asammdf.mf4")


def test_blocks_that_follow_themselves_are_refused(tmp_path: Path) -> None:
    """A data group whose next one is itself, in which asammdf runs for ever."""
    block = b"##HD" + bytes(4) + (32).to_bytes(8, "little") + (1).to_bytes(8, "little") + (104).to_bytes(8, "little")
    group = b"##DG" + bytes(4) + (40).to_bytes(8, "little") + (2).to_bytes(8, "little") + (104).to_bytes(8, "little")
    (tmp_path / "a.mf4").write_bytes(
        b"MDF     4.10    ".ljust(64, b"\0") + block.ljust(40, b"\0") + group.ljust(64, b"\0")
    )
    with pytest.raises(RecordError, match="block 104 follows itself"):
        Mdf().read_all(tmp_path / "a.mf4")


# ---- scenarios ----


@pytest.mark.parametrize("window", ["[9.6, 2.4]", "[-1.0, 2.0]", "[2.4, 99.0]", "[2.4, 2.4]", "[2.4, 2.4001]"])
def test_a_window_that_is_no_part_of_the_record_is_refused(window: str, tmp_path: Path) -> None:
    file = tmp_path / "Own-v0.toml"
    file.write_text(f'extends = "ShakerConstant-v2"\n[estimation]\nwindow_s = {window}\n')
    with pytest.raises(SpecError, match=r"window_s: .* is no part of a record"):
        load_scenario(file)


def test_arguments_for_a_misspelt_estimator_are_refused(tmp_path: Path) -> None:
    file = Path(short_scenario(tmp_path, "Short-v0"))
    file.write_text(file.read_text() + "\n[estimation.hyperparameters.pl_lsvm]\ngamma = 1.0\n")
    with pytest.raises(SpecError, match=r"unknown estimator 'pl_lsvm'\. Did you mean pl_lssvm"):
        run([file], ["least_squares"], 1, tmp_path / "out")


def test_a_scenario_of_days_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "Own-v0.toml"
    file.write_text('extends = "ShakerConstant-v2"\n[timing]\nduration_s = 1e6\n')
    with pytest.raises(SpecError, match=r"at most 1e.07 samples"):
        load_scenario(file)


def test_too_long_a_substep_is_said(tmp_path: Path) -> None:
    """With 2 substeps in place of 30 the record is off by 3.6 % of its spread."""
    file = tmp_path / "Own-v0.toml"
    for substeps, words in (
        (30, ""),
        (2, "Own-v0: .* of its spread with 4 times the substeps.*use more than 2 substeps"),
    ):
        timing = f"[timing]\nduration_s = 4.0\nsubsteps = {substeps}\n[estimation]\nwindow_s = [0.5, 1.5]\n"
        file.write_text(f'extends = "MillingDecreasing-v2"\n{timing}')
        assert re.fullmatch(f"{words}.*" if words else "", integration_doubt(load_scenario(file)))
    result = CliRunner().invoke(app, ["record", str(file), "-o", str(tmp_path / "a.csv")])
    assert (result.exit_code, "use more than 2 substeps" in result.stderr) == (0, True)
    with pytest.raises(SpecError, match="use more than 2 substeps"):
        run([file], ["null"], 1, tmp_path / "out")


# ---- code ----


def test_a_stepper_that_others_wrote_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_CACHE", str(tmp_path))
    kinds = (effects.get("viscous_friction"),)
    text, kernels = compose.source(kinds, 1) + "\nOWN = 1\n", [kind.kernel for kind in kinds]
    path = Path(str(compose.load(text, kernels).__file__))
    assert path.parent == tmp_path
    path.write_text("raise SystemExit('run')")
    assert compose.load(text, kernels).OWN == 1
    assert path.read_text() == text


def test_a_cache_that_anyone_may_write_to_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FDBENCH_CACHE", str(tmp_path))
    tmp_path.chmod(0o777)
    with pytest.raises(FdbenchError, match="anyone may write there"):
        compose.cache_folder()


def test_a_cache_folder_that_is_set_to_nothing_is_the_usual_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("XDG_CACHE_HOME", "")
    monkeypatch.delenv("FDBENCH_CACHE", raising=False)
    assert compose.cache_folder() == tmp_path / ".cache" / "fdbench"


def command(*words: str, **options: object) -> "subprocess.CompletedProcess[str]":
    own = {"env": {**os.environ}, "cwd": REPOSITORY, **options}
    program = [sys.executable, "-c", "import sys; from fdbench.cli import main; main()", *words]
    return subprocess.run(program, capture_output=False, text=True, timeout=120, check=False, **own)  # type: ignore[call-overload, no-any-return]


def test_outputs_that_are_full_or_closed_end_in_one_message() -> None:
    with Path("/dev/full").open("w") as full:
        done = command("--version", stdout=full, stderr=subprocess.PIPE)
    assert (done.returncode, done.stderr) == (2, "fdbench: No space left on device.\n")
    shell = f"{sys.executable} -c 'from fdbench.cli import main; main()' --version >&-"
    done = subprocess.run(shell, shell=True, capture_output=True, text=True, timeout=120, check=False, cwd=REPOSITORY)
    assert (done.returncode, done.stderr) == (0, "")


def test_without_a_compiler_there_is_one_message(tmp_path: Path) -> None:
    env = {**os.environ, "NUMBA_DISABLE_JIT": "1"}
    done = command("record", "ShakerConstant-v2", "-o", str(tmp_path / "a.csv"), env=env, stderr=subprocess.PIPE)
    assert done.returncode == 2
    assert done.stderr.endswith("kernels have to be compiled. Unset NUMBA_DISABLE_JIT in the environment.\n")
    assert done.stderr.count("\n") == 1


# ---- results ----


KEY = RunKey("S-v0", "x", 0)


def kept(folder: Path) -> Store:
    store = Store(folder)
    own = KeptRun(**KEY._asdict(), plant="feed_drive", status="ok", message="", seconds=1.0, provenance={"nonce": ""})
    store.write_run(own)
    assert store.read_run(KEY) == own
    return store


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("seconds", "1"), ("provenance", {"nonce": 3}), ("scores", 3), ("seed", "0"), ("status", []), ("new", 1)),
        *(("parameters", [{"parameter": 3}]), ("scores", [{"metric": "m", "unit": "", "value": 1e999}])),
    ],
)
def test_a_run_of_wrong_types_is_refused(key: str, value: object, tmp_path: Path) -> None:
    store = kept(tmp_path)
    file = store.run_file(KEY)
    file.write_text(json.dumps({**json.loads(file.read_text()), key: value}))
    with pytest.raises(FdbenchError, match=r"0\.json: not a run that this version can read"):
        store.read_run(KEY)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(FdbenchError, match=r"0\.json: not a run that this version can read"):
        store.read_run(KEY)


def test_a_damaged_estimate_is_refused(tmp_path: Path) -> None:
    import pyarrow
    from pyarrow import parquet

    store, good = Store(tmp_path), {"target_name": "a_m", "parameters": {"a": 1.0}, "covariance": [[1.0]]}
    series = {"time_s": [0.0, 1.0], "target": [1.0, 2.0]}
    store.estimate_file(KEY).parent.mkdir(parents=True)

    def write(columns: dict[str, object], about: object) -> None:
        table = pyarrow.table(columns).replace_schema_metadata({"fdbench": json.dumps(about)})
        parquet.write_table(table, store.estimate_file(KEY))

    write(series, good)
    assert store.read_estimate(KEY) is not None
    for columns, about in (
        (series, {**good, "parameters": {"a": "1"}}),
        (series, {**good, "covariance": [[1.0, 2.0]]}),
        (series, {**good, "covariance": 3}),
        (series, []),
        ({"time_s": [0.0, 1.0]}, good),
        ({**series, "odd": [1.0, 2.0]}, good),
        ({**series, "target": ["a", "b"]}, good),
        ({**series, "output": [1.0, None]}, good),
    ):
        write(columns, about)
        with pytest.raises(FdbenchError, match=r"0\.parquet: not an estimate"):
            store.read_estimate(KEY)


@pytest.mark.parametrize("content", [b"\xff", b'{"estimators": {"a|b": ""}}', b'{"commit": 3}', b"[" * 10**6])
def test_a_seal_of_any_bytes_is_refused(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "seal.json").write_bytes(content)
    with pytest.raises(FdbenchError, match=r"seal\.json: not a seal"):
        read_seal(tmp_path)


# ---- trials ----


@pytest.mark.parametrize(
    ("file", "change", "words"),
    [
        ("trial/manifest.json", lambda m: m["cases"].update({"../x": m["cases"].pop("000")}), "does not lie in the f"),
        ("trial/manifest.json", lambda m: m.update(effects="cogging"), "effects: a list is expected"),
        ("trial/manifest.json", lambda m: m.update(tier="\x1b[31m"), "is no name"),
        ("key.json", lambda k: k["cases"]["000"].update(salt="x"), "salt: hexadecimal digits"),
        ("key.json", lambda k: k["cases"]["000"]["truth"].update(listed=[{"nam": 1}]), "'name' is missing"),
        ("key.json", lambda k: k["cases"]["000"]["truth"].update(held_out={"a": {}}), "noise_floor, on_paper, oracle"),
        ("key.json", lambda k: k["cases"]["000"]["truth"].pop("unlisted"), "'unlisted' is missing"),
        ("answers.json", lambda a: a.update(cases=[]), "a table is expected"),
        ("answers.json", lambda a: a["cases"]["000"].update(seconds="1"), "seconds: a number .*is expected"),
        ("answers.json", lambda a: a.update(diagnoser=3), "diagnoser: a text is expected"),
    ],
)  # fmt: skip
def test_a_trial_of_wrong_types_is_refused(file: str, change, words: str, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    targets._make_trial(tmp_path)
    content = json.loads((tmp_path / file).read_text())
    change(content)
    (tmp_path / file).write_text(json.dumps(content))
    targets._reseal(tmp_path)
    with pytest.raises(SpecError, match=words):
        score.score(tmp_path / "trial", tmp_path / "answers.json", tmp_path / "key.json")


def test_a_digest_that_is_no_text_is_refused(tmp_path: Path) -> None:
    targets._make_trial(tmp_path)
    (tmp_path / "answers.sha256").write_bytes(b"\xff\xfe")
    with pytest.raises(SpecError, match="changed since it was handed in"):
        seal.check_digest(tmp_path / "answers.json")
    (tmp_path / "answers.sha256").write_bytes(bytes(5000))
    with pytest.raises(SpecError, match="larger than 4096 bytes"):
        seal.check_digest(tmp_path / "answers.json")


def test_a_damaged_calibration_is_refused(tmp_path: Path) -> None:
    targets._make_kept(tmp_path)
    targets._read_kept(tmp_path, "calibration.json", False)
    for content in ("[", "{}", "[3]", '[{"features": {}, "truth": {}}]'):
        (tmp_path / "calibration.json").write_text(content)
        with pytest.raises(SpecError, match=r"calibration\.json: not the cases of a calibration; remove it"):
            targets._read_kept(tmp_path, "calibration.json", True)


def test_a_machine_that_cannot_be_computed_with_is_refused() -> None:
    with pytest.raises(SpecError, match="too large or too small to compute with"):
        continuous(np.array([[np.nan]]), np.array([[1.0]]), np.array([[1.0]]), ["force_N"], ["position_m"], 1e-3)


@pytest.mark.filterwarnings("error")
def test_a_mass_that_cannot_be_divided_by_is_refused() -> None:
    plant = load_scenario("ShakerConstant-v0").plant
    assert isinstance(plant, FeedDrive)
    light = replace(plant, motor=replace(plant.motor, mass_kg=5e-324))
    with pytest.raises(SpecError, match=r"plant: the values of this machine are too large or too small"):
        light.check_loop(1e-3)


def test_an_answer_without_a_nominal_gap_is_shown(tmp_path: Path) -> None:
    targets._make_answer(tmp_path)
    answer = json.loads((tmp_path / "answer.json").read_text())
    answer["shrinkage"]["on_paper"] = 0.0
    (tmp_path / "answer.json").write_text(json.dumps(answer))
    assert targets._page(tmp_path, "answer.json", True) == ""
