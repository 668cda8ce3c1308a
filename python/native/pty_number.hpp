// Is a pty still the one that was opened? Its number goes to the next program that asks for a pty.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

namespace wirebond::engine {

/// Remembers where a path led. A pty's number, as in /dev/pts/5, is given away again once the pty has ended: the same
/// path may then be the terminal of a stranger. It is the same pty, or it is one that somebody made the path point to
/// since, with a new symbolic link. One thread at a time.
class PtyNumber {
 public:
  /// The path was opened.
  void remember(const std::string& path);

  /// The path is a pty that is not the remembered one, and the path itself is as it was. False for all that is no pty.
  bool is_a_strangers(const std::string& path) const;

 private:
  struct File {
    dev_t device = 0;
    ino_t node = 0;
    std::int64_t changed_ns = 0;  ///< on the file system's clock; a pty's is the time when it was made

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
