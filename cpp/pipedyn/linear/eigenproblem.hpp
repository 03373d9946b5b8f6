// SPDX-License-Identifier: MIT
//
// The spectrum of a model from its operators P at each speed: the lowest eigenpairs at any size,
// each with a checked residual.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "pipedyn/linear/operator.hpp"

namespace pipedyn {

/// Shifts of the inverse problem: positive, where stable pipes have no eigenvalue. They are tried
/// in turn until every residual passes.
inline constexpr double shifts[] = {0.97, 2.31, 0.41};

/// Most degrees of freedom of a problem solved by dense matrices: LAPACK takes a minute for 4,000
/// rows (measured: 3.4 s for 1,600 rows).
inline constexpr Index dense_limit = 2000;

/// P x and (dP/dlambda) x of one vector, and the sum of the sizes of the terms of P x.
struct Row {
  ComplexVector rest = {}, rate = {};
  double size = 0.0;

  void set(const Products& products, Index i, Complex value, double stiffness_size);
};

/// Memory of the refinement of a pair.
struct Refinement {
  Pair last, best;
  Row row;
};

/// Memory of the work of an operator on vectors.
struct WorkMemory {
  DenseOperator parts, sizes;
  ComplexTable lengths;
  ComplexVector conjugate, by_velocity, by_place;
};

using RealsRef = Eigen::Ref<const Reals>;
using VectorRef = Eigen::Ref<const ComplexVector>;

class Eigenproblem : public Spectrum {
 public:
  /// Writes the operator at a speed.
  using At = std::function<void(double u, DenseOperator& to)>;

  Eigenproblem(const Traits& known, At at) : Spectrum(known), at_(std::move(at)) {}

  const DenseOperator& at(double u);

  /// Finds the `count` roots of least magnitude with right vectors, and with left ones if they are
  /// asked for. Pairs that fail the check of their residual are refined once. Pairs that fail still
  /// are in the result, as are NaNs where a root is beyond double precision. Without `high`, pairs
  /// of modes so high that rounding explains any residual are not refined.
  /// The values, vectors and residuals of `found` are replaced, in its memory.
  virtual void lowest(double u, Index count, bool left, bool high, Pairs& found);
  /// Finds the `count` lowest roots by elimination along the pipe, with vectors or without. Returns
  /// false where roots could not be told from one another, or where some may be missing.
  virtual bool by_recursion(double, Index, bool, Pairs&) { return false; }

  /// The modes that the pipe has at rest without damping (`DenseOperator::undamped_modes`).
  const std::optional<Modes>& modes_at_rest();

  /// Completes pairs: computes the residual, if it is not known, and with left vectors all other
  /// numbers.
  virtual void assess(double u, Pairs& pairs);

  void sample(double u, Index count, Sample& at) override;
  void reuse(Spectrum& other) override;
  Pair refined(double u, const Pair& guess, bool vectors) override;
  Index standing() override { return free_turns().cols(); }
  Reals quotients(double u, const Pairs& pairs) override;
  /// Divergences from one eigenvalue problem in s = u^2, as K = K_0 + s A.
  Divergences divergences(double max_speed, bool first) override;
  /// The divergence within `reach` of a speed; none if there is none, or more than one.
  virtual std::optional<Divergence> divergence_near(double guess, double reach);

 protected:
  bool knows_modes() const { return modes_at_rest_.has_value(); }
  /// Whether lambda enters only as lambda^2 at a speed.
  bool is_squared(double u) const { return traits.squared || (traits.free_at_rest && u == 0.0); }
  /// Sets `noise` to how far rounding may have moved the roots of a sample.
  virtual void find_noise(Pairs& pairs);
  /// Sets `noise` to the errors of roots that follow from their residuals, except for the scatter
  /// of roots that meet.
  static void noise_of_residuals(Pairs& pairs);
  /// Work of the operator P on vectors (dof, r) that oscillate with the given frequencies.
  virtual void rayleigh(double u, const RealsRef& frequencies, const ColumnsRef& vectors,
                        Rayleigh& found);
  /// Replaces Re lambda and its uncertainty by those of the energy balance, where rounding hides
  /// it.
  void improve(double u, Pairs& pairs, Reals& uncertain);
  /// Improves Re lambda of the roots of a sample, and their noise, by the energy balance.
  virtual void find_growth(double u, Pairs& pairs) { improve(u, pairs, pairs.noise); }

 private:
  /// Memory that samples use one after the other.
  struct Memory {
    DenseOperator latest;
    Pairs pairs, one;  // about a shift; a refined root
    Values roots, before;
    std::vector<Index> order, hidden;
    Reals reals;
    ComplexTable right, left;
    std::array<Rayleigh, 2> forms;
    WorkMemory work;
    Refinement refined;
  };

  Memory& dense() { return dense_ ? *dense_ : *(dense_ = std::make_unique<Memory>()); }
  bool about(double u, double shift, Index count, bool left);
  void mend(double u, Pairs& pairs, bool left, bool high);
  void leave_axis(Pairs& pairs);
  void find_residuals(double u, Pairs& pairs);
  const Pair& near(double u, Complex value, const VectorRef& right);
  Pair null_pair(double u, const Pair& near, double& inertia);
  const Matrix& free_turns();
  std::vector<Divergence> divergences_beside(const Matrix& turns, double max_speed);
  Values singular_squares(const DenseOperator& one, const Matrix& at_rest, const Matrix& flux,
                          bool symmetric) const;

  const At at_;
  std::optional<Matrix> free_turns_;                   // computed when first asked for
  std::optional<std::optional<Modes>> modes_at_rest_;  // computed when first asked for
  static constexpr double no_speed = -1.0;
  double latest_speed_ = no_speed;  // of `latest`
  std::unique_ptr<Memory> dense_;   // made when first asked for
};

}  // namespace pipedyn
