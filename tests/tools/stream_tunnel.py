"""TCP connections over a pair of byte streams: into a guest that shares no network with its host.

Frames: number of the connection and length of the data, 32 bits each, then the data. An empty frame closes the
connection; number 0 carries texts for the program at the other end.
"""
import os
import socket
import struct
import threading

_HEAD = struct.Struct(">II")


class Tunnel:
    """One end. `connect` makes the connection that the other end asks for by a number not yet known; None: this end
    is the one that asks."""

    def __init__(self, source, sink, on_text, connect=None):
        self.source, self.sink, self.on_text, self.connect = source, sink, on_text, connect
        self.connections, self.lock, self.last = {}, threading.Lock(), 0

    def send(self, number, data):
        with self.lock:
            view = memoryview(_HEAD.pack(number, len(data)) + data)
            while view:
                view = view[os.write(self.sink, view):]

    def read(self, count):
        data = b""
        while len(data) < count:
            part = os.read(self.source, count - len(data))
            if not part:
                raise EOFError
            data += part
        return data

    def run(self):
        """Takes what comes until the stream ends."""
        try:
            while True:
                number, length = _HEAD.unpack(self.read(_HEAD.size))
                data = self.read(length)
                if number == 0:
                    self.on_text(data.decode())
                    continue
                connection = self.connections.get(number)
                if connection is None and data and self.connect:
                    try:
                        connection = self.connect()
                    except OSError:
                        self.send(number, b"")
                        continue
                    self.add(connection, number)
                if connection is None:
                    continue
                try:
                    if data:
                        connection.sendall(data)
                    else:
                        connection.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
        except (EOFError, OSError):
            pass

    def add(self, connection, number=None):
        with self.lock:
            if number is None:
                self.last += 1
                number = self.last
            self.connections[number] = connection
        threading.Thread(target=self.forward, args=(connection, number), daemon=True).start()

    def forward(self, connection, number):
        try:
            while data := connection.recv(65536):
                self.send(number, data)
        except OSError:
            pass
        self.connections.pop(number, None)
        connection.close()
        try:
            self.send(number, b"")
        except OSError:
            pass


def listen(tunnel, port):
    """Hands connections to 127.0.0.1:port to the other end, from a thread of its own. Returns the listening socket."""
    listener = socket.create_server(("127.0.0.1", port))

    def accept():
        while True:
            try:
                connection, _ = listener.accept()
            except OSError:
                return
            tunnel.add(connection)
    threading.Thread(target=accept, daemon=True).start()
    return listener
