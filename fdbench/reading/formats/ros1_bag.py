"""ROS 1 bags (extra ``logs``)."""

from pathlib import Path
from typing import final

from fdbench.errors import RecordError
from fdbench.reading.formats._format import Log, Raw, library
from fdbench.reading.formats._messages import Topics


@final
class Ros1Bag(Log):
    """One file that ``rosbag record`` writes, with the definitions of its messages; each topic is a clock.

    Layout: ROS bag format 2.0, read by the package rosbags. The samples in the tests are by rosbags, not by ROS.
    """

    suffixes = (".bag",)

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file begins with the version line."""
        return head.startswith(b"#ROSBAG V2.0\n")

    def read_all(self, file: Path) -> Raw:
        """Return all numbers of all topics."""
        highlevel = library("rosbags.highlevel", file)
        topics = Topics()
        try:
            with highlevel.AnyReader([file]) as reader:
                for connection, time_ns, data in reader.messages():
                    topics.add(connection.topic, time_ns, reader.deserialize(data, connection.msgtype))
        except Exception as error:  # rosbags has no common base for what damaged bags raise
            raise RecordError(f"{file}: not a ROS 1 bag, or a damaged one: {error}") from error
        return topics.raw(file)
