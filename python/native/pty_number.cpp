#include "pty_number.hpp"

#include <sys/stat.h>
#include <sys/sysmacros.h>

namespace wirebond::engine {

namespace {

// The major numbers of pty slaves: Linux, Documentation/admin-guide/devices.txt.
constexpr unsigned first_pty = 136;
constexpr unsigned last_pty = 143;

}  // namespace

PtyNumber::Seen PtyNumber::look(const std::string& path) {
  const auto file = [](const struct stat& found) {
    return File{found.st_dev, found.st_ino,
                static_cast<std::int64_t>(found.st_ctim.tv_sec) * 1'000'000'000 + found.st_ctim.tv_nsec};
  };
  struct stat name {};
  struct stat device {};
  if (::lstat(path.c_str(), &name) != 0 || ::stat(path.c_str(), &device) != 0) return {};
  const unsigned number = major(device.st_rdev);
  return {file(name), file(device), S_ISCHR(device.st_mode) && number >= first_pty && number <= last_pty};
}

void PtyNumber::remember(const std::string& path) { before_ = look(path); }

bool PtyNumber::is_a_strangers(const std::string& path) const {
  if (!before_.is_pty) return false;
  const Seen now = look(path);
  if (!now.is_pty) return false;
  // Without a symbolic link the name is the pty itself: it now belongs to another program.
  return now.name == before_.name || now.name == now.pty;
}

}  // namespace wirebond::engine
