// SPDX-License-Identifier: MIT
//
// Motions y' = f(t, y) by an explicit method of order 8 whose steps follow the error, each
// member of a batch with steps of its own; states at given times by dense output of order 7.
// O(rows) a step and member besides 12 evaluations of f, and 3 more where a sample is taken.
#pragma once

#include "pipedyn/motion/integrator.hpp"

namespace pipedyn {

class Dop853 final : public Integrator {
 public:
  /// start: (rows, members), all at one time.
  Dop853(Rates rates, Index rows, Index members, const double* start, double time,
         const Limits& limits);

  Vector state(Index member) const override;

 protected:
  Index step(double end) override;
  void keep(const std::vector<Index>& columns) override;

 private:
  Index active() const { return static_cast<Index>(which_.size()); }
  Index entries() const { return rows_ * active(); }
  void evaluate(const Vector& y, Vector& rates, double share);
  void combine(const double* weights, Index terms, const Vector& y, Vector& out);
  void choose_first_steps();
  void measure_errors();
  void control(Index j, double end);
  void interpolate();

  Vector y_, next_, stage_, steps_, scaled5_, scaled3_;  // rows of active() columns
  std::vector<Vector> rate_;                             // of the 13 stages
  Vector tried_, error_, t_;                             // by column
  std::vector<char> accepted_;
};

}  // namespace pipedyn
