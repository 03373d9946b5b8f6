// SPDX-License-Identifier: MIT
//
// A state with the work done on it, y = [q, q', W], so that an integrator sums W' = power to its
// own order: E(t) - E(0) - W(t) then audits the motion.
#pragma once

#include <vector>

#include "pipedyn/chain/motion.hpp"

namespace pipedyn {

/// dW/dtau (members).
template <class Model>
void total_power(const Model& model, const Batch& batch, double* total) {
  const std::ptrdiff_t members = batch.members;
  thread_local std::vector<double> parts;
  if (parts.size() < static_cast<std::size_t>(4 * members)) parts.resize(4 * members);
  model.power(batch, parts.data());
  for (std::ptrdiff_t j = 0; j < members; ++j) {
    const double* const of = parts.data() + j;
    total[j] = of[0] + of[members] + of[2 * members] + of[3 * members];
  }
}

/// Rates of y = [q, q', W] (2 dof + 1, members) of each member.
template <class Model>
void rhs_and_power(const Model& model, const Batch& batch, double* rates) {
  model.rhs(batch, rates);
  total_power(model, batch, rates + 2 * model.dof() * batch.members);
}

}  // namespace pipedyn
