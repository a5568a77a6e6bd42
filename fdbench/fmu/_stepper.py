"""The stepper of one axis in C: the integrator and the kernels of the axis' effects, with their values."""

from collections.abc import Sequence

import numpy as np

from fdbench.effects import Port
from fdbench.errors import SpecError
from fdbench.fmu._translate import Translator
from fdbench.plants.feed_drive import FeedDrive
from fdbench.simulate import integrator, layout
from fdbench.simulate.block import Blocks
from fdbench.simulate.ports import PORT_ARGUMENTS, Slot

# Functions of the integrator, with their arguments in C.
INTEGRATOR = {
    "propagate": "double *w, int row, int i, double x_m, double v_m, double x_t, double v_t, double force_m, "
    "double force_t",
    "measure_and_control": "double *w, double period",
    "integrate_substep": "double *w, double time_in_period, double period, double h",
}
# Arrays of the integrator in C: one lane.
ARRAYS = {"w": "w[{0}]"}


def stepper(drive: FeedDrive, period_s: float, substeps: int) -> str:
    """Return the text in C: ``initial``, the block of an axis, and ``sample``, which advances it by a sampling time.

    Raises
    ------
    SpecError
        If an effect is random, or is written in words that are not translated.
    """
    for effect in drive.effects:
        if effect.random:
            raise SpecError(f"plant.effects: {effect.name} is random; an FMU gives the same each time. Leave it out.")
    kinds = tuple(type(effect) for effect in drive.effects)
    blocks = Blocks(kinds, 1, 1)
    mechanics = drive.mechanics()
    blocks.set_mechanics(mechanics, period_s / substeps)
    blocks.set_scalars({**drive.rows(), "LOGGED_PER_N": 1.0 / drive.motor.force_per_unit})
    for number, effect in enumerate(drive.effects):
        blocks.set_effect(number, effect, not (mechanics.rigid and effect.needs_screw))
    translator = Translator(ARRAYS)
    constants = {name: row for row, name in enumerate(layout.ROWS)} | {"LANES": 1}
    constants |= {name: value for name, value in vars(layout).items() if name.startswith("OUT_")}
    ports = _ports(blocks.slots, translator)
    own = len(translator.functions)
    translator.ports = {port.value: f"port_{port.value}" for port in Port}
    for function, given in INTEGRATOR.items():
        translator.add(getattr(integrator, function), function, constants, given)
    kernels, integrated = translator.functions[:own], translator.functions[own:]
    values = blocks.values[0, :, 0]
    lines = [f"#define {name} {value}" for name, value in constants.items() if name != "LANES"]
    lines += [f"#define N_ROWS {len(values)}", f"#define N_OUT {layout.OUT_COLUMNS}"]
    lines += [f"#define SUBSTEPS {substeps}", f"#define PERIOD_S {float(period_s)!r}", ""]
    lines += [f"static const double initial[N_ROWS] = {{{', '.join(map(_number, values))}}};", ""]
    return "\n".join([*lines, *kernels, ports, *integrated])


def _number(value: float) -> str:
    value = float(value)
    return repr(value) if np.isfinite(value) else ("INFINITY" if value > 0.0 else "(-INFINITY)")


def _ports(slots: Sequence[Slot], translator: Translator) -> str:
    """Return a function for each port, which calls the kernels of its effects in order of their ranks."""
    texts = []
    for port, arguments in PORT_ARGUMENTS.items():
        own = sorted((slot for slot in slots if slot.effect.port is port), key=lambda slot: slot.effect.rank)
        given = ", ".join(f"int {name}" for name in ["x", "v", *arguments.split(", ")])
        calls = [line for slot in own for line in _call(slot, translator)]
        texts.append("\n".join([f"static void port_{port.value}(double *w, double h, {given})", "{", *calls, "}", ""]))
    return "\n".join(texts)


def _call(slot: Slot, translator: Translator) -> list[str]:
    """Return the lines that call the kernel of one effect and take in what it returns."""
    effect, port = slot.effect, slot.effect.port
    translator.add(effect.kernel, f"kernel_{effect.declared.name}")
    name, width = translator.known(effect.kernel)  # effects may share a kernel
    parameters, states = len(effect.parameters()), len(effect.states)
    rows = [f"w[{slot.parameter(place)}]" for place in range(parameters)]
    kept = [f"w[{slot.first_state + place}]" for place in range(states)]
    velocity = "w[COMMANDED_V]" if effect.follows_command else "w[v]"
    entering = "w[u] - w[total]" if port is Port.TRANSMISSION else "w[u]"
    given = ", ".join(["w[T]", "h", "w[x]", velocity, entering, *rows, *kept, "result"])
    first = 2 if port.is_force else 1
    if width != first + states:
        raise SpecError(f"{effect.name}: its kernel returns {width} numbers, not {first + states}.")
    lines = [f"double result[{width}];", f"{name}({given});"]
    if port.is_force:
        lines += ["w[force] += result[0];", "w[slope] += result[1];"]
        lines += ["w[PROCESS] += result[0];"] if effect.adds_to_disturbance() else []
    else:
        lines += ["w[total] += result[0];" if port is Port.TRANSMISSION else "w[u] = result[0];"]
    lines += [f"{row} = result[{first + place}];" for place, row in enumerate(kept)]
    return [f"    if (w[{slot.flag}] > 0.5) {{", *(f"        {line}" for line in lines), "    }"]
