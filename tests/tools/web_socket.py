"""HTTP requests and WebSockets (RFC 6455) of a client, as plain as they come: shares nothing with the program."""
import base64
import json
import os
import socket
import struct
import time

PATIENCE_S = 20.0


def exchange(port, path="/", host=None, headers=()):
    """Sends a request; the open connection, the status and what came with it so far."""
    connection = socket.create_connection(("127.0.0.1", port), PATIENCE_S)
    lines = [f"GET {path} HTTP/1.1", f"Host: {host or f'127.0.0.1:{port}'}", *headers, "", ""]
    connection.sendall("\r\n".join(lines).encode())
    answer = b""
    while b"\r\n\r\n" not in answer:
        part = connection.recv(65536)
        if not part:
            break
        answer += part
    if not answer:
        connection.close()
        raise ConnectionError("closed without an answer")
    return connection, int(answer.split()[1]), answer.split(b"\r\n\r\n", 1)[1]


def status(port, *arguments, **options):
    connection, code, _ = exchange(port, *arguments, **options)
    connection.close()
    return code


def upgrade(origin):
    key = base64.b64encode(os.urandom(16)).decode()
    return ("Connection: Upgrade", "Upgrade: websocket", "Sec-WebSocket-Version: 13", f"Sec-WebSocket-Key: {key}",
            *([f"Origin: {origin}"] if origin else []))


class WebSocket:
    """A WebSocket of a client; its messages are JSON."""

    def __init__(self, port, path):
        self.connection, code, self.rest = exchange(port, path, headers=upgrade(f"http://127.0.0.1:{port}"))
        assert code == 101, code

    def send(self, payload, opcode=1):
        mask = os.urandom(4)
        length = len(payload)
        size = bytes([0x80 | length]) if length < 126 else (
            b"\xfe" + struct.pack(">H", length) if length < 65536 else b"\xff" + struct.pack(">Q", length))
        head = bytes([0x80 | opcode]) + size
        self.connection.sendall(head + mask + bytes(byte ^ mask[i % 4] for i, byte in enumerate(payload)))

    def take(self, count):
        while len(self.rest) < count:
            part = self.connection.recv(65536)
            if not part:
                raise ConnectionError("closed")
            self.rest += part
        result, self.rest = self.rest[:count], self.rest[count:]
        return result

    def receive(self):
        """The next message of text."""
        return json.loads(self.receive_text())

    def receive_size(self):
        """How long the next message of text is, for those who only count."""
        return len(self.receive_text())

    def receive_text(self):
        while True:
            opcode, length = self.take(2)
            if length == 126:
                length, = struct.unpack(">H", self.take(2))
            elif length == 127:
                length, = struct.unpack(">Q", self.take(8))
            payload = self.take(length)
            if opcode & 15 == 8:
                raise ConnectionError("closed")
            if opcode & 15 == 1:
                return payload

    def close(self):
        self.connection.close()
