"""The port for Arduino's Stream: a generated folder is a library, and its sketch builds for three boards' stubs."""

from __future__ import annotations

import json
import re
import subprocess
from pathlib import Path

import pytest

from tests.shared import PROTOCOLS, ROOT
from wirebond.cli.main import main as wirebond

pytestmark = pytest.mark.live

BOARDS = ["ESP32", "RP2040", "SAMD"]
PAGE = (ROOT / "docs" / "firmware.md").read_text(encoding="utf-8")
# SAMD's stream does not say how much it takes: its sketch says that a write may wait.
DRIVE = """
#include <cstdio>
HardwareSerial Serial1;
static unsigned long now_us = 0;
unsigned long micros() { return now_us; }
unsigned long millis() { return now_us / 1000; }
int main() {
  setup();
  if (Serial1.rate != diffdrive::baud) return 1;
  for (int i = 0; i < 2000; ++i, now_us += 1000) {
    if (i % 10 == 0) {
      unsigned char frame[diffdrive::Velocity::Info::max_frame_bytes];
      std::size_t size = 0;
      if (diffdrive::encode(diffdrive::Velocity{0.5F, 0}, frame, sizeof frame, size) != wirebond::Status::ok) return 2;
      Serial1.come.insert(Serial1.come.end(), frame, frame + size);
    }
    Serial1.room = i % 3 == 0 ? 5 : 0;
    loop();
  }
  std::printf("%d frames, %d bytes left\\n", (int)rover_link.receiver().account().frames, (int)Serial1.gone.size());
  return rover.speed == 0.5F ? 0 : 3;
}
"""


def sketch() -> str:
    blocks = re.findall(r"^```cpp\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    return next(block for block in blocks if "wirebond/arduino/stream.hpp" in block)


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("libraries") / "wirebond_diffdrive"
    assert wirebond(["gen", str(PROTOCOLS / "diffdrive.yaml"), "--port", "arduino", "--out", str(out)]) == 0
    return out


def test_its_manifests_name_what_is_there(library: Path) -> None:
    lines = (library / "library.properties").read_text(encoding="utf-8").splitlines()
    properties = dict(line.split("=", 1) for line in lines)
    needed = {"name", "version", "author", "maintainer", "sentence", "paragraph", "category", "url", "architectures"}
    assert needed <= properties.keys()
    assert (library / properties["includes"]).is_file()
    manifest = json.loads((library / "library.json").read_text(encoding="utf-8"))
    assert manifest["name"] == properties["name"] == "wirebond_diffdrive"
    assert manifest["version"] == properties["version"]
    assert (library / manifest["headers"]).is_file()


@pytest.mark.parametrize("board", BOARDS)
def test_the_sketch_of_the_page_builds_and_runs(board: str, library: Path, tmp_path: Path) -> None:
    text = sketch()
    if board == "SAMD":
        text = text.replace("uart(Serial1)", "uart(Serial1, true)")
    source = tmp_path / "rover.cpp"
    source.write_text(text + (DRIVE if board != "ESP32" else ""), encoding="utf-8")
    flags = ["-std=gnu++17", "-O0", "-Wall", "-Wextra", "-Werror", f"-DARDUINO_ARCH_{board}"]
    folders = [f"-I{library}", f"-I{ROOT / 'ports' / 'arduino' / 'tests'}"]
    runs = board != "ESP32"
    target = ["-o", "rover"] if runs else ["-fsyntax-only"]
    done = subprocess.run(
        ["g++", *flags, *folders, str(source), *target], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    if runs:
        said = subprocess.run([tmp_path / "rover"], capture_output=True, text=True, check=True).stdout
        assert said == f"200 frames, {40 * 11} bytes left\n"


def test_the_sketch_for_beginners_builds(tmp_path: Path) -> None:
    page = (ROOT / "docs" / "start-arduino.md").read_text(encoding="utf-8")
    file, text = (
        next(iter(re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)))
        for language in ("yaml", "cpp sketch")
    )
    (tmp_path / "greenhouse.yaml").write_text(file, encoding="utf-8")
    (tmp_path / "greenhouse.cpp").write_text(text, encoding="utf-8")
    assert (
        wirebond(["gen", str(tmp_path / "greenhouse.yaml"), "--port", "arduino", "--out", str(tmp_path / "lib")]) == 0
    )
    command = ["g++", "-std=gnu++17", "-Wall", "-Wextra", "-Werror", "-DARDUINO_ARCH_RP2040", "-fsyntax-only"]
    command += [f"-I{tmp_path / 'lib'}", f"-I{ROOT / 'ports' / 'arduino' / 'tests'}", str(tmp_path / "greenhouse.cpp")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
