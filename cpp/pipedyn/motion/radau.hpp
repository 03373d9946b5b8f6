// SPDX-License-Identifier: MIT
//
// Integrates y' = f(t, y) by the implicit Radau IIA method with eight stages, which has order 15
// and is L-stable. A step solves
//   Z_i = h sum_j A_ij f(t + c_j h, y + Z_j)
// by Newton's method with one derivative J of f. The factors A^-1 = V diag(lambda) V^-1 decouple it
// into four complex systems (lambda_k / h - J) x_k = b_k. f is evaluated for the eight stages as
// one batch of eight members; the systems are solved side by side in the lanes of vectors. With u
// the polynomial through the start y and the stages, the error is estimated by the real part of
//   (lambda_1 / h - J)^-1 (f(t, y) - u'(t)),
// and by the error of u within the step, where u gives samples; where slopes of f jump, also by f
// between the stages. Members advance one after the other. An iteration costs O(rows) operations
// besides f and the solve.
#pragma once

#include <memory>
#include <optional>

#include "pipedyn/chain/motion.hpp"
#include "pipedyn/motion/integrator.hpp"

namespace pipedyn {

/// Solves (mu_k - J) x_k = b_k for four complex mu_k, where J is the derivative of a member's
/// rates. mu (8,) and each row of b (rows, 8) hold the four real parts, then the four imaginary
/// ones.
class ShiftedSystems {
 public:
  virtual ~ShiftedSystems() = default;
  /// Evaluates J at a state, for all solves until the next call.
  virtual void linearise(double t, const double* y, Index member) = 0;
  virtual void factorise(const double* mu) = 0;
  /// Overwrites b with x.
  virtual void solve(double* b) = 0;
};

/// Flow speed u (members,) of each motion of a batch, its drive (Drive::rows or more, members), or
/// empty if nothing drives it, and the relative errors that quadratures may leave, as in `Batch`,
/// or empty.
struct Flows {
  Vector u;
  Matrix drive{};
  Vector errors{};
  Matrix charts{};  // signs of segments in their charts (segments, members), or empty

  bool driven() const { return !drive.isZero(0.0); }
  Batch of(const double* y) const {
    return {.y = y,
            .u = u.data(),
            .members = u.size(),
            .u_step = 1,
            .drive = driven() ? drive.data() : nullptr,
            .drive_rows = driven() ? drive.rows() : Drive::rows,
            .errors = errors.size() > 0 ? errors.data() : nullptr,
            .charts = charts.size() > 0 ? charts.data() : nullptr};
  }
};
/// The flow of one member at one time.
using FlowAt = std::function<Flows(double t, Index member)>;

/// Systems with J as a dense matrix.
class DenseSystems final : public ShiftedSystems {
 public:
  /// A function that writes J (size, size) row by row.
  using Jacobian = std::function<void(double t, const double* y, Index member, double* out)>;

  DenseSystems(Jacobian jacobian, Index size);
  void linearise(double t, const double* y, Index member) override {
    jacobian_(t, y, member, slopes_.data());
  }
  void factorise(const double* mu) override;
  void solve(double* b) override;

 private:
  Jacobian jacobian_;
  Matrix slopes_;
  std::vector<double> factors_;
  std::vector<Index> pivots_;
};

/// The function f in two parts: for the rows that Newton's method solves for, and for the rows
/// after them, on which no rate depends, so that they need no solve. Arguments are those of
/// `Rates`.
struct ImplicitRates {
  Rates rates;
  Rates others;
  Index solved;  // number of rows of the first part
  std::unique_ptr<ShiftedSystems> systems;
};

/// Where slopes of f jump: displacements W sin(B p) of places from the positions p, the first rows
/// of a state, that pass their gap or its negative.
struct Stops {
  Matrix angles;   // B; empty if it is the identity
  Matrix weights;  // W (places, angles)
  Vector gaps;     // (places,)
};

class Radau final : public Integrator {
 public:
  /// start: states (rows, members), all at time t0; stops: those that are known, if slopes of f may
  /// jump.
  Radau(ImplicitRates rates, Index rows, Index members, const double* start, double time,
        const Limits& limits, std::optional<Stops> stops, std::shared_ptr<Charts> charts = nullptr);

  Vector state(Index member) const override { return states_.col(member); }

 protected:
  Index step(double end) override;
  void keep(const std::vector<Index>&) override {}

 private:
  void begin(Index which);
  void set_start_rates(Index which);
  void set_times(double from, double h);
  void allow();
  void predict(double h);
  bool solve(Index which, double h, Index& evaluations);
  double error(double h);
  double unseen(Index which, double h, Index& evaluations);
  enum class Contact { none, crossed, passed };
  Contact contact(const Matrix& positions, const Vector& shares) const;
  void accept(Index which, double h);

  ImplicitRates of_;
  std::optional<Stops> stops_;
  Matrix states_;  // (rows, members)
  Index current_ = -1;

  // The member that is advancing:
  Vector y_, allowed_, predicted_;  // predicted_: predicted change over the step
  Vector start_rates_, end_rates_;  // rates at y_ and at the end of the step
  std::vector<Index> same_;         // the member, once for each stage
  Vector stage_times_;              // of the stages
  Interpolant step_;
  Matrix z_, before_, w_;     // (rows, 8): stages, stages of the last step, unknowns of the systems
  Matrix at_, rates_at_, x_;  // states at the stages, their rates, right-hand sides or solutions
  Matrix between_;            // states between the stages
  double last_h_ = 0.0, factored_h_ = 0.0;
  double ratio_ = 0.0;        // of the lengths of two steps, to which beyond_ belongs
  double beyond_[8][8] = {};  // weights of the last step's stages in the predicted ones
  double contraction_ = 1.0;  // ratio of the next change to that of an iteration
  double left_ = 1.0;         // ratio of all later changes to that of an iteration
  Index iterations_ = 0;
  bool fresh_ = false;  // whether J was evaluated in this step
};

}  // namespace pipedyn
