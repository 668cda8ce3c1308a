"""Frames a second from bytes to values in JavaScript, by the engine's WebAssembly module in Node.

``page_decode_frames_per_s``: the nine enterprize messages in equal shares, in reads of 16 KiB, every value of every
frame read by JavaScript. Node has the same V8 as Chrome; a page does this in a worker.
``page_decode_over_columns``: the same over the native engine's columns in Python, on the same bytes in the same run.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

import wirebond
from bench.collateral import PROTOCOL
from bench.figures import ROOT, Figure
from bench.peers.wirebond_codec import Wirebond
from bench.peers.work import samples
from wirebond.protocol.tables import session_table

FRAMES = 90_000
SECONDS = 3.0
MODULE = ROOT / "build" / "wasm" / "engine.wasm"
COMMAND = "make bench ONLY=page_decode"


def measure(frames: int = FRAMES, seconds: float = SECONDS) -> list[Figure]:
    """:raises RuntimeError: there is no Node; or JavaScript does not find the values that the native engine does."""
    if shutil.which("node") is None:
        raise RuntimeError("page_decode needs Node")
    stream = Wirebond().stream(samples(frames))
    codec = wirebond.load(PROTOCOL)
    expected = codec.decode_columns(stream)
    with tempfile.TemporaryDirectory() as folder:
        tables, bytes_ = Path(folder) / "tables", Path(folder) / "stream"
        tables.write_bytes(session_table(codec.model))
        bytes_.write_bytes(stream)
        script = Path(__file__).with_name("page_decode.mjs")
        command = ["node", str(script), str(MODULE), str(tables), str(bytes_), str(seconds)]
        found = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    columns = [
        column
        for table in expected.values()
        for name, column in table.fields.items()
        if not name.startswith("header.") and isinstance(column, np.ndarray)
    ]
    total = sum(float(column.astype(np.float64).sum()) for column in columns)
    known = sum(table.rows for name, table in expected.items() if name != "unknown")
    if found["frames"] != known or not np.isclose(found["sum"], total):
        raise RuntimeError(f"JavaScript found {found}, the native engine {known} frames with the sum {total}")
    begin = time.perf_counter()
    passes = 0
    while time.perf_counter() - begin < seconds:
        codec.decode_columns(stream)
        passes += 1
    native = passes * known / (time.perf_counter() - begin)
    return [
        Figure("page_decode_frames_per_s", found["perSecond"], "frames/s", 5e6, COMMAND, at_most=False),
        Figure("page_decode_over_columns", found["perSecond"] / native, "times", None, COMMAND),
    ]
