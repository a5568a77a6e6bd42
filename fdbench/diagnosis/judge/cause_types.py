"""Types of causes: where the effect is in doubt, its type and side may not be."""

from collections.abc import Mapping, Sequence

from fdbench.diagnosis.answer.cause import Cause, CauseType, Suspect
from fdbench.diagnosis.answer.where import Dependence
from fdbench.diagnosis.settings import JUDGE
from fdbench.effects import Port, effects
from fdbench.plants.feed_drive import FeedDrive

MOTOR, TABLE = "motor", "table"
SIDES: Mapping[Port, str] = {
    Port.COMMAND: MOTOR,
    Port.MOTOR_FORCE: MOTOR,
    Port.MOTOR_ENCODER: MOTOR,
    Port.TABLE_FORCE: TABLE,
    Port.TABLE_INERTIA: TABLE,
    Port.TABLE_SCALE: TABLE,
}
OF_REST = {
    "velocity": "friction_over_velocity",
    "position": "force_over_position",
    "position_within_a_lead": "force_over_position",
    "position_by_direction": "friction_over_position",
    "acceleration": "inertia",
    "motor_force": "friction_over_load",
    "time": "friction_over_time",
}


def cause_types(
    causes: Sequence[Cause],
    suspects: Sequence[Suspect],
    unknown: float,
    rest: Sequence[Dependence],
    drive: FeedDrive,
) -> tuple[CauseType, ...]:
    r"""Return how probable it is that a cause of each type is there, most probable first.

    Look-alikes of one cause exclude each other, several causes do not:

    .. math:: P(T) = 1 - \prod_c \Bigl(1 - \sum_{e \in T} p_c(e)\Bigr)

    with the probability :math:`p_c(e)` that cause c is the effect e. An unknown cause counts as of the types that its
    rest depends on, in proportion to the share that such a function removes.
    """
    absent: dict[tuple[str, str | None], float] = {}

    def add(chances: Mapping[tuple[str, str | None], float]) -> None:
        for place, chance in chances.items():
            absent[place] = absent.get(place, 1.0) * (1.0 - min(chance, 1.0))

    for cause in causes:
        add(_of_effects({**cause.alternatives, cause.effect: cause.probability}, drive))
    for suspect in suspects:
        add(_of_effects({suspect.effect: suspect.probability}, drive))
    total = max(sum(item.share for item in rest), 1.0)
    add({(OF_REST[item.function_of], None): unknown * item.share / total for item in rest})
    found = [
        CauseType(type=kind, side=side, probability=1.0 - left)
        for (kind, side), left in absent.items()
        if 1.0 - left >= JUDGE.smallest_type
    ]
    return tuple(sorted(found, key=lambda item: -item.probability))


def _of_effects(chances: Mapping[str, float], drive: FeedDrive) -> dict[tuple[str, str | None], float]:
    found: dict[tuple[str, str | None], float] = {}
    for name, chance in chances.items():
        kind = effects.get(name)
        place = kind.type_of(), None if drive.screw is None else SIDES.get(kind.port)
        found[place] = found.get(place, 0.0) + chance
    return found
