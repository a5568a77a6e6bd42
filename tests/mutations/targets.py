"""What is attacked: valid files of each kind, and the functions behind the commands that read them."""

import codecs
import csv
import hashlib
import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from conftest import REPOSITORY
from proposal import log_writers, servo_tuning_writer
from report.test_answer_page import answer as answer_by_hand

from fdbench.benchmark import seal as run_seal
from fdbench.benchmark.compare import compare
from fdbench.benchmark.leaderboard import leaderboard
from fdbench.benchmark.store import Store
from fdbench.commands.import_ import import_
from fdbench.commands.show import show
from fdbench.diagnosis.model.nominal import load_nominal
from fdbench.proposal import of_tuning
from fdbench.reading import read_record
from fdbench.record import Record
from fdbench.report._measured_response import read_response
from fdbench.report.answer import write_answer
from fdbench.report.record import write_plot
from fdbench.scenario import load_scenario
from fdbench.trials import score, seal
from fdbench.trials.answer import _kept
from fdbench.trials.forms import KINDS
from fdbench.trials.machine_calibration import _kept_cases

N_SAMPLES = 240
MOST_STEPS = 200_000  # of a scenario that is simulated here


@dataclass(frozen=True)
class Target:
    """One row: what writes its files and returns their names, and what is done with them, told which was mutated.

    ``call`` returns a text where what was read is not what the file says; a ``share`` of the mutations is made where it
    takes long.
    """

    name: str
    make: Callable[[Path], list[str]]
    call: Callable[[Path, str, bool], str]
    share: float = 1.0


def record() -> Record:
    """Return a short record of a stroke, as a machine would give it."""
    time_s = 1e-3 * np.arange(N_SAMPLES)
    command = 0.05 * (1.0 - np.cos(2.0 * np.pi * time_s / time_s[-1]))
    random = np.random.default_rng(0)
    position = np.concatenate(([0.0] * 4, command[:-4])) + 1e-6 * random.normal(size=N_SAMPLES)
    torque = (
        3.0 * np.gradient(np.gradient(command, 1e-3), 1e-3)
        + 0.2 * np.sign(np.gradient(command))
        + 0.01 * random.normal(size=N_SAMPLES)
    )
    columns = {"time_s": time_s, "reference_position_m": command, "position_m": position, "motor_torque_Nm": torque}
    return Record(columns, {"scenario": "ByHand-v0", "seed": 3, "condition": "cold"})


# ---- records ----


def _make_records(folder: Path) -> list[str]:
    from scipy.io import savemat

    own = record()
    own.save(folder / "a.csv")
    own.save(folder / "a.parquet")
    plain = Record(dict(own.columns))
    text = "\n".join(
        [",".join(plain), *(",".join(f"{value:.9f}" for value in row) for row in zip(*plain.values(), strict=True))]
    )
    (folder / "b.csv").write_text(text + "\n")
    savemat(folder / "a.mat", {name: column[:, None] for name, column in own.items()})
    savemat(folder / "b.mat", {name: column[:, None] for name, column in own.items()}, do_compression=True)
    savemat(folder / "c.mat", {name: column[:, None] for name, column in own.items()}, format="4")
    return ["a.csv", "b.csv", "a.parquet", "a.mat", "b.mat", "c.mat"]


def _read_record(folder: Path, name: str, is_mutated: bool) -> str:
    file = folder / name
    read = read_record(file)
    if file.suffix == ".csv":
        return _differs_from_plain(read, file)
    same = all(np.array_equal(read[column], values) for column, values in record().items() if column in read)
    if file.suffix == ".parquet" and is_mutated and not same:
        return "the columns are not those that were written"
    return ""


def _differs_from_plain(read: Record, file: Path) -> str:
    """Return how a record differs from what csv and float make of its file, below lines above the names."""
    is_utf_16 = file.read_bytes()[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    with file.open(encoding="utf-16" if is_utf_16 else "utf-8-sig", newline="") as lines:
        rows = [row for row in csv.reader(line for line in lines if not line.startswith("#")) if row]
    places = [place for place, row in enumerate(rows) if [name.strip() for name in row] == list(read)]
    if not places:
        return f"no line has the names {list(read)[:5]}"
    plain = np.array([[float(cell) for cell in row] for row in rows[places[0] + 1 :]]).T
    return "" if np.array_equal(plain, np.array(list(read.values()))) else "other numbers than by float"


def _plot(folder: Path, name: str, is_mutated: bool) -> str:
    write_plot([read_record(folder / name)], folder / "plot.svg")
    return ""


# ---- logs ----


def _make_logs(folder: Path) -> list[str]:
    own, names = record(), []
    logs = {name.replace(", ", "_").replace(" ", "_").replace("-", ""): of for name, of in log_writers.WRITERS.items()}
    logs |= {"sinumerik": ("a.xml", log_writers.sinumerik), "klipper": ("a.csv", log_writers.klipper)}
    logs |= {"odrive": ("a.csv", log_writers.odrive_csv), "utf_16": ("a.csv", log_writers.utf_16_csv)}
    for key, (file, write) in logs.items():
        place = folder / key / file
        (folder / key).mkdir()
        write(own, place)
        names += [str(other.relative_to(folder)) for other in sorted(place.parent.iterdir())]
    return names


def _import(folder: Path, name: str, is_mutated: bool) -> str:
    file, out = folder / name, folder / "out"
    if file.suffix == ".yaml":
        file = next(other for other in file.parent.iterdir() if other.suffix != ".yaml")
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir()
    import_([file], out, None)
    mapping = out / f"{file.stem}.toml"
    if (out / "model.toml").exists():
        read_record(mapping)
        load_nominal(out / "model.toml")
    return ""


def _make_tuning(folder: Path) -> list[str]:
    servo_tuning_writer.servo_tuning(folder / "x.xml")
    servo_tuning_writer.servo_tuning(folder / "c.xml", rotary_axis=True)
    return ["x.xml", "c.xml"]


def _import_tuning(folder: Path, name: str, is_mutated: bool) -> str:
    tuned = of_tuning(folder / name)
    (folder / "model.toml").write_text(tuned.model)
    (folder / "response.csv").write_text(tuned.response or "frequency_Hz,magnitude\n1,1\n2,1\n")
    load_nominal(folder / "model.toml")
    read_response(folder / "response.csv")
    return ""


# ---- mappings, models, scenarios ----


MAPPING = """[record]
file = "a.csv"
delimiter = ","
samples = [0, 200]
condition = "cold"

[columns]
time_s = { from = "time_s", unit = "s" }
position_m = { from = "position_m", unit = "mm", gain = 1.0, offset = 0.0 }
motor_force_N = { from = "motor_torque_Nm", unit = "N m", gain = 628.3 }
"""


def _make_mapping(folder: Path) -> list[str]:
    record().save(folder / "a.csv")
    (folder / "a.toml").write_text(MAPPING)
    (folder / "b.toml").write_text(MAPPING.replace('delimiter = ","\n', "").replace("a.csv", "a.parquet"))
    record().save(folder / "a.parquet")
    return ["a.toml", "b.toml"]


def _read_mapping(folder: Path, name: str, is_mutated: bool) -> str:
    read_record(folder / name)
    return ""


def _make_model(folder: Path) -> list[str]:
    names = ("BallScrewAxis-v0.toml", "LinearMotorAxis-v0.toml")
    for name in names:
        shutil.copy(REPOSITORY / "scenarios" / name, folder / name)
    shutil.copy(REPOSITORY / "examples" / "emps" / "model.toml", folder / "emps.toml")
    return ["emps.toml", *names]


def _read_model(folder: Path, name: str, is_mutated: bool) -> str:
    load_nominal(folder / name)
    return ""


def _show_model(folder: Path, name: str, is_mutated: bool) -> str:
    show(str(folder / name), None, 1e-3 if name == "emps.toml" else None)
    return ""


def _make_scenarios(folder: Path) -> list[str]:
    names = sorted(path.name for path in (REPOSITORY / "scenarios").glob("*.toml"))
    for name in names:
        shutil.copy(REPOSITORY / "scenarios" / name, folder / name)
    return names


def _load_scenario(folder: Path, name: str, is_mutated: bool) -> str:
    scenario = load_scenario(folder / name)
    if scenario.timing is not None:
        scenario.context()
        scenario.drawn(1)
    return ""


def _make_short_scenario(folder: Path) -> list[str]:
    text = (REPOSITORY / "scenarios" / "ShakerConstant-v2.toml").read_text()
    for name in ("ShakerConstant-v0", "ShakerConstant-v1", "ShakerConstant-v2"):
        shutil.copy(REPOSITORY / "scenarios" / f"{name}.toml", folder / f"{name}.toml")
    (folder / "Short-v0.toml").write_text(text)
    return ["Short-v0.toml", "ShakerConstant-v0.toml"]


def _simulate(folder: Path, name: str, is_mutated: bool) -> str:
    """Simulate what needs no other stepper and takes no long time."""
    scenario, usual = (
        load_scenario(folder / name),
        load_scenario(name.removesuffix(".toml") if "Short" not in name else "ShakerConstant-v2"),
    )
    timing = scenario.timing
    kinds = [type(effect).name for effect in scenario.reality.effects]
    if timing is None or kinds != [type(effect).name for effect in usual.reality.effects]:
        return ""
    if type(scenario.plant) is type(usual.plant) and timing.n_samples * timing.substeps <= MOST_STEPS:
        scenario.record(1)
    return ""


# ---- results ----


def _make_results(folder: Path) -> list[str]:
    from short_scenario import short_scenario

    from fdbench.benchmark.run import run

    run([short_scenario(folder, "Short-v0")], ["least_squares"], 1, folder / "results", sealed=True)
    Store(folder / "results").write_made_for({"ab" * 32: ["velocity_loop", "feed_drive"], "cd" * 32: None})
    files = [
        path for path in (folder / "results").rglob("*") if path.is_file() and path.suffix in (".json", ".parquet")
    ]
    return sorted(str(path.relative_to(folder)) for path in files)


def _read_results(folder: Path, name: str, is_mutated: bool) -> str:
    store = Store(folder / "results")
    for key in store.run_keys():
        store.read_run(key)
        store.read_estimate(key)
        store.read_record(key.scenario, key.seed)
    store.made_for()
    run_seal.read_seal(store.folder)
    leaderboard(store)
    compare(store.scores(), store.scores())
    return ""


def _report_results(folder: Path, name: str, is_mutated: bool) -> str:
    from fdbench.report.results import write_report

    write_report(folder / "results", folder / "report.html")
    return ""


# ---- trials ----


def _make_trial(folder: Path) -> list[str]:
    """Write a trial of two cases whose files hold next to nothing: what scores it looks at digests alone."""
    effects, nonce, cases, truths, answers = ["backlash", "cogging"], "ab" * 32, {}, {}, {}
    for number, listed in enumerate((["cogging"], [])):
        name = f"{number:03d}"
        place = folder / "trial" / name
        (place / "records").mkdir(parents=True)
        (place / "records" / "a.csv").write_text("time_s\n0\n")
        salt = seal.salt(nonce, name)
        held_out = {"motor_force_N": {"noise_floor": 2.0, "on_paper": 22.0, "oracle": 4.0}}
        items = [{"name": item, "parameters": {"x": 0.5}, "mean_square": 3.0} for item in listed]
        truth = {"case": name, "listed": items, "unlisted": [], "kind": "screw", "held_out": held_out}
        truths[name] = {"salt": salt, "truth": truth}
        digest = hashlib.sha256(b"time_s\n0\n").hexdigest()
        cases[name] = {"truth_sha256": seal.commitment(salt, truth), "files": {"records/a.csv": digest}}
        said = {"effects": {"backlash": 0.25, "cogging": 0.5 + 0.1 * number}, "unknown": 0.1, "none": 0.3}
        answers[name] = {"status": "ok", "message": "", **said, "closure": 0.5, "seconds": 1.5}
    manifest = {
        "fdbench_version": "0",
        "commit": "c",
        "code_sha256": "d",
        "tier": "B",
        "effects": effects,
        "cases": cases,
    }
    manifest["nonce_sha256"] = seal.commitment(nonce, "nonce")
    seal.write_json(folder / "trial" / "manifest.json", manifest)
    seal.write_json(folder / "key.json", {"nonce": nonce, "manifest_sha256": "", "cases": truths})
    given = {"diagnoser": "x", "constant": False, "commit": "c", "cases": answers, "manifest_sha256": ""}
    seal.write_json(folder / "answers.json", given)
    _reseal(folder)
    return ["trial/manifest.json", "key.json", "answers.json", "answers.sha256"]


def _reseal(folder: Path) -> None:
    """Let whoever mutates a file seal it again, as far as it can be read, so that what it says is looked at."""
    try:
        manifest, key, answers = (
            json.loads((folder / name).read_text()) for name in ("trial/manifest.json", "key.json", "answers.json")
        )
        for name, case in manifest["cases"].items():
            case["truth_sha256"] = seal.commitment(key["cases"][name]["salt"], key["cases"][name]["truth"])
        (folder / "trial" / "manifest.json").write_text(json.dumps(manifest))
        answers["manifest_sha256"] = seal.file_digest(folder / "trial" / "manifest.json")
        (folder / "answers.json").write_text(json.dumps(answers))
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError, OSError):
        pass
    seal.write_digest(folder / "answers.json")


def _score(folder: Path, name: str, is_mutated: bool) -> str:
    kept = {
        file: (folder / file).read_bytes()
        for file in ("trial/manifest.json", "key.json", "answers.json", "answers.sha256")
    }
    if not name.endswith(".sha256"):
        _reseal(folder)
    try:
        score.text(score.score(folder / "trial", folder / "answers.json", folder / "key.json"))
    finally:
        for file, content in kept.items():
            (folder / file).write_bytes(content)
    return ""


# ---- other JSON ----


def _make_answer(folder: Path) -> list[str]:
    (folder / "answer.json").write_text(json.dumps(answer_by_hand(), indent=1))
    return ["answer.json"]


def _page(folder: Path, name: str, is_mutated: bool) -> str:
    write_answer(folder / name, folder / "page.html")
    return ""


def _make_kept(folder: Path) -> list[str]:
    from fdbench.diagnosis.judge import probability_models

    models = probability_models.models()
    own: dict[str, Any] = {kind: {kind: dict.fromkeys(getattr(models, kind).features, 0.5)} for kind in KINDS}
    cases = [
        {
            "features": own,
            "truth": {"listed": [{"name": "cogging"}], "unlisted": []},
            "number": 0,
            "named": [["cogging"]],
        }
    ]
    (folder / "calibration.json").write_text(json.dumps(cases, indent=1))
    said = {"effects": {"cogging": 0.5}, "unknown": 0.1, "none": 0.2, "closure": None}
    answers = {"diagnoser": "x", "cases": {"000": {"status": "ok", "message": "", **said, "seconds": 1.0}}}
    (folder / "answers.json").write_text(json.dumps(answers, indent=1))
    return ["calibration.json", "answers.json"]


def _read_kept(folder: Path, name: str, is_mutated: bool) -> str:
    if name == "answers.json":
        _kept(folder / name, {"diagnoser": "x"})
    else:
        _kept_cases(folder / name)
    return ""


def _make_response(folder: Path) -> list[str]:
    rows = [
        f"{frequency:.3f},{1.0 / frequency:.6f},{-10.0 * frequency:.4f}" for frequency in np.linspace(1.0, 20.0, 40)
    ]
    (folder / "a.csv").write_text("\n".join(["frequency_Hz,magnitude,phase_deg", *rows]) + "\n")
    return ["a.csv"]


def _response(folder: Path, name: str, is_mutated: bool) -> str:
    read_response(folder / name)
    return ""


TARGETS = (
    Target("records", _make_records, _read_record),
    Target("plots of records", _make_records, _plot, 0.25),
    Target("logs, imported", _make_logs, _import, 0.5),
    Target("servo tunings", _make_tuning, _import_tuning, 0.5),
    Target("mappings", _make_mapping, _read_mapping),
    Target("models", _make_model, _read_model),
    Target("linear models, shown", _make_model, _show_model, 0.02),
    Target("scenarios", _make_scenarios, _load_scenario),
    Target("scenarios, simulated", _make_short_scenario, _simulate),
    Target("results folders", _make_results, _read_results, 0.1),
    Target("reports of results", _make_results, _report_results, 0.02),
    Target("trials, keys and answers", _make_trial, _score, 0.5),
    Target("answers as JSON", _make_answer, _page),
    Target("what was kept", _make_kept, _read_kept),
    Target("frequency responses", _make_response, _response),
)
