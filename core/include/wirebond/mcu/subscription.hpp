// Functions that receive every message of a kind, from any source file; several for one message. No link, no queue.
#pragma once

#include "wirebond/header.hpp"

namespace wirebond {

/// Base class of a handler whose link's messages subscriptions receive, after its own `on`.
struct Subscribed {};

/// A variable of this type subscribes a function for as long as it lives:
///
///     static wirebond::Subscription<diffdrive::Velocity> log_velocity([](const diffdrive::Velocity& v) { ... });
///
/// If frames have header fields, the function may take the message's `Header` as its second parameter. At namespace
/// scope of any source file the subscription exists before `main`. The function runs inside `poll`, for the messages of
/// every link whose handler is `Subscribed`; several run in unspecified order. It takes two words, three if frames have
/// header fields, and no heap. Make and destroy subscriptions while no link is polled, or in the context that polls.
template <class Message, class Header = HeaderOf<typename Message::Info>>
class Subscription {
 public:
  using Function = void (*)(const Message&);
  using FunctionWithHeader = void (*)(const Message&, const Header&);

  explicit Subscription(Function function) : function_(function), next_(first_) { first_ = this; }
  explicit Subscription(FunctionWithHeader function) : with_header_(function), next_(first_) { first_ = this; }
  ~Subscription() {
    Subscription** place = &first_;
    while (*place != this) place = &(*place)->next_;
    *place = next_;
  }
  Subscription(const Subscription&) = delete;
  Subscription& operator=(const Subscription&) = delete;

  /// Call each function. A function may end its own subscription.
  static void publish(const Message& message, const Header& header) {
    for (Subscription* subscription = first_; subscription != nullptr;) {
      Subscription* const next = subscription->next_;
      if (subscription->function_ != nullptr) {
        subscription->function_(message);
      } else {
        subscription->with_header_(message, header);
      }
      subscription = next;
    }
  }

 private:
  static inline Subscription* first_ = nullptr;  // set before any constructor runs, in any order of source files

  Function function_ = nullptr;
  FunctionWithHeader with_header_ = nullptr;  // only one of the two is set
  Subscription* next_;
};

/// For frames without header fields.
template <class Message>
class Subscription<Message, NoHeader> {
 public:
  using Function = void (*)(const Message&);

  explicit Subscription(Function function) : function_(function), next_(first_) { first_ = this; }
  ~Subscription() {
    Subscription** place = &first_;
    while (*place != this) place = &(*place)->next_;
    *place = next_;
  }
  Subscription(const Subscription&) = delete;
  Subscription& operator=(const Subscription&) = delete;

  /// Call each function. A function may end its own subscription.
  static void publish(const Message& message) {
    for (Subscription* subscription = first_; subscription != nullptr;) {
      Subscription* const next = subscription->next_;
      subscription->function_(message);
      subscription = next;
    }
  }

 private:
  static inline Subscription* first_ = nullptr;  // set before any constructor runs, in any order of source files

  Function function_;
  Subscription* next_;
};

}  // namespace wirebond
