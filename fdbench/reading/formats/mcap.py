"""MCAP logs (extra ``logs``): topics of JSON or ROS 2 messages."""

import json
from pathlib import Path
from typing import Any, final

from fdbench.errors import RecordError
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
        reader = library("mcap.reader", file)
        topics, decode = Topics(), _Decoder(file)
        try:
            with file.open("rb") as stream:
                for schema, channel, message in reader.make_reader(stream).iter_messages():
                    topics.add(channel.topic, message.log_time, decode(schema, channel, message))
        except (library("mcap.exceptions", file).McapError, EOFError, OSError) as error:
            raise RecordError(f"{file}: not an MCAP file, or a damaged one: {error!r}.") from error
        except (ValueError, RecursionError) as error:
            raise RecordError(f"{file}: a message cannot be decoded: {error}.") from error
        return topics.raw(file)


class _Decoder:
    """Turns the bytes of messages into what they say."""

    def __init__(self, file: Path) -> None:
        self._file = file
        self._store: Any = None
        self._known: set[int] = set()

    def __call__(self, schema: Any, channel: Any, message: Any) -> Any:
        if channel.message_encoding == "json":
            return json.loads(message.data)
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
