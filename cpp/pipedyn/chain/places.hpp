// SPDX-License-Identifier: MIT
//
// Where the terms of a pipe act on a row of rigid segments. A law at arc length s acts on one
// segment, at an arm from its joint; one per length acts at two Gauss points of each segment, which
// is exact where it is linear in position and velocity. What acts at a place of the fixed base
// moves nothing and is left out.
//
// Local to each translation unit, like vector/pack.hpp.
#pragma once

#include <algorithm>
#include <cmath>

#include "pipedyn/pipe.hpp"
#include "pipedyn/terms/laws.hpp"

namespace {

/// Calls body(law, term, segment, arm, weight) for each place, segments counted from 0. The weight
/// is 1, or the length that a Gauss point stands for. base: length of the fixed part.
template <class Body>
void for_each_place(const pipedyn::Terms& terms, const pipedyn::Vector& length, double base,
                    const Body& body) {
  using pipedyn::Index;
  const Index n = length.size();
  for (const pipedyn::Term& term : terms) {
    Laws::with(term, [&](const auto& law) {
      if (law.along) {
        const double gauss = 0.5 / std::sqrt(3.0);
        for (Index j = 0; j < n; ++j) {
          for (const double point : {0.5 - gauss, 0.5 + gauss}) {
            body(law, term, j, point * length[j], 0.5 * length[j]);
          }
        }
        return;
      }
      if (term.at <= base) return;
      Index j = 0;
      double start = base;
      while (j + 1 < n && term.at > start + length[j]) start += length[j++];
      body(law, term, j, std::min(term.at - start, length[j]), 1.0);
    });
  }
}

}  // namespace
