// SPDX-License-Identifier: MIT
#include "pipedyn/motion/dop853.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "pipedyn/motion/dop853_coefficients.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

/// Least and largest factor by which the step size changes, after Hairer, Norsett and Wanner.
constexpr double least_factor = 1.0 / 3.0, most_factor = 6.0;

/// Exponent of the previous error in the choice of the next step size. Without it the step sizes of
/// undamped chains oscillate at the limit of stability, which was measured to cost a fifth of the
/// evaluations.
constexpr double memory = 0.08;

constexpr Index stages = 12;

/// Nodes c_s: place of each stage within the step.
double share(Index s) {
  static const std::array<double, stages + 4> shares = [] {
    std::array<double, stages + 4> found{};
    for (Index i = 1; i < stages + 4; ++i) {
      found[i] = std::accumulate(dop853::weights[i - 1], dop853::weights[i - 1] + i, 0.0);
    }
    return found;
  }();
  return shares[s];
}

}  // namespace

Dop853::Dop853(Rates rates, Index rows, Index members, const double* start, double time,
               const Limits& limits, std::shared_ptr<Charts> charts)
    : Integrator(rows, members, time, limits, std::move(charts)),
      rates_(std::move(rates)),
      y_(Eigen::Map<const Matrix>(start, rows, members)),
      absolute_(limits_.absolute),
      relative_(limits_.relative),
      rate_(stages + 1, y_),
      tried_(Vector::Zero(members)),
      zero_(Vector::Zero(y_.size())),
      dense_{{}, {}, {}, {}, {}, Stages(stages + 4), Stages(7)} {
  change_charts();
  evaluate(y_, rate_[0], 0.0);
  choose_first_steps();
}

Vector Dop853::state(Index member) const {
  return y_.col(std::find(which_.begin(), which_.end(), member) - which_.begin());
}

/// Computes out = y + h sum_s weights_s k_s.
void Dop853::combine(const Stages& of, const double* weights, Index terms, const double* y,
                     const Matrix& steps, Matrix& out) const {
  const double* k[stages + 4];
  double found[stages + 4];
  Index count = 0;
  for (Index s = 0; s < terms; ++s) {
    if (weights[s] == 0.0) continue;
    found[count] = weights[s];
    k[count++] = of[s].data();
  }
  out.resizeLike(steps);
  motion_kernel().combine(found, k, count, y, steps.data(), out.data(), out.size());
}

/// Rates of states, each at a given fraction of the step that is tried.
void Dop853::evaluate(const Matrix& y, Matrix& rates, double share) {
  t_.resize(active());
  for (Index j = 0; j < active(); ++j) {
    Member& member = members_[which_[j]];
    t_[j] = member.time + share * tried_[j];
    ++member.evaluations;
  }
  rates.resizeLike(y);
  rates_(t_, y.data(), which_, rates.data());
}

/// First step size, at which an explicit Euler step and the change of rates within it are small.
void Dop853::choose_first_steps() {
  const Index m = active();
  const Matrix allowed = absolute_ + y_.cwiseAbs() * relative_.asDiagonal();
  const auto norms = [&](const Matrix& of) {
    Vector sum = Vector::Zero(m);
    for (Index i = 0; i < rows_; ++i) {
      sum += of.row(i).cwiseQuotient(allowed.row(i)).cwiseAbs2().transpose();
    }
    return Vector((sum / static_cast<double>(rows_)).cwiseSqrt());
  };
  const Vector size = norms(y_), rate = norms(rate_[0]);
  for (Index j = 0; j < m; ++j) {
    tried_[j] = size[j] < 1e-5 || rate[j] < 1e-5 ? 1e-6 : 0.01 * size[j] / rate[j];
  }
  evaluate(y_ + rate_[0] * tried_.asDiagonal(), rate_[1], 1.0);
  const Vector change = norms(rate_[1] - rate_[0]);
  for (Index j = 0; j < m; ++j) {
    const double h = tried_[j], steepest = std::max(rate[j], change[j] / h);
    const double by_error =
        steepest < 1e-15 ? std::max(1e-6, 1e-3 * h) : std::pow(0.01 / steepest, 0.125);
    members_[j].step = std::isfinite(by_error) ? std::min(100.0 * h, by_error) : h;
  }
}

Index Dop853::step(double end) {
  const Index m = active();
  tried_.resize(m);
  for (Index j = 0; j < m; ++j) tried_[j] = length(members_[which_[j]], end);
  steps_ = tried_.transpose().replicate(rows_, 1);
  for (Index s = 1; s < stages; ++s) {
    combine(rate_, dop853::weights[s - 1], s, y_.data(), steps_, stage_);
    evaluate(stage_, rate_[s], share(s));
  }
  combine(rate_, dop853::weights[stages - 1], stages, y_.data(), steps_, next_);
  measure_errors();
  accepted_.assign(static_cast<std::size_t>(m), 0);
  for (Index j = 0; j < m; ++j) control(j, end);
  if (std::find(accepted_.begin(), accepted_.end(), 1) != accepted_.end()) {
    evaluate(next_, rate_[stages], 0.0);  // accepted members are at the end of their step
    interpolate();
    y_.swap(next_);
    rate_[0].swap(rate_[stages]);
    for (Index j = 0; j < m; ++j) {
      if (accepted_[j]) continue;
      y_.col(j) = next_.col(j);
      rate_[0].col(j) = rate_[stages].col(j);
    }
    if (change_charts()) evaluate(y_, rate_[0], 0.0);
  }
  for (const Index w : which_) {
    const bool spent = static_cast<double>(members_[w].evaluations + stages + 3) > limits_.most;
    if (spent && members_[w].progress == Progress::going) members_[w].progress = Progress::spent;
  }
  return stages;
}

/// Changes the charts of the columns' states where needed, and returns whether any was changed.
bool Dop853::change_charts() {
  bool any = false;
  for (Index j = 0; has_charts() && j < active(); ++j) {
    Vector y = y_.col(j);
    if (!choose_charts(which_[j], y)) continue;
    y_.col(j) = y;
    any = true;
  }
  return any;
}

/// Error of the step of each column, relative to the tolerance.
void Dop853::measure_errors() {
  const Index m = active();
  const auto largest = y_.cwiseAbs().cwiseMax(next_.cwiseAbs());
  scale_ = (absolute_ + largest * relative_.asDiagonal()).cwiseInverse();
  for (Index e = 0; e < 2; ++e) {
    combine(rate_, dop853::error_weights[e], stages, zero_.data(), steps_, stage_);
    squares_[e].setZero(m);
    for (Index i = 0; i < rows_; ++i) {
      squares_[e] += stage_.row(i).cwiseProduct(scale_.row(i)).cwiseAbs2().transpose();
    }
  }
  error_.resize(m);
  for (Index j = 0; j < m; ++j) {
    const double fifth = squares_[0][j], sum = fifth + 0.01 * squares_[1][j];
    error_[j] = sum == 0.0 ? 0.0 : fifth / std::sqrt(sum * static_cast<double>(rows_));
  }
}

/// Accepts or rejects the step of a column and chooses its next step size.
void Dop853::control(Index j, double end) {
  Member& member = members_[which_[j]];
  const double error = error_[j], h = tried_[j];
  if (error <= 1.0) {
    const double exponent = 0.125 - 0.2 * memory;
    const double wanted = safety * std::pow(error, -exponent) * std::pow(member.last_error, memory);
    const double most = member.rejected ? 1.0 : most_factor;
    move_on(member, h, h * std::clamp(wanted, least_factor, most), end);
    member.last_error = std::max(error, 1e-4);
    accepted_[j] = 1;
    return;
  }
  const bool finite = std::isfinite(error);
  member.overflowed |= !finite;
  shorten(member, h * (finite ? std::max(safety * std::pow(error, -0.125), least_factor) : 0.1));
}

/// Records accepted steps that contain a sample; dense output is computed for their columns alone.
void Dop853::interpolate() {
  const Index m = active();
  auto& [columns, which, from, steps, stage, rate, terms] = dense_;
  columns.clear();
  which.clear();
  for (Index j = 0; j < m; ++j) {
    if (!accepted_[j] || !is_asked_for(members_[which_[j]])) continue;
    columns.push_back(j);
    which.push_back(which_[j]);
  }
  if (columns.empty()) return;
  const Index c = static_cast<Index>(columns.size());
  const auto take = [&](const Matrix& every, Matrix& some) {  // Eigen would copy the indices
    some.resize(rows_, c);
    for (Index j = 0; j < c; ++j) some.col(j) = every.col(columns[static_cast<std::size_t>(j)]);
  };
  take(y_, from);
  take(steps_, steps);
  for (Index s = 0; s <= stages; ++s) take(rate_[s], rate[s]);
  t_.resize(c);
  for (Index s = stages + 1; s < stages + 4; ++s) {
    combine(rate, dop853::weights[s - 1], s, from.data(), steps, stage);
    for (Index j = 0; j < c; ++j) {
      t_[j] = members_[which[j]].time - (1.0 - share(s)) * steps(0, j);
    }
    rate[s].resizeLike(stage);
    rates_(t_, stage.data(), which, rate[s].data());
  }
  for (const Index w : which) members_[w].evaluations += 3;
  take(next_, terms[0]);
  terms[0] -= from;
  terms[1] = steps.cwiseProduct(rate[0]) - terms[0];
  terms[2] = terms[0] - terms[1] - steps.cwiseProduct(rate[stages]);
  for (Index t = 0; t < 4; ++t) {
    combine(rate, dop853::dense_weights[t], stages + 4, zero_.data(), steps, terms[3 + t]);
  }
  for (Index j = 0; j < c; ++j) {
    // from + x (terms_0 + (1 - x) (terms_1 + x (terms_2 + ...)))
    Matrix& p = step_.coefficients;
    p.resize(8, rows_);
    for (Index i = 0; i < rows_; ++i) {
      double of_row[8] = {};
      for (Index t = 6; t >= 0; --t) {
        of_row[0] += terms[t](i, j);
        for (Index e = 7 - t; e > 0; --e) {
          of_row[e] = t % 2 == 0 ? of_row[e - 1] : of_row[e] - of_row[e - 1];
        }
        if (t % 2 == 0) of_row[0] = 0.0;
      }
      for (Index e = 1; e < 8; ++e) p(e, i) = of_row[e];
      p(0, i) = from(i, j);
    }
    step_.to = members_[which[j]].time;
    step_.from = step_.to - steps(0, j);
    record(which[j], step_);
  }
}

void Dop853::keep(const std::vector<Index>& columns) {
  for (Matrix* const of : {&y_, &rate_[0], &absolute_}) *of = Matrix((*of)(Eigen::all, columns));
  relative_ = Vector(relative_(columns));
}

}  // namespace pipedyn
