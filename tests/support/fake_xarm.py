"""A controller on loopback that the unmodified xArm SDK takes for an xArm 7."""

import itertools
import os
import socket
import struct
import threading
import time

import numpy as np
import pytest

from simtune.errors import RobotError

STEP_S = 0.3

_ADDRESSES = itertools.count(os.getpid() * 64 % 2**22 + 2)
_VERSION = b"7,7,XS1300,AC1300,v2.2.0"
# Registers of the protocol, as far as anything hangs on them here.
_VERSION_R, _MOTION_EN, _SET_STATE, _GET_STATE, _GET_ERROR = 1, 11, 12, 13, 15
_SET_MODE, _MOVE_LINE, _SENSITIVITY, _GET_POSE = 19, 21, 37, 41
_REDUCED_SPEED, _REDUCED, _BOUNDARY, _REDUCED_STATE, _FENCE = 47, 50, 52, 53, 59


class FakeXArm:
    """Follows lines at the speed that they are sent with. Times are of the monotonic clock."""

    def __init__(self, place=(300.0, 0.0, 200.0)):
        """Raises PermissionError where ports below 1024 are not for everybody."""
        n = next(_ADDRESSES)
        self.ip = f"127.{1 + n // 2**16 % 254}.{n // 2**8 % 256}.{n % 256}"
        self.place, self.target = np.array(place), np.array(place)
        self.angles = np.array([np.pi, 0, 0])
        self.state, self.mode, self.error, self.sensitivity = 4, 0, 0, 3
        self.is_reduced, self.is_fenced, self.reduced_speed = 0, 0, 1000.0
        self.boundary = [9999, -9999] * 3
        self.lies: dict[int, bytes] = {}  # register → what it answers whatever was set
        self.deaf: set[int] = set()  # registers that take no effect
        self.silent = threading.Event()  # answers nothing any more
        self.moves: list[tuple[float, np.ndarray]] = []  # (10,) pose, speed, acceleration, ...
        self.stops: list[float] = []
        self.registers: list[int] = []  # all that were asked for
        self.speed, self._moved_s = 0.0, time.monotonic()
        self._lock = threading.RLock()
        self._sockets = [self._listen(502, self._serve), self._listen(30002, self._report)]

    def close(self):
        for listening in self._sockets:
            listening.shutdown(socket.SHUT_RDWR)  # else accept() goes on
            listening.close()

    def advance(self) -> np.ndarray:
        """The place (3,) now, mm."""
        with self._lock:
            now_s = time.monotonic()
            way, far = self.target - self.place, self.speed * (now_s - self._moved_s)
            distance = np.linalg.norm(way)
            if self.state < 3 and distance > 0:
                self.place = self.place + way * min(1.0, far / distance)
            self._moved_s = now_s
            return self.place

    def _listen(self, port, handle):
        listening = socket.create_server((self.ip, port))
        listening.settimeout(None)  # the SDK sets one second for the whole process

        def accept():
            while True:
                try:
                    connection, _ = listening.accept()
                except OSError:
                    return
                connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                threading.Thread(target=handle, args=(connection,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        return listening

    def _serve(self, connection):
        connection.settimeout(None)
        buffer = b""
        while received := _receive(connection):
            buffer += received
            while len(buffer) >= 6 and len(buffer) >= (size := 6 + buffer[4] * 256 + buffer[5]):
                (transaction, protocol), request = struct.unpack(">HH", buffer[:4]), buffer[6:size]
                buffer = buffer[size:]
                with self._lock:
                    answer = self._answer(request[0], request[1:])
                    flags = 0x40 * (self.error != 0) | 0x10 * (self.state >= 4)
                head = struct.pack(">HHH", transaction, protocol, 2 + len(answer))
                if not self.silent.is_set():
                    connection.sendall(head + bytes([request[0], flags]) + answer)

    def _answer(self, register: int, values: bytes) -> bytes:
        self.registers.append(register)
        self.advance()
        if register in self.lies:
            return self.lies[register]
        if register not in self.deaf:
            self._set(register, values)
        get = {
            _VERSION_R: _VERSION.ljust(40, b"\0"),
            _GET_STATE: bytes([self.state]),
            _GET_ERROR: bytes([self.error, 0]),
            _GET_POSE: struct.pack("<6f", *self.place, *self.angles),
            _REDUCED_STATE: bytes([self.is_reduced])
            + struct.pack(">6h", *self.boundary)
            + struct.pack("<16f", self.reduced_speed, *[1.0] * 15)
            + bytes([self.is_fenced, 0]),
        }
        return get.get(register, b"")

    def _set(self, register: int, values: bytes) -> None:
        if register == _SET_STATE:
            self.state = 2 if values[0] == 0 else values[0]
            if values[0] == 4:
                self.stops.append(time.monotonic())
        elif register == _SET_MODE:
            self.mode = values[0]
        elif register == _SENSITIVITY:
            self.sensitivity = values[0]
        elif register == _REDUCED_SPEED:
            (self.reduced_speed,) = struct.unpack("<f", values)
        elif register == _REDUCED:
            self.is_reduced = values[0]
        elif register == _FENCE:
            self.is_fenced = values[0]
        elif register == _BOUNDARY:
            self.boundary = list(struct.unpack("<6i", values))
        elif register == _MOVE_LINE:
            line = np.array(struct.unpack("<10f", values[:40]))
            self.moves.append((time.monotonic(), line))
            if self.state < 3 and not self.error:
                self.target, self.speed = line[:3], line[6]

    def _report(self, connection):
        """Twenty times a second; real controllers do five."""
        try:
            while True:
                with self._lock:
                    place, report = self.advance(), bytearray(245)
                    report[0:4] = struct.pack(">I", len(report))
                    report[4] = self.mode << 4 | self.state
                    report[35:59] = struct.pack("<6f", *place, *self.angles)
                    report[87:91] = 255, 255, self.error, 0
                    report[131:133] = self.sensitivity, 1
                    report[145:147] = 7, 7
                connection.sendall(report)
                time.sleep(0.05)
        except OSError:
            return


def _receive(connection) -> bytes:
    try:
        return connection.recv(4096)
    except OSError:
        return b""


def stopped_while_moving(controller, arm, then) -> str:
    """Let something happen on the way; why the arm was stopped before it was sent any further."""
    has_happened = False

    def move():
        nonlocal has_happened
        with arm.moving():
            for _ in range(10):
                arm.send(np.array([450.0, 100.0, 350.0]), arm.measure())
                arm.wait_until(time.monotonic() + STEP_S)
                if not has_happened:
                    has_happened = True
                    controller.stops.clear()
                    controller.moves.clear()
                    then()

    with pytest.raises(RobotError) as error:
        move()
    assert has_happened
    assert controller.stops
    assert not controller.moves
    return str(error.value)
