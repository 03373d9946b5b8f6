// SPDX-License-Identifier: MIT
//
// Places arrays in the scratch memory of the thread. A caller takes all its arrays from a Layout in
// one function. That function runs twice, first to count the numbers and then to place the arrays,
// so that exactly what is taken is allocated. An array of 0 numbers is a null pointer, and writing
// to it ends the process at once. The address sanitizer detects access between two arrays.
//
// All names are local to a translation unit, as each vector level compiles them anew: see pack.hpp.
#pragma once

#include "pipedyn/vector/pack.hpp"
#include "pipedyn/vector/scratch.hpp"

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/asan_interface.h>
#endif

namespace {

/// Places arrays in `numbers`; without it only counts how many numbers they take.
struct Layout {
  static constexpr Count line = 8;  // arrays begin at multiples of 8 numbers, the widest vector
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
  /// Room for an array of structs that consist of numbers.
  template <class Struct>
  Struct* take(Count count) {
    return reinterpret_cast<Struct*>(
        take(count * static_cast<Count>(sizeof(Struct) / sizeof(double))));
  }
};

/// Result of make(layout) with scratch memory for all arrays that it takes.
template <class Make>
auto laid_out(const Make& make) {
  Layout counted;
  make(counted);
  Layout layout(counted.used);
  return make(layout);
}

}  // namespace
