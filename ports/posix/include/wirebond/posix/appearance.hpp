// When a device's file may have appeared: the folder above it changed.
#pragma once

#include <sys/inotify.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

/// Becomes readable when something appears, or gets other permissions, in the folder of a path; or, as long as that
/// folder is not there, in the nearest one above it. A system without inotify never tells: look from time to time, too.
class Appearance {
 public:
  explicit Appearance(std::string path) : path_(std::move(path)) {}

  /// Watch from now on. Look at the path behind this call: what was there before it is not told.
  void watch() {
    changes_ = Descriptor(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
    if (!changes_.is_open()) return;
    std::string folder = path_;
    do {
      const std::size_t slash = folder.rfind('/');
      folder = slash == std::string::npos ? "." : slash == 0 ? "/" : folder.substr(0, slash);
    } while (::inotify_add_watch(changes_.get(), folder.c_str(), IN_CREATE | IN_MOVED_TO | IN_ATTRIB | IN_ONLYDIR) <
                 0 &&
             folder != "/" && folder != ".");
  }
  void stop() { changes_.reset(); }

  /// To be waited for; -1: not watching.
  int get() const { return changes_.get(); }

  /// Has anything changed since the last call? Watches again, as a folder nearer to the path may be there now.
  bool changed() {
    if (!changes_.is_open()) return false;
    char events[4096];
    bool any = false;
    while (::read(changes_.get(), events, sizeof events) > 0) any = true;
    if (any) watch();
    return any;
  }

 private:
  std::string path_;
  Descriptor changes_;
};

}  // namespace wirebond::posix
