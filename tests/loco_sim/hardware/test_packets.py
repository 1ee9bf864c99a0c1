# SPDX-License-Identifier: Apache-2.0
"""Packets of ours against the package of others that speaks the same protocol."""

import numpy as np
import pytest

from loco_sim.hardware.packets import HEADER, WRITE, Parser, crc16, status

sdk = pytest.importorskip("dynamixel_sdk")
HANDLER = sdk.PacketHandler(2.0)


def instruction(parameters, servo=1):
    """An instruction as the other package writes it."""

    class Port:
        is_using = False

        def clearPort(self):  # noqa: N802 (its name there)
            pass

        def writePort(self, packet):  # noqa: N802
            self.sent = bytes(packet)
            return len(packet)

    packet = [0] * (len(parameters) + 10)
    packet[4:8] = servo, *(len(parameters) + 3).to_bytes(2, "little"), WRITE
    packet[8:-2] = parameters
    port = Port()
    assert HANDLER.txPacket(port, packet) == sdk.COMM_SUCCESS
    return port.sent


@pytest.mark.parametrize("size", [1, 7, 30])
def test_the_checksum_is_that_of_the_other_package(size):
    data = np.random.default_rng(size).bytes(size)
    assert crc16(data) == HANDLER.updateCRC(0, data, size)


@pytest.mark.parametrize(
    "parameters",
    [b"", b"\x74\x00\x01\x02", b"\xff\xff\xfd"],  # it does not stuff
)
def test_instructions_of_the_other_package_are_read(parameters):
    (packet,) = Parser().feed(instruction(parameters))
    assert (packet.id, packet.instruction, packet.is_valid) == (1, WRITE, True)
    assert packet.parameters == parameters


def test_packets_come_in_pieces_and_between_noise():
    stream = b"\x00\xff" + instruction(b"\x01") + b"\xff\xff" + instruction(b"\x02", 7) + b"\xff"
    parser, packets = Parser(), []
    for byte in stream:
        packets += parser.feed(bytes([byte]))
    assert [(p.id, p.parameters) for p in packets] == [(1, b"\x01"), (7, b"\x02")]


def test_a_wrong_byte_is_noticed():
    data = bytearray(instruction(b"\x01\x02"))
    data[9] ^= 1
    assert [p.is_valid for p in Parser().feed(bytes(data))] == [False]


def test_a_length_beyond_all_packets_is_skipped():
    stream = HEADER + b"\x01\xff\xff" + instruction(b"\x03")
    assert [p.parameters for p in Parser().feed(stream)] == [b"\x03"]


def test_answers_are_stuffed():
    assert b"\xff\xff\xfd\xfd" in status(1, 0, b"\xff\xff\xfd")
