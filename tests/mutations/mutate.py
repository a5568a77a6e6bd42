"""Mutations: what is done to the bytes of a file, by kind; the same seed gives the same bytes."""

import re
from collections.abc import Callable, Mapping

import numpy as np

Random = np.random.Generator
Mutation = Callable[[bytes, Random], bytes]

LARGEST = 4_000_000  # bytes that a mutation may grow a file to

NUMBERS = (
    *("nan", "NaN", "inf", "-inf", "Infinity", "1e308", "-1.7e308", "1e400", "1e-308", "5e-324", "1e100", "1e-300"),
    *("0", "-0", "-1", "1", "2", "0.5", "3.0", "1_0", "0x1F", "1e5", "99999999999999999999", "9223372036854775808"),
    *(
        "9" * 400,
        "9" * 5000,
        "9" * 100_000,
        "0." + "3" * 5000,
        "1,5",
        "1.5.2",
        "--3",
        "+7",
        "1e",
        "٣",
        "½",
        "1979-05-27",
    ),
)
TEXTS = (
    *("", " ", "x", "true", "null", "none", "../../x", "/etc/passwd", "a/b", "..", "CON", "fdbench", "time_s", "kind"),
    *(
        "a\\nb",
        "a\\u0000b",
        "\\ud800",
        "\\u202e",
        "\\u001b[31m",
        "%s%n{0}{}",
        "$(id)",
        "`x`",
        "<script>",
        "[x](y)",
        "|",
    ),
    *(
        "ä" * 3,
        "漢字",
        "😀",
        "q" * 300,
        "q" * 20_000,
        "word " * 3000,
        "a." * 60 + "b",
        "\\",
        '"',
        "'",
        "\x1b[31m",
        "\x7f",
    ),
)
VALUES = (
    *(
        "true",
        "false",
        "null",
        "[]",
        "{}",
        "[[]]",
        "[1]",
        '[""]',
        '"text"',
        '""',
        "[1, 2]",
        '{"a": 1}',
        "{a = 1}",
        "[{}]",
    ),
    *(
        "[" * 200 + "]" * 200,
        "[" * 50_000,
        '{"a":' * 50_000,
        "{a=" * 2000,
        '[["x"]]',
        "[null]",
        "[nan]",
        '{"kind": "x"}',
    ),
)
MAGIC = (
    b"PAR1",
    b"MATLAB 5.0",
    b"MATLAB 7.3",
    b"\x89HDF\r\n",
    b"\x89MCAP0\r\n",
    b"MDF     ",
    b"UnFinMF ",
    b"PK\x03\x04",
    b"SQLite format 3\x00",
    b"<?xml",
    b"<traceSession",
    b"Name\tx",
    b"#time,accel_x",
    b"\x1f\x8b",
    b"\xff\xfe",
    b"\xef\xbb\xbf",
)

_NUMBER = re.compile(rb"[-+]?\d+(?:[.,]\d+)?(?:[eE][-+]?\d+)?")
_QUOTED = re.compile(rb'"((?:[^"\\\n]|\\.){0,200})"')
_WORD = re.compile(rb"[A-Za-z_][A-Za-z0-9_]+")
_VALUE = re.compile(rb'(?<=[=:] )(?:"[^"\n]*"|[-\w.]+|\[[^\]\n]*\])')


def _place(data: bytes, random: Random) -> int:
    return int(random.integers(0, len(data) + 1))


def _replaced(pattern: re.Pattern[bytes], data: bytes, random: Random, values: tuple[str, ...]) -> bytes:
    """Return the data with one of the first thousand places that fit a pattern replaced."""
    found = [match.span() for _, match in zip(range(1000), pattern.finditer(data), strict=False)]
    if not found:
        return flipped(data, random)
    start, stop = found[int(random.integers(len(found)))]
    return data[:start] + values[int(random.integers(len(values)))].encode() + data[stop:]


def flipped(data: bytes, random: Random) -> bytes:
    """One to eight bits."""
    changed = bytearray(data or b"\0")
    for _ in range(int(random.integers(1, 9))):
        changed[int(random.integers(len(changed)))] ^= 1 << int(random.integers(8))
    return bytes(changed)


def scrambled(data: bytes, random: Random) -> bytes:
    """A stretch of random bytes."""
    place, length = _place(data, random), int(random.integers(1, 64))
    return data[:place] + random.bytes(length) + data[place + length :]


def truncated(data: bytes, random: Random) -> bytes:
    """The end is missing."""
    return data[: _place(data, random)]


def cut_near_the_end(data: bytes, random: Random) -> bytes:
    """Some bytes at the end are missing."""
    return data[: -int(random.integers(1, 40))]


def beheaded(data: bytes, random: Random) -> bytes:
    """The beginning is missing."""
    return data[_place(data, random) :]


def doubled(data: bytes, random: Random) -> bytes:
    """A stretch is there twice."""
    start, stop = sorted((_place(data, random), _place(data, random)))
    return data[:stop] + data[start:stop] + data[stop:]


def exchanged(data: bytes, random: Random) -> bytes:
    """Two stretches have changed places."""
    a, b, c = sorted(_place(data, random) for _ in range(3))
    return data[:a] + data[b:c] + data[a:b] + data[c:]


def zeroed(data: bytes, random: Random) -> bytes:
    """A stretch of zeros, as after a crash of the file system."""
    start, stop = sorted((_place(data, random), _place(data, random)))
    return data[:start] + bytes(stop - start) + data[stop:]


def other_magic(data: bytes, random: Random) -> bytes:
    """It begins like another format."""
    mark = MAGIC[int(random.integers(len(MAGIC)))]
    return mark + data[len(mark) * int(random.integers(2)) :]


def other_number(data: bytes, random: Random) -> bytes:
    """A number is another one."""
    return _replaced(_NUMBER, data, random, NUMBERS)


def other_text(data: bytes, random: Random) -> bytes:
    """A text between quotes is another one."""
    return _replaced(_QUOTED, data, random, tuple(f'"{text}"' for text in TEXTS))


def other_word(data: bytes, random: Random) -> bytes:
    """A word is another one, or one of the file."""
    own = tuple(match[0].decode() for _, match in zip(range(200), _WORD.finditer(data), strict=False))
    return _replaced(_WORD, data, random, own if own and random.random() < 0.5 else TEXTS)


def other_value(data: bytes, random: Random) -> bytes:
    """A value is of another type."""
    return _replaced(_VALUE, data, random, (*VALUES, *NUMBERS))


def other_lines(data: bytes, random: Random) -> bytes:
    """A line is missing, there twice, elsewhere, empty or very long."""
    lines = data.split(b"\n")
    place, other = (int(random.integers(len(lines))) for _ in range(2))
    kind = int(random.integers(6))
    if kind == 0:
        del lines[place]
    elif kind == 1:
        lines.insert(other, lines[place])
    elif kind == 2:
        lines[place], lines[other] = lines[other], lines[place]
    elif kind == 3:
        lines[place] = b""
    elif kind == 4:
        lines[place] = lines[place] * (1 + 200_000 // max(len(lines[place]), 1))
    else:
        lines[place:place] = [lines[place]] * (1 + 500_000 // max(len(lines[place]) + 1, 1) // 10)
    return b"\n".join(lines)


def inserted(data: bytes, random: Random) -> bytes:
    """Something that does not belong there."""
    parts = (
        b"\0",
        b"\r",
        b"\n",
        b"\xff",
        b"\x1b[2J",
        b",",
        b'"',
        b"#",
        b"[",
        b"]",
        b"{",
        b"=",
        b".",
        b"\xe2\x80\xae",
        b"\xed\xa0\x80",
    )
    place = _place(data, random)
    part = parts[int(random.integers(len(parts)))]
    return data[:place] + part * int(random.choice([1, 1, 1, 2, 50, 50_000])) + data[place:]


def recoded(data: bytes, random: Random) -> bytes:
    """Another encoding."""
    text = data.decode("utf-8", errors="replace")
    return text.encode(
        ("utf-16", "utf-16-le", "utf-32", "cp1252", "utf-8-sig", "utf-7")[int(random.integers(6))], "replace"
    )


def other_ends(data: bytes, random: Random) -> bytes:
    """Other ends of lines."""
    return data.replace(b"\n", (b"\r\n", b"\r", b"\n\n", b"\x0b", b"", b" ")[int(random.integers(6))])


def widened(data: bytes, random: Random) -> bytes:
    """Each line is repeated, so that the table has many columns."""
    times = int(random.choice([2, 10, 1000, 20_000]))
    lines = data.split(b"\n")[:8]
    return b"\n".join(b",".join([line] * min(times, 1 + LARGEST // (8 + 8 * len(line)))) for line in lines) + b"\n"


def renamed_and_widened(data: bytes, random: Random) -> bytes:
    """Many columns of many names."""
    count = int(random.choice([100, 1500, 3000, 50_000]))
    names = b",".join(b"c%d_m" % number for number in range(count))
    rows = [b",".join([b"%d" % row] * count) for row in range(4)]
    return b"\n".join([b"time_s," + names, *(b"%d," % place + row for place, row in enumerate(rows))]) + b"\n"


def dotted(data: bytes, random: Random) -> bytes:
    """A dotted key of many parts."""
    parts = int(random.choice([5, 15, 17, 500, 20_000]))
    return (
        b".".join([b"a"] * parts) + b" = 1\n" + data
        if random.random() < 0.5
        else data + b"\n[" + b".".join([b"a"] * parts) + b"]\n"
    )


def spliced(data: bytes, random: Random) -> bytes:
    """Two mutations, one after the other."""
    kinds = [kind for kind in BYTES.values() if kind is not spliced]
    for _ in range(2):
        data = kinds[int(random.integers(len(kinds)))](data, random)[:LARGEST]
    return data


def empty(data: bytes, random: Random) -> bytes:
    """Nothing, or next to nothing."""
    return (b"", b"\n", b"\0", b" ", b"\xff\xfe", b"[]", b"{}", b"a")[int(random.integers(8))]


def junk(data: bytes, random: Random) -> bytes:
    """Random bytes throughout, perhaps below the first ones."""
    return data[: int(random.choice([0, 8, 64, 512]))] + random.bytes(int(random.integers(1, 4000)))


BYTES: Mapping[str, Mutation] = {
    kind.__name__: kind
    for kind in (
        *(flipped, scrambled, truncated, cut_near_the_end, beheaded, doubled, exchanged, zeroed, other_magic),
        *(other_number, other_text, other_word, other_value, other_lines, inserted, recoded, other_ends),
        *(widened, renamed_and_widened, dotted, empty, junk),
    )
}
MUTATIONS: Mapping[str, Mutation] = {**BYTES, "spliced": spliced}


def mutated(data: bytes, random: Random) -> tuple[str, bytes]:
    """Return the kind of a mutation drawn at random, and what it makes of a file."""
    kinds = list(MUTATIONS)
    kind = kinds[int(random.integers(len(kinds)))]
    return kind, MUTATIONS[kind](data, random)[:LARGEST]
