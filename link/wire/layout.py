"""Layout of MAVLink frames on the wire: the one definition for live links and for the compiled scan of tlogs.

Source: MAVLink serialisation, https://mavlink.io/en/guide/serialization.html.
"""

MAGIC_1, MAGIC_2 = 0xFE, 0xFD
"""First byte of a frame of MAVLink 1 and 2."""
LENGTH_AT, FLAGS_AT = 1, 2
"""Position of the length of the payload, and in MAVLink 2 of the flags."""
SIGNED = 0x01
"""The only flag that a reader must understand: a signature follows."""
SENDER_AT_1, SENDER_AT_2 = 3, 5
"""Position of the system, which the component follows."""
ID_AT_1, ID_AT_2 = 5, 7
"""Position of the id of the message: one byte in MAVLink 1, three in MAVLink 2."""
HEADER_1_BYTES, HEADER_2_BYTES = 6, 10
CHECKSUM_BYTES = 2
SIGNATURE_BYTES = 13
AROUND_1_BYTES, AROUND_2_BYTES = HEADER_1_BYTES + CHECKSUM_BYTES, HEADER_2_BYTES + CHECKSUM_BYTES
"""Bytes of an unsigned frame besides its payload."""
MAX_FRAME_BYTES = AROUND_2_BYTES + 255 + SIGNATURE_BYTES
