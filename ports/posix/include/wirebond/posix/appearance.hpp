// Detects that a device's file may have appeared: the folder above it changed.
#pragma once

#include <sys/inotify.h>
#include <unistd.h>

#include <cerrno>
#include <string>

#include "wirebond/posix/descriptor.hpp"

namespace wirebond::posix {

/// Becomes readable when a file appears, or its permissions change, in the folder of a path; or, while that folder does
/// not exist, in the nearest one above it. A system without inotify never reports: check from time to time, too.
class Appearance {
 public:
  /// `path` may be empty: then nothing is watched.
  explicit Appearance(std::string path) : path_(std::move(path)) {}

  /// Try to open the device: return what `attempt()` returns. The folder is watched before that, and earlier changes
  /// are forgotten. So a device that appears during the attempt, or after it, is reported by `changed`, and none is
  /// missed.
  template <class Attempt>
  auto watching(Attempt&& attempt) {
    watch();
    return attempt();
  }
  void stop() { changes_.reset(); }

  /// Return the descriptor to wait for; -1: not watching.
  int get() const { return changes_.get(); }

  /// Check whether anything changed since the last attempt or call. Watches a folder nearer to the path if it exists
  /// now.
  bool changed() {
    if (!changes_.is_open() || !drained()) return false;
    watch_nearest();
    return true;
  }

 private:
  void watch() {
    if (path_.empty()) return;
    if (!changes_.is_open()) changes_ = Descriptor(::inotify_init1(IN_NONBLOCK | IN_CLOEXEC));
    if (!changes_.is_open()) return;
    static_cast<void>(drained());
    watch_nearest();
  }

  bool drained() {
    char events[4096];
    bool any = false;
    while (::read(changes_.get(), events, sizeof events) > 0) any = true;
    return any;
  }

  /// On the same descriptor: an existing watch stays, with its reports.
  void watch_nearest() {
    std::string folder = path_;
    do {
      const std::size_t slash = folder.rfind('/');
      folder = slash == std::string::npos ? "." : slash == 0 ? "/" : folder.substr(0, slash);
    } while (::inotify_add_watch(changes_.get(), folder.c_str(), IN_CREATE | IN_MOVED_TO | IN_ATTRIB | IN_ONLYDIR) <
                 0 &&
             folder != "/" && folder != ".");
  }

  std::string path_;
  Descriptor changes_;
};

}  // namespace wirebond::posix
