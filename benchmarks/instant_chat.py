"""A chat server that answers immediately, so that the time of a run is spent by the client."""

from __future__ import annotations

import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

from own_process import serving

_ANSWER = json.dumps(
    {
        "choices": [{"message": {"role": "assistant", "content": "B"}}],
        "usage": {"prompt_tokens": 300, "completion_tokens": 1},
    }
).encode()
_REPLY = b"HTTP/1.1 200 OK\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n%b" % (len(_ANSWER), _ANSWER)


@contextmanager
def instant_chat_server() -> Iterator[int]:
    """Serve OpenAI's chat protocol in a separate process, and give the port on the loopback address.

    The server reads each request to its end and answers with the letter B and token counts.
    """
    with serving(_serve) as port:
        yield port


def _serve(answer: Connection) -> None:
    listener = socket.create_server(("127.0.0.1", 0), backlog=128)
    answer.send(listener.getsockname()[1])
    while True:
        connection, _ = listener.accept()
        threading.Thread(target=_answer_all, args=(connection,), daemon=True).start()


def _answer_all(connection: socket.socket) -> None:
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    buffer = bytearray(1 << 20)
    with connection:
        while True:
            data = bytearray()
            while b"\r\n\r\n" not in data:
                count = connection.recv_into(buffer)
                if not count:
                    return
                data += buffer[:count]
            head, _, body = data.partition(b"\r\n\r\n")
            sizes = [line.split(b":")[1] for line in head.split(b"\r\n") if line.lower().startswith(b"content-length")]
            left = int(sizes[0]) - len(body)
            while left > 0 and (count := connection.recv_into(buffer, min(left, len(buffer)))):
                left -= count
            connection.sendall(_REPLY)
