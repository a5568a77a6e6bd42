"""What the process that holds the truth and its workers say to each other, over a pair of sockets.

A request is pickled, for its sender is trusted. An answer is never unpickled: it is a token, a header in JSON and the
numbers of its arrays, each of bounded size. The token is the request's, so that nothing can be answered beforehand.

===============  =========================  ==================================================
request          8 bytes                    length
..               length                     pickle
answer           16 bytes                   token of the request
..               4 bytes, 8 bytes           length of the header and of the arrays
..               ..                         JSON, with the shapes of the arrays by name
..               ..                         float64 of all arrays, one after another
===============  =========================  ==================================================
"""

import json
import math
import pickle
import socket
import struct
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fdbench.errors import FdbenchError
from fdbench.record import FloatArray

REQUEST, ANSWER = struct.Struct("!Q"), struct.Struct("!16sIQ")

LARGEST_HEADER, LARGEST_ARRAYS = 2**20, 2**28

MOST_ARRAYS, MOST_DIMENSIONS = 16, 2


class Unreadable(FdbenchError):
    """An answer breaks the rules of this module."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reply:
    """What a worker says; of one that was received nothing has been checked but that it is of these types."""

    header: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, FloatArray] = field(default_factory=dict)


# ---- requests ----


def send_request(channel: socket.socket, request: Mapping[str, Any]) -> None:
    """Send a request to a worker."""
    content = pickle.dumps(dict(request), protocol=pickle.HIGHEST_PROTOCOL)
    channel.sendall(REQUEST.pack(len(content)))
    channel.sendall(content)


def receive_request(channel: socket.socket) -> dict[str, Any]:
    """Return the next request; EOFError where the other side is gone."""
    (length,) = REQUEST.unpack(_exactly(channel, REQUEST.size))
    request: dict[str, Any] = pickle.loads(_exactly(channel, length))
    return request


# ---- answers ----


def send_answer(channel: socket.socket, token: bytes, reply: Reply) -> None:
    """Answer a request; the arrays of the reply are of float64."""
    shapes = {name: list(values.shape) for name, values in reply.arrays.items()}
    text = json.dumps({**reply.header, "arrays": shapes}).encode()
    body = b"".join(values.tobytes() for values in reply.arrays.values())
    if len(text) > LARGEST_HEADER or len(body) > LARGEST_ARRAYS:
        raise Unreadable(
            f"the answer has {len(text)} bytes of names and texts and {len(body)} of arrays; at most {LARGEST_HEADER} "
            f"and {LARGEST_ARRAYS} are allowed."
        )
    channel.sendall(ANSWER.pack(token, len(text), len(body)) + text + body)


def receive_answer(channel: socket.socket, token: bytes, deadline: float) -> Reply:
    """Return the answer to the request with this token.

    Raises
    ------
    Unreadable
        If it is too long, has another token or breaks the format.
    TimeoutError
        At the deadline, a time of `time.monotonic`.
    EOFError
        If the other side is gone.
    """
    found, length, size = ANSWER.unpack(_exactly(channel, ANSWER.size, deadline))
    if found != token:
        raise Unreadable("it is none to what was asked")
    if length > LARGEST_HEADER or size > LARGEST_ARRAYS:
        raise Unreadable(f"it says to have {length} bytes of text and {size} of arrays")
    text, body = _exactly(channel, length, deadline), _exactly(channel, size, deadline)
    try:
        header = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Unreadable("it is no JSON") from error
    if not isinstance(header, dict):
        raise Unreadable("it is no table")
    return Reply(header=header, arrays=_arrays(header.pop("arrays", None), body))


def _arrays(shapes: Any, body: bytes) -> dict[str, FloatArray]:
    if not isinstance(shapes, dict) or len(shapes) > MOST_ARRAYS:
        raise Unreadable("it does not say which arrays it has")
    for shape in shapes.values():
        sizes = shape if isinstance(shape, list) and len(shape) <= MOST_DIMENSIONS else [None]
        if not all(type(n) is int and 0 <= n <= LARGEST_ARRAYS for n in sizes):
            raise Unreadable("an array has no shape")
    if 8 * sum(math.prod(shape) for shape in shapes.values()) != len(body):
        raise Unreadable("its arrays have other lengths than it says")
    numbers, arrays, start = np.frombuffer(body, dtype=np.float64), dict[str, FloatArray](), 0
    for name, shape in shapes.items():
        stop = start + math.prod(shape)
        arrays[name] = numbers[start:stop].reshape(shape)
        start = stop
    return arrays


def _exactly(channel: socket.socket, length: int, deadline: float | None = None) -> bytes:
    """Return so many bytes, by a deadline."""
    content = bytearray(length)
    view, received = memoryview(content), 0
    while received < length:
        if deadline is not None:
            left = deadline - time.monotonic()
            if left <= 0.0:
                raise TimeoutError
            channel.settimeout(left)
        n = channel.recv_into(view[received:])
        if n == 0:
            raise EOFError
        received += n
    return bytes(content)
