"""A slow and obvious decoder: the whole stream in one piece, bit-by-bit checks, straight from the parts of the model.

It shares no code with the engine: no plan, no tables, no state between calls. Tests compare the two, byte for byte.
"""

from tests.reference.outcome import Frame, Result
from tests.reference.stream import decode, decode_blocks

__all__ = ["Frame", "Result", "decode", "decode_blocks"]
