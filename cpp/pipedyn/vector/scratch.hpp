// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pipedyn {

/// At least count numbers, on a vector's boundary, kept by the thread until it ends. The next call
/// may overwrite or move them.
inline double* scratch(std::ptrdiff_t count) {
  constexpr std::size_t boundary = 64;
  thread_local std::vector<double> kept;
  const std::size_t needed = static_cast<std::size_t>(count) + boundary / sizeof(double);
  if (kept.size() < needed) kept = std::vector<double>(needed);
  const auto address = reinterpret_cast<std::uintptr_t>(kept.data());
  return kept.data() + (boundary - address % boundary) % boundary / sizeof(double);
}

}  // namespace pipedyn
