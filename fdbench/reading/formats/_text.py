"""Text of files in the encodings that loggers write; whatever is behind it sees UTF-8 without a byte order mark.

UTF-8 and UTF-16 are told by their byte order mark (The Unicode Standard, section 23.8). Without one a text is UTF-8, or
else Windows-1252, which exporters of western Europe write.
"""

import codecs
import gzip
import io
import zlib
from pathlib import Path
from typing import IO

from fdbench.errors import RecordError

LARGEST_UTF_16 = LARGEST_SPACED = LARGEST_UNPACKED = 2**28  # bytes, as it is held in memory
GZIP = b"\x1f\x8b"
_MARKS = {codecs.BOM_UTF8: "utf-8", codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}


def marked_encoding(head: bytes) -> str:
    r"""Return the encoding that the byte order mark at the begin of a file says, or an empty text.

    >>> marked_encoding(b"\xff\xfet\x00"), marked_encoding(b"time_s")
    ('utf-16-le', '')
    """
    return next((encoding for mark, encoding in _MARKS.items() if head.startswith(mark)), "")


def in_utf_8(head: bytes) -> bytes:
    r"""Return the begin of a file in UTF-8 without a mark, where a mark says what it is in; else as it is.

    >>> in_utf_8(b"\xfe\xff\x00t\x00\xb5"), in_utf_8(b"MDF     ")
    (b't\xc2\xb5', b'MDF     ')
    """
    encoding = marked_encoding(head)
    return head.decode(encoding, errors="ignore").lstrip("\ufeff").encode() if encoding else head


def open_unpacked(file: Path) -> IO[bytes]:
    """Return a file as a stream, unpacked where it is compressed by gzip.

    Raises
    ------
    RecordError
        If it is compressed, and damaged or larger than `LARGEST_UNPACKED`.
    """
    stream = file.open("rb")
    if not stream.peek(len(GZIP)).startswith(GZIP):
        return stream
    with stream, gzip.open(stream) as packed:
        try:
            content = packed.read(LARGEST_UNPACKED + 1)
        except (OSError, EOFError, zlib.error) as error:
            raise RecordError(f"{file}: compressed by gzip, but damaged or cut: {error}.") from error
    if len(content) > LARGEST_UNPACKED:
        raise RecordError(f"{file}: compressed; unpacked at most {LARGEST_UNPACKED} bytes are read. Unpack it first.")
    return io.BytesIO(content)


def open_text(file: Path) -> IO[bytes]:
    """Return a file of text, unpacked, as a stream in UTF-8, or, where it has no mark, as it is.

    Raises
    ------
    RecordError
        As `open_unpacked`; or if it is UTF-16 that is damaged, larger than `LARGEST_UTF_16`, or without a mark.
    """
    stream = open_unpacked(file)
    head = stream.read(64)
    encoding = marked_encoding(head)
    stream.seek(len(codecs.BOM_UTF8) if encoding == "utf-8" else 0)
    if encoding in ("", "utf-8"):
        if _has_utf_16_letters(head):
            stream.close()
            raise RecordError(f"{file}: UTF-16 without a byte order mark, by which it is told. Save it as UTF-8.")
        return stream
    with stream:
        content = stream.read(LARGEST_UTF_16 + 1)
    if len(content) > LARGEST_UTF_16:
        raise RecordError(f"{file}: UTF-16, of which at most {LARGEST_UTF_16} bytes are read. Save it as UTF-8.")
    try:
        return io.BytesIO(content.decode(encoding).removeprefix("\ufeff").encode())
    except UnicodeError as error:
        raise RecordError(f"{file}: it begins as UTF-16, but is none, or was cut: {error}.") from error


def with_single_blanks(file: Path) -> IO[bytes]:
    """Return a file of text as `open_text` has it, with one blank where several are, and none at an edge of a line.

    Raises
    ------
    RecordError
        As `open_text`; or if it is larger than `LARGEST_SPACED`.
    """
    with open_text(file) as stream:
        content = stream.read(LARGEST_SPACED + 1)
    if len(content) > LARGEST_SPACED:
        raise RecordError(f"{file}: between blanks at most {LARGEST_SPACED} bytes are read. Split the file.")
    return io.BytesIO(b"\n".join(b" ".join(line.split()) for line in content.split(b"\n")))


def text_of(file: Path) -> str:
    """Return a file of text as a whole.

    Raises
    ------
    RecordError
        As `open_text`; or if it is neither UTF-8 nor Windows-1252.
    """
    with open_text(file) as stream:
        content = stream.read()
    for encoding in ("utf-8", "cp1252"):
        try:
            return content.decode(encoding)
        except UnicodeDecodeError as error:
            fault = error
    raise RecordError(f"{file}: neither UTF-8 nor Windows-1252: {fault}. Save it as UTF-8.")


def whole_lines_of(file: Path) -> list[str]:
    """Return the lines of a file of text whose producer ends each.

    Raises
    ------
    RecordError
        As `text_of`; or if the last one has no end.
    """
    text = text_of(file)
    if not text.endswith("\n"):
        raise RecordError(f"{file}: the last line has no end. The file was cut there: remove the line.")
    return text.splitlines()


def _has_utf_16_letters(head: bytes) -> bool:
    """Return whether every other byte is 0, and none between them, as in western letters of UTF-16."""
    halves = head[0::2], head[1::2]
    return len(head) >= 8 and any(not any(one) and all(other) for one, other in (halves, halves[::-1]))
