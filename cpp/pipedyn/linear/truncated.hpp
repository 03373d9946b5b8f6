// SPDX-License-Identifier: MIT
//
// The spectrum of a reduced model, held against one of more functions, its own among them.
// To first order in the coupling to the others the larger model has the roots
//
//     lambda + d,   d = y^H P_12 P_22^-1 P_21 x / y^H P' x
//
// (Schur complement; measured on pipes from beta = 1e-6 to 0.99, d is within 3 % of the difference
// where that is 2e-3 of lambda, and within a third at 5e-2). Where Re d is small against Re
// lambda of every root looked at, at every sample, the larger model's roots are on the same side of
// the axis, and between samples the search counts d as rounding. So crossings of the one are those
// of the other, which Newton's method finds from them: no search of the larger model is needed.
#pragma once

#include <memory>
#include <optional>

#include "pipedyn/linear/crossings.hpp"
#include "pipedyn/linear/eigenproblem.hpp"

namespace pipedyn {

class Truncated : public Spectrum {
 public:
  /// shared: where the larger model has the functions of the other; resolved: as of a `Range`,
  /// of the model of fewer functions.
  Truncated(std::shared_ptr<Eigenproblem> fewer, std::shared_ptr<Eigenproblem> more,
            std::vector<Index> shared, Index resolved)
      : Spectrum(fewer->traits),
        fewer_(std::move(fewer)),
        more_(std::move(more)),
        shared_(std::move(shared)),
        resolved_(2 * resolved) {}

  Sample sample(double u, Index count) override;
  Pair refined(double u, const Pair& guess) override;
  Reals quotients(double u, const Pairs& pairs) override { return fewer_->quotients(u, pairs); }
  Index standing() override { return fewer_->standing(); }
  Spectrum& without_loss() override { return traits.lossy() ? fewer_->without_loss() : *this; }
  Divergences divergences(double max_speed) override;

  /// The crossings of a search of this spectrum as the larger model has them; none where they may
  /// differ in number, and where that model has not as many unstable roots, of so many resolved
  /// modes, at the end of the search.
  std::optional<Sweep> of_larger(Sweep sweep, double end, Index resolved);

 private:
  std::optional<AxisCrossing> of_larger(const AxisCrossing& crossing);
  int unstable(double u, Index resolved);
  void count() { factorised_ += fewer_->factorisations() + more_->factorisations(); }

  std::shared_ptr<Eigenproblem> fewer_, more_;
  std::vector<Index> shared_;
  Index resolved_;           // roots
  bool alike_ = true;        // whether all roots seen are on the same side in both
  Divergences divergences_;  // of the larger model
};

}  // namespace pipedyn
