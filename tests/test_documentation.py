"""The pages are true: every example is run, every file loaded, every program compiled, every link kept.

How a block of a page is treated, by what stands behind its fence:

- ``yaml``: a whole protocol file loads; a piece of one loads together with the rest that it needs.
- ``yaml mapping``: a mapping file of ROS 2 loads, for the whole protocol file that stands before it on the page, or
  for diffdrive; ``yaml mapping wrong`` is refused with that output.
- ``yaml wrong``: as ``yaml``, but it is refused with the problems that the ``output`` block behind it shows.
- ``python``: the blocks of a page are run in order, as one program. It can import the module generated from diffdrive.
- ``console``: commands behind ``$`` that show their output are run, in order; others are advice.
- ``cpp``, ``c``: compiles by itself against the generated code of all protocols; a program with ``main`` is also run.
  (One for a tty is built and run by tests/end_to_end/test_cpp_host.py.)
- ``output``: what the block before it prints.

The port ``/dev/ttyUSB0`` stands for a virtual diffdrive MCU on a pty. In shown output ``...`` stands for any text. The
current folder has ``protocols/`` of the repository and each whole protocol file of the page, under its protocol's name.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import itertools
import os
import re
import shlex
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import typer

import wirebond
from tests.command import run as run_command
from tests.waiting import moments
from wirebond.cli.main import app
from wirebond.cli.web import with_web_address
from wirebond.generate.code import generate_c, generate_cpp, generate_python
from wirebond.protocol import ProtocolFileError, load, loads
from wirebond.ros2.mapping import read_mapping
from wirebond.ros2.types import MISSING as ROS2_MISSING
from wirebond.sim import pty_port
from wirebond.sim.virtual_mcu import VirtualMcu

ROOT = Path(__file__).resolve().parents[1]
ENGLISH = sorted(path for path in (ROOT / "docs").glob("*.md") if ".zh" not in path.name)  # tests/test_chinese_pages.py
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *ENGLISH]
LINKED = [
    *PAGES,
    *(ROOT / name for name in ("CHANGELOG.md", "SECURITY.md", "CODE_OF_CONDUCT.md", "firmware/README.md")),
]
PORT = "/dev/ttyUSB0"
DIFFDRIVE = load(ROOT / "protocols" / "diffdrive.yaml")
# `c client`: compiled and run by tests/server. `cpp sketch`: compiled by tests/test_arduino.py.
LANGUAGES = {
    "yaml",
    "yaml wrong",
    "yaml mapping",
    "yaml mapping wrong",
    "python",
    "console",
    "cpp",
    "c",
    "c client",
    "cpp sketch",
    "output",
    "cmake",
    "makefile",
    "json",
    "text",
}
RUN = ("wirebond ", "echo ")  # commands that a page may show with their output
COLUMNS = 200
QUICK = [
    "-O0",
    "-DWIREBOND_INLINE=inline",
    "-DWIREBOND_INLINE_LAMBDA=",
]  # to compile; users' flags are test_compile.py's
CXX = ["g++", *QUICK, "-std=c++17", "-Wall", "-Wextra", "-Werror", "-fno-exceptions", "-fno-rtti"]
CC = ["gcc", "-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic"]

REST_OF_FILE = {  # what a piece of a protocol file lacks
    "wirebond": "wirebond: 1\n",
    "protocol": "protocol: example\n",
    "frame": "frame: [magic: 0xAA, length: u8, id: u8, payload: by_length, check: crc-16/mcrf4xx]\n",
    "messages": "messages: {ping: {id: 0x01, sender: host, fields: {number: {type: u16}}}}\n",
}


@dataclass(frozen=True)
class Block:
    page: Path
    line: int  # of its first line of text
    language: str
    text: str
    output: str | None  # of the `output` block right behind it

    @property
    def place(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"


def blocks(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found = []
    fences = list(re.finditer(r"^```(.*)\n((?:(?!```).*\n)*?)```$", text, re.MULTILINE))
    for fence, following in itertools.zip_longest(fences, fences[1:]):
        output = None
        if following is not None and following[1] == "output" and not text[fence.end() : following.start()].strip():
            output = following[2]
        line = text.count("\n", 0, fence.start()) + 2
        found.append(Block(page, line, fence[1], fence[2], output))
    return found


def blocks_of(*languages: str) -> list[Block]:
    return [block for page in PAGES for block in blocks(page) if block.language in languages]


def pages_with(language: str) -> list[Path]:
    return [page for page in PAGES if any(block.language == language for block in blocks(page))]


def by_place(block: Block) -> str:
    return block.place


def by_name(page: Path) -> str:
    return page.name


def differs(wanted: str, got: str) -> str:
    """Return the difference, empty if there is none."""
    is_shown = doctest.OutputChecker().check_output(wanted, got, doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE)
    return "" if is_shown else f"the page shows\n{wanted}\nand the output is\n{got}"


def compare(place: str, wanted: str, got: str) -> None:
    assert not differs(wanted, got), f"{place}: {differs(wanted, got)}"


# ---- where examples run


def is_whole_file(block: Block) -> bool:
    return block.language == "yaml" and re.search(r"^wirebond:", block.text, re.MULTILINE) is not None


@pytest.fixture(scope="session")
def generated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the generated C and C++ of the repository's protocols and of those in the pages."""
    folder = tmp_path_factory.mktemp("generated")
    for path in sorted((ROOT / "protocols").glob("*.yaml")):
        generate_c(wirebond.load(path).model, folder)
        generate_cpp(wirebond.load(path).model, folder)  # has the link's header, too
    for block in blocks_of("yaml"):
        if is_whole_file(block):
            generate_c(loads(block.text), folder)
    return folder


@pytest.fixture
def workspace(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder of a page's examples."""
    (tmp_path / "protocols").symlink_to(ROOT / "protocols")
    for block in blocks(request.getfixturevalue("page")):
        if is_whole_file(block):
            (tmp_path / f"{loads(block.text).name}.yaml").write_text(block.text, encoding="utf-8")
    generate_python(wirebond.load(ROOT / "protocols" / "diffdrive.yaml").model, tmp_path / "modules")
    monkeypatch.syspath_prepend(tmp_path / "modules")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextlib.contextmanager
def virtual_mcu() -> Iterator[str]:
    """The tty of a virtual diffdrive MCU that is driving, so that its values change."""
    port = pty_port.PtyPort()
    codec = wirebond.load(ROOT / "protocols" / "diffdrive.yaml")
    mcu = VirtualMcu(codec, time.monotonic())
    drive = codec.encode("velocity", linear=0.5, angular=0)
    ended = threading.Event()

    def serve() -> None:
        while not ended.is_set():
            port.write(mcu.feed(drive, time.monotonic()))
            pty_port.run(mcu, port, time.monotonic() + 0.05, lambda _: None)

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        yield port.path
    finally:
        ended.set()
        thread.join()
        port.close()


# ---- the examples


def test_every_block_says_what_it_is() -> None:
    found = [block for page in PAGES for block in blocks(page)]
    assert len(found) > 20
    assert [f"{b.place}: `{b.language}`" for b in found if b.language not in LANGUAGES] == []
    assert all(page.read_text(encoding="utf-8").count("```") == 2 * len(blocks(page)) for page in PAGES)


def completed(block: Block) -> str:
    """A piece of a protocol file with the rest behind it, so that lines keep their numbers."""
    given = set(re.findall(r"^(\w+):", block.text, re.MULTILINE))
    return block.text + "".join(text for key, text in REST_OF_FILE.items() if key not in given)


@pytest.mark.parametrize("block", blocks_of("yaml"), ids=by_place)
def test_protocol_files_load(block: Block) -> None:
    loads(completed(block), block.place)


@pytest.mark.parametrize("block", blocks_of("yaml mapping"), ids=by_place)
def test_mapping_of_ros_loads(block: Block) -> None:
    before = [b for b in blocks(block.page) if b.line < block.line and b.language == "yaml" and is_whole_file(b)]
    read_mapping(block.text, loads(before[-1].text) if before else DIFFDRIVE)


@pytest.mark.parametrize("block", blocks_of("yaml mapping wrong"), ids=by_place)
def test_wrong_mapping_has_the_problems_that_the_page_shows(block: Block) -> None:
    with pytest.raises(ProtocolFileError) as raised:
        read_mapping(block.text, DIFFDRIVE)
    problems = [f"{p.line}:{p.column}: {p.sentence}" for p in raised.value.problems]
    assert block.output is not None, f"{block.place} has no output behind it"
    compare(block.place, block.output, "\n".join(problems) + "\n")


@pytest.mark.parametrize("block", blocks_of("yaml wrong"), ids=by_place)
def test_wrong_protocol_files_are_refused_in_the_words_shown(block: Block) -> None:
    with pytest.raises(ProtocolFileError) as refused:
        loads(completed(block), "robot.yaml")
    assert str(refused.value).split("\n") == (block.output or "").splitlines()


@pytest.mark.live
@pytest.mark.parametrize("page", pages_with("python"), ids=by_name)
@pytest.mark.usefixtures("workspace")
def test_python_runs(page: Path) -> None:
    program: dict[str, object] = {"__name__": "__main__"}
    for block in blocks(page):
        if block.language == "console":
            for command, _ in commands(block):
                if command.startswith("wirebond new "):  # it makes a file that the program reads
                    run_command(*shlex.split(command)[1:])
        if block.language != "python":
            continue
        printed = io.StringIO()
        with contextlib.ExitStack() as running:
            text = block.text
            if PORT in text:
                text = text.replace(PORT, running.enter_context(virtual_mcu()))
            running.enter_context(contextlib.redirect_stdout(printed))
            # Line numbers of the page, for whoever reads the traceback.
            exec(compile("\n" * (block.line - 1) + text, str(page), "exec"), program)
        compare(block.place, block.output or "", printed.getvalue())


def commands(block: Block) -> Iterator[tuple[str, str]]:
    """Each command that shows its output, and that output."""
    for entry in re.split(r"^\$ ", block.text, flags=re.MULTILINE)[1:]:
        command, _, output = entry.partition("\n")
        if output:
            yield command, output


@pytest.mark.live
@pytest.mark.parametrize("page", pages_with("console"), ids=by_name)
def test_commands_print_what_is_shown(page: Path, workspace: Path) -> None:
    """A command that talks to a robot for a moment is run until it shows this: either may be held up meanwhile."""
    scripts = Path(sys.executable).parent
    environment = {**os.environ, "PATH": f"{scripts}:{os.environ['PATH']}", "COLUMNS": f"{COLUMNS}", "NO_COLOR": "1"}
    status = 0

    def shows(command: str, wanted: str) -> None:
        nonlocal status
        got = ""
        with virtual_mcu() if PORT in command else contextlib.nullcontext(PORT) as port:
            for _ in moments(lambda: got):  # noqa: B023 - the newest
                line = command.replace(PORT, port)
                if line.startswith("wirebond ") and not re.search(r"[|<>&;$`*?]", line):
                    result = run_command(*shlex.split(line)[1:], cwd=workspace, columns=COLUMNS, merged=True)
                else:
                    result = subprocess.run(
                        ["bash", "-c", f"(exit {status}); {line}"],
                        cwd=workspace, env=environment, timeout=600, check=False, text=True,
                        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                    )  # fmt: skip
                status = result.returncode
                got = differs(wanted, result.stdout.replace(port, PORT))
                if not got or PORT not in command:
                    break
        assert not got, got
        assert not (wanted.strip() == "..." and status), f"it fails\n{result.stdout}"

    for block in blocks(page):
        for command, wanted in commands(block) if block.language == "console" else ():
            print(f"{block.place}, {command}")
            assert command.startswith(RUN), "it shows an output that cannot be checked"
            shows(command, wanted)


def shown_commands() -> list[tuple[str, str]]:
    """Every whole ``wirebond`` command of the pages, also those that are not run, and where it stands. A command with
    placeholders or choices is not one."""
    found = []
    for page in PAGES:
        for number, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1):
            shown = re.match(r"^(?:    |\$ |    \$ )(?:\S*/bin/)?wirebond (.*)$", line)
            if shown and not re.search(r"[|\[\]…]|\.\.\.|\\$|\b[A-Z_]{2,}\b(?!=)", shown[1]):
                found.append((f"{page.relative_to(ROOT)}:{number}", shown[1]))
    return found


@pytest.mark.parametrize(("place", "command"), shown_commands(), ids=str)
def test_commands_that_are_shown_have_these_arguments_and_options(place: str, command: str) -> None:
    words = shlex.split(re.split(r" (?:[&>#]|2>)", command.removesuffix("&"))[0], comments=True)
    words = with_web_address(words)
    whole = typer.main.get_command(app)
    context = whole.make_context("wirebond", words)
    while isinstance(getattr(whole, "commands", None), dict):
        name, whole, words = whole.resolve_command(context, context._protected_args + context.args)
        context = whole.make_context(name, list(words), parent=context)


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, check=False, capture_output=True, text=True, timeout=600)


@pytest.mark.live
@pytest.mark.parametrize("block", blocks_of("cpp"), ids=by_place)
def test_cpp_compiles(block: Block, generated: Path, tmp_path: Path) -> None:
    source = tmp_path / "example.cpp"
    source.write_text(block.text, encoding="utf-8")
    if (
        "wirebond/posix/" in block.text and block.page.name == "cpp-host.md"
    ):  # tests/end_to_end/test_cpp_host.py builds it as its page says, and runs it
        return
    compile_and_run(block, [*CXX, f"-I{generated}", *port_folders(block, tmp_path), str(source)], tmp_path)


def port_folders(block: Block, folder: Path) -> list[str]:
    """Return the folders of the ports that the block includes, and of the doubles of their vendors' headers."""
    ports = sorted(set(re.findall(r"wirebond/(\w+)/", block.text)))
    ports += re.findall(r'"wirebond_(\w+)\.h"', block.text)  # in C
    ports += ["freertos"] if '"FreeRTOS.h"' in block.text else []
    (folder / "usart.h").write_text(
        '#include "stm32f4xx_hal.h"\nextern UART_HandleTypeDef huart2, huart3;\n', encoding="utf-8"
    )
    parts = [ROOT / "ports" / port / part for port in ports for part in ("include", "tests", "c")]
    return [f"-I{part}" for part in (folder, *parts, ROOT / "ports" / "stm32" / "include")]


@pytest.mark.live
@pytest.mark.parametrize("block", blocks_of("c"), ids=by_place)
def test_c_compiles_and_needs_no_cpp_library(block: Block, generated: Path, tmp_path: Path) -> None:
    source = tmp_path / "example.c"
    source.write_text(block.text, encoding="utf-8")
    objects: list[str] = []
    included = re.findall(r'^#include "(\w+)\.h"', block.text, re.MULTILINE)
    for name in included if "int main(" in block.text else ():
        objects.append(str(tmp_path / f"{name}.o"))
        made = run(*CXX, f"-I{generated}", "-c", str(generated / f"{name}.cpp"), "-o", objects[-1])
        assert made.returncode == 0, made.stderr
    compile_and_run(block, [*CC, f"-I{generated}", *port_folders(block, tmp_path), str(source), *objects], tmp_path)


def compile_and_run(block: Block, compiler: list[str], folder: Path) -> None:
    """A block with ``main`` must print its output; another must compile."""
    if "int main(" not in block.text:
        result = run(*compiler, "-c", "-o", str(folder / "example.o"))
        assert result.returncode == 0, f"{block.place}:\n{result.stderr}"
        assert block.output is None, f"{block.place} shows an output and has no main"
        return
    program = folder / "example"
    result = run(*compiler, "-o", str(program))
    assert result.returncode == 0, f"{block.place}:\n{result.stderr}"
    result = run(str(program))
    assert result.returncode == 0, f"{block.place}:\n{result.stdout}{result.stderr}"
    compare(block.place, block.output or "", result.stdout)


# ---- what pages refer to


def without_blocks(page: Path) -> str:
    return re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)


def anchors(page: Path) -> set[str]:
    """Return the anchors of the page's headings, as the web pages of source hosts make them."""
    headings = re.findall(r"^#+ (.*)$", without_blocks(page), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("page", LINKED, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    lost = []
    for target in re.findall(r"\]\(([^)\s]+)\)", without_blocks(page)):
        if target.startswith(("https://", "http://")):
            continue
        name, _, wanted = target.partition("#")
        file = (page.parent / name).resolve() if name else page
        if not file.exists() or (wanted and wanted not in anchors(file)):
            lost.append(target)
    assert lost == []


@pytest.mark.parametrize("page", PAGES, ids=by_name)
def test_files_that_are_named_exist(page: Path) -> None:
    folders = "cmake|core|ports|python|protocols|firmware|tests|bench|docs|setup"
    named = re.findall(rf"`((?:{folders})/[\w./-]*)`", without_blocks(page))
    assert [name for name in named if not (ROOT / name).exists() and name != "bench/latest.json"] == []


@pytest.mark.live
def test_no_text_installs_the_package_by_its_name() -> None:
    """It is not published: the name could be anybody's."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    endings = (".md", ".py", ".cmake", ".ts", ".svelte", ".txt", ".xml", ".hpp", ".h", ".j2", ".toml", ".yaml")
    by_name = re.compile(r"\b(?:pip|pipx|uv|uvx)\b[^\n]*\binstall\b[^\n]*?[ '\"`]wirebond\b(?![/\w.-]|_ros)")
    found = [
        f"{name}: {text}"
        for name in listed
        if name.endswith(endings) and (ROOT / name).is_file() and name != "tests/test_documentation.py"
        for text in by_name.findall((ROOT / name).read_text(encoding="utf-8", errors="replace"))
    ]
    assert found == []


def test_packages_of_an_extra_are_named_as_pyproject_has_them() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    assert all(package in ROS2_MISSING for package in extras["ros2"])
    (parquet,) = extras["parquet"]
    assert f"pip install '{parquet}'" in (ROOT / "python" / "src" / "wirebond" / "recording" / "export.py").read_text()


def tour_paths(text: str) -> set[str]:
    """Files, and folders of two names and more, that stand in backticks. `<name>` stands for any name."""
    ending = r"\.(?:hpp|cpp|h|py|ts|svelte|j2|yaml|json|md|txt)"
    whole = re.findall(rf"`([\w<>./-]+{ending}|[\w<>.-]+/[\w<>./-]*)`", text)
    return {name.replace("<name>", "*") for name in whole if "<protocol>" not in name}


def test_the_tour_names_files_where_they_are() -> None:
    text = without_blocks(ROOT / "docs" / "TOUR.md")
    roots = ("", "core/include/wirebond", "engine/include/wirebond", "python", "python/src/wirebond")
    stated = re.search(r"Paths begin at the root of the repository, or in (.*?)\.", text, re.DOTALL)
    assert stated is not None and tuple(re.findall(r"`([\w/]+?)/`", stated[1])) == roots[1:]
    named = tour_paths(text)
    assert len(named) > 80
    assert [name for name in sorted(named) if not any(list((ROOT / root).glob(name)) for root in roots)] == []


def tracked_sources() -> list[str]:
    """Return the texts of the repository's own source files, except this one, which names dead identifiers."""
    endings = (".py", ".pyi", ".hpp", ".h", ".cpp", ".c", ".j2", ".ts", ".svelte", ".txt", ".cmake")
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    chosen = [name for name in listed if name.endswith(endings) and name != "tests/test_documentation.py"]
    return [(ROOT / name).read_text(encoding="utf-8") for name in chosen if (ROOT / name).is_file()]


def missing_identifiers(text: str, sources: list[str]) -> list[str]:
    """Return the identifiers in backticks that no source has. All names of `Link::run` must be in one file."""
    found = []
    for name in sorted(set(re.findall(r"`([A-Za-z_]\w*(?:(?:::|\.)\w+)*)(?:\(\))?`", text)) - tour_paths(text)):
        words = [re.compile(rf"\b{word}\b") for word in re.split(r"::|\.", name)]
        if not any(all(word.search(source) for word in words) for source in sources):
            found.append(name)
    return found


@pytest.mark.live
def test_the_tour_names_identifiers_that_exist() -> None:
    text, sources = without_blocks(ROOT / "docs" / "TOUR.md"), tracked_sources()
    assert missing_identifiers(text, sources) == []
    assert missing_identifiers("`WIRE_TYPES`, `Link::walk_away`, `FieldKind`", sources) == [
        "Link::walk_away",
        "WIRE_TYPES",
    ]


def test_make_targets_that_are_named_exist() -> None:
    targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
    named = {name for page in PAGES for name in re.findall(r"`make ([a-z-]+)", page.read_text(encoding="utf-8"))}
    assert "demo" in named
    assert named - targets == set()


def test_figures_name_a_benchmark_that_exists_and_the_readme_repeats_them() -> None:
    row = re.compile(r"^\| `(\w+)` .*\| `make bench ONLY=(\w+)` \|$", re.MULTILINE)
    figures = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8")
    of_readme = [m.group() for m in row.finditer((ROOT / "README.md").read_text(encoding="utf-8"))]
    assert len(of_readme) == 5
    assert [line for line in of_readme if line not in figures] == []
    rows = row.findall(figures)
    sources = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "bench").glob("*.py")))
    assert len(rows) >= 8
    for figure, benchmark in rows:
        assert f'"{benchmark}": (' in sources, f"no benchmark {benchmark}"
        assert f'"{figure}"' in sources or figure.startswith("collateral_"), f"no figure {figure}"


def test_the_comparison_repeats_measured_figures() -> None:
    measured = [ROOT / "docs" / "figures.md", *sorted((ROOT / "docs" / "peers").glob("*.md"))]
    number = re.compile(r"\d(?:[\d .]*\d)?")
    known = set(number.findall("\n".join(path.read_text(encoding="utf-8") for path in measured)))
    section = (ROOT / "docs" / "comparison.md").read_text(encoding="utf-8").partition("## Figures")[2]
    rows = [line.split("|")[2:4] for line in section.splitlines() if re.search(r"\d", line) and line.startswith("| ")]
    found = [value for cells in rows for cell in cells for value in number.findall(cell.replace("MAVLink 2", ""))]
    assert len(found) >= 10
    assert [value for value in found if value not in known] == []


def test_every_recipe_has_an_example_that_runs() -> None:
    page = ROOT / "docs" / "recipes.md"
    starts = [n for n, line in enumerate(page.read_text(encoding="utf-8").splitlines(), 1) if line.startswith("### ")]
    assert len(starts) >= 25
    run = [block.line for block in blocks(page) if block.language in ("python", "console", "yaml")]
    ends = [*starts[1:], sys.maxsize]
    assert [begin for begin, end in zip(starts, ends, strict=True) if not any(begin < n < end for n in run)] == []
