"""Source code out of a protocol."""

from wirebond.gen.c import c_files, c_texts, generate_c
from wirebond.gen.cpp import cpp_files, cpp_header, generate_cpp
from wirebond.gen.current import Stale, stale_files
from wirebond.gen.folder import PORTS, PORTS_IN_C, port_files_in_c, port_headers, write_files
from wirebond.gen.python import generate_python, python_files, python_module
from wirebond.gen.ros2 import generate_ros2, ros2_files
from wirebond.gen.starter import STARTER_PORTS, starter_path, starter_text

__all__ = [
    "PORTS", "PORTS_IN_C", "STARTER_PORTS", "Stale", "c_files", "c_texts", "cpp_files", "cpp_header", "generate_c",
    "generate_cpp", "generate_python", "generate_ros2", "port_files_in_c", "port_headers", "python_files",
    "python_module", "ros2_files", "stale_files", "starter_path", "starter_text", "write_files",
]  # fmt: skip
