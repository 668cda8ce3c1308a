"""docs/firmware.md, followed to the letter: its source file and its lines in projects as CubeMX makes them."""

from __future__ import annotations

import os
import re
import subprocess
from pathlib import Path

import pytest

from tests.shared import PROTOCOLS, ROOT
from wirebond.cli.main import main as wirebond
from wirebond.generate.code import generate_c, generate_cpp, port_files_in_c, port_headers, write_files
from wirebond.protocol.loader import load

pytestmark = pytest.mark.live

PAGES = {name: (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("firmware", "c")}
STRICT = ["-Wall", "-Wextra", "-Werror"]
TARGET = ["-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard"]

# What CubeMX 6.12 writes, without what the guide does not touch: a Makefile for C, a CMakeLists.txt for C.
MAKEFILE = f"""\
TARGET = robot
BUILD_DIR = build
CC = arm-none-eabi-gcc
C_INCLUDES = -ICore/Inc
OPT = -Os
CFLAGS = {" ".join(TARGET)} $(C_INCLUDES) $(OPT) -Wall -Werror -fdata-sections -ffunction-sections
OBJECTS = $(BUILD_DIR)/main.o
vpath %.c Core/Src
$(BUILD_DIR)/%.o: %.c Makefile | $(BUILD_DIR)
\t$(CC) -c $(CFLAGS) $< -o $@
$(BUILD_DIR):
\tmkdir $@
{{lines}}
# link
$(BUILD_DIR)/$(TARGET).elf: $(OBJECTS) Makefile
\t$(CC) -r -nostdlib $(OBJECTS) -o $@
"""
CMAKE = f"""\
cmake_minimum_required(VERSION 3.22)
set(CMAKE_PROJECT_NAME robot)
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
set(CMAKE_CXX_COMPILER arm-none-eabi-g++)
set(CMAKE_C_FLAGS "{" ".join(TARGET)} -Os -Wall -Werror")
set(CMAKE_CXX_FLAGS "${{CMAKE_C_FLAGS}} -fno-rtti -fno-exceptions -fno-threadsafe-statics")
project(${{CMAKE_PROJECT_NAME}} LANGUAGES C ASM)
add_library(${{CMAKE_PROJECT_NAME}} STATIC Core/Src/main.c)
target_include_directories(${{CMAKE_PROJECT_NAME}} PRIVATE Core/Inc)
"""


def blocks(language: str, page: str = "firmware") -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", PAGES[page], re.MULTILINE | re.DOTALL)


def run(*command: str | Path, cwd: Path) -> None:
    done = subprocess.run(list(map(str, command)), cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, f"{command}\n{done.stdout[-3000:]}{done.stderr[-3000:]}"


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A project with the page's source file, and a double of the HAL in the place of the vendor's."""
    for folder in ("Core/Src", "Core/Inc"):
        (tmp_path / folder).mkdir(parents=True)
    generate_cpp(load(PROTOCOLS / "diffdrive.yaml"), tmp_path / "generated")
    write_files(tmp_path / "generated", port_headers("stm32_hal") | port_headers("stm32_ll"))
    (tmp_path / "Core/Src/rover_link.cpp").write_text(blocks("cpp")[0], encoding="utf-8")
    main = "void rover_link_poll(unsigned long);\nint main(void) {\n  for (;;) rover_link_poll(0);\n}\n"
    (tmp_path / "Core/Src/main.c").write_text(main, encoding="utf-8")
    hal = ROOT / "ports" / "stm32_hal" / "tests" / "stm32f4xx_hal.h"
    (tmp_path / "Core/Inc/stm32f4xx_hal.h").write_text(hal.read_text(encoding="utf-8"), encoding="utf-8")
    usart = '#include "stm32f4xx_hal.h"\nextern UART_HandleTypeDef huart2, huart3;\n'
    (tmp_path / "Core/Inc/usart.h").write_text(usart, encoding="utf-8")
    return tmp_path


def write_c_project(project: Path, port: str = "stm32_hal") -> None:
    """Write the STM32 project of docs/c.md, in the place of the C++ one."""
    diffdrive = load(PROTOCOLS / "diffdrive.yaml")
    generate_c(diffdrive, project / "generated")
    write_files(project / "generated", port_files_in_c(port))
    (project / "Core/Src/rover_link.cpp").unlink(missing_ok=True)
    text = next(block for block in blocks("c", "c") if f"WIREBOND_{port.upper()}_PORT" in block)
    (project / "Core/Src/rover_link.c").write_text(text, encoding="utf-8")


@pytest.mark.parametrize(
    ("page", "level"),
    [("firmware", "-O0"), ("firmware", "-Os"), ("c", "-O0"), pytest.param("c", "-Os", marks=pytest.mark.long)],
)
def test_makefile_lines_build_it(page: str, level: str, project: Path) -> None:
    if page == "c":
        write_c_project(project)
    (lines,) = blocks("makefile", page)
    (project / "Makefile").write_text(MAKEFILE.replace("{lines}", lines), encoding="utf-8")
    run("make", f"OPT={level}", "build/robot.elf", cwd=project)


@pytest.mark.parametrize("page", ["firmware", pytest.param("c", marks=pytest.mark.long)])
def test_cmake_lines_build_it(page: str, project: Path) -> None:
    if page == "c":
        write_c_project(project)
    lines = next(block for block in blocks("cmake", page) if "enable_language" in block)
    (project / "CMakeLists.txt").write_text(CMAKE + lines, encoding="utf-8")
    run("cmake", "-S", ".", "-B", "build", "-G", "Ninja", cwd=project)
    run("cmake", "--build", "build", cwd=project)


# ---- the vendor's own headers, where they are: STM32_HAL_PATH is an STM32Cube package, or a folder with several

HAL = Path(os.environ.get("STM32_HAL_PATH", "/nonexistent"))
FAMILIES = {"f4": "STM32F407xx", "g4": "STM32G473xx"}


def blocks_for_stm32() -> list[str]:
    """The page's other blocks for the HAL's port and for the one without the HAL, which need nothing else."""
    ports = ("wirebond/stm32_hal/", "wirebond/stm32_ll/")
    found = [text for text in blocks("cpp")[1:] if any(port in text for port in ports)]
    return [text for text in found if "freertos" not in text]


def with_channels(text: str) -> str:
    """Return the code of the port without the HAL, as the page gives it for a G4."""
    channels = "{USART3, DMA1, DMA1_Channel1, 1, DMA1_Channel2, 2, USART3_IRQn}"
    return re.sub(r"\{USART3, DMA1, .*?\}", channels, text).replace("stm32f4xx.h", "stm32g4xx.h")


@pytest.mark.skipif(not HAL.is_dir(), reason="STM32_HAL_PATH names no folder with the vendor's HAL")
@pytest.mark.parametrize("callbacks", ["0U", "1U"])
@pytest.mark.parametrize("family", FAMILIES)
def test_it_compiles_against_the_vendors_hal(family: str, callbacks: str, project: Path) -> None:
    hal, device = f"stm32{family}xx_hal", f"stm32{family}xx"
    templates = sorted(HAL.rglob(f"{hal}_conf_template.h"))
    if not templates:
        pytest.skip(f"STM32_HAL_PATH has no HAL of the {family.upper()}")
    (project / "Core/Inc/stm32f4xx_hal.h").unlink()
    configuration = templates[0].read_text(encoding="utf-8")
    configuration = re.sub(r"(USE_HAL_UART_REGISTER_CALLBACKS\s+)\dU", rf"\g<1>{callbacks}", configuration)
    (project / "Core/Inc" / f"{hal}_conf.h").write_text(configuration, encoding="utf-8")
    usart = f'#include "{hal}.h"\nextern UART_HandleTypeDef huart2, huart3;\n'
    (project / "Core/Inc/usart.h").write_text(usart, encoding="utf-8")
    source = project / "Core/Src/rover_link.cpp"
    if callbacks == "1U":  # the call that replaces the three functions, as the page has it
        text = source.read_text(encoding="utf-8").replace("namespace {", "").replace("}  // namespace", "")
        text = re.sub(r"^void HAL_.*?^}$", "", text, flags=re.MULTILINE | re.DOTALL)
        text += "bool begin() { return wirebond::stm32_hal::register_events<rover_link>(huart3); }\n"
        source.write_text(text, encoding="utf-8")
    folders = {templates[0].parent, *(path.parent for path in HAL.rglob(f"{device}.h"))}
    folders |= {path.parent for path in sorted(HAL.rglob("core_cm4.h"))[:1]}
    vendor = [part for folder in sorted(folders) for part in ("-isystem", str(folder))]
    flags = ["-std=c++17", "-Os", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti", *TARGET]
    folder = ["-Igenerated", "-isystem", "Core/Inc", f"-D{FAMILIES[family]}", *vendor]
    run("arm-none-eabi-g++", *flags, *folder, "-c", source, "-o", "rover_link.o", cwd=project)
    if callbacks == "0U":
        for text in blocks_for_stm32():
            source.write_text(text if family == "f4" else with_channels(text), encoding="utf-8")
            run("arm-none-eabi-g++", *flags, *folder, "-c", source, "-o", "block.o", cwd=project)
        for port in ("stm32_hal", "stm32_ll"):
            write_c_project(project, port)
            user = project / "Core/Src/rover_link.c"
            if family != "f4":
                user.write_text(with_channels(user.read_text(encoding="utf-8")), encoding="utf-8")
            for part in (user, f"generated/wirebond_{port}.c"):
                c = ["-std=c99", "-Os", *STRICT, *TARGET]
                run("arm-none-eabi-gcc", *c, *folder, "-c", part, "-o", "part.o", cwd=project)


DRIVES = """\
// The page's source file on the double of the HAL: what its rover does when the host falls silent, and afterwards.
#include "rover_link.cpp"

#include "board.hpp"
#include "stm32f4xx_hal.h"
#include "wirebond/fake/line.hpp"

extern "C" void USART3_IRQHandler(void) { rover_link_pended(); }

int main() {
  wirebond::fake::Line in{diffdrive::baud, 10};
  wirebond::fake::Line out{diffdrive::baud, 10};
  wirebond::fake::Uart hardware{in, out};
  Board board{hardware};
  wirebond::fake::Time now = 0;
  const auto pass = [&](unsigned ms) {
    for (; ms != 0; --ms) {
      board.run(now += 1'000'000);
      rover_link_poll(static_cast<std::uint32_t>(now / 1000));
    }
  };
  const auto command = [&](float linear) {
    unsigned char frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    if (diffdrive::encode(diffdrive::Velocity{linear, 0.0F}, frame, sizeof frame, size) != wirebond::Status::ok) return;
    in.put(frame, size, now);
    pass(5);
  };
  pass(5'000);  // the host boots
  if (rover.speed != 0.0F) return 1;
  command(0.5F);
  if (rover.speed != 0.5F) return 2;
  pass(1'500);  // silence
  if (rover.speed != 0.0F) return 3;
  command(0.5F);
  if (rover.speed != 0.5F) return 4;  // `stop` ends with the next message
  pass(4'000);
  command(0.5F);
  if (rover.speed != 0.0F) return 5;  // safe mode does not
  if (rover_link.counters().held_back != 1) return 6;
  rover_button_pressed();
  if (rover.speed != 0.0F) return 7;
  command(0.25F);
  return rover.speed == 0.25F ? 0 : 8;
}
"""


def test_its_rover_does_not_move_in_safe_mode_until_it_is_recovered(project: Path) -> None:
    """The source file itself runs: it drove on in safe mode once, and everybody copies it."""
    ports = ROOT / "ports"
    main = project / "Core/Src/drives.cpp"
    main.write_text(DRIVES, encoding="utf-8")
    folders = ("generated", "Core/Inc", "Core/Src", ports / "stm32_hal/tests", ports / "fake/include")
    includes = [f"-I{project / folder}" for folder in folders]
    double = ports / "stm32_hal/tests/stm32f4xx_hal.cpp"
    run("c++", "-std=c++17", "-O0", "-Wall", "-Wextra", *includes, main, double, "-o", "drives", cwd=project)
    run("./drives", cwd=project)


BAD_LINE = """\
// The page's source file on a line with an error in one of 100 bytes: each frame that is whole in memory acts.
#include "rover_link.cpp"

#include BOARD
#include "wirebond/fake/line.hpp"

namespace fake = wirebond::fake;

extern "C" void USART3_IRQHandler(void) { rover_link_pended(); }
void usart3_pended() { rover_link_pended(); }

int main() {
  fake::Line in{diffdrive::baud, 10};
  fake::Line out{diffdrive::baud, 10};
  in.faults = {4'000, 3'000, 3'000, 0};
  static fake::Uart hardware{in, out};
  static Board board{hardware};
  fake::Time now = 0;
  unsigned whole = 0;
  const auto pass = [&] {
    for (int ms = 0; ms < 4; ++ms) {
      board.run(now += 1'000'000);
      rover_link_poll(static_cast<std::uint32_t>(now / 1000));
    }
  };
  pass();
  for (int i = 0; i < 4'000; ++i) {
    const float linear = static_cast<float>(i - 2'000) / 1000.0F;
    unsigned char frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    const diffdrive::Velocity velocity{linear, 0.0F};
    if (diffdrive::encode(velocity, frame, sizeof frame, size) != wirebond::Status::ok) return 1;
    in.forget();
    in.put(frame, size, now);
    pass();
    bool is_whole = true;
    for (const fake::LineByte& byte : in.bytes()) {
      is_whole = is_whole && byte.fate <= fake::Fate::damaged && byte.seen == byte.sent;
    }
    if (is_whole && rover.speed - linear > 0.0005F) return 2;
    if (is_whole && linear - rover.speed > 0.0005F) return 2;
    whole += is_whole ? 1u : 0u;
  }
  if (hardware.counts().receive_starts != 1) return 3;
  if (whole < 3'500 || whole > 3'950) return 4;
  const wirebond::LinkCounters counters = rover_link.counters();
  if (counters.framing_errors < 100 || counters.noise_errors < 70 || counters.overruns < 70) return 5;
  if (counters.framing_errors + counters.noise_errors > in.count(fake::Fate::damaged)) return 6;
  if (counters.overruns > in.count(fake::Fate::overrun)) return 7;
  return counters.receive_restarts == 0 ? 0 : 8;
}
"""
QUICK = ["-std=c++17", "-O0", "-Wall", "-Wextra"]


def test_on_a_bad_line_reception_never_stops_and_each_whole_frame_acts(project: Path) -> None:
    ports = ROOT / "ports"
    main = project / "Core/Src/bad_line.cpp"
    main.write_text(BAD_LINE, encoding="utf-8")
    folders = ("generated", "Core/Inc", "Core/Src", ports / "stm32_hal/tests", ports / "fake/include")
    includes = [f"-I{project / folder}" for folder in folders]
    double = ports / "stm32_hal/tests/stm32f4xx_hal.cpp"
    run("c++", *QUICK, '-DBOARD="board.hpp"', *includes, main, double, "-o", "bad_line", cwd=project)
    run("./bad_line", cwd=project)


@pytest.mark.skipif(not HAL.is_dir(), reason="STM32_HAL_PATH names no folder with the vendor's HAL")
def test_so_it_is_with_the_vendors_own_drivers(project: Path) -> None:
    drivers = next(HAL.rglob("STM32F4xx_HAL_Driver"), None)
    if drivers is None:
        pytest.skip("STM32_HAL_PATH has no HAL of the F4")
    ports, registers = ROOT / "ports", ROOT / "ports" / "stm32_hal" / "vendor_tests"
    (project / "Core/Inc/stm32f4xx_hal.h").unlink()
    main = project / "Core/Src/bad_line.cpp"
    main.write_text(BAD_LINE, encoding="utf-8")
    vendor = [drivers / "Inc", drivers.parent / "CMSIS/Device/ST/STM32F4xx/Include"]
    folders = [*(project / folder for folder in ("generated", "Core/Inc", "Core/Src")), registers]
    includes = [f"-I{folder}" for folder in (*folders, ports / "fake/include", *vendor)]
    low = ["-fno-pie", "-DSTM32F407xx", "-DUSE_HAL_DRIVER"]  # the HAL keeps addresses in 32 bits
    made = []
    for name in ("uart", "dma"):
        source = drivers / "Src" / f"stm32f4xx_hal_{name}.c"
        run("gcc", "-O1", "-w", *low, *includes, "-c", source, "-o", f"{name}.o", cwd=project)
        made.append(f"{name}.o")
    sources = [main, registers / "registers.cpp", *made]
    run("c++", *QUICK, *low, "-no-pie", '-DBOARD="registers.hpp"', *includes, *sources, "-o", "bad_line", cwd=project)
    run("./bad_line", cwd=project)


# What a project may do wrong, by its port, and the first words of what its link says of it.
MISTAKES = {
    "stm32_hal": {
        "none": "nothing is known to be wrong",
        "interrupt off": "the UART's interrupt is off",
        "no line for pends": "the UART's interrupt was pended and `on_pended` was not called",
        "DMA in normal mode": "the receive DMA is in normal mode",
        "no receive DMA": "the UART has no receive DMA",
        "no transmit DMA": "the UART has no transmit DMA",
        "wrong baud rate": "the UART has another baud rate",
        "tick below the UART": "the HAL's tick cannot interrupt",
        "UART not initialised": "the UART is not initialised",
        "milliseconds": "the time that the poll is given passes too slowly",
    },
    "stm32_ll": {
        "none": "nothing is known to be wrong",
        "interrupt off": "the UART's interrupt is off",
        "DMA in normal mode": "the receive DMA is in normal mode",
        "no receive DMA": "the UART has no receive DMA",
        "no transmit DMA": "the UART has no transmit DMA",
        "wrong baud rate": "bytes come, and no frame is among them",  # registers do not tell the clock
        "UART not initialised": "the UART is not initialised",
        "milliseconds": "the time that the poll is given passes too slowly",
    },
}
MAKES_A_MISTAKE = {
    "stm32_hal": """\
extern "C" void USART3_IRQHandler(void) {
  if (mistake != "no line for pends") rover_link_pended();
}

static void make_it() {
  if (mistake == "interrupt off") nvic_registers = {};
  if (mistake == "DMA in normal mode") huart3.hdmarx->Init.Mode = DMA_NORMAL;
  if (mistake == "no receive DMA") huart3.hdmarx = nullptr;
  if (mistake == "no transmit DMA") huart3.hdmatx = nullptr;
  if (mistake == "wrong baud rate") huart3.Init.BaudRate = 57600;
  if (mistake == "tick below the UART") uwTickPrio = 15;
  if (mistake == "UART not initialised") huart3.gState = huart3.RxState = HAL_UART_STATE_RESET;
}
""",
    "stm32_ll": """\
static void make_it() {
  if (mistake == "interrupt off") nvic_registers = {};
  if (mistake == "DMA in normal mode") DMA1_Stream1->CR = DMA_SxCR_MINC;
  if (mistake == "no receive DMA") DMA1_Stream1->CR = 0;
  if (mistake == "no transmit DMA") DMA1_Stream3->CR = 0;
  if (mistake == "UART not initialised") USART3->CR1 = 0;
}
""",
}
MISTAKEN = """\
// A project with a mistake on simulated registers: both ends send for two seconds, then it prints what its link says.
#include <cstdio>
#include <string>

#include "board.hpp"
#include "diffdrive.hpp"
#include "wirebond/fake/line.hpp"
#include "wirebond/sim/uart.hpp"

extern "C" void rover_link_pended(void);
extern "C" void rover_link_poll(std::uint32_t now_us);
extern "C" const char* rover_link_why(void);

static std::string mistake;

MAKES_A_MISTAKE
int main(int, char** arguments) {
  mistake = arguments[1];
  wirebond::fake::Line in{diffdrive::baud, 10};
  wirebond::fake::Line out{diffdrive::baud, 10};
  wirebond::fake::Uart hardware{in, out};
  Board board{hardware};
  make_it();
  wirebond::sim::UartReceiver heard({diffdrive::baud}, {mistake == "wrong baud rate" ? 57'600 : diffdrive::baud});
  wirebond::fake::Time now = 0;
  for (int i = 0; i < 2000; ++i) {
    if (i % 10 == 0) {
      unsigned char frame[diffdrive::Velocity::Info::max_frame_bytes];
      std::size_t size = 0;
      if (diffdrive::encode(diffdrive::Velocity{}, frame, sizeof frame, size) != wirebond::Status::ok) return 1;
      const auto put = [&](std::uint8_t byte) { in.put(byte, now); };
      heard.take(frame, size, put);
      heard.rest(put);
    }
    board.run(now += 1'000'000);
    rover_link_poll(static_cast<std::uint32_t>(now / (mistake == "milliseconds" ? 1'000'000 : 1000)));
  }
  std::puts(rover_link_why());
}
"""


@pytest.mark.parametrize("port", MISTAKES)
@pytest.mark.parametrize("language", ["C++", "C"])
def test_each_mistake_in_a_project_is_said_by_its_link(language: str, port: str, project: Path) -> None:
    main = project / "Core/Src/mistaken.cpp"
    main.write_text(MISTAKEN.replace("MAKES_A_MISTAKE", MAKES_A_MISTAKE[port]), encoding="utf-8")
    source = project / "Core/Src/rover_link.cpp"
    made: list[Path] = []
    includes = on_board(project, port)
    if language == "C":
        write_c_project(project, port)
        made = [project / "generated" / f"diffdrive{kind}.cpp" for kind in ("", "_link")]
        source = compile_c(project, "-O0", includes, port=port)
    elif port == "stm32_ll":
        text = next(text for text in blocks("cpp") if "stm32_ll/uart.hpp" in text)
        why = 'extern "C" const char* rover_link_why(void) { return text_of(rover_link.why()); }\n'
        source.write_text(text + why, encoding="utf-8")
    quick = ["-O0", "-Wall", "-Wextra", "-Werror"]
    run("c++", "-std=c++17", *quick, *includes, main, source, *made, double(port), "-o", "mistaken", cwd=project)
    for mistake, words in MISTAKES[port].items():
        said = subprocess.run([project / "mistaken", mistake], capture_output=True, text=True, check=True).stdout
        assert said.startswith(words), f"{mistake}: {said}"


def on_board(project: Path, port: str) -> list[str]:
    """Return the folders of the project's files, and the board of the port's own tests."""
    ports = ROOT / "ports"
    own = [project / "generated", project / "Core/Inc"]
    others = [ports / port / "tests", ports / "fake/include", ROOT / "sim/include"]
    return [f"-I{folder}" for folder in own + others]


def double(port: str) -> Path:
    """Return the folder that replaces the vendor's code and registers."""
    return ROOT / "ports" / port / "tests" / ("board.cpp" if port == "stm32_ll" else "stm32f4xx_hal.cpp")


def compile_c(
    project: Path, level: str, includes: list[str], source: str = "rover_link.c", port: str = "stm32_hal"
) -> Path:
    """The C of a project in one object: the user's source and the port's."""
    strict = ["gcc", "-std=c99", level, *STRICT, *includes]
    run(*strict, "-c", project / "Core/Src" / source, "-o", "source.o", cwd=project)
    in_c = project / f"generated/wirebond_{port}.c"
    run(*strict, "-c", in_c, "-o", "port.o", cwd=project)
    if port == "stm32_ll":  # whose registers notice each access: the same file as C++
        run("c++", "-x", "c++", "-std=c++17", level, *STRICT, *includes, "-c", in_c, "-o", "port.o", cwd=project)
    run("ld", "-r", "source.o", "port.o", "-o", f"c{level}.o", cwd=project)
    return project / f"c{level}.o"


STARTED = """\
// What `--starter` wrote, on simulated registers: frames come and go, and its link has nothing to say.
#include <cstdio>

#include "board.hpp"
#include "diffdrive.hpp"
#include "wirebond/fake/line.hpp"

extern "C" void usart3_link_pended(void);
extern "C" void usart3_link_poll(std::uint32_t now_us);
extern "C" const char* usart3_link_why(void);

#ifdef HAL_UART_MODULE_ENABLED  // CubeMX's handler, with the line that the file asks for
extern "C" void USART3_IRQHandler(void) { usart3_link_pended(); }
#endif

int main() {
  wirebond::fake::Line in{diffdrive::baud, 10};
  wirebond::fake::Line out{diffdrive::baud, 10};
  wirebond::fake::Uart hardware{in, out};
  Board board{hardware};
  wirebond::fake::Time now = 0;
  for (int i = 0; i < 1500; ++i) {
    unsigned char frame[diffdrive::Velocity::Info::max_frame_bytes];
    std::size_t size = 0;
    if (diffdrive::encode(diffdrive::Velocity{}, frame, sizeof frame, size) != wirebond::Status::ok) return 1;
    if (i % 10 == 0) in.put(frame, size, now);
    board.run(now += 1'000'000);
    usart3_link_poll(static_cast<std::uint32_t>(now / 1000));
  }
  std::printf("%s; %d bytes left\\n", usart3_link_why(), static_cast<int>(out.put_count()));
}
"""


@pytest.mark.parametrize("port", ["stm32_hal", "stm32_ll"])
@pytest.mark.parametrize("language", ["cpp", "c"])
def test_the_file_that_starter_writes_works_as_it_is(language: str, port: str, project: Path) -> None:
    command = ["gen", str(PROTOCOLS / "diffdrive.yaml"), "--lang", language, "--out", str(project / "generated")]
    command += ["--port", port, "--uart", "USART3", "--starter"]
    assert wirebond(command) == 0
    source = project / "Core/Src" / f"usart3_link.{language}"
    text = source.read_text(encoding="utf-8")
    filled = text.replace("return false;", "return true;")  # so that something is sent
    assert filled != text
    source.write_text(filled, encoding="utf-8")
    assert wirebond(command) == 2  # it is the user's now
    assert source.read_text(encoding="utf-8") == filled
    includes = on_board(project, port)
    for level in ("-O0", "-Os") if port == "stm32_hal" else ("-Os",):
        compiler = ["arm-none-eabi-g++", "-std=c++17", "-fno-exceptions", "-fno-rtti"]
        if language == "c":
            compiler = ["arm-none-eabi-gcc", "-std=c99"]
        run(*compiler, level, *TARGET, *STRICT, *includes, "-c", source, "-o", "source.o", cwd=project)
    main = project / "Core/Src/started.cpp"
    main.write_text(STARTED, encoding="utf-8")
    others: list[Path] = [double(port)]
    if language == "c":
        others += [project / "generated" / f"diffdrive{kind}.cpp" for kind in ("", "_link")]
        others.append(compile_c(project, "-Os", includes, "usart3_link.c", port))
    else:
        others.append(source)
    run("c++", "-std=c++17", "-O0", *includes, main, *others, "-o", "started", cwd=project)
    said = subprocess.run([project / "started"], capture_output=True, text=True, check=True).stdout
    left = re.fullmatch(r"nothing is known to be wrong; ([0-9]+) bytes left\n", said)
    assert left is not None, said
    assert int(left[1]) == 30 * 11  # odometry, every 50 ms


def test_a_port_beside_one_amalgamated_header_needs_no_other(project: Path) -> None:
    for port in ("stm32_hal", "stm32_ll"):
        for language, compiler in (("cpp", ["g++", "-std=c++17"]), ("c", ["gcc", "-std=c99"])):
            out = project / f"{port}_{language}"
            gen = ["gen", str(PROTOCOLS / "diffdrive.yaml"), "--lang", language, "--port", port, "--amalgamate"]
            assert wirebond([*gen, "--out", str(out)]) == 0
            user = [text for text in blocks(language, {"cpp": "firmware", "c": "c"}[language]) if port in text.lower()]
            source = out / f"user.{language}"
            source.write_text(user[0].replace("diffdrive_link.hpp", "diffdrive.hpp"), encoding="utf-8")
            parts = [source, *out.glob("wirebond_*.c")]
            folders = [f"-I{folder}" for folder in (out, ROOT / "ports" / port / "tests", project / "Core/Inc")]
            run(*compiler, *STRICT, *folders, "-fsyntax-only", *parts, cwd=project)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--starter"], "--starter and --uart go together"),
        (["--uart", "USART3", "--starter"], "--starter is for one --port"),
        (["--port", "posix", "--uart", "USART3", "--starter"], "which is stm32_hal or stm32_ll"),
        (["--port", "stm32_hal", "--uart", "huart3", "--starter"], "expected a UART as the vendor's headers call it"),
        (["--port", "stm32_hal", "--uart", "USART3", "--starter", "--amalgamate"], "leave --amalgamate out"),
        (["--port", "stm32_hal", "--uart", "USART3", "--starter", "--check"], "which --check ignores"),
        (["--lang", "c", "--port", "posix"], "there is no --port posix in C"),
    ],
)
def test_a_failed_start_gets_a_sentence(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "generated"
    assert wirebond(["gen", str(PROTOCOLS / "diffdrive.yaml"), "--out", str(out), *options]) == 2
    assert words in capsys.readouterr().err
    assert not out.exists()
