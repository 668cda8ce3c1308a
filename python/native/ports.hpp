// The seam to the ports of the engine's own: one of ports.cpp and no_ports.cpp is linked (WIREBOND_ENGINE_PORTS).
#pragma once

#include <nanobind/nanobind.h>

namespace wirebond::engine {

namespace nb = nanobind;

/// Register with Python what the engine has for ports: `Link` and `port_latency_us`, or neither, and the functions for
/// the end of the interpreter and for forks, which always exist.
void bind_ports(nb::module_& m);

}  // namespace wirebond::engine
