// What the engine refuses.
#pragma once

#include <stdexcept>

namespace wirebond::engine {

/// A value that a message does not allow: a sentence that names the fact and the limit.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

}  // namespace wirebond::engine
