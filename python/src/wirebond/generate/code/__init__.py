"""Source code out of a protocol."""

from wirebond.generate.code.c import c_files, c_texts, generate_c
from wirebond.generate.code.cpp import cpp_files, cpp_header, generate_cpp
from wirebond.generate.code.current import Stale, stale_files
from wirebond.generate.code.folder import PORTS, PORTS_IN_C, port_files_in_c, port_headers, write_files
from wirebond.generate.code.python import generate_python, python_files, python_module
from wirebond.generate.code.ros2 import generate_ros2, ros2_files
from wirebond.generate.code.starter import STARTER_PORTS, starter_path, starter_text

__all__ = [
    "PORTS", "PORTS_IN_C", "STARTER_PORTS", "Stale", "c_files", "c_texts", "cpp_files", "cpp_header", "generate_c",
    "generate_cpp", "generate_python", "generate_ros2", "port_files_in_c", "port_headers", "python_files",
    "python_module", "ros2_files", "stale_files", "starter_path", "starter_text", "write_files",
]  # fmt: skip
