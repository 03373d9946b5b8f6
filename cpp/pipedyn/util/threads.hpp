// SPDX-License-Identifier: MIT
#pragma once

#include <algorithm>
#include <functional>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// Amount of work, in units of one segment's share of a chain's rhs, some 30 ns, from which a
/// second thread is worth waking: that takes some 20 us.
constexpr Index worth_a_thread = 3000;

/// Threads of this machine that a process may use.
Index threads();

/// Calls part(k) for k = 0 .. parts - 1 at once, the first in the caller's thread, and returns when
/// all have; one after the other where another caller has the threads. Exceptions are passed on.
void at_once(Index parts, const std::function<void(Index)>& part);

/// Calls part(begin, end) for parts of 0 .. count that are worth a thread each. each: amount of
/// work of one.
template <class Part>
void in_parts(Index count, Index each, const Part& part) {
  const Index worth = std::min(count, count * each / worth_a_thread);
  if (worth < 2) return part(Index{0}, count);
  const Index parts = std::min(worth, threads());
  at_once(parts, [&](Index k) { part(k * count / parts, (k + 1) * count / parts); });
}

}  // namespace pipedyn
