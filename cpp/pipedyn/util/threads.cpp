// SPDX-License-Identifier: MIT
#include "pipedyn/util/threads.hpp"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <future>
#include <thread>
#include <vector>

#ifdef __linux__
#include <sched.h>
#endif

namespace pipedyn {

Index threads() {
  static const Index found = [] {
    Index processors = std::max<Index>(std::thread::hardware_concurrency(), 1);
#ifdef __linux__
    cpu_set_t allowed;  // the call fails on machines with more processors than it holds
    if (sched_getaffinity(0, sizeof allowed, &allowed) == 0) processors = CPU_COUNT(&allowed);
#endif
    const char* const wanted = std::getenv("OMP_NUM_THREADS");
    const Index most = wanted == nullptr ? 0 : std::atoi(wanted);
    return most > 0 ? std::min(most, processors) : processors;
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
