// SPDX-License-Identifier: MIT
#include "pipedyn/util/threads.hpp"

#include <atomic>
#include <future>
#include <thread>
#include <vector>

#ifdef __linux__
#include <sched.h>
#endif

namespace pipedyn {

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

void run_on_threads(Index parts, const std::function<void(Index)>& part) {
  static std::atomic<Index> callers = 0;
  struct Caller {
    const bool alone = callers++ == 0;
    ~Caller() { --callers; }
  } const caller;
  std::vector<std::future<void>> others;
  if (caller.alone) {
    for (Index k = 1; k < parts; ++k) others.push_back(std::async(std::launch::async, part, k));
  }
  const Index own = parts - static_cast<Index>(others.size());
  for (Index k = 0; k < own; ++k) part(k);
  for (std::future<void>& other : others) other.get();
}

}  // namespace pipedyn
