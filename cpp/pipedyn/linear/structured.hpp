// SPDX-License-Identifier: MIT
//
// Roots of a determinant that is eliminated along the pipe (determinant.hpp), in O(dof) for each
// root.
//
// Starts are LAPACK's roots, or those of a coarser model if few roots of a long chain or a large
// basis are wanted; next to speeds whose roots are known, they are cubics through these. All roots
// are corrected at once by the method of Ehrlich and Aberth, which is Newton's on the determinant
// divided by the factors (lambda - lambda_k) of the other roots,
//   1 / (d log det P / dlambda - sum_k 1 / (lambda - lambda_k)),
// so that no two end at one root. The same expression, less the root itself, checks that no root is
// missing: it vanishes if all roots are there, and its mean over a circle, times lambda, is the
// number of missing roots inside. Roots that are zero by structure, where nothing holds a joint,
// are counted by the power of lambda in the determinant and are exact. Roots that fail a check are
// computed from matrices, up to 2,000 degrees of freedom.
#pragma once

#include <optional>

#include "pipedyn/linear/determinant_roots.hpp"

namespace pipedyn {

class Structured : public Eigenproblem {
 public:
  /// stiffness_size: size of K at rest, in elastic coordinates.
  Structured(const Traits& traits, std::shared_ptr<const Determinant> of, double stiffness_size);

  void lowest(double u, Index count, bool left, bool high, Pairs& found) override;
  bool by_recursion(double u, Index count, bool vectors, Pairs& found) override;
  /// Roots as `by_recursion` gives them, from the known roots of the nearest speed.
  bool from_known(double u, Index count, bool vectors, Pairs& found);
  /// Writes d log det P / dlambda - sum_k 1 / (lambda - lambda_k) over known roots, without those
  /// at lambda itself.
  void log_derivatives(double u, const ValuesRef& at, const ValuesRef& known,
                       Eigen::Ref<Values> found) const {
    of_->log_derivatives(u, at, known, found);
  }
  /// Takes the roots of a nearly equal model as starts at a speed.
  void assume(double u, const Values& roots);
  void assess(double u, Pairs& pairs) override;
  std::optional<Forms> forms(const Pair& pair) const override;
  Index standing() override { return zeros_in_flow_; }
  Pair refined(double u, const Pair& guess, bool vectors) override;
  Reals quotients(double u, const Pairs& pairs) override;
  /// Divergences by a search that is certified: the zeros of the determinant in a disc are counted
  /// by its log-derivative on the circle, in O(n) for each point.
  Divergences divergences(double max_speed, bool first) override;
  std::optional<Divergence> divergence_near(double guess, double reach) override;
  std::vector<double> numbers() const override;
  bool all_roots(double u, Values& roots) override;
  void reuse(Spectrum& other) override;

 protected:
  void find_noise(Pairs& pairs) override { noise_of_residuals(pairs); }
  void rayleigh(double u, const RealsRef& frequencies, const ColumnsRef& vectors,
                Rayleigh& found) override;
  void find_growth(double u, Pairs& pairs) override;

 private:
  const std::shared_ptr<const Determinant> of_;
  const Index zeros_at_rest_, zeros_in_flow_;

  struct Known {
    double u = infinite;  // where no roots are known
    Approximations roots = {};
    int most = 0;  // most corrections that take them to another speed
  };

  /// Memory that samples use one after the other.
  struct Memory : RootsMemory {
    // Roots of the last samples: steps are halved from the right, and go on from there.
    std::vector<Known> samples = std::vector<Known>(8);
    Approximations starts;
    Pairs refined, again, one;  // all roots, poor ones that are computed once more, a single one
    Values values;
    std::vector<Complex> both;  // roots and the conjugates that they imply
    std::vector<Index> some, from, which, poor;
  };
  mutable Memory memory_;

  const Known* nearest_known(double u) const;
  /// Keeps roots in place of the oldest, whose memory it leaves there.
  void keep(double u, Approximations& roots, int most);
  /// Takes starts to roots, which it keeps.
  bool from(Approximations& starts, double u, Index count, bool vectors, int most_corrections,
            Pairs& found);
  bool with_conjugates(const Approximations& roots, Index count, Pairs& found) const;
  Pairs at(double u, const ValuesRef& values, bool vectors) const;
  void at(double u, const ValuesRef& values, bool vectors, Pairs& found,
          const std::vector<Index>& places = {}) const;
  void refine_roots(double u, const Approximations& roots, bool vectors, Pairs& found) const;
  Index roots_at_zero(double u) const { return u == 0.0 ? zeros_at_rest_ : zeros_in_flow_; }
  /// Approximate roots of an operator at a speed, from its undamped modes if these are known.
  Approximations starts_of(const DenseOperator& p, double u,
                           const std::optional<Modes>& modes) const;
  void balance(double u, Pairs& pairs);
  /// A range of speeds, with the sign of det K at its ends and the number of its zeros in the
  /// range.
  struct Bracket {
    double low, high, before, after;
    int zeros = 0;
  };
  StaticDeterminants static_determinants(Reals u) const;
  void isolate(const Bracket& range, bool first, std::vector<Bracket>& found) const;
  double zero_in(const Bracket& range) const;
  Divergence divergence_at(double u) const;
  bool has_lowest(double u, const Approximations& roots, std::size_t least) const;
};

}  // namespace pipedyn
