"""Source code out of a protocol."""

from wirebond.codegen.cpp import cpp_header, generate_cpp

__all__ = ["cpp_header", "generate_cpp"]
