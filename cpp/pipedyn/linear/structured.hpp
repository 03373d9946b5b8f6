// SPDX-License-Identifier: MIT
//
// Roots of a determinant that is eliminated along the pipe (determinant.hpp), O(dof) for one of
// them.
//
// Starts are LAPACK's roots, or for few of a long chain or a large basis those of a coarser one;
// beside speeds whose roots are known, cubics through these. All are corrected at once by the
// method of Ehrlich and Aberth, Newton's on what the others leave of the determinant,
//   1 / (d log det P / dlambda - sum_k 1 / (lambda - lambda_k)),
// so that no two end on one root. That none is missing is checked by the same expression without
// the root itself: it vanishes if all roots are there, and its mean over a circle, times lambda,
// is the number of those missing inside. Roots that are zero by structure, where nothing holds a
// joint, are counted by the power of lambda in the determinant and are exact. What fails a check is
// solved by matrices, up to 2,000 degrees of freedom.
#pragma once

#include <optional>

#include "pipedyn/linear/determinant_roots.hpp"

namespace pipedyn {

class Structured : public Eigenproblem {
 public:
  /// stiffness_size: of K at rest, in elastic coordinates.
  Structured(const Traits& traits, std::shared_ptr<const Determinant> of, double stiffness_size);

  Pairs lowest(double u, Index count, bool left, bool high) override;
  std::optional<Pairs> by_recursion(double u, Index count, bool vectors) override;
  /// As `by_recursion`, from the known roots nearest by or, of so many halvings of the way to them,
  /// from those found so at its middle.
  std::optional<Pairs> from_known(double u, Index count, bool vectors, int halvings);
  /// d log det P / dlambda - sum_k 1 / (lambda - lambda_k), but for known roots k at lambda itself.
  Values log_derivatives(double u, const Values& at, const Values& known = {}) const {
    return of_->log_derivatives(u, at, known);
  }
  /// Takes roots of a model that is nearly the same as starts at a speed.
  void assume(double u, const Values& roots);
  void assess(double u, Pairs& pairs) override;
  void share(const Spectrum& other) override;
  std::optional<Forms> forms(const Pair& pair) const override;
  Index standing() override { return zeros_in_flow_; }
  std::optional<Sample> near(double u, const Sample& from) override;
  Pair refined(double u, const Pair& guess) override;
  Reals quotients(double u, const Pairs& pairs) override;
  /// By a search that is certified: the determinant's zeros in a disc are counted by its
  /// log-derivative on the circle, O(n) a point.
  Divergences divergences(double max_speed, bool first) override;
  std::optional<Divergence> divergence_near(double guess, double reach) override;

 protected:
  Reals rounding(const Pairs& pairs) const override;
  Works works(double u, const Reals& frequencies, const ComplexTable& vectors) override;
  void find_growth(double u, Pairs& pairs) override;

 private:
  const std::shared_ptr<const Determinant> of_;
  const Index zeros_at_rest_, zeros_in_flow_;

  struct Known {
    double u;
    Approximations roots;
    int most;  // corrections that make them roots at another speed
  };
  std::vector<Known> known_;       // of the last samples
  Approximations starts_at_rest_;  // once known

  std::optional<Pairs> from(Approximations starts, double u, Index count, bool vectors,
                            int most_corrections);
  Pairs at(double u, const Values& values, bool vectors) const;
  Pairs polished(double u, const Approximations& roots, bool vectors) const;
  Index roots_at_zero(double u) const { return u == 0.0 ? zeros_at_rest_ : zeros_in_flow_; }
  Approximations dense_starts(double u, Index wanted);
  void balance(double u, Pairs& pairs);
  /// Roots by matrices of this determinant or a coarser one.
  Approximations starts_of(const Determinant& of, double u) const;
  /// A range of speeds with the sign of det K at its ends, and how many zeros it has.
  struct Bracket {
    double low, high, before, after;
    int zeros = 0;
  };
  Stills still(Reals u) const;
  double determinant(double u) const;
  void isolate(const Bracket& range, bool first, std::vector<Bracket>& found) const;
  Reals zeros_in(const std::vector<Bracket>& ranges) const;
  Divergence divergence_at(double u) const;
  std::optional<Approximations> missing_within(double u, const Approximations& roots,
                                               std::size_t least) const;
};

}  // namespace pipedyn
