// Checks whether a pty is still the one that was opened: its number is reused by the next program that requests a pty.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

namespace wirebond::engine {

/// Remembers where a path led. The number of a pty, as in /dev/pts/5, is reused once the pty has ended: the same path
/// may then be a stranger's terminal. It is ours if a new symbolic link was made since that points the path to it. A
/// pty is lost only when it ends, so the same number is never the same pty, even if both were made at the same time:
/// the clock of the file system has steps of milliseconds. One thread at a time.
class PtyNumber {
 public:
  /// Remember the path, which was opened.
  void remember(const std::string& path);

  /// Return true if the remembered path is a pty.
  bool is_known() const { return before_.is_pty; }

  /// Check whether the path, whose remembered pty has ended, is a pty although the path itself is unchanged. False for
  /// anything that is not a pty.
  bool is_a_strangers(const std::string& path) const;

 private:
  struct File {
    dev_t device = 0;
    ino_t node = 0;
    std::int64_t changed_ns = 0;  ///< on the file system's clock; for a pty, the time when it was made

    bool operator==(const File& other) const {
      return device == other.device && node == other.node && changed_ns == other.changed_ns;
    }
  };
  struct Seen {
    File name;  ///< the path itself: the pty, or a symbolic link to it
    File pty;
    bool is_pty = false;
  };

  static Seen look(const std::string& path);

  Seen before_;
};

}  // namespace wirebond::engine
