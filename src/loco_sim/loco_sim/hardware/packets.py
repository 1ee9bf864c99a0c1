# SPDX-License-Identifier: Apache-2.0
"""Packets of Dynamixel protocol 2.0 from the servo's side, and the registers used.

A packet is a header, the number of the servo, a length, an instruction, parameters and a
CRC-16. The driver's side is the third-party package `dynamixel-sdk`.
"""

from __future__ import annotations

from typing import NamedTuple

HEADER = b"\xff\xff\xfd\x00"
READ, WRITE, STATUS, SYNC_READ, SYNC_WRITE = 0x02, 0x03, 0x55, 0x82, 0x83
ALERT = 0x80  # bit of the error byte of a status packet: hardware error
BAD_RANGE, BAD_ACCESS = 0x04, 0x07  # errors of an instruction
_MIN_LENGTH, _MAX_LENGTH = 3, 1024  # smallest length (instruction and CRC); largest packet [bytes]


class Register(NamedTuple):
    """A register of an X-series servo."""

    address: int
    size: int  # [bytes]


OPERATING_MODE = Register(11, 1)  # 0 current, 5 position with a limit of current
TORQUE_ENABLE = Register(64, 1)
HARDWARE_ERROR = Register(70, 1)
BUS_WATCHDOG = Register(98, 1)  # counts of WATCHDOG_UNIT; EXPIRED once it has expired
GOAL_CURRENT = Register(102, 2)
GOAL_POSITION = Register(116, 4)
PRESENT = Register(126, 21)  # the following registers in one block
PRESENT_CURRENT = Register(126, 2)
PRESENT_VELOCITY = Register(128, 4)
PRESENT_POSITION = Register(132, 4)
PRESENT_TEMPERATURE = Register(146, 1)
WATCHDOG_UNIT, EXPIRED = 0.02, 255  # [s]; value
VELOCITY_UNIT = 0.229 * 2.0 * 3.141592653589793 / 60.0  # velocity of a count [rad/s]
ERRORS = {
    0x01: "input voltage",
    0x04: "overheating",
    0x08: "motor encoder",
    0x10: "electrical shock",
    0x20: "overload",
}
CURRENT_MODE, POSITION_MODE = 0, 5


class Packet(NamedTuple):
    """An instruction to one or all servos."""

    id: int
    instruction: int
    parameters: bytes
    is_valid: bool = True  # whether the CRC is correct


def crc16(data: bytes) -> int:
    """CRC of the bytes of a packet before its CRC: polynomial 0x8005, no reflection."""
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def status(servo: int, error: int = 0, parameters: bytes = b"") -> bytes:
    """Status packet of a servo."""
    body = bytes([STATUS, error]) + parameters
    body = body.replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
    head = HEADER + bytes([servo]) + (len(body) + 2).to_bytes(2, "little")
    return head + body + crc16(head + body).to_bytes(2, "little")


class Parser:
    """Extracts packets from a stream of bytes, skipping other bytes."""

    def __init__(self) -> None:
        self._bytes = b""

    def feed(self, data: bytes) -> list[Packet]:
        """The packets completed by these bytes."""
        self._bytes += data
        packets = []
        while (packet := self._next()) is not None:
            packets.append(packet)
        return packets

    def _next(self) -> Packet | None:
        while True:
            start = self._bytes.find(HEADER)
            if start < 0:  # the end may be the beginning of a header
                self._bytes = self._bytes[-3:]
                return None
            self._bytes = self._bytes[start:]
            if len(self._bytes) < 7:
                return None
            length = int.from_bytes(self._bytes[5:7], "little")
            if _MIN_LENGTH <= length <= _MAX_LENGTH:
                break
            self._bytes = self._bytes[4:]
        if len(self._bytes) < 7 + length:
            return None
        packet, self._bytes = self._bytes[: 7 + length], self._bytes[7 + length :]
        body = packet[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
        is_valid = crc16(packet[:-2]) == int.from_bytes(packet[-2:], "little")
        return Packet(packet[4], body[0], body[1:], is_valid)
