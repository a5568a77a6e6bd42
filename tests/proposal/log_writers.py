"""A record as logs of several controllers would have it; each writer follows the layout that its reader documents."""

import json
import struct
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from fdbench.record import Record


def in_file_units(record: Record) -> dict[str, np.ndarray]:
    """Return time (ms), command and position (mm) and torque (N m)."""
    return {
        "time": 1e3 * record["time_s"],
        "command": 1e3 * record["reference_position_m"],
        "position": 1e3 * record["position_m"],
        "torque": np.asarray(record["motor_torque_Nm"]),
    }


def german_csv(record: Record, file: Path) -> None:
    """A preamble, semicolons, decimal commas, units below the names, a column of words, Windows' characters."""
    lines = ["Messung;Achse X", "", "Zeit;Lagesollwert;Lageistwert;Drehmoment;Temperatur °C;Modus", "ms;mm;mm;Nm;°C;"]
    for row in zip(*in_file_units(record).values(), strict=True):
        lines.append(";".join(f"{value:.8f}".replace(".", ",") for value in row) + ";20,5;Auto")
    file.write_text("\n".join(lines) + "\n", "cp1252")


def bracket_csv(record: Record, file: Path) -> None:
    """Units in the names, speeds whose unit follows from the position, times in seconds."""
    columns = in_file_units(record)
    speed = 60.0 * np.gradient(columns["position"], record.sampling_time_s)
    lines = ["Time [s],Position command [mm],Actual position [mm],Actual velocity,Torque command [Nm]"]
    values = (1e-3 * columns["time"], columns["command"], columns["position"], speed, columns["torque"])
    lines += [",".join(f"{value:.8f}" for value in row) for row in zip(*values, strict=True)]
    file.write_text("\n".join(lines) + "\n")


def utf_16_csv(record: Record, file: Path) -> None:
    """The German table as PowerShell would copy it."""
    german_csv(record, file)
    file.write_bytes(file.read_text("cp1252").encode("utf-16"))


def halsampler(record: Record, file: Path, tag: bool = False, lost: int = 0) -> None:
    """Rows as ``printf("%f ")`` writes them; the first fifth is before an overrun if samples are lost."""
    lines = []
    columns = in_file_units(record)
    for place, row in enumerate(zip(columns["command"], columns["position"], columns["torque"], strict=True)):
        number = place + (lost if place >= record.n_samples // 5 else 0)
        if lost and place == record.n_samples // 5:
            lines.append("overrun")
        lines.append((f"{number} " if tag else "") + "".join(f"{value:f} " for value in row) + "1 ")
    file.write_text("\n".join(lines) + "\n")


def sinumerik(record: Record, file: Path) -> None:
    """The servo cycle stores what changes; the second encoder is stored each second cycle, shifted by one."""
    columns = in_file_units(record)
    step = record.sampling_time_s
    signals = [
        ("f1", step, "Position setpoint (64 bit)", "/Nck/!SD/nckServoDataCmdPos64 [u1, 7]", "posn", "command"),
        (
            "f2",
            step,
            "Torque-prod. Current set val. i(q)",
            "/Nck/!SD/nckServoDataCmdCurr32 [u1, 7]",
            "current",
            "torque",
        ),
        (
            "f3",
            2 * step,
            "Actual position value for measuring system 2.",
            "/Nck/!SEMA/measPos2 [u1, 7]",
            "posn",
            "position",
        ),
    ]
    lines = [
        '<?xml version="1.0" encoding="utf-8" ?>',
        '<traceSession version="01.00.03.02">',
        '<traceData dataFrames="1">',
    ]
    lines += [" <dataFrame>", f'  <frameHeader dropOuts="0" stopInc="{step * (record.n_samples - 1):.6f}"/>']
    for key, interval, label, name, units, _ in signals:
        lines.append(
            f'  <dataSignal domain="NCU_1" interval="{interval:.6f}" id="{key}" description="{label}" name="{name}" '
            f'unitsType="{units}" dataType="double"/>'
        )
    last: dict[str, str] = {}
    for place in range(record.n_samples):
        cells = ""
        for key, interval, *_, column in signals:
            text = f"{columns[column][place]:.6f}"
            is_slow = interval > step
            if (is_slow and place % 2 == 1) or (not is_slow and text != last.get(key)):
                cells += f' {key}="{text}"'
                last[key] = text
        if cells:
            lines.append(f'  <rec time="{step * place:.6f}"{cells}/>')
    file.write_text("\n".join([*lines, " </dataFrame>", "</traceData>", "</traceSession>"]) + "\n")


def twincat(record: Record, file: Path, mark: str = "\t", shared: bool = False) -> None:
    """A head of lines for each channel, decimal commas, a slow channel that ends earlier; EOF at the end."""
    columns = in_file_units(record)
    channels = [("SetPos", "command", "mm (Length)"), ("ActPos", "position", "mm (Length)")]
    channels += [("SetTorque", "torque", "Nm (Torque)"), ("Temp", "time", "(None)")]
    ticks = 132959733843760000
    lines = [f"Name{mark}Scope", f"File{mark}x.csv", f"Starttime of export{mark}{ticks}{mark}Montag"]
    lines += [f"Endtime of export{mark}{ticks + round(1e4 * columns['time'][-1])}{mark}Montag", "", ""]

    def head(key: str, values: Sequence[str]) -> str:
        cells = [f"{key}{mark}{value}" for value in values]
        return mark.join([key, *values[:3], cells[3]]) if shared else mark.join(cells)

    lines.append(head("Name", [name for name, *_ in channels]))
    lines.append(head("SampleTime[ms]", ["1", "1", "1", "4"]))
    lines.append(head("ScaleFactor", ["1"] * 4))
    lines += [head("Unit", [unit for *_, unit in channels]), ""]

    def text(value: float) -> str:
        return f"{value:.8f}".replace(".", ",")

    for place in range(record.n_samples):
        time = text(columns["time"][place])
        row = [text(columns[key][place]) for _, key, _ in channels[:3]]
        cells = [time, *row] if shared else [cell for value in row for cell in (time, value)]
        is_slow = 4 * place < record.n_samples
        cells += [text(columns["time"][4 * place]), "20"] if is_slow else [" ", " "]
        lines.append(mark.join(cells))
    file.write_text("\n".join([*lines, "EOF"]) + "\n", "utf-8")


def codesys_trace(record: Record, file: Path, flags: int = 16, scatter_us: int = 0) -> None:
    """One variable after the other, each with its times; one ends a sample earlier, another is a text."""
    columns = in_file_units(record)
    ticks = {16: 1, 32: 1000}[flags & 48]
    lines = ["[key]; [value]", "Version; 0x03050000", "IecTaskName; EtherCAT_Task", "Comment; ", "EveryNCycles; 1"]
    lines += ["BufferEntries; 5000", f"Flags; {flags}"]
    variables = [("fSetPosition", "command"), ("fActPosition", "position"), ("fSetTorque", "torque")]
    for number, (name, key) in enumerate([*variables, ("bPower", ""), ("sState", "")]):
        lines += [f"{number}.Variable; GVL.Axis_X.{name}", f"{number}.Class; 14", f"{number}.Data; "]
        for place in range(record.n_samples - (name == "bPower")):
            time = 50 + ticks * place + place * 7919 % (2 * scatter_us + 1) - scatter_us
            value = {"bPower": "TRUE", "sState": "'ready; on'"}.get(name) or repr(float(columns[key][place]))
            lines.append(f"; {time}; {value}")
    file.write_bytes(("\n".join(lines) + "\n").replace("\n;", "\r\n;").encode("utf-8-sig"))


def odrive_csv(record: Record, file: Path) -> None:
    """A user's own table of ODrive's values: turns, and amperes at 0.5 N m/A; names as in its API."""
    turns = {name: record[name] / 0.01 for name in ("reference_position_m", "position_m")}
    values = (record["time_s"], *turns.values(), record["motor_torque_Nm"] / 0.5)
    lines = ["timestamp,axis0.controller.input_pos,axis0.pos_estimate,axis0.motor.Iq_setpoint"]
    lines += [",".join(f"{value:.9f}" for value in row) for row in zip(*values, strict=True)]
    file.write_text("\n".join(lines) + "\n")


def klipper(record: Record, file: Path) -> None:
    """Accelerations only."""
    rows = [f"{time:.6f},{9.0 * np.sin(time):.6f},0.100000,9810.0" for time in record["time_s"]]
    file.write_text("\n".join(["##stats", "#time,accel_x,accel_y,accel_z", *rows]) + "\n")


def mdf(record: Record, file: Path) -> None:
    """One group, by asammdf."""
    from asammdf import MDF, Signal

    columns, units = in_file_units(record), {"command": "mm", "position": "mm", "torque": "Nm"}
    with MDF(version="4.10") as written:
        signals = [
            Signal(columns[key], np.asarray(record["time_s"]), name=f"X axis {key}", unit=unit)
            for key, unit in units.items()
        ]
        written.append(signals)
        written.save(file)


def mcap_json(record: Record, file: Path) -> None:
    """One topic of JSON, by the package mcap."""
    from mcap.writer import Writer

    with file.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("State", "jsonschema", b'{"type": "object"}')
        channel = writer.register_channel("/axis", "json", schema)
        for time_s, command, position, torque in zip(record["time_s"], *_rows(record), strict=True):
            said = {"position_command_mm": command, "position_actual_mm": position, "torque_command_Nm": torque}
            stamp = 1_700_000_000_000_000_000 + round(1e9 * time_s)
            writer.add_message(channel, stamp, json.dumps(said).encode(), stamp)
        writer.finish()


def ros2_bag(record: Record, file: Path, storage: str = "SQLITE3") -> None:
    """Joint states and commands on two topics with the same stamps, by rosbags; ``file`` is within the bag's folder."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    with Writer(file.parent, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        topics = [
            writer.add_connection(name, state.__msgtype__, typestore=store) for name in ("/joint_states", "/command")
        ]
        for time_s, command, position, torque in zip(record["time_s"], *_rows(record), strict=True):
            time_ns = 1_700_000_000_000_000_000 + round(1e9 * time_s)
            head = header(stamp(time_ns // 10**9, time_ns % 10**9), "")
            none = np.zeros(0)
            for topic, place, effort in ((topics[0], position, [torque]), (topics[1], command, [])):
                said = state(head, ["slide"], np.array([1e-3 * place]), none, np.array(effort))
                writer.write(topic, time_ns + 12345, store.serialize_cdr(said, state.__msgtype__))


def ros1_bag(record: Record, file: Path) -> None:
    """One topic of joint states whose effort is the torque, and one of commands, by rosbags."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    stamp = store.types["builtin_interfaces/msg/Time"]
    with Writer(file) as writer:
        topics = [
            writer.add_connection(name, state.__msgtype__, typestore=store) for name in ("/joint_states", "/command")
        ]
        for number, (time_s, command, position, torque) in enumerate(
            zip(record["time_s"], *_rows(record), strict=True)
        ):
            time_ns = 1_700_000_000_000_000_000 + round(1e9 * time_s)
            head = header(number, stamp(time_ns // 10**9, time_ns % 10**9), "")
            none = np.zeros(0)
            for topic, place, effort in ((topics[0], position, [torque]), (topics[1], command, [])):
                said = state(head, ["slide"], np.array([1e-3 * place]), none, np.array(effort))
                writer.write(topic, time_ns + 12345, store.serialize_ros1(said, state.__msgtype__))


def twincat_svb(record: Record, file: Path, has_times: bool = True, start_ticks: int = 0) -> None:
    """A head, a header for each channel, then times, in 32 bits, and values of each channel."""
    columns = in_file_units(record)
    ticks = 132959733843760000
    sample = round(1e7 * record.sampling_time_s)
    channels = [("SetPos", "command"), ("ActPos", "position"), ("SetTorque", "torque")]
    kind = np.dtype([("time", "<u4"), ("value", "<f8")] if has_times else [("value", "<f8")])

    def text(words: str) -> bytes:
        return struct.pack("<i", len(words.encode())) + words.encode()

    def header(name: str, start: int) -> bytes:
        body = text(name) + text("5.1.2.3.1.1") + struct.pack("<iq?", 851, sample, True)
        body += text(f"MAIN.{name}") + text("") + struct.pack("<qq", 16448, 608) + text("REAL64")
        body += struct.pack("<iiqqqddq", 5, 8, record.n_samples, kind.itemsize * record.n_samples, start, 0.0, 1.0, -1)
        return struct.pack("<q", 8 + len(body)) + body

    def head(size: int) -> bytes:
        body = text("Scope µ") + struct.pack("<qqi", ticks, ticks + sample * record.n_samples, len(channels))
        for place, (name, _) in enumerate(channels):
            body += header(name, size + place * kind.itemsize * record.n_samples)
        return struct.pack("<q", 8 + len(body)) + body

    content = head(len(head(0)))
    for _, column in channels:
        rows = np.zeros(record.n_samples, kind)
        rows["value"] = columns[column]
        if has_times:
            rows["time"] = (start_ticks + sample * np.arange(record.n_samples)) % 2**32
        content += rows.tobytes()
    file.write_bytes(content)


def _rows(record: Record) -> list[np.ndarray]:
    columns = in_file_units(record)
    return [columns[key] for key in ("command", "position", "torque")]


WRITERS: dict[str, tuple[str, Callable[[Record, Path], None]]] = {
    "csv, German": ("a.csv", german_csv),
    "csv, units in names": ("a.txt", bracket_csv),
    "halsampler": ("a.dat", halsampler),
    "halsampler -t": ("a.log", lambda record, file: halsampler(record, file, tag=True)),
    "twincat": ("a.csv", twincat),
    "twincat, shared times": ("a.csv", lambda record, file: twincat(record, file, ";", shared=True)),
    "codesys, ms": ("a.csv", codesys_trace),
    "codesys, us that scatter": ("a.csv", lambda record, file: codesys_trace(record, file, 36, scatter_us=40)),
    "mdf": ("a.mf4", mdf),
    "mcap, JSON": ("a.mcap", mcap_json),
    "ROS 2 bag": ("bag/bag.db3", ros2_bag),
    "ROS 1 bag": ("a.bag", ros1_bag),
    "twincat, binary": ("a.svb", twincat_svb),
    "twincat, binary without times": ("a.dat", lambda record, file: twincat_svb(record, file, has_times=False)),
    "ROS 2 bag in MCAP": ("bag/bag.mcap", lambda record, file: ros2_bag(record, file, "MCAP")),
}
