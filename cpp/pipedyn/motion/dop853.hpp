// SPDX-License-Identifier: MIT
//
// Motions y' = f(t, y) by an explicit method of order 8 whose steps follow the error, each
// member of a batch with steps of its own; states at given times by dense output of order 7.
// O(rows) a step and member besides 12 evaluations of f, and 3 more where a sample is taken.
#pragma once

#include "pipedyn/motion/integrator.hpp"

namespace pipedyn {

/// The rates at each stage, rows of as many columns as go on.
using Stages = std::vector<Vector>;

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
  void choose_first_steps();
  void measure_errors();
  void control(Index j, double end);
  void interpolate();
  void gather(const Vector& all, const std::vector<Index>& columns, Vector& some) const;

  Rates rates_;
  Vector y_, next_, stage_, steps_, squares5_, squares3_;
  Vector relative_, absolute_;                // `Limits` of each entry
  Stages rate_;                               // 13
  Vector tried_, fifth_, third_, error_, t_;  // by column
  std::vector<char> accepted_;

  struct Dense {  // of the columns that are interpolated
    Vector from, steps, stage, zero;
    Stages rate, terms;
  };
  Dense dense_;
  Interpolant step_;
};

}  // namespace pipedyn
