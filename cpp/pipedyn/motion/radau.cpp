// SPDX-License-Identifier: MIT
#include "pipedyn/motion/radau.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <utility>

#include "pipedyn/motion/radau_coefficients.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

constexpr Index lanes = 2 * MotionKernel::shifts;

/// Least and largest factor by which the step size changes.
constexpr double shortest_next = 0.1, longest_next = 5.0;

/// Largest relative tolerance. Steps with a looser one, which shrinks to this with its absolute
/// one, shake modes whose positions change by less than that: reduced models of 4 to 10 functions
/// took 4 to 60 times as long at 1e-3 as at this, or ended in states that are not finite.
constexpr double loosest = 2e-5;

/// Newton's method stops when the remaining error is below this fraction of the tolerance, and
/// gives up after this number of iterations.
constexpr double newton_share = 0.005;
constexpr Index most_iterations = 10;

/// J is kept while an iteration reduces the error to less than this fraction, and the step size
/// while it would grow by less than this factor: J and its factors cost about as much as an
/// iteration. Chains of 3 to 1000 segments take 0 to 15 % less time than with a J for each step.
constexpr double kept_contraction = 1e-4, kept_step = 1.2;

/// J is computed at the state that is predicted for this stage, near the end of the step. Among all
/// stages and the start this choice took the fewest iterations, both with chains and with reduced
/// models, whose J serves the next steps too.
constexpr Index expanded = 5;

/// Exponent of the error in the choice of the step size, as the error estimate has order 8.
constexpr double exponent = 1.0 / 9.0;

using Table = double[radau::stages][radau::stages];

/// Computes out = in M.
void combine_rows(const double* in, const Table& matrix, Index rows, double* out) {
  motion_kernel().mix_stages(in, matrix[0], nullptr, nullptr, rows, out);
}

}  // namespace

// ------------------------------------------------------------------------------------ systems

DenseSystems::DenseSystems(Jacobian jacobian, Index size)
    : jacobian_(std::move(jacobian)),
      slopes_(size, size),
      factors_(static_cast<std::size_t>(lanes * size * size)),
      pivots_(static_cast<std::size_t>(4 * size)) {}

void DenseSystems::factorise(const double* mu) {
  const Index n = slopes_.rows();
  Eigen::Map<Matrix> entries(factors_.data(), n * n, lanes);
  entries.leftCols(lanes / 2) = -slopes_.reshaped<Eigen::RowMajor>().replicate(1, lanes / 2);
  entries.rightCols(lanes / 2).setZero();
  for (Index i = 0; i < n; ++i) entries.row(i * (n + 1)) += Eigen::Map<const Vector>(mu, lanes);
  motion_kernel().factorise_dense(factors_.data(), n, pivots_.data());
}

void DenseSystems::solve(double* b) {
  motion_kernel().solve_dense(factors_.data(), pivots_.data(), slopes_.rows(), b);
}

// -------------------------------------------------------------------------------------- steps

Radau::Radau(ImplicitRates rates, Index rows, Index members, const double* start, double time,
             const Limits& limits, std::optional<Stops> stops, std::shared_ptr<Charts> charts)
    : Integrator(rows, members, time, limits, std::move(charts)),
      of_(std::move(rates)),
      stops_(std::move(stops)),
      states_(Eigen::Map<const Matrix>(start, rows, members)),
      z_(rows, radau::stages),
      before_(rows, radau::stages),
      w_(of_.solved, lanes),
      at_(rows, radau::stages),
      rates_at_(rows, radau::stages),
      x_(of_.solved, lanes),
      between_(rows, radau::stages) {
  const Vector finer = (loosest / limits_.relative.array()).min(1.0);
  limits_.relative = limits_.relative.cwiseProduct(finer);
  limits_.absolute = limits_.absolute * finer.asDiagonal();
}

/// Sets the times of the stages of a step.
void Radau::set_times(double from, double h) {
  stage_times_ = from + h * Eigen::Map<const Vector>(radau::nodes, radau::stages).array();
}

/// Begins at the state of a member, with a first step size estimated from its rates.
void Radau::begin(Index which) {
  current_ = which;
  same_.assign(radau::stages, which);
  y_ = states_.col(which);
  choose_charts(which, y_);
  set_start_rates(which);
  allow();
  const double rate = start_rates_.cwiseQuotient(allowed_).norm();
  const double size = std::sqrt(static_cast<double>(of_.solved));
  members_[which].step = rate > 0.0 ? std::pow(0.01 * size / rate, exponent) : 1.0;
  if (!std::isfinite(rate)) members_[which].step = 1e-6;
}

/// Sets the rates at the state, to which no earlier step leads.
void Radau::set_start_rates(Index which) {
  last_h_ = factored_h_ = 0.0;
  fresh_ = false;
  contraction_ = left_ = 1.0;
  Vector rates(rows_);
  of_.rates(Vector::Constant(1, members_[which].time), y_.data(), {which}, rates.data());
  ++members_[which].evaluations;
  start_rates_ = rates.head(of_.solved);
}

void Radau::allow() {
  const Index n = of_.solved;
  allowed_ =
      limits_.absolute.col(current_).head(n) + limits_.relative[current_] * y_.head(n).cwiseAbs();
}

/// Predicts the stages of a step by extrapolating the polynomial of the last step.
void Radau::predict(double h) {
  const Index n = of_.solved;
  const double ratio = h / last_h_;
  if (last_h_ == 0.0) {
    z_.setZero();
    w_.setZero();
  } else {
    for (Index i = 0; i < radau::stages && ratio != ratio_; ++i) {
      const double x = 1.0 + radau::nodes[i] * ratio;
      for (Index k = 0; k < radau::stages; ++k) {
        double weight = 0.0;
        for (Index p = radau::stages - 1; p >= 0; --p) weight = x * (radau::powers[k][p] + weight);
        beyond_[k][i] = weight - (k == radau::stages - 1 ? 1.0 : 0.0);
      }
    }
    ratio_ = ratio;
    combine_rows(before_.data(), beyond_, n, z_.data());
    combine_rows(z_.data(), radau::to_systems, n, w_.data());
  }
  at_.topRows(n) = z_.topRows(n).colwise() + y_.head(n);
  predicted_ = z_.col(radau::stages - 1).head(n);
}

/// Solves for the stages of a step by Newton's method, and returns whether it converged.
bool Radau::solve(Index which, double h, Index& evaluations) {
  const Index n = of_.solved;
  set_times(members_[which].time, h);
  double mu[lanes];
  for (Index i = 0; i < lanes; ++i) mu[i] = radau::shifts[i] / h;
  const double floor = 10.0 * std::numeric_limits<double>::epsilon() / limits_.relative[current_];
  const double enough = std::max(newton_share, floor);
  double last = 0.0;
  left_ = std::pow(std::max(left_, std::numeric_limits<double>::epsilon()), 0.8);
  for (iterations_ = 1; iterations_ <= most_iterations; ++iterations_) {
    evaluations += radau::stages;
    if (static_cast<double>(members_[which].evaluations + evaluations) > limits_.most) {
      evaluations -= radau::stages;
      members_[which].progress = Progress::spent;
      return false;
    }
    of_.rates(stage_times_, at_.data(), same_, rates_at_.data());
    if (iterations_ == 1) {
      if (!fresh_ && contraction_ > kept_contraction) {
        of_.systems->linearise(stage_times_[expanded], Vector(at_.col(expanded)).data(), which);
        fresh_ = true;
        factored_h_ = 0.0;
      }
      if (factored_h_ != h) of_.systems->factorise(mu);
      factored_h_ = h;
    }
    motion_kernel().mix_stages(rates_at_.data(), radau::to_systems[0], w_.data(), mu, n, x_.data());
    of_.systems->solve(x_.data());
    const double squares =
        motion_kernel().correct_stages(x_.data(), radau::to_stages[0], y_.data(), allowed_.data(),
                                       n, w_.data(), z_.data(), at_.data());
    const double size = std::sqrt(squares / static_cast<double>(radau::stages * n));
    if (!std::isfinite(size)) {
      members_[which].overflowed = true;
      return false;
    }
    if (iterations_ > 1) {
      contraction_ = size / last;
      if (contraction_ >= 0.99) return false;
      left_ = contraction_ / (1.0 - contraction_);
      const double remaining = static_cast<double>(most_iterations - iterations_);
      if (left_ * size * std::pow(contraction_, remaining) > enough) return false;
    }
    if (left_ * size <= enough) return true;
    last = size;
  }
  return false;
}

/// Error of the step relative to the tolerance, the larger of two estimates. The first takes the
/// polynomial's rates at the start of the step from those of the state, as they miss them by an
/// error of the order of the polynomial's. It does not see the error of the polynomial within the
/// step, which matters where modes decay fast. That error is estimated by the distance between the
/// end and the extrapolation of the last step's polynomial, because both are proportional to the
/// same derivative.
double Radau::error(double h) {
  const Index n = of_.solved;
  Table rates{};  // of the polynomial at the start and at the end of the step
  for (Index k = 0; k < radau::stages; ++k) {
    rates[k][0] = radau::powers[k][0] / h;
    rates[k][1] = radau::end_rate[k] / h;
  }
  combine_rows(z_.data(), rates, n, x_.data());
  end_rates_ = x_.col(1);
  x_.col(0) = start_rates_ - x_.col(0);
  of_.systems->solve(x_.data());
  double within = 0.0;
  if (last_h_ > 0.0) {
    const double ratio = h / last_h_;
    within = radau::missed * ratio / (1.0 + ratio);
    for (const double node : radau::nodes) within *= ratio / (1.0 + ratio - node);
  }
  double squares = 0.0, squares_within = 0.0;
  for (Index i = 0; i < n; ++i) {
    const double change = z_(i, radau::stages - 1);
    const double largest = std::max(std::abs(y_[i]), std::abs(y_[i] + change));
    const double scale =
        1.0 / (limits_.absolute(i, current_) + limits_.relative[current_] * largest);
    const double at_end = x_(i, 0) * scale, inside = (change - predicted_[i]) * scale;
    squares += at_end * at_end;
    squares_within += inside * inside;
  }
  return std::sqrt(std::max(squares, within * within * squares_within) / static_cast<double>(n));
}

namespace {

/// Number of places after each stage, or the start, up to the next stage at which `unseen` looks:
/// with one between stages, a tenth of the motions that graze a stop were wrong. The last place is
/// the stage itself, whose rates are asked again if Newton's method ended with its first iteration:
/// it then saw those of predicted stages, which may not have been in contact. Without that 215
/// of 3000 motions that graze a stop were wrong by more than 600 tolerances, with it one.
constexpr Index places = 4;

/// Weights of the stages in the changes and the slopes, times h, at a place up to each stage.
struct Between {
  Vector shares = Vector(radau::stages), gaps = Vector(radau::stages);  // of the step
  Table values{}, slopes{};

  explicit Between(double place) {
    for (Index i = 0; i < radau::stages; ++i) {
      const double before = i > 0 ? radau::nodes[i - 1] : 0.0;
      gaps[i] = radau::nodes[i] - before;
      shares[i] = before + place * gaps[i];
      for (Index k = 0; k < radau::stages; ++k) {
        for (Index p = radau::stages - 1; p >= 0; --p) {
          slopes[k][i] =
              slopes[k][i] * shares[i] + static_cast<double>(p + 1) * radau::powers[k][p];
          values[k][i] = shares[i] * (values[k][i] + radau::powers[k][p]);
        }
      }
    }
  }
};

}  // namespace

/// Error of the step relative to the tolerance where slopes of f jump within it, as where a pipe
/// meets a stop between two stages: the estimates for smooth f do not see that. It is the change
/// from one stage to the next that the rates between them make, beyond those of the polynomial. As
/// stiff modes multiply what Newton's method leaves, it is four times the change that systems of
/// the step give where that is less.
double Radau::unseen(Index which, double h, Index& evaluations) {
  static const std::array<Between, places> all{Between(0.25), Between(0.5), Between(0.75),
                                               Between(1.0)};
  constexpr Index systems = MotionKernel::shifts;
  const Index n = of_.solved;
  // Below this relative tolerance rounding of the rates would be seen.
  const double least = std::max(1.0, 1e-11 / limits_.relative[current_]);
  const Vector ends =
      y_.head(n).cwiseAbs().cwiseMax((y_.head(n) + z_.col(lanes - 1).head(n)).cwiseAbs());
  const Vector allowed =
      least * (limits_.absolute.col(current_).head(n) + limits_.relative[current_] * ends);
  const auto largest = [&](const Matrix& changes) {
    const Matrix shares = allowed.cwiseInverse().asDiagonal() * changes;
    return shares.allFinite()
               ? std::sqrt(shares.colwise().squaredNorm().maxCoeff() / static_cast<double>(n))
               : std::numeric_limits<double>::infinity();
  };
  // Positions at the start, then at the places up to each stage.
  const Index rows = stops_->angles.size() > 0 ? stops_->angles.cols() : stops_->weights.cols();
  Matrix positions(rows, 1 + places * radau::stages);
  Vector shares = Vector::Zero(positions.cols());
  const auto go_to = [&](const Between& at) {
    combine_rows(z_.data(), at.values, n, between_.data());
    between_.topRows(n).colwise() += y_.head(n);
  };
  positions.col(0) = y_.head(rows);
  for (Index place = 0; place < places; ++place) {
    const Between& at = all[static_cast<std::size_t>(place)];
    go_to(at);
    for (Index i = 0; i < radau::stages; ++i) {
      positions.col(1 + place + places * i) = between_.col(i).head(rows);
      shares[1 + place + places * i] = at.shares[i];
    }
  }
  constexpr double halving = 512.0;  // half as long a step shows more
  const Contact found = contact(positions, shares);
  if (found == Contact::passed) return halving;
  if (found == Contact::none) return 0.0;
  left_ = 1.0;  // the next step may be in contact where this one was not
  const Index asked = iterations_ > 1 ? places - 1 : places;
  evaluations += asked * radau::stages;
  double worst = 0.0;
  for (const Between& at : std::span(all).first(static_cast<std::size_t>(asked))) {
    go_to(at);
    combine_rows(z_.data(), at.slopes, n, x_.data());
    of_.rates(members_[which].time + h * at.shares.array(), between_.data(), same_,
              rates_at_.data());
    const Matrix missed = rates_at_.topRows(n) - x_ / h;
    const double change = largest(h * missed * at.gaps.asDiagonal());
    if (!(change > 1.0)) continue;
    double of_systems = 0.0;
    for (Index k = 0; k < radau::stages; k += systems) {
      x_.leftCols(systems) = missed.middleCols(k, systems);
      x_.rightCols(systems).setZero();
      of_.systems->solve(x_.data());
      const Matrix squares = x_.leftCols(systems).cwiseAbs2() + x_.rightCols(systems).cwiseAbs2();
      of_systems = std::max(of_systems, largest(4.0 * squares.cwiseSqrt()));
    }
    worst = std::max(worst, std::min(change, of_systems));
  }
  return worst;
}

/// Whether a place crosses its gap between two of the positions, or goes beyond it and back between
/// them, as a parabola through three shows. positions: at ascending shares of a step. Where places
/// are not known they may cross.
Radau::Contact Radau::contact(const Matrix& positions, const Vector& shares) const {
  const Matrix angles = stops_->angles.size() > 0 ? stops_->angles * positions : positions;
  const Matrix across = stops_->weights * Matrix(angles.array().sin());
  Contact found = stops_->gaps.size() > 0 ? Contact::none : Contact::crossed;
  for (Index stop = 0; stop < across.rows(); ++stop) {
    const double gap = stops_->gaps[stop], least = 0.01 * limits_.relative[current_] * gap;
    const auto side = [&](Index k) { return (across(stop, k) > gap) - (across(stop, k) < -gap); };
    for (Index k = 1; k < across.cols(); ++k) {
      if (side(k) != side(k - 1)) found = Contact::crossed;
      if (k + 1 == across.cols() || side(k - 1) != 0 || side(k) != 0 || side(k + 1) != 0) continue;
      const double left = shares[k] - shares[k - 1], right = shares[k + 1] - shares[k];
      const double here = across(stop, k), rise = (here - across(stop, k - 1)) / left;
      const double bend = ((across(stop, k + 1) - here) / right - rise) / (left + right);
      const double slope = rise + bend * left, farthest = -0.5 * slope / bend;
      if (!(farthest >= -left && farthest <= right)) continue;
      if (std::abs(here + 0.5 * slope * farthest) > gap + least) return Contact::passed;
    }
  }
  return found;
}

Index Radau::step(double end) {
  const Index which = which_.front();
  if (which != current_) begin(which);
  Index evaluations = 0;
  Member& member = members_[which];
  const double h = length(member, end);
  allow();
  predict(h);
  bool solved = solve(which, h, evaluations);
  double found = solved ? std::max(error(h), 1e-10) : 0.0;
  if (solved && found <= 1.0 && stops_) found = std::max(found, unseen(which, h, evaluations));
  if (std::isnan(found)) {
    member.overflowed = true;
    solved = false;
  }
  member.evaluations += evaluations;
  if (!solved) left_ = 1.0;
  if (solved && found <= 1.0) {
    const double more = 2.0 * most_iterations;
    double factor = safety * (more + 1.0) / (more + static_cast<double>(iterations_)) *
                    std::pow(found, -exponent);
    if (last_h_ > 0.0) {
      factor *= std::min(1.0, h / last_h_ * std::pow(member.last_error / found, exponent));
    }
    factor = std::clamp(factor, shortest_next, member.rejected ? 1.0 : longest_next);
    if (factor >= 1.0 && factor <= kept_step) factor = 1.0;
    move_on(member, h, h * factor, end);
    member.last_error = std::max(found, 1e-2);
    accept(which, h);
  } else if (member.progress == Progress::spent) {
    return evaluations;
  } else if (!solved && !fresh_) {
    contraction_ = 1.0;  // forces a new J
  } else {
    const double factor = solved ? safety * std::pow(found, -exponent) : 0.5;
    shorten(member, h * std::max(factor, shortest_next));
  }
  return evaluations;
}

/// Continues from the end of an accepted step, to which the time of the member has advanced.
void Radau::accept(Index which, double h) {
  const Index n = of_.solved, more = rows_ - n;
  const double from = members_[which].time - h;
  if (more > 0) {
    set_times(from, h);
    of_.others(stage_times_, at_.data(), same_, rates_at_.row(n).data());
    combine_rows(rates_at_.row(n).data(), radau::integrals, more, z_.row(n).data());
    z_.bottomRows(more) *= h;
  }
  if (is_asked_for(members_[which])) {
    combine_rows(z_.data(), radau::powers, rows_, rates_at_.data());
    step_.from = from;
    step_.to = members_[which].time;
    step_.coefficients.resize(1 + radau::stages, rows_);
    step_.coefficients << y_.transpose(), rates_at_.transpose();
    record(which, step_);
  }
  start_rates_.swap(end_rates_);
  y_ += z_.col(radau::stages - 1);
  std::swap(z_, before_);
  last_h_ = h;
  fresh_ = false;
  if (choose_charts(which, y_)) set_start_rates(which);
  states_.col(which) = y_;
}

}  // namespace pipedyn
