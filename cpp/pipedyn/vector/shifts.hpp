// SPDX-License-Identifier: MIT
//
// Complex numbers in the lanes of a vector, one for each of the four shifts mu of the systems
// (mu - J) x = b that an implicit step solves. Narrow vectors hold some of the shifts, and the
// solve takes several passes.
//
// The file is local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/vector/complex.hpp"

namespace {

/// A vector with a lane for each shift, or for some of the shifts.
#if PIPEDYN_WIDTH > 4
typedef double Shifts __attribute__((vector_size(32)));
#else
using Shifts = Pack;
#endif
constexpr Count shift_count = 4;
constexpr Count shift_passes = shift_count / lanes<Shifts>;

using Complex = ComplexLanes<Shifts>;

/// A row of an array (rows, 2 shifts): the real parts, then the imaginary parts.
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
