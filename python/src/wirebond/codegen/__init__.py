"""Source code out of a protocol."""

from wirebond.codegen.c import c_texts, generate_c
from wirebond.codegen.cpp import cpp_header, generate_cpp
from wirebond.codegen.folder import PORTS, port_headers, write_files
from wirebond.codegen.python import generate_python, python_module

__all__ = [
    "PORTS", "c_texts", "cpp_header", "generate_c", "generate_cpp", "generate_python", "port_headers", "python_module",
    "write_files",
]  # fmt: skip
