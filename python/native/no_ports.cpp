// The engine opens no port, as on Windows and macOS: Python opens it, and drives a LinkCore in threads of its own.
#include "ports.hpp"

namespace wirebond::engine {

/// No thread waits in the engine without the interpreter here, so its end and a fork need nothing.
void bind_ports(nb::module_& m) {
  m.def("hold_waiting_threads", [] {});
  m.def("settle_threads", [] {});
  m.def("after_fork", [] {});
}

}  // namespace wirebond::engine
