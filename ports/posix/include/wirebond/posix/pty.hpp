// A pseudo-terminal pair: a simulated MCU on one side, a tty that programs can open on the other.
#pragma once

#include <fcntl.h>
#include <stdlib.h>

#include <string>

#include "wirebond/posix/descriptor.hpp"
#include "wirebond/posix/serial.hpp"

namespace wirebond::posix {

/// `controller` is ours. `path` is for others to open; holding `keeper` open keeps the line alive between two openers,
/// as a real UART is alive when no program reads.
struct Pty {
  Descriptor controller;
  Descriptor keeper;
  std::string path;
};

/// Open a pty: the line raw, the controller non-blocking. Returns false (errno set) if the system has no pty left.
inline bool open_pty(Pty& pty) {
  Descriptor controller(::posix_openpt(O_RDWR | O_NOCTTY | O_CLOEXEC | O_NONBLOCK));
  if (!controller.is_open() || ::grantpt(controller.get()) != 0 || ::unlockpt(controller.get()) != 0) return false;
  char name[128];
  if (::ptsname_r(controller.get(), name, sizeof name) != 0) return false;
  Descriptor keeper(::open(name, O_RDWR | O_NOCTTY | O_CLOEXEC));
  SerialError error;
  if (!keeper.is_open() || !configure_serial(keeper.get(), {}, error)) return false;
  pty.controller = std::move(controller);
  pty.keeper = std::move(keeper);
  pty.path = name;
  return true;
}

}  // namespace wirebond::posix
