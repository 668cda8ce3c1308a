"""The ``wirebond`` command as a whole: its groups of commands, its exit codes, and turning errors into sentences.

Exit codes: 0 done; 1 the input is wrong (protocol file, value, bytes without a frame); 2 wrong usage; 3 the port cannot
be opened or was lost; 130 ended by Ctrl-C where that is not a normal end.
"""

from __future__ import annotations

import errno
import logging
import os
import sys
from io import TextIOWrapper
from typing import Annotated, cast

import typer

from wirebond.cli.interrupts import EXIT_INTERRUPTED
from wirebond.cli.options import files, lines, parameters, recordings, simulation
from wirebond.cli.output import ReaderGone, console, drop, errors, fail, plain
from wirebond.cli.shown_logs import show_port_log
from wirebond.errors import (
    HeaderFileError,
    LinkDownError,
    PortError,
    ProtocolFileError,
    UsageError,
    WirebondError,
)
from wirebond.visible import visible

EXIT_INPUT, EXIT_USAGE, EXIT_PORT = 1, 2, 3

app = typer.Typer(
    help="The serial link between a robot's computer and its microcontroller, from one protocol file.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="`wirebond help COMMAND` explains a command. Exit codes: 0 done, 1 wrong input, 2 wrong usage, 3 port "
    "trouble, 130 interrupted.",
)
_GROUPS = {"Files and bytes": files, "Ports": lines, "Recordings": recordings, "Simulation": simulation}
for heading, group in _GROUPS.items():
    for command in group.commands.registered_commands:
        command.rich_help_panel = heading
    app.add_typer(group.commands)
app.add_typer(parameters.commands, name="param", rich_help_panel="Ports")


def _version(wanted: bool) -> None:
    if wanted:
        from wirebond import __version__

        console.print(f"wirebond {__version__}")
        raise typer.Exit


def _cmakedir(wanted: bool) -> None:
    if wanted:
        from wirebond.paths import cmake

        sys.stdout.write(f"{cmake()}\n")
        raise typer.Exit


@app.callback()
def common(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")
    ] = False,
    cmakedir: Annotated[
        bool,
        typer.Option(
            "--cmakedir", callback=_cmakedir, is_eager=True, help="Print the folder for CMake's wirebond_DIR and exit."
        ),
    ] = False,
) -> None:
    """Link a robot's computer to its microcontroller over a serial port, from one protocol file."""


def main(arguments: list[str] | None = None) -> int:
    """Run the whole command, and return its exit code: every error that can be foreseen becomes a sentence."""
    logging.getLogger("wirebond").addHandler(logging.NullHandler())  # the commands report these events themselves
    show_port_log()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a terminal of another encoding shows those that it has
    code = _run(arguments)
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        drop(1)
    except OSError as error:
        drop(1)
        fail(_output_sentence(error))
        code = EXIT_INPUT
    return code


def _run(arguments: list[str] | None) -> int:
    try:
        given = sys.argv[1:] if arguments is None else arguments
        if given[:1] == ["help"]:
            given = [*given[1:], "--help"]
        if "--web" in given:
            from wirebond.cli.web import with_web_address

            given = with_web_address(given)
        return int(app(args=given, prog_name="wirebond", standalone_mode=False) or 0)
    except ReaderGone:
        return 0
    except SystemExit:  # of rich, whose reader has gone while it showed --help
        return 0
    except (KeyboardInterrupt, typer.Abort):
        return EXIT_INTERRUPTED
    except _USAGE_ERROR as error:
        return _wrong_usage(error)
    except (ProtocolFileError, HeaderFileError) as error:
        for problem in error.problems:
            errors.print(plain(str(problem)))
        return EXIT_INPUT
    except WirebondError as error:
        fail(str(error))
        port_trouble = isinstance(error, PortError | LinkDownError)
        return EXIT_PORT if port_trouble else EXIT_USAGE if isinstance(error, UsageError) else EXIT_INPUT
    except OSError as error:
        fail(_file_sentence(error))
        return EXIT_INPUT


# What typer raises for a wrong command line. It exports only this subclass, and which module has the base has changed.
_USAGE_ERROR = cast(type[Exception], typer.BadParameter.__bases__[0])


def _wrong_usage(error: BaseException) -> int:
    """Print Typer's sentence, with the command's usage. If no argument was given, help is shown instead."""
    context = getattr(error, "ctx", None)
    if type(error).__name__ == "NoArgsIsHelpError":
        return EXIT_USAGE  # it has printed the help
    if context is not None:
        errors.print(plain(context.get_usage().strip()))
    fail(str(getattr(error, "format_message", error.__str__)()))
    if context is not None:
        errors.print(plain(f"`{context.command_path} --help` explains its arguments"))
    return EXIT_USAGE


_FILE_ADVICE = {
    errno.ENOENT: "there is no such file or folder; check the path",
    errno.ENOTDIR: "a part of this path is a file, not a folder; check the path",
    errno.EISDIR: "this is a folder; name a file in it",
    errno.EACCES: "you may not read or write here; check the permissions of the file and of its folder",
    errno.EPERM: "the system does not allow this; check the permissions of the file and of its folder",
    errno.EROFS: "this file system can only be read; name a place on another one",
    errno.ENOSPC: "no space is left on the disk; nothing was changed. Make room, or name a place on another disk",
    errno.EDQUOT: "your share of the disk is used up; nothing was changed. Make room, or name a place on another disk",
    errno.EFBIG: "the file would be larger than is allowed here; nothing was changed",
    errno.ELOOP: "this symbolic link leads back to itself; check the path",
    errno.ENAMETOOLONG: "the name is too long for this file system; name a shorter one",
}


def _file_sentence(error: OSError) -> str:
    if error.filename is None:
        return _output_sentence(error)
    what = _FILE_ADVICE.get(error.errno or 0, f"{error.strerror or error}; check the path")
    return f"{visible(os.fsdecode(error.filename))}: {what}"


def _output_sentence(error: OSError) -> str:
    drop(1)  # otherwise the rest fails once more when Python ends
    return f"the output cannot be written: {error.strerror or error}"


if __name__ == "__main__":
    sys.exit(main())
