// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <functional>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// Amount of work from which starting a second thread, which takes some 30 us, pays. The unit is
/// one segment's share of a chain's right-hand side: some 5 ns in a batch, and 30 ns for one state.
constexpr Index worth_a_thread = 20000;

/// Number of threads that the process may use on this machine, at most OMP_NUM_THREADS where that
/// is set: by it batch systems and clusters share the processors among processes.
Index threads();

/// Calls part(k) for k = 0 .. parts - 1 in parallel, the first in the caller's thread, and returns
/// when all have returned. If another caller has the threads, the calls are made one after the
/// other. Exceptions are passed on.
void run_on_threads(Index parts, const std::function<void(Index)>& part);

/// Calls part(begin, end) for parts of 0 .. count, each large enough for a thread of its own. each:
/// amount of work for one index.
template <class Part>
void in_parts(Index count, Index each, const Part& part) {
  const Index worth = std::min(count, count * each / worth_a_thread);
  if (worth < 2) return part(Index{0}, count);
  const Index parts = std::min(worth, threads());
  run_on_threads(parts, [&](Index k) { part(k * count / parts, (k + 1) * count / parts); });
}

}  // namespace pipedyn
