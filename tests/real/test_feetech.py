"""The emulated servos keep the protocol of the real ones: bytes, registers, motion, and silence where it is due."""

import os
import select
import termios
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.real import feetech
from tests.real.feetech import (
    BROADCAST,
    GOAL,
    PING,
    POSITION,
    READ,
    TORQUE,
    WRITE,
    Parser,
    Servo,
    ServoChain,
    checksum,
    packet,
    signed,
    so101_chain,
    with_sign,
)


class Clock:
    now = 0.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def chain(clock):
    return ServoChain([Servo(n, clock=clock) for n in range(1, 7)])


def asked(chain, number, instruction, *parameters):
    """The answers without their delays, parsed."""
    found = chain.answers(packet(number, instruction, bytes(parameters)))
    return list(Parser().feed(b"".join(made for _, made in found)))


def word(data):
    return int.from_bytes(data, "little")


def test_packets_are_those_of_the_manual():
    # Feetech's manual of the protocol: ping of servo 1, and its answer.
    assert packet(1, PING) == bytes.fromhex("ffff010201fb")
    assert packet(1, 0) == bytes.fromhex("ffff010200fc")
    # Read the position of servo 1, and the answer 1304 (0x0518).
    assert packet(1, READ, bytes((0x38, 2))) == bytes.fromhex("ffff0104023802be")
    assert packet(1, 0, bytes((0x18, 0x05))) == bytes.fromhex("ffff0104001805dd")
    assert checksum(bytes((1, 2, 1))) == 0xFB


@given(st.integers(0, 253), st.integers(0, 255), st.binary(max_size=40), st.binary(max_size=8), st.data())
def test_a_packet_is_found_however_its_bytes_come(number, instruction, parameters, noise, data):
    noise = noise.replace(b"\xff", b"")
    stream = noise + packet(number, instruction, parameters) + noise + packet(3, PING)
    cut = data.draw(st.integers(0, len(stream)))
    parser = Parser()
    found = [*parser.feed(stream[:cut]), *parser.feed(stream[cut:])]
    assert found == [(number, instruction, parameters), (3, PING, b"")]


@given(st.integers(0, 60))
def test_a_packet_with_a_wrong_byte_is_dropped_and_the_next_one_is_heard(bit):
    sent = bytearray(packet(2, WRITE, bytes((GOAL, 0x12, 0x03))))
    sent[2 + bit % 6] ^= 1 << bit % 8
    found = list(Parser().feed(bytes(sent) + bytes(260) + packet(3, PING)))
    assert (2, WRITE, bytes((GOAL, 0x12, 0x03))) not in found
    assert list(Parser().feed(bytes(sent[:6]) + packet(3, PING) * 60))[-1] == (3, PING, b"")


@given(st.integers(-1023, 1023))
def test_signs_are_magnitudes_with_a_bit(value):
    assert signed(with_sign(value, 10), 10) == value
    assert 0 <= with_sign(value, 10) < 2048


def test_servos_answer_for_themselves_alone(chain):
    assert asked(chain, 4, PING) == [(4, 0, b"")]
    assert asked(chain, 9, PING) == []
    assert [number for number, _, _ in asked(chain, BROADCAST, PING)] == [1, 2, 3, 4, 5, 6]
    assert asked(chain, 2, READ, feetech.MODEL_NUMBER, 2) == [(2, 0, (777).to_bytes(2, "little"))]
    assert asked(chain, 2, 0x77) == []
    assert chain.answers(packet(1, PING)[:-1] + b"\0") == []


def test_servos_at_another_baud_rate_hear_nothing(chain):
    assert chain.answers(packet(1, PING), baud_rate=termios.B115200) == []
    asked(chain, 1, WRITE, feetech.BAUD_RATE, 4)
    assert asked(chain, 1, PING) == []
    assert chain.answers(packet(1, PING), baud_rate=termios.B115200) == [(0.0, packet(1, 0))]


def test_writing_is_answered_as_the_response_level_says(chain):
    assert asked(chain, 1, WRITE, GOAL, 0, 8) == [(1, 0, b"")]
    assert asked(chain, 1, WRITE, feetech.RESPONSE_LEVEL, 0) == []
    assert asked(chain, 1, WRITE, GOAL, 0, 8) == []
    assert asked(chain, 1, PING) == [(1, 0, b"")]
    assert asked(chain, 1, READ, GOAL, 2) == [(1, 0, b"\0\x08")]


def test_measured_values_and_the_model_cannot_be_written(chain):
    asked(chain, 1, WRITE, feetech.MODEL_NUMBER, 1, 1)
    asked(chain, 1, WRITE, POSITION, 1, 1)
    assert asked(chain, 1, READ, feetech.MODEL_NUMBER, 2)[0][2] == (777).to_bytes(2, "little")
    assert word(asked(chain, 1, READ, POSITION, 2)[0][2]) == 2048


def test_a_change_of_eprom_stays_only_while_the_lock_is_open(chain):
    servo = chain.servos[0]
    asked(chain, 1, WRITE, feetech.LOW, 100, 0)
    assert servo.word(feetech.LOW) == 100
    servo.cycle_power()
    assert servo.word(feetech.LOW) == 0
    asked(chain, 1, WRITE, feetech.LOCK, 0)
    asked(chain, 1, WRITE, feetech.LOW, 100, 0)
    servo.cycle_power()
    assert (servo.word(feetech.LOW), servo.byte(feetech.LOCK), servo.byte(TORQUE)) == (100, 1, 0)
    asked(chain, 1, WRITE, feetech.LOCK, 0)
    asked(chain, 1, WRITE, feetech.NUMBER, 9)
    assert asked(chain, 1, PING) == []
    assert asked(chain, 9, PING) == [(9, 0, b"")]


def test_a_motor_goes_to_its_goal_at_its_speed_and_not_without_torque(chain, clock):
    servo = chain.servos[0]
    asked(chain, 1, WRITE, GOAL, *(3000).to_bytes(2, "little"))
    clock.now = 1.0
    assert servo.position == 2048
    asked(chain, 1, WRITE, TORQUE, 1)  # holds its position
    clock.now = 2.0
    assert servo.position == 2048
    asked(chain, 1, WRITE, GOAL, *(3000).to_bytes(2, "little"))
    clock.now = 2.1
    assert servo.position == pytest.approx(2048 + 0.1 * feetech.MOST_SPEED, abs=1)
    assert asked(chain, 1, READ, feetech.MOVING, 1)[0][2] == b"\x01"
    asked(chain, 1, WRITE, feetech.GOAL_SPEED, *(100).to_bytes(2, "little"))
    before = servo.position
    clock.now = 2.6
    assert servo.position == pytest.approx(before + 50, abs=1)
    asked(chain, 1, WRITE, TORQUE, 0)
    before = servo.position
    clock.now = 9.0
    assert servo.position == before
    assert servo.goals == [3000, 3000]


def test_a_goal_is_clipped_to_the_limits(chain, clock):
    servo = chain.servos[0]
    servo.store(low=1000, high=2500)
    asked(chain, 1, WRITE, TORQUE, 1)
    for goal, end in ((4000, 2500), (10, 1000)):
        asked(chain, 1, WRITE, GOAL, *goal.to_bytes(2, "little"))
        clock.now += 5.0
        assert servo.position == end


def test_the_homing_offset_shifts_the_position_within_a_turn(chain):
    servo = chain.servos[0]
    servo.store(offset=-300)
    assert servo.word(feetech.OFFSET) == 300 | 1 << 11
    assert servo.position == 2348
    servo.encoder = 100.0
    servo.store(offset=200)
    assert servo.position == feetech.TURN - 100
    asked(chain, 1, WRITE, feetech.PHASE, 12 | 0x10)
    assert servo.position == -100
    assert word(asked(chain, 1, READ, POSITION, 2)[0][2]) == 100 | 1 << 15


def test_the_load_has_the_sign_of_its_direction(chain, clock):
    servo = chain.servos[0]
    asked(chain, 1, WRITE, TORQUE, 1)
    servo.blocked = True
    seen = []
    for goal in (2148, 1948, 4000):
        asked(chain, 1, WRITE, GOAL, *goal.to_bytes(2, "little"))
        clock.now += 1.0
        seen.append(word(asked(chain, 1, READ, feetech.LOAD, 2)[0][2]))
    assert servo.position == 2048
    assert seen == [400, 400 | 1 << 10, 1000]
    asked(chain, 1, WRITE, TORQUE, 0)
    assert word(asked(chain, 1, READ, feetech.LOAD, 2)[0][2]) == 0


def test_many_are_read_and_written_at_once(chain):
    found = asked(chain, BROADCAST, feetech.SYNC_WRITE, GOAL, 2, 1, 1, 4, 9, 0, 0, 3, 7, 6)
    assert found == []
    assert [chain.servos[n].goals for n in (0, 1, 2)] == [[0x0401], [], [0x0607]]
    assert asked(chain, BROADCAST, feetech.SYNC_READ, GOAL, 2, 3, 1, 9) == [(3, 0, b"\x07\x06"), (1, 0, b"\x01\x04")]
    chain.servos[2].silent = True
    assert asked(chain, BROADCAST, feetech.SYNC_READ, GOAL, 2, 3, 1) == [(1, 0, b"\x01\x04")]


def test_what_is_registered_waits_for_the_action(chain):
    assert asked(chain, 1, feetech.REG_WRITE, GOAL, 1, 4) == [(1, 0, b"")]
    assert asked(chain, 2, feetech.REG_WRITE, GOAL, 2, 4) == [(2, 0, b"")]
    assert chain.servos[0].goals == []
    assert asked(chain, BROADCAST, feetech.ACTION) == []
    assert asked(chain, BROADCAST, feetech.ACTION) == []
    assert [servo.goals for servo in chain.servos[:3]] == [[0x0401], [0x0402], []]


def test_faults_are_those_of_a_line(chain):
    servo = chain.servos[0]
    servo.error = feetech.OVERLOAD
    assert asked(chain, 1, PING) == [(1, feetech.OVERLOAD, b"")]
    servo.corrupt = 1
    ((_, made),) = chain.answers(packet(1, PING))
    assert list(Parser().feed(made)) == []
    assert asked(chain, 1, PING) == [(1, feetech.OVERLOAD, b"")]
    servo.late_s = 0.3
    assert [late for late, _ in chain.answers(packet(1, PING) * 2)] == [0.3, 0.0]


def test_the_port_answers_and_is_gone_when_it_is_unplugged():
    with so101_chain(degrees=(10.0, 0, 0, 0, 0), gripper=100.0) as chain:
        host = os.open(chain.port, os.O_RDWR | os.O_NOCTTY)
        try:
            settings = termios.tcgetattr(host)
            settings[4] = settings[5] = termios.B1000000
            termios.tcsetattr(host, termios.TCSANOW, settings)
            os.write(host, packet(1, READ, bytes((POSITION, 2))) + packet(6, READ, bytes((feetech.HIGH, 2))))
            parser, found, until = Parser(), [], time.monotonic() + 10.0
            while len(found) < 2 and time.monotonic() < until:
                if select.select([host], [], [], 0.1)[0]:
                    found += parser.feed(os.read(host, 100))
            assert [(number, word(data)) for number, _, data in found] == [(1, 2204), (6, 3480)]
            settings[4] = settings[5] = termios.B115200
            termios.tcsetattr(host, termios.TCSANOW, settings)
            os.write(host, packet(1, PING))
            assert select.select([host], [], [], 0.2)[0] == []
            chain.unplug()
            assert select.select([host], [], [], 5.0)[0] == [host]
            with pytest.raises(OSError, match="Input/output"):
                os.write(host, packet(1, PING))
        finally:
            os.close(host)
