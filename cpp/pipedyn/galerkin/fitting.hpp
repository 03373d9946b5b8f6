// SPDX-License-Identifier: MIT
#pragma once

#include <vector>

namespace pipedyn {

/// What is fixed to the pipe at one arc length: a point mass, with its weight, and a spring to the
/// axis, whose force -stiffness x acts along x alone.
struct Fitting {
  double at;         // arc length, 0 < at <= 1
  double mass;       // in the pipe's whole mass
  double stiffness;  // in EI / L^3
};

using Fittings = std::vector<Fitting>;

}  // namespace pipedyn
