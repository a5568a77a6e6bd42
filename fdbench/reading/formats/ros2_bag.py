"""ROS 2 bags in SQLite (extra ``logs``), given by their file .db3 with metadata.yaml beside it."""

from pathlib import Path
from typing import final

from fdbench.errors import RecordError
from fdbench.reading.formats._format import Log, Raw, library
from fdbench.reading.formats._messages import Topics


@final
class Ros2Bag(Log):
    """A folder that ``ros2 bag record`` writes, read as a whole; each topic is a clock.

    Layout: rosbag2, read by the package rosbags. The samples in the tests are written by rosbags, not by ROS 2.
    """

    suffixes = (".db3",)

    @classmethod
    def recognises(cls, head: bytes) -> bool:
        """Return whether the file is an SQLite database."""
        return head.startswith(b"SQLite format 3\x00")

    def read_all(self, file: Path) -> Raw:
        """Return all numbers of all topics."""
        highlevel, typesys = library("rosbags.highlevel", file), library("rosbags.typesys", file)
        if not (file.parent / "metadata.yaml").is_file():
            raise RecordError(
                f"{file}: no metadata.yaml beside it. Keep the bag's folder together; `ros2 bag reindex`."
            )
        topics = Topics()
        store = typesys.get_typestore(typesys.Stores.LATEST)
        try:
            with highlevel.AnyReader([file.parent], default_typestore=store) as reader:
                for connection, time_ns, data in reader.messages():
                    topics.add(connection.topic, time_ns, reader.deserialize(data, connection.msgtype))
        except Exception as error:  # rosbags and sqlite have no common base for what damaged bags raise
            raise RecordError(f"{file}: not a ROS 2 bag, or a damaged one: {error}") from error
        return topics.raw(file)
