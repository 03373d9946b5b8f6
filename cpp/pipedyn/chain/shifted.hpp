// SPDX-License-Identifier: MIT
//
// Solution of (mu - J) x = b for a chain in O(n), with J = d(dy/dtau)/dy about any state and mu
// complex, the linear system of implicit integrators. Four mu are solved for at once, one in each
// lane of a vector.
//
// With b = [b1, b2] and x = [x1, x2] the angle of segment j changes by (x2_j + b1_j) / mu, its rate
// by x2_j and its angular acceleration by mu x2_j - b2_j. The unknown of derivative.hpp is x2_j.
//
// Local to each translation unit, like pack.hpp.
#pragma once

#include "pipedyn/chain/derivative.hpp"
#include "pipedyn/vector/shifts.hpp"

namespace {

/// Pointers into the array of factors for the shifts of one pass: to 1 / mu and to the segments.
template <Count size>
struct ShiftedFactors {
  using Segment = Eliminated<double, Complex, size>;

  Complex* inverse;
  Segment* segments;

  ShiftedFactors(double* array, Count n, Count pass) {
    constexpr std::uintptr_t boundary = alignof(Segment);
    const std::uintptr_t start =
        (reinterpret_cast<std::uintptr_t>(array) + boundary - 1) / boundary;
    Complex* const shifts = reinterpret_cast<Complex*>(start * boundary);
    inverse = shifts + pass;
    segments = reinterpret_cast<Segment*>(shifts + shift_passes) + pass * n;
  }
  static Count numbers(Count n) {
    const Count bytes = shift_passes * static_cast<Count>(sizeof(Complex)) +
                        shift_passes * n * static_cast<Count>(sizeof(Segment)) +
                        static_cast<Count>(alignof(Segment));
    return bytes / static_cast<Count>(sizeof(double));
  }
};

/// The right-hand side b of an implicit step: known changes of angles, b1 / mu, and of
/// accelerations, -b2.
struct ShiftedRight {
  using Number = Complex;
  static constexpr Count known = 2, kinds[] = {own_angle, own_acceleration};
  const double* b;
  Count segments, pass;
  Complex inverse;  // 1 / mu

  Count last() const { return segments - 1; }
  static bool any(Count) { return true; }
  Complex change(Count i, Count j) const {
    if (j < 0) return {};
    return i == 0 ? inverse * read_shifted(b, j, pass) : -1.0 * read_shifted(b, segments + j, pass);
  }
};

/// Calls body(factors, pass) for each pass, which has as many shifts as a vector has lanes.
template <class Body>
void for_each_pass(const ChainModel& model, double* array, const Body& body) {
  with_carried(model, [&]<Count size>() {
    for (Count pass = 0; pass < shift_passes; ++pass) {
      body(ShiftedFactors<size>(array, model.size, pass), pass);
    }
  });
}

Count shifted_numbers(const ChainModel& model) {
  return with_carried(model,
                      [&]<Count size>() { return ShiftedFactors<size>::numbers(model.size); });
}

void factorise_shifted(const ChainModel& model, const Batch& one, const double* mu, double* array) {
  auto about =
      laid_out([&](Layout& layout) { return Linearised<double>(model, {one, 0, 1}, layout); });
  about.linearise();
  for_each_pass(model, array, [&](const auto& factors, Count pass) {
    const Complex shift = read_shifted(mu, 0, pass), inverted = inverse(shift);
    *factors.inverse = inverted;
    eliminate(about, {inverted, Complex{} + 1.0, shift}, factors.segments);
  });
}

void solve_shifted(const ChainModel& model, double* array, double* x) {
  const Count n = model.size;
  Complex* const alone = laid_out([&](Layout& layout) { return layout.take<Complex>(n); });
  for_each_pass(model, array, [&](const auto& factors, Count pass) {
    const Complex inverted = *factors.inverse;
    solve_segments(factors.segments, n, ShiftedRight{x, n, pass, inverted}, alone,
                   [=](Count j, const Complex& rate) {
                     write_shifted(x, j, pass, inverted * (rate + read_shifted(x, j, pass)));
                     write_shifted(x, n + j, pass, rate);
                   });
  });
}

}  // namespace
