// A function that can be left in its middle and entered again: for tests that suspend a sender at a chosen step.
#pragma once

#include <ucontext.h>

#include <cstddef>
#include <functional>
#include <utility>
#include <vector>

/// Runs `body` piece by piece: `resume` goes on until the body calls `pause`, or ends. One thread.
class Fiber {
 public:
  explicit Fiber(std::function<void()> body) : body_(std::move(body)), stack_(128 * 1024) {
    getcontext(&inside_);
    inside_.uc_stack.ss_sp = stack_.data();
    inside_.uc_stack.ss_size = stack_.size();
    inside_.uc_link = &outside_;
    makecontext(&inside_, &Fiber::enter, 0);
  }
  Fiber(const Fiber&) = delete;
  Fiber& operator=(const Fiber&) = delete;

  void resume() {
    if (ended_) return;
    Fiber* const before = current_;
    current_ = this;
    swapcontext(&outside_, &inside_);
    current_ = before;
  }
  bool ended() const { return ended_; }

  /// Leave the fiber that runs; nothing happens outside of one.
  static void pause() {
    if (current_ != nullptr) swapcontext(&current_->inside_, &current_->outside_);
  }
  static Fiber* current() { return current_; }

 private:
  static void enter() {
    Fiber* const self = current_;
    self->body_();
    self->ended_ = true;
  }

  static inline Fiber* current_ = nullptr;
  std::function<void()> body_;
  std::vector<char> stack_;
  ucontext_t inside_{};
  ucontext_t outside_{};
  bool ended_ = false;
};
