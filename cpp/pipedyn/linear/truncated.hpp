// SPDX-License-Identifier: MIT
//
// The spectrum of a reduced model, compared with that of a model of more functions. Next to each
// root of the smaller model the larger one has a root lambda + d. Newton's method on the
// determinant P' of the larger model, divided by its other roots, gives d to first order:
//
//     d = -1 / (d log det P' / dlambda - sum_k 1 / (lambda - lambda_k)).
//
// Where Re d is small against Re lambda for every root looked at, at every sample, the larger
// model's roots are on the same side of the axis; between samples the search counts d as rounding.
// So the crossings of the smaller model are also those of the larger one, which Newton's method
// finds from them: no search of the larger model is needed.
#pragma once

#include <memory>
#include <optional>

#include "pipedyn/linear/crossings.hpp"
#include "pipedyn/linear/structured.hpp"

namespace pipedyn {

class Truncated : public Spectrum {
 public:
  /// resolved: number of modes looked at, as in `Range`; it is that of the search of the model of
  /// fewer functions.
  Truncated(std::shared_ptr<Structured> fewer, std::shared_ptr<Structured> more, Index resolved)
      : Spectrum(fewer->traits),
        fewer_(std::move(fewer)),
        more_(std::move(more)),
        resolved_(2 * resolved) {}

  void sample(double u, Index roots, Sample& at) override;
  Pair refined(double u, const Pair& guess, bool vectors) override;
  Reals quotients(double u, const Pairs& pairs) override { return fewer_->quotients(u, pairs); }
  Index standing() override { return fewer_->standing(); }
  Spectrum& without_loss() override {
    return traits.is_hysteretic() ? fewer_->without_loss() : *this;
  }
  Divergences divergences(double max_speed, bool first) override {
    return fewer_->divergences(max_speed, first);
  }
  std::optional<Forms> forms(const Pair& pair) const override { return fewer_->forms(pair); }

  /// The crossings that a search of this spectrum found, computed with the larger model. None where
  /// the two models may differ in the number of crossings, or where the larger model has another
  /// number of unstable roots among the `resolved` modes at the speed `end`, at which the search
  /// ends.
  std::optional<Sweep> of_larger(Sweep sweep, double end, Index resolved);

 private:
  std::optional<AxisCrossing> of_larger(const AxisCrossing& crossing);
  int unstable(double u, Index resolved);
  void count_work() { factorised_ += fewer_->factorisations() + more_->factorisations(); }

  std::shared_ptr<Structured> fewer_, more_;
  Index resolved_;     // number of roots looked at
  bool alike_ = true;  // whether each root seen is on one side in both models
  // Memory of a sample: which roots the larger model is asked for, and its answers.
  std::vector<Index> asked_;
  Values at_, missed_;
};

}  // namespace pipedyn
