// SPDX-License-Identifier: MIT
//
// Integrates y' = f(t, y) by the explicit Runge-Kutta method of order 8 of Dormand and Prince. Each
// member of a batch has its own steps, which follow its error; dense output of order 7 gives states
// at given times. A step of a member costs 12 evaluations of f, 3 more if it contains a sample, and
// O(rows) operations.
#pragma once

#include "pipedyn/motion/integrator.hpp"

namespace pipedyn {

class Dop853 final : public Integrator {
 public:
  /// start: states (rows, members), all at time t0, in their first charts.
  Dop853(Rates rates, Index rows, Index members, const double* start, double time,
         const Limits& limits, std::shared_ptr<Charts> charts = nullptr);

  Vector state(Index member) const override;

 protected:
  Index step(double end) override;
  void keep(const std::vector<Index>& columns) override;

 private:
  using Stages = std::vector<Matrix>;  // rates at each stage

  Index active() const { return static_cast<Index>(which_.size()); }
  void combine(const Stages& of, const double* weights, Index terms, const double* y,
               const Matrix& steps, Matrix& out) const;
  void evaluate(const Matrix& y, Matrix& rates, double share);
  void choose_first_steps();
  void measure_errors();
  void control(Index j, double end);
  void interpolate();
  bool change_charts();

  // Matrices have a column for each member that is advancing.
  Rates rates_;
  Matrix y_, next_, stage_, steps_;
  Matrix absolute_, scale_;   // absolute tolerance of each entry; 1 / the error that it is allowed
  Vector relative_;           // relative tolerance of each column
  Stages rate_;               // rates at the 13 stages
  Vector tried_, error_, t_;  // of each column
  Vector squares_[2];         // of each column: squares of its errors of order 5 and 3
  std::vector<char> accepted_;
  Vector zero_;  // as large as the largest matrix

  struct Dense {                        // dense output of the columns that are interpolated
    std::vector<Index> columns, which;  // of y_, and their members
    Matrix from, steps, stage;
    Stages rate, terms;
  };
  Dense dense_;
  Interpolant step_;
};

}  // namespace pipedyn
