"""A slow and obvious decoder: the whole stream in one piece, bit-by-bit checks, straight from the parts of the model.

It shares no code with the engine: no plan, no tables, no state between calls. Tests compare the two, byte for byte.
"""

from tests.reference.listening import Addressee, Sequence, addressees, receiver_field, sequence_of
from tests.reference.outcome import Frame, Result
from tests.reference.stream import decode, decode_blocks

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
