"""XML of controllers, parsed as it comes: in any encoding, without document types."""

from pathlib import Path
from typing import Any
from xml.parsers import expat

from fdbench.errors import RecordError
from fdbench.reading.formats._text import marked_encoding, open_text


def xml_parser(file: Path) -> Any:
    """Return a parser that refuses document types, which could refer to other files; its handlers are to be set."""
    with file.open("rb") as stream:
        parser = expat.ParserCreate("utf-8" if marked_encoding(stream.read(4)) else None)

    def refuse(*_: Any) -> None:
        raise RecordError(f"{file}: line {parser.CurrentLineNumber}: a document type; SINUMERIK writes none.")

    parser.StartDoctypeDeclHandler = refuse
    return parser


def parse_xml(parser: Any, file: Path) -> None:
    """Feed a file to its parser, in one piece: in small ones, a long value takes the square of its length.

    Raises
    ------
    RecordError
        If it is not XML, or was cut.
    """
    with open_text(file) as stream:
        content = stream.read()
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        cut = " The file was cut there." if "no element found" in str(error) or "unclosed" in str(error) else ""
        raise RecordError(f"{file}: not valid XML: {error}.{cut}") from error
