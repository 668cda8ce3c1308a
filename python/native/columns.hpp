// Captures and streams as numpy columns, without a Python object per message.
#pragma once

#include <nanobind/nanobind.h>

namespace wirebond::engine {

namespace nb = nanobind;

/// Register `decode_columns`, `decode_timed_columns` and `Follower` with Python.
void bind_columns(nb::module_& m);

}  // namespace wirebond::engine
