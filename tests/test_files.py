"""Files that are written are whole or not there, whatever writes them and whenever it fails."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from fdbench.errors import FdbenchError, SpecError
from fdbench.files import remove_forgotten, replaced, write_text

resource = pytest.importorskip("resource", reason="limits of the size of files are of POSIX")

# Writes every kind of file with room for so many bytes in each, and prints what is said of it.
PROGRAM = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from fdbench.benchmark.store import Store
from fdbench.errors import FdbenchError
from fdbench.files import write_text
from fdbench.record import Record
from fdbench.report._page import write_page
from fdbench.report.record import write_plot

time_s = 1e-3 * np.arange(3000)
record = Record({"time_s": time_s, "position_m": np.sin(time_s), "reference_position_m": np.cos(time_s)})
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.getrlimit(resource.RLIMIT_FSIZE)[1]))
for name, write in {
    "record.csv": record.save,
    "record.parquet": record.save,
    "plot.html": lambda path: write_plot([record], path),
    "plot.svg": lambda path: write_plot([record], path),
    "answer.json": lambda path: write_text(path, "{" + 9000 * " " + "}"),
    "folder/run.json": lambda path: Store(path.parent).write_selection({"scenarios": 900 * ["ShakerConstant-v2"]}),
}.items():
    try:
        write(Path(name))
    except FdbenchError as error:
        print(error)
"""
FILES = ("record.csv", "record.parquet", "plot.html", "plot.svg", "answer.json", "folder/run.json")


def test_a_full_disk_leaves_what_was_there(tmp_path: Path) -> None:
    """Of each file 4096 bytes find room: none is cut under its name, none is left beside, and each is named."""
    (tmp_path / "folder").mkdir()
    for name in FILES:
        (tmp_path / name).write_text("as it was", "utf-8")
    command = [sys.executable, "-c", PROGRAM, "4096"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=True)
    assert done.stdout.splitlines() == [f"{name}: cannot be written: File too large." for name in FILES]
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert left == set(FILES)
    assert {(tmp_path / name).read_text("utf-8") for name in FILES} == {"as it was"}


def test_an_interruption_leaves_what_was_there(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    write_text(path, "before")

    def interrupted() -> None:
        with replaced(path) as partial:
            partial.write_text("half", "utf-8")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_text("utf-8") == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_faults_are_said_in_the_words_of_who_writes(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"no_folder.a\.txt: cannot be written: No such file or directory\.$"):
        write_text(tmp_path / "no_folder" / "a.txt", "", SpecError)
    write_text(tmp_path / "folder" / "a.txt", "text", folders=True)
    assert (tmp_path / "folder" / "a.txt").read_text("utf-8") == "text"
    with pytest.raises(FdbenchError, match="folder: cannot be written"):
        write_text(tmp_path / "folder", "")


def test_links_stay_links_and_what_is_no_file_is_written_to(tmp_path: Path) -> None:
    target, link = tmp_path / "target.txt", tmp_path / "link.txt"
    write_text(target, "before")
    link.symlink_to(target)
    write_text(link, "after")
    assert link.is_symlink()
    assert target.read_text("utf-8") == "after"
    command = [sys.executable, "-c", "from fdbench.files import write_text; write_text('/dev/stdout', 'said')"]
    with (tmp_path / "piped.txt").open("w") as file:
        subprocess.run(command, stdout=file, timeout=60, check=True)
    assert (tmp_path / "piped.txt").read_text("utf-8") == "said"
    assert subprocess.run(command, capture_output=True, text=True, timeout=60, check=True).stdout == "said"
    write_text(os.devnull, "nothing")
    assert Path(os.devnull).exists()
    assert not Path(os.devnull).is_file()


def test_what_a_killed_writer_left_is_removed_and_what_is_being_written_stays(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    left, finished = tmp_path / "runs" / ".0.json.7.7.partial", tmp_path / "0.json"
    for file in (left, finished):
        file.write_text("{}")
        os.utime(file, (0.0, 0.0))
    with replaced(tmp_path / "scores.parquet") as partial:
        partial.write_text("half")
        remove_forgotten(tmp_path)
        assert sorted(tmp_path.rglob("*.*")) == sorted([partial, finished])
