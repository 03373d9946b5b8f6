// SPDX-License-Identifier: MIT
#include "pipedyn/linear/loci.hpp"

#include <cmath>
#include <numbers>

namespace pipedyn {

std::optional<std::vector<LociRow>> root_loci(Spectrum& spectrum, const std::vector<double>& speeds,
                                              Index count, Index taken,
                                              const std::function<void(Index rows)>& report) {
  std::vector<LociRow> rows;
  const auto take = [&](double u) {
    auto at = std::make_shared<const Sample>(spectrum.sample(u, taken));
    report(static_cast<Index>(rows.size()));
    return at;
  };
  const SharedSample first = take(speeds[0]);
  const double delta = spectrum.traits.delta;
  const Roots modes = modes_of_pairs(first->values, delta);
  Roots upper(count, -1), lower(count, -1);
  for (Index i = 0; i < first->size(); ++i) {
    const Index branch = modes[i] - 1;
    if (branch < 0 || branch >= count) continue;
    const Index other = std::exchange(upper[branch], i);
    if (other < 0) continue;
    lower[branch] = other;
    if (is_above(first->values[other], first->values[i])) std::swap(upper[branch], lower[branch]);
  }
  for (const Index i : lower) {
    if (i < 0) return {};
  }
  const auto add_row = [&](const Sample& at) {
    LociRow row{Values(count), Values(count), Flags(count), Reals(count)};
    for (Index k = 0; k < count; ++k) {
      const Index i = upper[k], j = lower[k];
      row.values[k] = at.values[i];
      row.partners[k] = at.values[j];
      row.converged[k] = has_converged(at.values[i], at.residual[i]) &&
                         has_converged(at.values[j], at.residual[j]);
      row.errors[k] = std::max(at.uncertain[i], at.uncertain[j]);
    }
    rows.push_back(std::move(row));
  };
  add_row(*first);
  // The cluster begins beyond the last mode asked for: -1 / delta (1 + 1 / (delta omega)^2) there.
  const double number = std::numbers::pi * (static_cast<double>(count) + 0.5);
  const double beyond = std::max(delta * number * number, 1.0);
  const Cluster cluster{delta, 0.5 / (beyond * beyond), spectrum.traits.zero};
  Roots tracked = upper;
  tracked.insert(tracked.end(), lower.begin(), lower.end());
  bool complete = true;

  const auto visit = [&](const Step& step) {
    const Values& there = step.right->values;
    for (Index k = 0; k < count; ++k) {
      Index &up = upper[k], &low = lower[k];
      const bool was_real = step.start(up).imag() == 0.0 && step.start(low).imag() == 0.0;
      const Index onto = step.onto[up], other = step.onto[low];
      complete = complete && onto >= 0 && other >= 0 &&
                 !(taken < 2 * spectrum.traits.dof && step.lost(up));
      if (!complete) return false;
      up = onto;
      low = other;
      // A complex root's partner is its conjugate, whichever root of the cluster that is.
      for (Index i = 0; there[up].imag() != 0.0 && i < there.size(); ++i) {
        if (there[i] != std::conj(there[up])) continue;
        low = i;
        break;
      }
      // A branch that left the upper half plane comes back there.
      if ((was_real || cluster.holds(there[up])) && there[up].imag() < 0.0) std::swap(up, low);
    }
    if (step.right->u == speeds[rows.size()]) add_row(*step.right);
    return true;
  };
  const auto sure = [](const Step&) { return true; };
  track({take, sure, visit, cluster, longest_step}, first, {speeds.begin() + 1, speeds.end()},
        tracked);
  report(static_cast<Index>(rows.size()));
  if (!complete) return {};
  return rows;
}

}  // namespace pipedyn
