"""What every hypothesis may re-calibrate of a nominal model."""

import functools
import math

from fdbench.diagnosis.model.known_effects import (
    WIDTH,
    amplitude_of,
    is_friction,
    known_friction,
    silent,
    turns_sign,
)
from fdbench.diagnosis.model.nominal import Nominal
from fdbench.diagnosis.model.nominal_parameter import (
    ControllerGain,
    ForceOffset,
    FrictionForm,
    FrictionSide,
    KnownAmplitude,
    Mass,
    NominalParameter,
    ReferenceDelay,
    TransitionVelocity,
    Viscous,
)
from fdbench.effects import Port
from fdbench.plants.feed_drive import Cascade

GAINS = ("position_gain_per_s", "velocity_gain_N_s_per_m", "integral_gain_N_per_m")  # of a cascade


@functools.lru_cache(maxsize=16)
def nominal_parameters(nominal: Nominal) -> tuple[NominalParameter, ...]:
    """Return what every hypothesis may re-calibrate, as far as a model has it and is in doubt of it."""
    drive, doubt = nominal.drive, nominal.uncertainty
    sides = ("motor", "table") if drive.screw is not None else ("motor",)
    viscous = max(drive.viscous_friction_N_s_per_m, 1e-3 * drive.mass_kg) * doubt.viscous
    lever = 1.0 if drive.screw is not None else drive.mass_kg / drive.motor.mass_kg
    known = list(enumerate(drive.effects))
    return (
        *(Mass(name=f"{side}_mass", side=side, deviation=doubt.mass * lever) for side in sides),
        *(Viscous(name=f"{side}_viscous", side=side, deviation=viscous, relative=doubt.viscous) for side in sides),
        *(
            KnownAmplitude(
                name=f"known_{item.name}",
                index=index,
                deviation=doubt.known_effects,
                is_friction=is_friction(item),
            )
            for index, item in known
            if item.calibrates not in (FrictionForm.kind, ForceOffset.kind)
        ),
        *(
            TransitionVelocity(name=f"width_{item.name}", index=index, deviation=doubt.transition_velocity)
            for index, item in known
            if doubt.transition_velocity > 0.0 and turns_sign(item)
        ),
        *_force_offset(nominal),
        *_friction_form(nominal),
        *_friction_side(nominal),
        *_of_the_cascade(nominal),
    )


def _force_offset(nominal: Nominal) -> list[NominalParameter]:
    kinds = [kind for kind in nominal.library if kind.calibrates == ForceOffset.kind]
    if not kinds or nominal.force_offset_N == 0.0:
        return []
    # A known constant force is a weight, as uncertain as a mass.
    weight = sum(abs(amplitude_of(known)) for known in nominal.drive.effects if known.calibrates == ForceOffset.kind)
    deviation = math.hypot(nominal.force_offset_N, nominal.uncertainty.mass * weight)
    return [ForceOffset(name=ForceOffset.kind, deviation=deviation, effect=silent(kinds[0]))]


def _friction_form(nominal: Nominal) -> list[NominalParameter]:
    """Return the bumps of a free friction curve, within a share of the friction that is known."""
    kinds = [kind for kind in nominal.library if kind.calibrates == FrictionForm.kind]
    deviation, fastest = nominal.uncertainty.friction_form, nominal.covered.fastest_m_per_s
    if not kinds or deviation == 0.0 or fastest == 0.0 or known_friction(nominal.drive) == 0.0:
        return []
    effect = silent(kinds[0]).changed(fastest_m_per_s=fastest)
    names = (kinds[0].amplitude, *kinds[0].further_amplitudes)
    return [FrictionForm(name=f"friction_{name}", deviation=deviation, effect=effect, amplitude=name) for name in names]


def _friction_side(nominal: Nominal) -> list[NominalParameter]:
    """Return which part of the friction that is known acts on the motor side instead of the table."""
    drive, deviation = nominal.drive, nominal.uncertainty.friction_side
    kinds = [kind for kind in nominal.library if kind.calibrates == FrictionSide.kind]
    known = [
        index for index, item in enumerate(drive.effects) if type(item).port is Port.TABLE_FORCE and turns_sign(item)
    ]
    if (
        not kinds
        or not known
        or drive.screw is None
        or deviation == 0.0
        or any(item.declared is kinds[0].declared for item in drive.effects)
    ):
        return []
    effect = silent(kinds[0]).changed(**{WIDTH: getattr(drive.effects[known[0]], WIDTH)})
    return [FrictionSide(name=FrictionSide.kind, index=known[0], deviation=deviation, effect=effect)]


def _of_the_cascade(nominal: Nominal) -> list[NominalParameter]:
    """Return by how much the velocity's reference is late, and the gains that are not zero."""
    controller, doubt = nominal.drive.controller, nominal.uncertainty
    if not isinstance(controller, Cascade):
        return []
    found: list[NominalParameter] = []
    delay_s = doubt.reference_delay * nominal.covered.period_s
    if delay_s > 0.0 and controller.velocity_feedforward != 0.0:
        found.append(ReferenceDelay(name=ReferenceDelay.kind, deviation=delay_s))
    gains = [name for name in GAINS if doubt.controller_gains > 0.0 and getattr(controller, name) != 0.0]
    return found + [ControllerGain(name=name, deviation=doubt.controller_gains) for name in gains]
