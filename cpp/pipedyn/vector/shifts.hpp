// SPDX-License-Identifier: MIT
//
// Complex numbers in the lanes of a vector, one for each of the four shifts mu of the systems
// (mu - J) x = b that an implicit step solves; in narrow vectors they take several passes.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/vector/complex.hpp"

namespace {

/// Lanes for the shifts, or for some of them.
#if PIPEDYN_WIDTH > 4
typedef double Shifts __attribute__((vector_size(32)));
#else
using Shifts = Pack;
#endif
constexpr Count shift_count = 4;
constexpr Count shift_passes = shift_count / lanes<Shifts>;

using Complex = ComplexLanes<Shifts>;

/// A row of numbers (rows, 2 shifts), of which the real parts are first.
inline Complex read_shifted(const double* x, Count row, Count pass) {
  const double* const at = x + 2 * shift_count * row + pass * lanes<Shifts>;
  return {load<Shifts>(at), load<Shifts>(at + shift_count)};
}

inline void write_shifted(double* x, Count row, Count pass, const Complex& value) {
  double* const at = x + 2 * shift_count * row + pass * lanes<Shifts>;
  store(at, value.re);
  store(at + shift_count, value.im);
}

}  // namespace
