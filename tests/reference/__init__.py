"""A slow decoder beside the engine's, which shares none of its code: `explain`'s, and what an end makes of the frames.

Tests compare the two: every frame, every discarded byte by its cause, every sum.
"""

from tests.reference.decoding import Frame, Result, decode, decode_blocks
from tests.reference.listening import Addressee, Sequence, addressees, receiver_field, sequence_of

__all__ = [
    "Addressee",
    "Frame",
    "Result",
    "Sequence",
    "addressees",
    "decode",
    "decode_blocks",
    "receiver_field",
    "sequence_of",
]
