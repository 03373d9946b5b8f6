// SPDX-License-Identifier: MIT
#include "pipedyn/util/threads.hpp"

#include <atomic>
#include <chrono>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <thread>
#include <utility>

#ifndef _WIN32
#include <pthread.h>
#endif
#ifdef __linux__
#include <sched.h>
#endif

namespace pipedyn {

namespace {

/// Threads that wait for work, as many as were needed at any time. They keep their scratch memory.
class Helpers {
 public:
  /// Whether the caller has got the threads.
  bool taken() { return !busy_.exchange(true); }
  void give_back() { busy_ = false; }

  void run(Index parts, const std::function<void(Index)>& part) {
    {
      const std::lock_guard lock(mutex_);
      for (; count_ < parts - 1; ++count_) std::thread([this, k = count_] { serve(k); }).detach();
      part_ = &part;
      wanted_ = left_ = parts - 1;
      ++round_;
    }
    begun_.notify_all();
    attempt(0);
    soon([this] { return left_ == 0; });
    std::unique_lock lock(mutex_);
    done_.wait(lock, [this] { return left_ == 0; });
    if (error_ != nullptr) std::rethrow_exception(std::exchange(error_, nullptr));
  }

 private:
  /// Spins for a while before it sleeps, as work mostly comes soon. A thread that sleeps may be
  /// woken on the processor of another one, so that the two take turns.
  template <class Condition>
  static void soon(const Condition& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::microseconds(100);
    while (!condition() && std::chrono::steady_clock::now() < end) std::this_thread::yield();
  }

  void attempt(Index k) {
    try {
      (*part_)(k);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      error_ = std::current_exception();
    }
  }

  [[noreturn]] void serve(Index number) {
    for (Index seen = 0;;) {
      soon([&] { return round_ != seen; });
      {
        std::unique_lock lock(mutex_);
        begun_.wait(lock, [&] { return round_ != seen; });
        seen = round_;
        if (number >= wanted_) continue;
      }
      attempt(number + 1);
      const std::lock_guard lock(mutex_);
      if (--left_ == 0) done_.notify_one();
    }
  }

  std::atomic<bool> busy_ = false;
  std::mutex mutex_;
  std::condition_variable begun_, done_;
  const std::function<void(Index)>* part_ = nullptr;
  Index count_ = 0, wanted_ = 0;
  std::atomic<Index> left_ = 0, round_ = 0;
  std::exception_ptr error_;
};

/// The threads are never joined; they wait until the process ends.
std::atomic<Helpers*>& helpers() {
  static std::atomic<Helpers*> own = [] {
#ifndef _WIN32
    // A child process has none of these threads.
    pthread_atfork(nullptr, nullptr, [] { helpers() = new Helpers; });
#endif
    return new Helpers;
  }();
  return own;
}

}  // namespace

Index threads() {
  static const Index found = [] {
#ifdef __linux__
    cpu_set_t allowed;  // the call fails on machines with more processors than it holds
    if (sched_getaffinity(0, sizeof allowed, &allowed) == 0) return Index{CPU_COUNT(&allowed)};
#endif
    return std::max<Index>(std::thread::hardware_concurrency(), 1);
  }();
  return found;
}

void at_once(Index parts, const std::function<void(Index)>& part) {
  Helpers& own = *helpers();
  if (parts < 2 || !own.taken()) {
    for (Index k = 0; k < parts; ++k) part(k);
    return;
  }
  struct Taken {
    Helpers& of;
    ~Taken() { of.give_back(); }
  } const taken{own};
  own.run(parts, part);
}

}  // namespace pipedyn
