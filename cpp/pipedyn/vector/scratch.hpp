// SPDX-License-Identifier: MIT
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

namespace pipedyn {

/// Numbers on a vector's boundary.
class Scratch {
 public:
  /// At least count of them; the next call may overwrite or move them.
  double* operator()(std::ptrdiff_t count) {
    constexpr std::size_t boundary = 64;
    const std::size_t needed = static_cast<std::size_t>(count) + boundary / sizeof(double);
    if (kept_.size() < needed) kept_ = std::vector<double>(needed);
    const auto address = reinterpret_cast<std::uintptr_t>(kept_.data());
    return kept_.data() + (boundary - address % boundary) % boundary / sizeof(double);
  }

 private:
  std::vector<double> kept_;
};

/// The same of the thread, kept until it ends.
inline double* scratch(std::ptrdiff_t count) {
  thread_local Scratch kept;
  return kept(count);
}

}  // namespace pipedyn
