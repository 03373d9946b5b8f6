// SPDX-License-Identifier: MIT
//
// The nearest of many points, which may lie on a curve in time, by a k-d tree: SciPy's takes longer
// to import than to search.
#pragma once

#include <algorithm>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// Points (count, n) in a tree: each branch is divided at the median of its widest coordinate.
class NearestPoint {
 public:
  /// once, twice: derivatives of the points in time (count, n); empty if they are on no curve.
  explicit NearestPoint(Matrix points, Matrix once = {}, Matrix twice = {})
      : points_(std::move(points)),
        once_(std::move(once)),
        twice_(std::move(twice)),
        order_(static_cast<std::size_t>(points_.rows())) {
    if (once_.rows() != twice_.rows() || once_.cols() != twice_.cols() ||
        (once_.size() > 0 && (once_.rows() != points_.rows() || once_.cols() != size()))) {
      throw std::invalid_argument("derivatives must have the shape of the points");
    }
    std::iota(order_.begin(), order_.end(), Index{0});
    divide(0, points_.rows());
    Matrix sorted(points_.rows(), points_.cols());
    for (Index i = 0; i < sorted.rows(); ++i) sorted.row(i) = points_.row(number(i));
    points_ = std::move(sorted);  // those of a leaf lie side by side
  }

  Index size() const { return points_.cols(); }

  /// Number of the point nearest to x (n,), or -1 if all are as far away as `most` or farther.
  /// Writes the difference of x from the point to away (n,), infinite if there is none; if the
  /// points are on a curve, the difference from it, to third order in the time by which x is ahead
  /// of the point.
  Index operator()(const double* x, double most, double* away) const {
    Search found{.x = {x, size()}, .square = most * most};
    std::size_t branch = 0;
    search(0, points_.rows(), branch, found);
    Eigen::Map<Eigen::RowVectorXd> left(away, size());
    if (found.at < 0) {
      left.setConstant(std::numeric_limits<double>::infinity());
      return -1;
    }
    const Index at = number(found.at);
    left = found.x - points_.row(found.at);
    if (once_.size() > 0) {
      const auto once = once_.row(at);
      const double ahead = once.dot(left) / std::max(once.squaredNorm(), 1e-300);
      left -= ahead * (once + 0.5 * ahead * twice_.row(at));
    }
    return at;
  }

 private:
  static constexpr Index leaf = 12;  // points that are compared one after the other

  struct Branch {
    Index axis;
    double middle;
    std::size_t beyond;  // number of the branch of the larger half; that of the other one follows
  };
  struct Search {
    Eigen::Map<const Eigen::RowVectorXd> x;
    double square;  // distance of the nearest so far
    Index at = -1;
  };

  Index number(Index at) const { return order_[static_cast<std::size_t>(at)]; }

  void divide(Index low, Index high) {
    if (high - low <= leaf) return;
    Eigen::RowVectorXd least = points_.row(number(low)), largest = least;
    for (Index i = low + 1; i < high; ++i) {
      least = least.cwiseMin(points_.row(number(i)));
      largest = largest.cwiseMax(points_.row(number(i)));
    }
    Index axis = 0;
    (largest - least).maxCoeff(&axis);
    const auto at = [&](Index i) { return points_(i, axis); };
    const Index middle = low + (high - low) / 2;
    std::ranges::nth_element(order_.begin() + low, order_.begin() + middle, order_.begin() + high,
                             {}, at);
    const std::size_t own = branches_.size();
    branches_.push_back({axis, at(number(middle)), 0});
    divide(low, middle);
    branches_[own].beyond = branches_.size();
    divide(middle, high);
  }

  void search(Index low, Index high, std::size_t branch, Search& found) const {
    if (high - low <= leaf) {
      for (Index i = low; i < high; ++i) {
        const double square = (points_.row(i) - found.x).squaredNorm();
        if (square < found.square) found.square = square, found.at = i;
      }
      return;
    }
    const auto& [axis, middle, beyond] = branches_[branch];
    const double away = found.x[axis] - middle;
    const Index half = low + (high - low) / 2;
    for (const bool larger : {away >= 0.0, away < 0.0}) {  // first the half in which x lies
      if (larger != (away >= 0.0) && away * away >= found.square) return;
      if (larger) {
        search(half, high, beyond, found);
      } else {
        search(low, half, branch + 1, found);
      }
    }
  }

  Matrix points_, once_, twice_;
  std::vector<Index> order_;
  std::vector<Branch> branches_;
};

}  // namespace pipedyn
