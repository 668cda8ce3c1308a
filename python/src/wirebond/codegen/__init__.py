"""Source code out of a protocol."""

from wirebond.codegen.c import c_texts, generate_c
from wirebond.codegen.cpp import cpp_header, generate_cpp
from wirebond.codegen.python import generate_python, python_module

__all__ = ["c_texts", "cpp_header", "generate_c", "generate_cpp", "generate_python", "python_module"]
