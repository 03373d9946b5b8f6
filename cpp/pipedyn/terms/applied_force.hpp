// SPDX-License-Identifier: MIT
//
// Forces of the user's own that vary in time, fixed in direction: at one place, or per length all
// along the pipe as a polynomial sum_k c_k T_k(2 s - 1) in Chebyshev polynomials of the arc length
// s. What is known at a time, the components (x, y, z) of each c_k, stands in the drive of a batch,
// three rows for each, behind the motion of the base. Planar models do not read z.
#pragma once

#include "pipedyn/terms/station.hpp"
#include "pipedyn/terms/term.hpp"

namespace {

struct AppliedForce : NoLaw {
  static constexpr const char* name = "applied_force";
  static constexpr bool applied = true;
  std::ptrdiff_t first, count = 1;  // of the coefficients in the drive

  explicit AppliedForce(const pipedyn::Term& term)
      : first(static_cast<std::ptrdiff_t>(term.numbers[0])) {}
  auto load(const auto&) const { return Load(0.0, 0.0); }  // where nothing drives the pipe
};

struct AppliedLoad : AppliedForce {
  static constexpr const char* name = "applied_load";
  static constexpr bool along = true;

  explicit AppliedLoad(const pipedyn::Term& term) : AppliedForce(term) {
    count = static_cast<std::ptrdiff_t>(term.numbers[1]);
  }
};

/// An applied force at one time and place, as a law.
template <class Real>
struct AppliedNow : NoLaw {
  static constexpr bool has_potential = false;
  Real x{}, y{}, z{};

  /// row(k): row k of the drive behind the motion of the base. Clenshaw's recurrence.
  template <class Row>
  AppliedNow(const AppliedForce& law, double s, const Row& row, bool in_space = false) {
    const double t = 2.0 * s - 1.0;
    const auto sum = [&](int component) {
      Real next{}, beyond{};
      for (std::ptrdiff_t k = law.count - 1; k > 0; --k) {
        const Real own = row(3 * (law.first + k) + component) + (2.0 * t) * next - beyond;
        beyond = next;
        next = own;
      }
      return Real(row(3 * law.first + component) + t * next - beyond);
    };
    x = sum(0);
    y = sum(1);
    if (in_space) z = sum(2);
  }
  AppliedNow() = default;
  auto load(const auto&) const { return Load(x, y); }
  SpatialLoad<Real> load_in_space(const SpatialStation<Real>&) const { return {{x, y, z}}; }
};

}  // namespace
