"""Recordings of a link: raw bytes of both directions with their times, events, and the protocol file, in one MCAP file.

>>> with wirebond.open("robot.yaml", "/dev/ttyUSB0") as link, link.record("run.mcap"):  # doctest: +SKIP
...     drive(link)
>>> recording = wirebond.recording.open("run.mcap")  # doctest: +SKIP
>>> recording.columns()["odometry"].t  # doctest: +SKIP
"""

from wirebond.recording.into_firmware import RecordedFirmware, replay_into_firmware
from wirebond.recording.recorder import Recorder
from wirebond.recording.recording import Recording
from wirebond.recording.recording import open_recording as open

__all__ = ["RecordedFirmware", "Recorder", "Recording", "open", "replay_into_firmware"]
