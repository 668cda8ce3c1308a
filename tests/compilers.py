"""The compiler with which tests build what they run: Clang needs half of GCC's time.

That GCC compiles every generated header without a warning is shown in generate/code/test_compile.py; it also builds the
engine, and in the long proofs the unit tests in C++.
"""

from __future__ import annotations

CXX = "clang++-14"
CC = "clang-14"
CMAKE = [f"-DCMAKE_CXX_COMPILER={CXX}", f"-DCMAKE_C_COMPILER={CC}"]
# Without debug information, which costs a quarter of the time: stacks name functions, and UBSan the line.
SANITIZE = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
SANITIZE_FOR_C = [*SANITIZE, "-fno-sanitize=function"]  # of C++ for a program in C: `function` needs a C++ library
