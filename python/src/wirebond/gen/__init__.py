"""Source code out of a protocol."""

from wirebond.gen.c import c_files, c_texts, generate_c
from wirebond.gen.cpp import cpp_files, cpp_header, generate_cpp
from wirebond.gen.current import Stale, stale_files
from wirebond.gen.folder import PORTS, port_headers, write_files
from wirebond.gen.python import generate_python, python_files, python_module

__all__ = [
    "PORTS", "Stale", "c_files", "c_texts", "cpp_files", "cpp_header", "generate_c", "generate_cpp", "generate_python",
    "port_headers", "python_files", "python_module", "stale_files", "write_files",
]  # fmt: skip
