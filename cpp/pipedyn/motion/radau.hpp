// SPDX-License-Identifier: MIT
//
// Motions y' = f(t, y) by the Radau IIA method of seven stages: implicit, of order 13, stable
// however fast f decays or turns. A step solves
//   Z_i = h sum_j A_ij f(t + c_j h, y + Z_j)
// by Newton's method with one derivative J of f. A^-1 = V diag(lambda) V^-1 decouples it into
// systems (lambda_k / h - J) x_k = b_k, one real and three complex. The seven stages and the start
// of the step go through f as a batch of eight members, the systems through the lanes of one solve.
// The error is what an embedded rule of order 7 differs by, after one solve with the real system,
// or what the step's polynomial, from which samples come, misses within.
// Members move one after the other. O(rows) an iteration besides f and a solve.
#pragma once

#include <memory>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/motion/integrator.hpp"

namespace pipedyn {

/// Solves (mu_k - J) x_k = b_k for four complex mu_k with the derivative J of a member's rates.
/// Real parts are first, in mu (8) and in each row of b (rows, 8).
class ShiftedSystems {
 public:
  virtual ~ShiftedSystems() = default;
  /// Takes J at a state from now on.
  virtual void linearise(double t, const double* y, Index member) = 0;
  virtual void factorise(const double* mu) = 0;
  /// b becomes x.
  virtual void solve(double* b) = 0;
  /// Whether J costs no more than its factors.
  virtual bool is_cheap() const { return false; }
};

/// Flow speed and drive of a member at a time.
struct Flow {
  double u = 0.0, drive[Drive::rows] = {};
  bool driven = false;

  Batch of(const double* y) const {
    return {.y = y, .u = &u, .members = 1, .u_step = 0, .drive = driven ? drive : nullptr};
  }
};
using FlowAt = std::function<Flow(double t, Index member)>;

/// J of a chain, by its recursion.
class ChainSystems final : public ShiftedSystems {
 public:
  ChainSystems(const Chain& chain, FlowAt flow);
  void linearise(double t, const double* y, Index member) override;
  void factorise(const double* mu) override;
  void solve(double* b) override;
  bool is_cheap() const override { return true; }

 private:
  const Chain& chain_;
  FlowAt flow_at_;
  Vector state_;
  Flow flow_;
  std::vector<double> factors_;
};

/// J as a matrix.
class DenseSystems final : public ShiftedSystems {
 public:
  /// Writes J (size, size) by rows.
  using Jacobian = std::function<void(double t, const double* y, Index member, double* out)>;

  DenseSystems(Jacobian jacobian, Index size);
  void linearise(double t, const double* y, Index member) override;
  void factorise(const double* mu) override;
  void solve(double* b) override;

 private:
  Jacobian jacobian_;
  Matrix slopes_;
  std::vector<double> factors_;
  std::vector<Index> pivots_;
};

/// f of the rows that Newton's method solves for, and of those after them, which it leaves out
/// because no rate depends on them: of states and into rates as for `Rates`.
struct ImplicitRates {
  Rates rates;
  Rates others;
  Index solved;  // rows of the first
  std::unique_ptr<ShiftedSystems> systems;
};

class Radau final : public Integrator {
 public:
  /// start: (rows, members), all at one time.
  Radau(ImplicitRates rates, Index rows, Index members, const double* start, double time,
        const Limits& limits);

  Vector state(Index member) const override { return states_.col(member); }

 protected:
  Index step(double end) override;
  void keep(const std::vector<Index>&) override {}

 private:
  void begin(Index which);
  void allow();
  void predict(double h);
  bool solve(Index which, double h, Index& evaluations);
  double error(double h);
  void accept(Index which, double h);

  ImplicitRates of_;
  Matrix states_;  // (rows, members)
  Index current_ = -1;

  // Of the member that moves:
  Vector y_, allowed_, predicted_;  // the last: change of the step
  Matrix z_, before_, w_;           // (rows, 8): stages, those of the last step, systems
  Matrix at_, rates_at_, x_;        // states at the stages, rates there, b or x
  double last_h_ = 0.0, factored_h_ = 0.0;
  double contraction_ = 1.0, left_ = 1.0;  // of an iteration's change: the next, and all after it
  Index iterations_ = 0;
  bool fresh_ = false;  // J is of this step
};

}  // namespace pipedyn
