// SPDX-License-Identifier: MIT
//
// Root loci: branches of eigenvalues as functions of the flow speed.
#pragma once

#include <optional>

#include "pipedyn/linear/tracking.hpp"

namespace pipedyn {

/// Branches at one speed, (count) of each: a root, the other of its pair, and of both whether they
/// passed the check of their residual and how far they may be off.
struct LociRow {
  Values values, partners;
  Flags converged;
  Reals errors;
};

/// The `count` lowest branches at each of increasing speeds, tracked among the `taken` lowest
/// roots; none where one climbs out of these. `report` is called after each sample with the number
/// of rows done, and may throw.
std::optional<std::vector<LociRow>> root_loci(Spectrum& spectrum, const std::vector<double>& speeds,
                                              Index count, Index taken,
                                              const std::function<void(Index rows)>& report);

}  // namespace pipedyn
