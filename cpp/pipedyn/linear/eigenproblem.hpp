// SPDX-License-Identifier: MIT
//
// The spectrum of a model by its matrices, or by products and solves with them: the lowest
// eigenpairs at any size, each with a checked residual.
#pragma once

#include <memory>
#include <optional>

#include "pipedyn/linear/eigenpairs.hpp"

namespace pipedyn {

/// What another route than the operator's knows better, each empty where there is none.
struct Corrections {
  /// Changes all roots found at a speed: some are better known, some not the model's.
  std::function<void(double u, bool velocity_free, Pairs& pairs)> amend;
  /// Residual, uncertainty and slope of a root that it knows better; false if it does not.
  std::function<bool(double u, Pair& pair)> known;
  /// The root next to a guess, if it knows that better; false if it does not.
  std::function<bool(double u, Pair& guess)> refined;
};

class Eigenproblem : public Spectrum {
 public:
  using At = std::function<std::shared_ptr<const Operator>(double u)>;

  /// complete: whether the operators' inverse problems give all roots.
  /// free_at_rest: whether lambda enters only as lambda^2 at u = 0.
  /// statics: whose stiffness is singular where a real root passes zero, and only there; this if
  /// null.
  Eigenproblem(const Traits& traits, At at, bool complete, bool free_at_rest,
               Corrections corrections = {}, std::shared_ptr<Eigenproblem> statics = nullptr);

  /// The `count` roots of least magnitude with right vectors, and with left ones if asked for.
  /// Pairs that fail the check of their residual are refined once; those that fail still are in the
  /// result, as are NaNs where doubles hold no root. Without `high`, modes so high that rounding
  /// explains any residual are left as they are.
  Pairs lowest(double u, Index count, bool left, bool high);
  Assessment assessed(double u, const Pairs& pairs, bool slopes);

  Sample sample(double u, Index count) override;
  Pair refined(double u, const Pair& guess) override;
  Pair null_pair(double u, const Pair& near) override;
  double determinant(double u, const Pair& near) override;

 private:
  const Operator& at(double u);
  std::optional<Pairs> about(double u, double shift, Index count, bool left);
  void mend(double u, Pairs& pairs, bool left, bool high);
  Pair near(double u, const Pair& guess);
  void improve(double u, Pairs& pairs, const Assessment& found, Reals& uncertain);

  const At at_;
  const bool complete_, free_at_rest_;
  const Corrections corrections_;
  const std::shared_ptr<Eigenproblem> statics_;
  std::shared_ptr<const Operator> latest_;
  double latest_speed_ = -1.0;
};

/// M, V, D, K and A of P(lambda, u) = lambda^2 M + lambda (u V + D) + K + a u^2 A.
struct Matrices {
  Matrix mass, velocity, damping, stiffness, flux;
};

/// The operators of a model in matrices. size: of K at rest, as of an operator.
Eigenproblem::At dense_operators(const Lapack& lapack, Matrices matrices, double centrifugal,
                                 double size);

}  // namespace pipedyn
