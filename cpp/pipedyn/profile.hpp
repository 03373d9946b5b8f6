// SPDX-License-Identifier: MIT
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <stdexcept>
#include <utility>
#include <vector>

namespace pipedyn {

/// A number that varies along the pipe, for example its bending stiffness, in units of its value at
/// the clamp. The pipe is divided into stretches; on each the number is a Chebyshev series in x,
/// which runs from -1 to 1 along the stretch. Immutable.
class Profile {
 public:
  Profile() = default;  // the constant 1

  /// ends: ends of the stretches, from 0 to 1; series: coefficients on each stretch. Throws
  /// std::invalid_argument unless the ends ascend and each stretch has a series.
  Profile(std::vector<double> ends, std::vector<std::vector<double>> series)
      : ends_(std::move(ends)), series_(std::move(series)) {
    const bool ascend =
        std::adjacent_find(ends_.begin(), ends_.end(), std::greater_equal<>()) == ends_.end();
    const auto empty = [](const std::vector<double>& of) { return of.empty(); };
    if (series_.empty() || ends_.size() != series_.size() + 1 || !ascend ||
        std::any_of(series_.begin(), series_.end(), empty)) {
      throw std::invalid_argument("a profile must have ascending ends and a series between each");
    }
  }

  bool varies() const { return !series_.empty(); }
  const std::vector<double>& ends() const { return ends_; }

  /// Highest degree at which a coefficient exceeds a share of the largest of its series; 0 if the
  /// profile is constant.
  Eigen::Index degree(double share) const {
    std::size_t highest = 0;
    for (const std::vector<double>& one : series_) {
      double largest = 0.0;
      for (const double c : one) largest = std::max(largest, std::abs(c));
      for (std::size_t k = 0; k < one.size(); ++k) {
        if (std::abs(one[k]) > share * largest) highest = std::max(highest, k);
      }
    }
    return static_cast<Eigen::Index>(highest);
  }

  /// The value at arc length s, by Clenshaw's recurrence. Where two stretches meet, the value is
  /// that of the stretch beyond.
  double operator()(double s) const {
    if (!varies()) return 1.0;
    const auto beyond = std::upper_bound(ends_.begin() + 1, ends_.end() - 1, s);
    const auto stretch = static_cast<std::size_t>(beyond - ends_.begin()) - 1;
    const std::vector<double>& c = series_[stretch];
    const double low = ends_[stretch], x = 2.0 * (s - low) / (ends_[stretch + 1] - low) - 1.0;
    double next = 0.0, after = 0.0;
    for (std::size_t k = c.size() - 1; k > 0; --k) {
      after = std::exchange(next, c[k] + 2.0 * x * next - after);
    }
    return c[0] + x * next - after;
  }

 private:
  std::vector<double> ends_;
  std::vector<std::vector<double>> series_;
};

}  // namespace pipedyn
