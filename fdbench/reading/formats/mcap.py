"""MCAP logs (extra ``logs``): topics of JSON or ROS 2 messages."""

from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, final

from fdbench.documents import json_value
from fdbench.errors import FdbenchError, RecordError
from fdbench.reading.formats._format import Log, Raw, library
from fdbench.reading.formats._messages import Topics


@final
class Mcap(Log):
    """Messages of encoding ``json``, and ``cdr`` with a schema ``ros2msg``; each topic is a clock.

    Layout: mcap.dev/spec, read by the package mcap; ROS 2 messages are decoded by the package rosbags. The samples in
    the tests are written by the package mcap, the MCAP project's own, and by rosbags.
    """

    suffixes = (".mcap",)

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the magic bytes."""
        return head.startswith(b"\x89MCAP")

    def read_all(self, file: Path) -> Raw:
        """Return all numbers of all topics."""
        topics, decode = Topics(), _Decoder(file)
        with file.open("rb") as stream:
            for topic, time_ns, message in _decoded(stream, decode, file):
                topics.add(topic, time_ns, message)
        return topics.raw(file)


def _decoded(stream: IO[bytes], decode: "_Decoder", file: Path) -> Iterator[tuple[str, int, Any]]:
    """Yield topic, time and content of each message."""
    reader = library("mcap.reader", file)
    try:
        for schema, channel, message in reader.make_reader(stream).iter_messages():
            yield channel.topic, message.log_time, decode(schema, channel, message)
    except FdbenchError:
        raise
    except Exception as error:  # mcap, rosbags and the unpackers have no common base for what damaged files raise
        words = str(error) or type(error).__name__
        raise RecordError(f"{file}: not an MCAP file, or a damaged one: {words}.") from error


class _Decoder:
    """Turns the bytes of messages into what they say."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._store: Any = None
        self._known: set[int] = set()

    def __call__(self, schema: Any, channel: Any, message: Any) -> Any:
        if channel.message_encoding == "json":
            return json_value(message.data)
        if channel.message_encoding != "cdr" or schema is None or schema.encoding != "ros2msg":
            raise RecordError(
                f"{self._file}: topic {channel.topic} is encoded as {channel.message_encoding}; read are json and, "
                "with ros2msg, cdr. Convert the log, or leave the topic out."
            )
        typesys = library("rosbags.typesys", self._file)
        if self._store is None:
            self._store = typesys.get_typestore(typesys.Stores.EMPTY)
        if schema.id not in self._known:
            self._store.register(typesys.get_types_from_msg(schema.data.decode(), schema.name))
            self._known.add(schema.id)
        return self._store.deserialize_cdr(message.data, schema.name)
