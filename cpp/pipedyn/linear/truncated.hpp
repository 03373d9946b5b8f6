// SPDX-License-Identifier: MIT
//
// The spectrum of a reduced model, held against that of one of more functions. Next to a root of
// the one the other has a root lambda + d, and Newton's method on what its other roots leave of the
// determinant makes d to first order:
//
//     d = -1 / (d log det P' / dlambda - sum_k 1 / (lambda - lambda_k)).
//
// Where Re d is small against Re lambda of every root looked at, at every sample, the larger
// model's roots are on the same side of the axis, and between samples the search counts d as
// rounding. So crossings of the one are those of the other, which Newton's method finds from them:
// no search of the larger model is needed.
#pragma once

#include <memory>
#include <optional>

#include "pipedyn/linear/crossings.hpp"
#include "pipedyn/linear/structured.hpp"

namespace pipedyn {

class Truncated : public Spectrum {
 public:
  /// resolved: as of a `Range`, of the model of fewer functions.
  Truncated(std::shared_ptr<Structured> fewer, std::shared_ptr<Structured> more, Index resolved)
      : Spectrum(fewer->traits),
        fewer_(std::move(fewer)),
        more_(std::move(more)),
        resolved_(2 * resolved) {}

  Sample sample(double u, Index count) override;
  std::optional<Sample> near(double u, const Sample& from) override {
    return fewer_->near(u, from);
  }
  Pair refined(double u, const Pair& guess) override;
  Reals quotients(double u, const Pairs& pairs) override { return fewer_->quotients(u, pairs); }
  Index standing() override { return fewer_->standing(); }
  Spectrum& without_loss() override { return traits.lossy() ? fewer_->without_loss() : *this; }
  Divergences divergences(double max_speed, bool first) override {
    return fewer_->divergences(max_speed, first);
  }
  std::optional<Forms> forms(const Pair& pair) const override { return fewer_->forms(pair); }

  /// The crossings of a search of this spectrum as the larger model has them; none where they may
  /// differ in number, and where that model has not as many unstable roots, of so many resolved
  /// modes, at the end of the search.
  std::optional<Sweep> of_larger(Sweep sweep, double end, Index resolved);

 private:
  std::optional<AxisCrossing> of_larger(const AxisCrossing& crossing);
  int unstable(double u, Index resolved);
  void count() { factorised_ += fewer_->factorisations() + more_->factorisations(); }

  std::shared_ptr<Structured> fewer_, more_;
  Index resolved_;     // roots
  bool alike_ = true;  // whether all roots seen are on the same side in both
};

}  // namespace pipedyn
