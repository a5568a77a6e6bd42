"""Logs of rotary axes, of two encoders and of torques in steps: which column is what, and what gain is asked for."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from fdbench import cli
from fdbench.reading import read_record
from fdbench.record import FloatArray, Record

STEP_S = 1e-3
TIME_S = STEP_S * np.arange(4000)


def imported(folder: Path, **columns: FloatArray) -> Result:
    """Import columns as a CSV; of ``a__b`` the blanks are written as in ``a b``."""
    rows = zip(TIME_S, *columns.values(), strict=True)
    head = ",".join(["t_s", *(name.replace("__", " ") for name in columns)])
    (folder / "a.csv").write_text("\n".join([head, *(",".join(f"{value:.9g}" for value in row) for row in rows), ""]))
    return CliRunner().invoke(cli.app, ["import", str(folder / "a.csv")])


def read(folder: Path) -> Record:
    return read_record(folder / "a.toml")


def noise(size: float, seed: int = 0) -> FloatArray:
    return size * np.random.default_rng(seed).standard_normal(len(TIME_S))


def stroke() -> tuple[FloatArray, FloatArray, FloatArray]:
    """A command, what follows it 5 ms later, and the force that moves it: F = 2 a + 1 v + 0.5 sign(v)."""
    speed = 2.0 * np.pi * 0.7

    def at(time: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        phase = speed * np.maximum(time - 0.1, 0.0)
        moves = time > 0.1
        return 3.0 * (1.0 - np.cos(phase)), 3.0 * speed * np.sin(phase), 3.0 * moves * speed**2 * np.cos(phase)

    command, (place, velocity, acceleration) = at(TIME_S)[0], at(TIME_S - 5e-3)
    return command, place + noise(1e-5), 2.0 * acceleration + velocity + 0.5 * np.sign(velocity) + noise(0.01, 1)


def played(place: FloatArray, play: float) -> FloatArray:
    """What is behind a play."""
    behind, now = np.empty_like(place), place[0]
    for sample, ahead in enumerate(place):
        now = min(max(now, ahead - 0.5 * play), ahead + 0.5 * play)
        behind[sample] = now
    return behind


def coasted(torque: FloatArray) -> FloatArray:
    """The angle of an inertia of 0.1 with a drag of 0.3 under a torque."""
    angle, speed = np.zeros_like(torque), 0.0
    for sample in range(len(torque) - 1):
        speed += STEP_S * (torque[sample] - 0.3 * speed) / 0.1
        angle[sample + 1] = angle[sample] + STEP_S * speed
    return angle


def test_a_torque_in_a_few_steps_is_the_output(tmp_path: Path) -> None:
    torque = np.repeat([0.0, 1.0, -1.0, 2.0, -2.0], 800)
    result = imported(tmp_path, torque_cmd=torque, angle=coasted(torque) + noise(1e-6))
    assert result.exit_code == 0, result.output
    np.testing.assert_array_equal(read(tmp_path)["motor_torque_Nm"], torque)


def test_a_switch_that_is_called_an_output_is_none(tmp_path: Path) -> None:
    _, place, _ = stroke()
    result = imported(tmp_path, angle=place, digital_output=np.repeat([0.0, 1.0, 0.0, 1.0], 1000))
    assert result.exit_code == 1
    assert "'digital_output': a few values, as of a switch or a mode, which mass and friction do not" in result.output


def test_a_limit_in_steps_is_not_the_commanded_torque(tmp_path: Path) -> None:
    command, place, force = stroke()
    limit = np.repeat([3.0, 4.0, 5.0, 6.0], 1000)
    result = imported(tmp_path, x_set=command, x=place, torque_limit_set=limit, torque=force)
    assert result.exit_code == 0, result.output
    np.testing.assert_allclose(read(tmp_path)["motor_force_N"], force, rtol=1e-8)


def test_sides_that_only_names_tell(tmp_path: Path) -> None:
    """Motor and table are nearer to one another than to their command, which passed for a force."""
    command, motor, torque = stroke()
    table = played(motor, 0.02) + noise(1e-5, 2)
    result = imported(tmp_path, C_soll=command, C_motor=motor, C_tisch=table, M_mot=torque)
    assert result.exit_code == 0, result.output
    found = read(tmp_path)
    for name, values in (("reference", command), ("motor", motor), ("table", table)):
        np.testing.assert_allclose(found[f"{name}_position_rad"], values, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found["motor_torque_Nm"], torque, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("name", ["C_tisch", "second"])
def test_a_second_position_is_proposed(name: str, tmp_path: Path) -> None:
    command, motor, torque = stroke()
    table = 0.02 * played(motor, 0.02) + 0.3 + noise(2e-7, 2)
    result = imported(tmp_path, phi_set=command, phi=motor, torque=torque, **{name: table})
    assert result.exit_code == 0, result.output
    assert f"table_position_rad is '{name}': GUESS: 'phi' but for a little, the table's" in result.output
    assert "CHECK table_position_rad: 'phi' but for a little" in result.output
    assert "CHECK table_position_rad: its gain is a guess" in result.output
    found = read(tmp_path)
    np.testing.assert_allclose(found["motor_position_rad"], motor, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(found["table_position_rad"] - 15.0, played(motor, 0.02), atol=5e-3)


def test_the_same_position_in_counts_is_no_second_one(tmp_path: Path) -> None:
    command, motor, torque = stroke()
    result = imported(tmp_path, phi_set=command, phi=motor, torque=torque, counter=np.round(1e4 * motor))
    assert result.exit_code == 0, result.output
    assert "table_position_rad" not in read(tmp_path)
    assert "left out 'counter'" in result.output


def test_of_several_axes_none_is_a_second_position(tmp_path: Path) -> None:
    command, place, force = stroke()
    beside = place + noise(1e-4, 3)
    result = imported(tmp_path, x_set=command, x=place, force=force, y_set=1.0001 * command, y=beside)
    assert result.exit_code == 0, result.output
    assert "table_position_m" not in read(tmp_path)


def test_of_three_columns_without_names_the_leading_one_is_the_command(tmp_path: Path) -> None:
    command, motor, force = stroke()
    table = played(motor, 0.02) + noise(1e-5, 2)
    result = imported(tmp_path, one=table, two=motor, three=command, four=force)
    assert result.exit_code == 0, result.output
    found = read(tmp_path)
    np.testing.assert_allclose(found["reference_position_m"], 1e-3 * command, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found["motor_position_m"], 1e-3 * motor, rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(found["table_position_m"], 1e-3 * table, rtol=1e-8, atol=1e-9)


def test_the_angle_of_a_screw_beside_its_table_has_a_gain(tmp_path: Path) -> None:
    """A lead of 10 mm: the angle had been read as if it were millimetres."""
    command, place, force = stroke()
    angle = 200.0 * np.pi * 1e-3 * played(place, 1e-3)
    result = imported(tmp_path, x_set_mm=command, x_mm=place, motor_angle_rad=angle, torque_Nm=force)
    assert result.exit_code == 0, result.output
    assert 'motor_position_m = { from = "motor_angle_rad", unit = "rad", gain = 0.001592 }' in (
        tmp_path / "a.toml"
    ).read_text("utf-8")
    assert (
        "CHECK motor_position_m: its gain is a guess, by which it is 'x_mm' again. Give the true one" in result.output
    )


def test_a_command_in_another_unit_than_the_motors_angle_has_a_gain(tmp_path: Path) -> None:
    command, place, force = stroke()
    speed = np.gradient(command, STEP_S)
    angle = 200.0 * np.pi * 1e-3 * np.concatenate((place[5:], np.full(5, place[-1])))
    result = imported(tmp_path, x_set_mm=command, v_set_mm_s=speed, motor_angle_rad=angle, torque_Nm=force)
    assert result.exit_code == 0, result.output
    assert "CHECK reference_position_rad: its gain is a guess" in result.output
    assert "left out 'v_set_mm_s': no unit makes it the derivative" in result.output
    np.testing.assert_allclose(read(tmp_path)["reference_position_rad"], 0.2 * np.pi * command, rtol=1e-3, atol=1e-9)


def test_a_side_that_does_not_follow_is_said(tmp_path: Path) -> None:
    """Such as a temperature that is called theta."""
    command, place, force = stroke()
    warming = 20.0 + TIME_S + noise(0.01)
    result = imported(tmp_path, x_set=command, x=place, theta_motor=warming, force=force)
    assert "CHECK motor_position_m: it does not follow 'x', so that its gain is open" in result.output


def test_a_torque_and_its_command_are_no_positions(tmp_path: Path) -> None:
    command, place, force = stroke()
    result = imported(tmp_path, one=command, two=place, torque_set=force + noise(0.01, 5), torque=force)
    assert result.exit_code == 0, result.output
    assert "reference_position_m is 'one'" in result.output
    assert "motor_force_N is 'torque" in result.output


def test_a_motors_angle_and_a_current_ask_for_gear_and_constant(tmp_path: Path) -> None:
    _, place, torque = stroke()
    result = imported(tmp_path, motor_angle_rad=place, i_q=torque)
    assert result.exit_code == 0, result.output
    mapping = (tmp_path / "a.toml").read_text("utf-8")
    for words in (
        "CHECK position_rad: the motor's angle counts as the axis's. Behind a gear give each position 1 / its ratio",
        "until you give the motor's constant in N m/A (behind a gear times its ratio) as gain",
    ):
        assert words in result.output
        assert words in mapping
    assert 'position_rad = { from = "motor_angle_rad", unit = "rad", gain = 1.0 }' in mapping


def test_the_velocity_is_that_of_its_own_position(tmp_path: Path) -> None:
    """The command's velocity is no derivative of a position that lags far behind it."""
    command, place, force = stroke()
    late = np.concatenate((np.full(120, place[0]), place[:-120]))
    result = imported(
        tmp_path, x_cmd_mm=command, v_cmd_mm_s=np.gradient(command, STEP_S), x_mm=0.8 * late, torque_Nm=force
    )
    assert result.exit_code == 0, result.output
    assert "its name says velocity, and it is the derivative of 'x_cmd_mm' (100%)" in result.output
    np.testing.assert_allclose(
        read(tmp_path)["reference_velocity_m_per_s"], 1e-3 * np.gradient(command, STEP_S), rtol=1e-8, atol=1e-9
    )


def test_the_units_of_positions_are_told_by_the_commands_velocity(tmp_path: Path) -> None:
    command, place, force = stroke()
    result = imported(tmp_path, x_cmd=command, v_cmd_mm_s=np.gradient(command, STEP_S), x=0.95 * place, force=force)
    assert result.exit_code == 0, result.output
    assert "in mm: the derivative of 'x_cmd' is 'v_cmd_mm_s' in mm/s" in result.output


def test_counts_do_not_take_the_unit_of_their_command(tmp_path: Path) -> None:
    command, place, force = stroke()
    speed = np.gradient(command, STEP_S)
    result = imported(tmp_path, x_cmd_mm=command, v_cmd_mm_s=speed, x=np.round(1e4 * place), force=force)
    assert result.exit_code == 0, result.output
    assert "CHECK the unit of the positions: um is a guess. Counts of an encoder: write gain" in result.output


@pytest.mark.parametrize(
    ("name", "size", "unit"), [("phi", 1.0, "rad"), ("Winkel", 57.3, "deg"), ("theta", 1.0, "rad")]
)
def test_names_of_angles_make_a_rotary_axis(name: str, size: float, unit: str, tmp_path: Path) -> None:
    _, place, torque = stroke()
    result = imported(tmp_path, **{name: size * place}, torque=torque)
    assert result.exit_code == 0, result.output
    assert f"position_rad is '{name}': its name says position; in {unit}: GUESS: by its name an angle" in result.output
    assert f"CHECK the unit of the positions: {unit} is a guess." in result.output
    assert "A first model, rotary" in result.output


def test_a_position_lags_behind_what_is_called_its_command(tmp_path: Path) -> None:
    """A velocity loop alone: the integral of its command runs away from the position."""
    command, place, torque = stroke()
    result = imported(tmp_path, w_set_int=command, phi=0.93 * place, torque=torque)
    assert result.exit_code == 0, result.output
    assert "reference_position_rad is 'w_set_int': its name says commanded, and 'phi' follows it" in result.output
