#!/usr/bin/env bash
# Compiles the engine to WebAssembly, build/wasm/engine.wasm and a copy in the Python package, with the C++ compiler of the package `ziglang`.
set -euo pipefail
cd "$(dirname "$0")/.."
python=$1
out=build/wasm
mkdir -p "$out"

zig=("$python" -m ziglang)
lib=$("$python" -c 'import ziglang, pathlib; print(pathlib.Path(ziglang.__file__).parent / "lib")')
# Everything that browsers of 2022 have; the exceptions are those of the first proposal, which all of them have.
target=(-target wasm32-wasi -O2 -fwasm-exceptions -mcpu=generic+exception_handling+bulk_memory+nontrapping_fptoint+sign_ext)

# The compiler's own runtime has no exceptions for this target: these are its files for them.
abi=(-std=c++23 "-I$lib/libcxxabi/include" "-I$lib/libunwind/include" "-I$lib/libcxx/src" -D_LIBCXXABI_HAS_NO_THREADS
     -D_LIBCPP_BUILDING_LIBRARY -D_LIBCXXABI_BUILDING_LIBRARY)
for name in cxa_exception cxa_personality; do
  "${zig[@]}" c++ "${target[@]}" "${abi[@]}" -w -c "$lib/libcxxabi/src/$name.cpp" -o "$out/$name.o"
done
"${zig[@]}" cc "${target[@]}" "-I$lib/libunwind/include" -D_LIBUNWIND_HAS_NO_THREADS -D_LIBUNWIND_HIDE_SYMBOLS \
  -D_LIBUNWIND_DISABLE_VISIBILITY_ANNOTATIONS -w -c "$lib/libunwind/src/Unwind-wasm.c" -o "$out/unwind.o"
"${zig[@]}" cc "${target[@]}" -c engine/wasm/exceptions.S -o "$out/exceptions.o"

# Without the file that needs threads: a page decodes recordings piece by piece.
sources=()
for source in engine/src/*.cpp; do
  [ "$source" = engine/src/capture.cpp ] || sources+=("$source")
done
"${zig[@]}" c++ "${target[@]}" -std=c++17 -Wall -Wextra -Werror -Icore/include -Iengine/include -mexec-model=reactor -s \
  engine/wasm/{module,link}.cpp "${sources[@]}" "$out"/{cxa_exception,cxa_personality,unwind,exceptions}.o -o "$out/engine.wasm"
cp "$out/engine.wasm" python/src/wirebond/console/engine.wasm
