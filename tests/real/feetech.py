"""A chain of STS3215 servos behind a pseudo-terminal, which answers as the real ones do on their serial line.

Written from the published facts of Feetech's protocol and memory table, and from the registers that lerobot names:

- A packet is ``FF FF id length instruction parameters checksum``, with ``length`` = parameters + 2 and the checksum the
  inverted sum of all bytes after the header. An answer has an error byte in place of the instruction. A packet with a
  wrong checksum, for another id or at another baud rate is not answered.
- Addresses below 40 are EPROM: while ``Lock`` is 1, a change is lost when the power goes.
- Present position = encoder - homing offset, modulo a turn unless bit 4 of ``Phase`` is set. The offset has its sign in
  bit 11, a load in bit 10, positions in bit 15.
- At 12 V, 60 degrees take 0.222 s.

Assumed, because it is not documented: a motor that is switched on holds its position, a motor that is off ignores its
goal, and the sign of the load is the direction in which the motor pushes. Acceleration is not modeled. The load is
proportional to the lag, plus ``push``.
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Self

PING, READ, WRITE, REG_WRITE, ACTION, SYNC_READ, SYNC_WRITE = 0x01, 0x02, 0x03, 0x04, 0x05, 0x82, 0x83
BROADCAST = 0xFE
MODEL = 777
OVERLOAD = 0x20
"""Bit of the error byte."""

MODEL_NUMBER, NUMBER, BAUD_RATE, RESPONSE_LEVEL = 3, 5, 6, 8
LOW, HIGH, MOST_TORQUE, PHASE, P_GAIN, OFFSET, MODE = 9, 11, 16, 18, 21, 31, 33
TORQUE, GOAL, GOAL_SPEED, TORQUE_LIMIT, LOCK = 40, 42, 46, 48, 55
POSITION, SPEED, LOAD, VOLTAGE, TEMPERATURE, MOVING, CURRENT = 56, 58, 60, 62, 63, 66, 69
_EPROM_END, _SIZE = 40, 128
_READ_ONLY = {*range(NUMBER), *range(POSITION, CURRENT + 2)}
_BAUD_RATES = (termios.B1000000, termios.B500000, None, None, termios.B115200, termios.B57600, termios.B38400)

TURN = 4096
MOST_SPEED = TURN / 6 / 0.222
"""Largest speed [steps/s]."""
_LOAD_PER_STEP = 4.0 / 32
"""Load per step of lag and unit of the P coefficient, in tenths of a percent: a choice, 250 steps are the maximum."""

MOTORS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll", "gripper")


def checksum(body: bytes) -> int:
    """Return the checksum of what stands between the header and the checksum."""
    return ~sum(body) & 0xFF


def packet(number: int, instruction: int, parameters: bytes = b"") -> bytes:
    """Return a packet; with an error byte as instruction, an answer."""
    body = bytes((number, len(parameters) + 2, instruction)) + parameters
    return b"\xff\xff" + body + bytes((checksum(body),))


def signed(word: int, bit: int) -> int:
    """Return the value of a word with a sign bit."""
    return -(word & ~(1 << bit)) if word >> bit & 1 else word


def with_sign(value: int, bit: int) -> int:
    """Return the word of a value with a sign bit."""
    return abs(value) | (1 << bit if value < 0 else 0)


class Parser:
    """Takes bytes as they come, and gives whole packets with a right checksum: (id, instruction, parameters)."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, data: bytes) -> Iterable[tuple[int, int, bytes]]:
        self._bytes += data
        while True:
            at = self._bytes.find(b"\xff\xff")
            if at < 0:
                del self._bytes[: max(0, len(self._bytes) - 1)]
                return
            del self._bytes[:at]
            if len(self._bytes) < 4:
                return
            number, length = self._bytes[2], self._bytes[3]
            if number == 0xFF or length < 2:
                del self._bytes[0]
                continue
            if len(self._bytes) < length + 4:
                return
            body, sent = bytes(self._bytes[2 : length + 3]), self._bytes[length + 3]
            if sent != checksum(body):
                del self._bytes[:2]
                continue
            del self._bytes[: length + 4]
            yield number, body[2], body[3:]


class Servo:
    """One STS3215.

    Attributes:
        encoder: Absolute angle of the axis [steps].
        push: Load from outside, in tenths of a percent of the maximum.
        blocked: Whether the axis cannot turn.
        error: Error byte of its answers.
        silent: Whether it gives no answer, as with a broken wire.
        corrupt: Number of next answers with a wrong checksum.
        late_s: Delay of the next answer [s].
        goals: Goal positions in the order in which they were written.
    """

    def __init__(self, number: int, *, encoder: float = 2048.0, clock: Callable[[], float] = time.monotonic) -> None:
        self.encoder, self._clock, self._at = float(encoder), clock, clock()
        self.push = self.error = self.corrupt = 0
        self.late_s = 0.0
        self.blocked = self.silent = False
        self.goals: list[int] = []
        self._pending: tuple[int, bytes] | None = None
        self._registers = bytearray(_SIZE)
        for address, value in ((0, 3), (1, 9), (NUMBER, number), (RESPONSE_LEVEL, 1), (P_GAIN, 32), (PHASE, 12)):
            self._registers[address] = value
        for address, value in ((MODEL_NUMBER, MODEL), (HIGH, TURN - 1), (MOST_TORQUE, 1000)):
            self._put(address, value)
        self._saved = bytes(self._registers[:_EPROM_END])
        self.cycle_power()

    def cycle_power(self) -> None:
        """Switch the power off and on: SRAM and unsaved EPROM are lost."""
        self._advance()
        self._registers[:_EPROM_END] = self._saved
        self._registers[_EPROM_END:] = bytes(_SIZE - _EPROM_END)
        self._registers[LOCK], self._registers[VOLTAGE], self._registers[TEMPERATURE] = 1, 120, 30
        self._put(TORQUE_LIMIT, self.word(MOST_TORQUE))

    @property
    def number(self) -> int:
        return self._registers[NUMBER]

    @property
    def baud_rate(self) -> int | None:
        """Its baud rate as a constant of termios."""
        code = self._registers[BAUD_RATE]
        return _BAUD_RATES[code] if code < len(_BAUD_RATES) else None

    @property
    def position(self) -> int:
        """The present position as the line gives it."""
        return signed(int.from_bytes(self.read(POSITION, 2), "little"), 15)

    def byte(self, address: int) -> int:
        return self._registers[address]

    def word(self, address: int) -> int:
        return int.from_bytes(self._registers[address : address + 2], "little")

    def _put(self, address: int, value: int) -> None:
        self._registers[address : address + 2] = value.to_bytes(2, "little")

    def store(self, **words: int) -> None:
        """Set words in EPROM for good, by the names of this module in lower case: ``low``, ``high``, ``offset``."""
        for name, value in words.items():
            self._put(globals()[name.upper()], with_sign(value, 11) if name == "offset" else value)
        self._saved = bytes(self._registers[:_EPROM_END])

    # ------------------------------------------------------------------------------------------------- motion

    def _from_encoder(self) -> float:
        present = self.encoder - signed(self.word(OFFSET), 11)
        return present if self._registers[PHASE] & 0x10 else present % TURN

    def _wanted(self) -> float:
        goal, low, high = signed(self.word(GOAL), 15), self.word(LOW), self.word(HIGH)
        return min(max(goal, low), high) if (low, high) != (0, 0) else goal

    def _advance(self) -> None:
        now = self._clock()
        passed, self._at = now - self._at, now
        if not self._registers[TORQUE] or self._registers[MODE] != 0:
            return
        lag = self._wanted() - self._from_encoder()
        most = (self.word(GOAL_SPEED) or MOST_SPEED) * passed
        if not self.blocked:
            self.encoder += min(max(lag, -most), most)

    def _measure(self) -> None:
        self._advance()
        present = self._from_encoder()
        self._put(POSITION, with_sign(round(present) % TURN if present >= 0 else round(present), 15))
        lag = self._wanted() - present if self._registers[TORQUE] else 0.0
        load = round(_LOAD_PER_STEP * self._registers[P_GAIN] * lag) + self.push if self._registers[TORQUE] else 0
        most = self.word(TORQUE_LIMIT)
        self._put(LOAD, with_sign(min(max(load, -most), most), 10))
        self._registers[MOVING] = int(abs(lag) >= 1.0 and not self.blocked)

    # ---------------------------------------------------------------------------------------------- registers

    def read(self, address: int, length: int) -> bytes:
        self._measure()
        return bytes(self._registers[address : address + length]).ljust(length, b"\0")

    def write(self, address: int, data: bytes) -> None:
        self._advance()
        was_on = self._registers[TORQUE]
        for at, value in enumerate(data, address):
            if at in _READ_ONLY or at >= _SIZE:
                continue
            self._registers[at] = value
            if at < _EPROM_END and not self._registers[LOCK]:
                self._saved = self._saved[:at] + bytes((value,)) + self._saved[at + 1 :]
        if address <= GOAL < address + len(data):
            self.goals.append(signed(self.word(GOAL), 15))
        if self._registers[TORQUE] and not was_on:
            self._put(GOAL, with_sign(round(self._from_encoder()), 15))

    def answer(self, instruction: int, parameters: bytes) -> bytes | None:
        """Return the answer to an instruction for this servo alone; None for none."""
        data = b""
        if instruction == READ and len(parameters) == 2:
            data = self.read(*parameters)
        elif instruction == WRITE and len(parameters) >= 2:
            self.write(parameters[0], parameters[1:])
        elif instruction == REG_WRITE and len(parameters) >= 2:
            self._pending = (parameters[0], parameters[1:])
        elif instruction == ACTION:
            self.act()
        elif instruction != PING:
            return None
        wanted = instruction in (READ, PING) or self._registers[RESPONSE_LEVEL] > 0
        return self.status(data) if wanted else None

    def act(self) -> None:
        """Do what was written with REG_WRITE."""
        if self._pending is not None:
            self.write(*self._pending)
            self._pending = None

    def status(self, data: bytes = b"") -> bytes | None:
        """Return an answer with its faults; None if it is silent."""
        if self.silent:
            return None
        made = packet(self.number, self.error, data)
        if self.corrupt:
            self.corrupt -= 1
            made = made[:-1] + bytes((made[-1] ^ 0x55,))
        return made


class ServoChain:
    """Servos on one line. As a context manager, it answers on the pseudo-terminal ``port``."""

    def __init__(self, servos: Iterable[Servo]) -> None:
        self.servos = tuple(servos)
        self.port = ""
        self._parser, self._thread = Parser(), threading.Thread(target=self._run, daemon=True)
        self._ends: list[int] = []
        self._stop_read, self._stop_write = os.pipe()

    def answers(self, data: bytes, *, baud_rate: int = termios.B1000000) -> list[tuple[float, bytes]]:
        """Return the answers to bytes of the line, each with its delay [s]."""
        found: list[tuple[float, bytes]] = []
        for number, instruction, parameters in self._parser.feed(data):
            hearing = [servo for servo in self.servos if servo.baud_rate == baud_rate]
            for servo, made in self._answers(hearing, number, instruction, parameters):
                if made is not None:
                    found.append((servo.late_s, made))
                    servo.late_s = 0.0
        return found

    @staticmethod
    def _answers(
        servos: list[Servo], number: int, instruction: int, parameters: bytes
    ) -> list[tuple[Servo, bytes | None]]:
        by_number = {servo.number: servo for servo in servos}
        if instruction == SYNC_READ and number == BROADCAST and len(parameters) >= 2:
            asked = [by_number[n] for n in parameters[2:] if n in by_number]
            return [(servo, servo.status(servo.read(*parameters[:2]))) for servo in asked]
        if instruction == SYNC_WRITE and number == BROADCAST and len(parameters) >= 2:
            address, length = parameters[:2]
            for at in range(2, len(parameters) - length, length + 1):
                servo = by_number.get(parameters[at])
                if servo is not None:
                    servo.write(address, parameters[at + 1 : at + 1 + length])
            return []
        if number == BROADCAST:
            made = [(servo, servo.answer(instruction, parameters)) for servo in servos]
            return made if instruction == PING else []
        return [(s, s.answer(instruction, parameters)) for s in servos if s.number == number]

    # ------------------------------------------------------------------------------------------------- the port

    def __enter__(self) -> Self:
        master, slave = os.openpty()
        tty.setraw(slave)
        self._ends = [master, slave]  # the slave stays open here too, so that a host may come and go
        self.port = os.ttyname(slave)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()
        os.close(self._stop_read)
        os.close(self._stop_write)

    def unplug(self) -> None:
        """Pull the cable: the port is gone for the host."""
        if self._ends:
            os.write(self._stop_write, b"x")
            self._thread.join(5.0)
            for end in self._ends:
                os.close(end)
            self._ends = []

    def _run(self) -> None:
        master = self._ends[0]
        while True:
            ready, _, _ = select.select([master, self._stop_read], [], [])
            if self._stop_read in ready:
                return
            with contextlib.suppress(OSError):
                heard = os.read(master, 4096)
                for late_s, made in self.answers(heard, baud_rate=termios.tcgetattr(master)[5]):
                    time.sleep(late_s)
                    os.write(master, made)


CALIBRATION = {
    "shoulder_pan": (-170, 740, 3440),
    "shoulder_lift": (1050, 820, 3210),
    "elbow_flex": (-925, 900, 3130),
    "wrist_flex": (33, 850, 3220),
    "wrist_roll": (-1380, 0, 4095),
    "gripper": (710, 2010, 3480),
}
"""Homing offset, smallest and largest position of each motor, of the size that real arms have [steps]."""


def so101_chain(*, degrees: Iterable[float] = (0.0,) * 5, gripper: float = 50.0) -> ServoChain:
    """Return the six calibrated servos of an SO-101 with the arm at joint angles, and the gripper at an opening."""
    servos = []
    for number, (motor, turn) in enumerate(zip(MOTORS, (*degrees, gripper), strict=True), 1):
        offset, low, high = CALIBRATION[motor]
        if motor == "gripper":
            present = low + turn / 100.0 * (high - low)
        else:
            present = (low + high) / 2 + turn * (TURN - 1) / 360.0
        servo = Servo(number, encoder=present + offset)
        servo.store(offset=offset, low=low, high=high)
        servos.append(servo)
    return ServoChain(servos)


def write_calibration(path: Path, **changed: dict[str, int]) -> None:
    """Write a calibration file as lerobot does; ``changed`` replaces values of motors."""
    form = {}
    for number, (motor, (offset, low, high)) in enumerate(CALIBRATION.items(), 1):
        values = {"id": number, "drive_mode": 0, "homing_offset": offset, "range_min": low, "range_max": high}
        form[motor] = values | changed.get(motor, {})
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(form, indent=4))
