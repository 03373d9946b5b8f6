// SPDX-License-Identifier: MIT
#include "pipedyn/linear/truncated.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Largest |d / lambda| at which d is trusted to a third of itself, and largest |Re d / Re lambda|
/// at which the side of the axis is trusted.
constexpr double largest_shift = 0.05, largest_share = 0.5;

/// Distance from a crossing within which that of the larger model is looked for, relative to 1 + u.
constexpr double near_by = 1e-3;

}  // namespace

void Truncated::sample(double u, Index roots, Sample& at) {
  fewer_->sample(u, roots, at);
  // Three kinds of roots lie far from the axis: those of the lowest modes, of which the smaller
  // model misses little; those that damping holds near -1 / delta whatever their shape; and those
  // of the highest modes, which are not the pipe's.
  const auto is_far = [](Complex value) { return value.real() < -heavy_damping * std::abs(value); };
  std::vector<Index>& asked = asked_;  // only the upper of two conjugates is asked for
  asked.clear();
  for (Index i = 0; i < std::min(resolved_, at.size()); ++i) {
    const Complex value = at.values[i];
    const bool is_lower = value.imag() < 0.0;
    if (!is_lower && !is_far(value) && traits.counts(value)) asked.push_back(i);
  }
  const Index count = static_cast<Index>(asked.size());
  auto places = room_in(at_, count), missed = room_in(missed_, count);
  for (Index k = 0; k < count; ++k) places[k] = at.values[asked[k]];
  more_->log_derivatives(u, places, at.values, missed);
  missed = -missed.inverse();
  for (std::size_t k = 0; k < asked.size(); ++k) {
    const Index i = asked[k];
    const Complex value = at.values[i];
    // A pivot is 0 only at a root: there d is 0.
    const Complex shift = std::isnan(std::norm(missed[k])) ? 0.0 : missed[k];
    const double real = std::abs(value.real()), lost = std::abs(shift.real());
    if (u == 0.0 && !traits.damped && real <= at.noise[i]) continue;  // on the axis in both models
    if (std::abs(shift) <= largest_shift * std::abs(value) && lost <= largest_share * real) {
      const bool paired = value.imag() > 0.0 && !traits.is_hysteretic() && i + 1 < at.size();
      at.noise.segment(i, paired ? 2 : 1) += 2.0 * lost;
    } else {
      alike_ = false;
    }
  }
  count_work();
}

Pair Truncated::refined(double u, const Pair& guess, bool vectors) {
  return fewer_->refined(u, guess, vectors);
}

std::optional<Sweep> Truncated::of_larger(Sweep sweep, double end, Index resolved) {
  if (!alike_ || sweep.untracked || !sweep.failure.empty()) return {};
  int expected = sweep.unstable_at_rest;
  for (AxisCrossing& crossing : sweep.crossings) {
    const std::optional<AxisCrossing> there = of_larger(crossing);
    if (!there) return {};
    crossing = *there;
    expected += crossing.change;
  }
  const bool as_many = unstable(end, resolved) == expected;
  count_work();
  if (!as_many) return {};
  return sweep;
}

std::optional<AxisCrossing> Truncated::of_larger(const AxisCrossing& crossing) {
  if (crossing.pair.right.size() == 0) return {};
  const double u = crossing.speed, reach = near_by * (1.0 + u);
  const double low = std::max(u - reach, 0.0), high = u + reach;
  AxisCrossing there = crossing;
  if (crossing.value == 0.0) {
    auto& lossless = static_cast<Eigenproblem&>(more_->without_loss());
    const std::optional<Divergence> nearest = lossless.divergence_near(u, reach);
    if (!nearest) return {};
    there.speed = nearest->speed;
    there.error = nearest->error;
    there.pair = nearest->pair;
    return there;
  }
  std::tie(there.speed, there.pair) = newton(*more_, u, Pair{crossing.pair.value}, low, high);
  there.error = error_of(there.pair);
  const double off = std::abs(there.pair.value.imag() - crossing.pair.value.imag());
  const bool good = there.pair.converged() && off <= near_by * (1.0 + std::abs(crossing.value)) &&
                    std::abs(there.pair.value.real()) <= 1e-6 * (1.0 + std::abs(crossing.value)) &&
                    (there.pair.slope.real() > 0.0) == (crossing.change > 0);
  if (!good) return {};
  there.value = {0.0, std::abs(there.pair.value.imag())};
  return there;
}

/// Number of unstable roots, as far as rounding does not hide it, among those of the `resolved`
/// lowest modes.
int Truncated::unstable(double u, Index resolved) {
  constexpr Index beyond = 8;  // further roots, so that a next one is known
  const Index count = 2 * resolved;
  Sample at;
  if (fewer_->from_known(u, count + beyond, false, at)) more_->assume(u, at.values);
  more_->sample(u, count, at);
  int number = 0;
  for (Index i = more_->standing(); i < at.size(); ++i) {
    const bool grows = at.values[i].real() > at.noise[i];
    if (grows && traits.counts(at.values[i])) number += traits.is_hysteretic() ? 2 : 1;
  }
  return number;
}

}  // namespace pipedyn
