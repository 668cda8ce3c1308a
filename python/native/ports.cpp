// The engine opens ttys and TCP connections itself, as on Linux.
#include "ports.hpp"

#include <nanobind/stl/string.h>

#include <string>

#include "link.hpp"
#include "wirebond/posix/latency.hpp"

namespace wirebond::engine {

void bind_ports(nb::module_& m) {
  bind_link(m);
  m.def(
      "port_latency_us",
      [](const std::string& path, double bytes_per_second, const std::string& ttys) {
        return posix::port_latency_us(path, bytes_per_second, ttys);
      },
      nb::arg("path"), nb::arg("bytes_per_second"), nb::arg("ttys") = "/sys/class/tty",
      "How long the port may hold bytes back, by what the system says of its device.");
}

}  // namespace wirebond::engine
