// Waits without the interpreter's lock, even while the interpreter ends. No link, no port.
#pragma once

#include <nanobind/nanobind.h>

#include <atomic>
#include <thread>

#include "ended_threads.hpp"

namespace wirebond::engine {

/// The problem: a thread that waits in a link must not return to Python once the interpreter ends (ended_threads.hpp).
///
/// The answer: a thread that waits in a `WithoutGil` when the interpreter ends stays there: it sleeps until the process
/// is gone. `hold_waiting_threads` waits for those that are on their way back.
class WithoutGil {
 public:
  WithoutGil() {
    outside_.fetch_add(1);
    thread_ = PyEval_SaveThread();
  }
  ~WithoutGil() {
    if (ends_.load() && std::this_thread::get_id() != ending_thread_) {
      outside_.fetch_sub(1);
      EndedThreads::sleep();
    }
    PyEval_RestoreThread(thread_);
    outside_.fetch_sub(1);
  }
  WithoutGil(const WithoutGil&) = delete;
  WithoutGil& operator=(const WithoutGil&) = delete;

  /// Let no thread except the caller's return from its wait from now on. Wake the waiting threads, then call `settle`.
  /// With the GIL.
  static void hold_waiting_threads() {
    ending_thread_ = std::this_thread::get_id();
    ends_.store(true);
  }

  /// Wait until every thread has returned or sleeps. The waiting ones must have been woken. With the GIL.
  static void settle() {
    PyThreadState* const thread = PyEval_SaveThread();
    while (outside_.load() != 0) std::this_thread::yield();
    PyEval_RestoreThread(thread);
  }

  /// In a forked child only the forking thread continues.
  static void after_fork() { outside_.store(0); }

 private:
  inline static std::atomic<int> outside_{0};
  inline static std::atomic<bool> ends_{false};
  inline static std::thread::id ending_thread_;

  PyThreadState* thread_;
};

}  // namespace wirebond::engine
