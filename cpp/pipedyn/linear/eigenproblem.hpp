// SPDX-License-Identifier: MIT
//
// The spectrum of a model by its operators at each speed: the lowest eigenpairs at any size, each
// with a checked residual.
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "pipedyn/linear/operator.hpp"

namespace pipedyn {

/// Positive, where stable pipes have no eigenvalue; tried in turn until every residual passes.
inline constexpr double shifts[] = {0.97, 2.31, 0.41};

/// Most degrees of freedom of a problem solved dense: 4,000 rows take LAPACK a minute (measured:
/// 1,600 rows 3.4 s).
inline constexpr Index dense_limit = 2000;

class Eigenproblem : public Spectrum {
 public:
  using At = std::function<std::shared_ptr<DenseOperator>(double u)>;

  Eigenproblem(const Traits& known, At at) : Spectrum(known), at_(std::move(at)) {}

  const DenseOperator& at(double u);

  /// The `count` roots of least magnitude with right vectors, and with left ones if asked for.
  /// Pairs that fail the check of their residual are refined once; those that fail still are in the
  /// result, as are NaNs where doubles hold no root. Without `high`, modes so high that rounding
  /// explains any residual are left as they are.
  virtual Pairs lowest(double u, Index count, bool left, bool high);
  /// The same of a chain, with vectors or without; none where roots could not be told from one
  /// another, or where some may be missing.
  virtual std::optional<Pairs> by_recursion(double, Index, bool) { return {}; }

  /// The modes that the pipe has at rest without damping, see `DenseOperator::undamped_modes`.
  const std::optional<Modes>& modes_at_rest();

  /// Finds what is not known of pairs: the residual, and with left vectors all else.
  virtual void assess(double u, Pairs& pairs);

  Sample sample(double u, Index count) override;
  Pair refined(double u, const Pair& guess) override;
  Index standing() override { return free_turns().cols(); }
  Reals quotients(double u, const Pairs& pairs) override;
  /// From one eigenvalue problem in s = u^2, as K = K_0 + s A.
  Divergences divergences(double max_speed, bool first) override;
  /// The divergence within so much of a speed, if there is one alone.
  virtual std::optional<Divergence> divergence_near(double guess, double reach);

 protected:
  bool knows_modes() const { return modes_at_rest_.has_value(); }
  /// Whether lambda enters only as lambda^2 at a speed.
  bool is_squared(double u) const { return traits.squared || (traits.free_at_rest && u == 0.0); }
  /// How far rounding may have moved the roots of a sample.
  virtual Reals rounding(const Pairs& pairs) const;
  /// How far residuals say that roots may be off, but for what those that meet scatter by.
  static Reals told_by_residuals(const Pairs& pairs);
  /// The work on vectors of some frequencies.
  virtual Works works(double u, const Reals& frequencies, const ComplexTable& vectors);
  /// Re lambda and its uncertainty by the energy balance, where rounding hides it.
  void improve(double u, Pairs& pairs, Reals& uncertain);
  /// The same of a sample's roots.
  virtual void find_growth(double u, Pairs& pairs) { improve(u, pairs, pairs.noise); }

 private:
  std::optional<Pairs> about(double u, double shift, Index count, bool left);
  void mend(double u, Pairs& pairs, bool left, bool high);
  void leave_axis(Pairs& pairs);
  Pair near(double u, const Pair& guess);
  Pair null_pair(double u, const Pair& near, double& inertia);
  const Matrix& free_turns();
  std::vector<Divergence> divergences_beside(const Matrix& turns, double max_speed);
  Values singular_squares(const DenseOperator& one, const Matrix& still, const Matrix& flux,
                          bool symmetric) const;

  const At at_;
  std::optional<Matrix> free_turns_;                   // once they are asked for
  std::optional<std::optional<Modes>> modes_at_rest_;  // the same
  std::shared_ptr<DenseOperator> latest_;
  double latest_speed_ = -1.0;
};

}  // namespace pipedyn
