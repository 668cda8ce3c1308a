// Threads that are in the engine when the interpreter ends. No link, no port.
#pragma once

#include <chrono>
#include <exception>
#include <thread>

namespace wirebond::engine {

/// The problem: before Python 3.14, a daemon thread that asks for the GIL after the interpreter's end is ended by
/// `pthread_exit`. With glibc this unwinds its C++ frames like an exception without a type, which may not be swallowed:
/// a function that nanobind calls seems to have failed without a cause, and a destructor terminates the process.
///
/// The answer: such a thread sleeps until the process is gone, as CPython 3.14 does it.
class EndedThreads {
 public:
  [[noreturn]] static void sleep() {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }

  /// For an exception translator: sleep if there is no exception, because the thread is being ended.
  static void sleep_if_ended(const std::exception_ptr& error) {
    if (!error) sleep();
  }

  /// Let other threads sleep in `std::terminate` from now on, unless an exception is the reason. At exit.
  static void hold() {
    ending_thread_ = std::this_thread::get_id();
    before_ = std::set_terminate([] {
      if (std::this_thread::get_id() != ending_thread_ && !std::current_exception()) sleep();
      before_();
    });
  }

 private:
  inline static std::thread::id ending_thread_;
  inline static std::terminate_handler before_ = nullptr;
};

}  // namespace wirebond::engine
