"""NMEA 0183 against pynmea2."""

from __future__ import annotations

import random
import string
from typing import Any

import pynmea2

from tests.contrib.oracle import Case, Oracle
from wirebond.protocol.model import End, Message

_TALKERS = ("GP", "GN", "GL", "II", "SD")
_FORMATTERS = ("GGA", "RMC", "GLL", "VTG", "HDT", "DPT", "ZDA", "GSA")
_CHARACTERS = string.ascii_letters + string.digits + ".-+ "


class Nmea(Oracle):
    def values(self, message: Message, source: random.Random) -> dict[str, Any]:
        words = ["".join(source.choices(_CHARACTERS, k=source.randrange(8))) for _ in range(source.randrange(1, 9))]
        return {"text": ",".join([source.choice(_TALKERS) + source.choice(_FORMATTERS), *words])}

    def encode(self, case: Case) -> bytes | None:
        formatter, *words = case.wire[0].decode().split(",")
        kind = getattr(pynmea2, formatter[2:])
        sentence: pynmea2.NMEASentence = kind(formatter[:2], formatter[2:], words)
        return sentence.render(newline=True).encode()

    def decode(self, frame: bytes, sender: End) -> Case | None:
        if frame[:1] != b"$" or frame[-5:-4] != b"*" or frame[-2:] != b"\r\n" or frame.count(b"\n") != 1:
            return None  # the library reads lines, and takes sentences with less
        try:
            sentence = pynmea2.parse(frame.decode("ascii"), check=True)
        except pynmea2.ChecksumError:
            return None
        except pynmea2.ParseError:  # a sentence of a type that the library does not know may still be whole
            text, digits = frame[1:-5], frame[-4:-2]
            if b"*" in text or digits != b"%02X" % pynmea2.NMEASentence.checksum(text.decode("ascii")):
                return None
            return Case("sentence", sender, [text])
        except (ValueError, AttributeError):
            return None
        words = [sentence.identifier().rstrip(","), *sentence.data]
        return Case("sentence", sender, [",".join(words).encode()])
