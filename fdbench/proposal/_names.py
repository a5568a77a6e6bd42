"""What the name of a column, the words beside it and its unit say of it."""

import re
from dataclasses import dataclass

from fdbench.record import FloatArray
from fdbench.units import si_unit, spelt_unit

# SI unit -> what is measured, and whether it turns.
_MEASURED = {
    "s": ("time", False),
    "m": ("position", False),
    "rad": ("position", True),
    "m/s": ("velocity", False),
    "rad/s": ("velocity", True),
    "m/s^2": ("acceleration", False),
    "rad/s^2": ("acceleration", True),
    "N": ("output", False),
    "N m": ("output", False),
    "A": ("output", False),
    "V": ("output", False),
}
# What is measured, by words; the first that fits counts.
_QUANTITIES = {
    "error": r"\b(f ?err(or)?|flw|lag|deviation|following|contour\w*)\b|error|fehler|abweichung",
    "time": r"\b(t|ts|epoch|unix\w*|time\w*|zeit\w*|temps|tempo|tiempo|stamp|clock)\b|时间|時間",
    "acceleration": r"\bacc(el)?\b|accel|beschleunigung|加速度",
    "velocity": r"\b(v|vel|velo)\b|velocity|speed|geschwindigkeit|drehzahl|vitesse|velocit|velocidad|速度",
    "output": (
        r"\b(f|u|i|iq|trq|tau|curr|mom|par)\b|force|kraft|torque|moment|effort|current|strom|voltage|spannung|output|"
        "couple|courant|coppia|corrente|corriente|转矩|扭矩|トルク|电流|電流"
    ),
    "position": (
        r"\b(q|x|y|z|pos|posn|phi|theta)\b|position|lage|winkel|angle|angolo|[aá]ngulo|\bweg\b|displacement|encoder|"
        "scale|posizione|posici[oó]n|位置|角度"
    ),
}
_SIDES = {
    "motor": r"\b(mot|motor\w*|rotor)\b|measuring system 1|\bmeas pos 1\b|\benc(oder)? ?1\b",
    "table": r"\b(table|tisch|load|scale|direct)\b|measuring system 2|\bmeas pos 2\b|\benc(oder)? ?2\b|maßstab",
}
_REFERENCE = (
    r"\b(set\w*|cmd\w*|comm?and\w*|ref\w*|desired|target|demand|goal|input|nominal|soll\w*|consign[ea]|riferimento)\b|"
    "soll|setpoint|指令|目标|目標"
)
# The SI unit that words speak of; A, B and C before another word are rotary axes (ISO 841).
_SPOKEN_UNITS = {
    "A": r"\b(i|iq|curr)\b|current|strom|courant|corri?ente|电流|電流",
    "V": r"\bu\b|voltage|spannung",
    "rad": r"\b(phi|theta)\b|winkel|angle|angolo|[aá]ngulo|角度|^[abc] \w",
}
_BRACKETS = re.compile(r"^(.*?)\s*(?:[\[({<]([^\])}>]*)[\])}>]|(?:\s(?:in|/)\s|,\s*)(\S+))\s*$")
# A last word of two letters or more; the least of a value is no time in minutes.
_LAST_WORD = re.compile(r"^(.+?)(?:_|\s+)(?!min$)([A-Za-z°/]{2,}(?:_per_[a-z]+2?)?)$")
_QUOTIENT = re.compile(r"^(.+?)[_ ]([A-Za-z°]+)_(?:per_)?(s2?|min)$")
# A last letter is a unit where the word before it says what is measured; else it may be an axis or a motor.
_LAST_LETTER = re.compile(
    r"^(.*(?:force|kraft|\bf))_(N)$|^(.*(?:curr|current|strom|\bi|\biq))_(A)$|"
    r"^(.*(?:volt|voltage|spannung|\bu))_(V)$|^(.*(?:time|zeit|\bt))_(s)$",
    re.IGNORECASE,
)

# ODrive's own names of values, which are in turns, turns per second and amperes (its API reference, 0.5 and later).
_ODRIVE = {
    r"(pos_(estimate|setpoint)|input_pos)$": "rev",
    r"(vel_(estimate|setpoint)|input_vel)$": "rev/s",
    r"\bIq_": "A",
}

# Programmers of controllers begin names with the type of the value.
_TYPE = re.compile(r"(?<![A-Za-z])(?:[bfinruwx]|di|lr|ui)(?=([A-Z][a-z]{2,}[A-Za-z]*))")


@dataclass(frozen=True)
class LogColumn:
    """A column of a log and what its name says.

    ``unit`` is one of ours or empty, ``why`` says where it is from; ``foreign_unit`` is one that is not known here.
    ``spoken_unit`` is the SI unit that the words speak of, such as rad of an angle, or empty.
    """

    name: str
    values: FloatArray
    quantity: str
    side: str
    is_reference: bool
    unit: str
    why: str
    clock: str
    foreign_unit: str = ""
    spoken_unit: str = ""


def column(name: str, values: FloatArray, unit: str, label: str, clock: str) -> LogColumn:
    """Return a column with what its name, its label and the unit that the file gives say."""
    stem, known, why = name, spelt_unit(unit), "the file says so"
    if not known and (found := _BRACKETS.match(name)):
        unit = found[2] or found[3] or ""
        stem, known, why = found[1], spelt_unit(unit), "its name says so"
    if not known and (found := _LAST_WORD.match(name)):
        known, why = spelt_unit(found[2].replace("_per_", "/")), "its name says so"
        stem = found[1] if known else name
    if not known and (found := _QUOTIENT.match(name)):
        known, why = spelt_unit(f"{found[2]}/{found[3]}"), "its name says so"
        stem = found[1] if known else name
    if not known and (found := _LAST_LETTER.match(name)):
        stem, last = (part for part in found.groups() if part is not None)
        known, why = spelt_unit(last), "its name says so"
    for pattern, odrive in _ODRIVE.items():
        if not known and re.search(pattern, name):
            known, why = odrive, "ODrive counts so"
    said = f"{_words(_without_type(stem))} {label.lower()}"
    quantity = next((key for key, pattern in _QUANTITIES.items() if re.search(pattern, said)), "")
    if known and quantity != "error":
        share = "output" if quantity == "output" else ""  # such as a torque in per cent
        quantity = _MEASURED.get(si_unit(known, name)[0], (share, False))[0]
    side = next((key for key, pattern in _SIDES.items() if re.search(pattern, said)), "")
    is_reference = re.search(_REFERENCE, said) is not None
    foreign = "" if known else unit.strip()
    spoken = next((si for si, pattern in _SPOKEN_UNITS.items() if re.search(pattern, said)), "")
    return LogColumn(name, values, quantity, side, is_reference, known, why if known else "", clock, foreign, spoken)


def turns(unit: str) -> bool:
    """Return whether a unit is one of angles.

    >>> turns("deg"), turns("mm/min")
    (True, False)
    """
    return bool(unit) and _MEASURED.get(si_unit(unit, unit)[0], ("", False))[1]


def _without_type(text: str) -> str:
    """Return a name without the letters of a type before what says by itself what is measured.

    >>> _without_type("Axis.fSetPosition"), _without_type("iSoll")
    ('Axis.SetPosition', 'iSoll')
    """

    def rest(found: re.Match[str]) -> str:
        says = any(re.search(pattern, _words(found[1])) for pattern in _QUANTITIES.values())
        return "" if says else found[0]

    return _TYPE.sub(rest, text)


def _words(text: str) -> str:
    """Return the words of a name, in lower case with blanks between.

    >>> _words("nckServoDataActCurr32"), _words("IST_Position"), _words("Posición real, 位置")
    ('nck servo data act curr 32', 'ist position', 'posición real 位置')
    """
    return " ".join(re.findall(r"[A-ZÀ-ÖØ-Þ]?[a-zß-öø-ÿ]+|[A-ZÀ-ÖØ-Þ]+(?![a-z])|\d+|[^\W\d_A-ZÀ-ÿa-z]+", text)).lower()
