// SPDX-License-Identifier: MIT
//
// Arrays in the thread's scratch. Whoever needs some takes them all from a Layout in one function,
// which is called twice: first to count, then to place them. So what is allocated is what is taken,
// and what is taken follows from the same question as what is written: an array that is not needed
// has no place, and to write it ends the process at once. The address sanitizer sees what is read
// or written between two arrays.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/vector/pack.hpp"
#include "pipedyn/vector/scratch.hpp"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#endif

namespace {

/// Hands out the scratch of so many numbers; without any it only counts.
struct Layout {
  static constexpr Count line = 8;  // numbers, that arrays begin on the widest vector's boundary
#ifdef __SANITIZE_ADDRESS__
  static constexpr Count gap = line;
#else
  static constexpr Count gap = 0;
#endif
  double* scratch = nullptr;
  Count used = 0;

  Layout() = default;
  explicit Layout(Count numbers) : scratch(pipedyn::scratch(numbers)) {}

  double* take(Count numbers) {
    if (numbers == 0) return nullptr;
    double* const start = scratch == nullptr ? nullptr : scratch + used;
    const Count taken = (numbers + line - 1) / line * line + gap;
    used += taken;
#ifdef __SANITIZE_ADDRESS__
    if (start != nullptr) {
      __asan_poison_memory_region(start + numbers,
                                  static_cast<std::size_t>(taken - numbers) * sizeof(double));
    }
#endif
    return start;
  }
  /// Room for so many structs of numbers.
  template <class Struct>
  Struct* take(Count count) {
    return reinterpret_cast<Struct*>(
        take(count * static_cast<Count>(sizeof(Struct) / sizeof(double))));
  }
};

/// What make(layout) makes of scratch for all that it takes.
template <class Make>
auto laid_out(const Make& make) {
  Layout counted;
  make(counted);
  Layout layout(counted.used);
  return make(layout);
}

}  // namespace
