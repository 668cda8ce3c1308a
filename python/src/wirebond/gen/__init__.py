"""Source code out of a protocol."""

from wirebond.gen.c import c_texts, generate_c
from wirebond.gen.cpp import cpp_header, generate_cpp
from wirebond.gen.folder import PORTS, port_headers, write_files
from wirebond.gen.python import generate_python, python_module

__all__ = [
    "PORTS", "c_texts", "cpp_header", "generate_c", "generate_cpp", "generate_python", "port_headers", "python_module",
    "write_files",
]  # fmt: skip
