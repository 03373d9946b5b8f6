// SPDX-License-Identifier: MIT
//
// Roots on the imaginary axis, from guesses near by: the speed at which a root passes the axis,
// with the error of that speed.
#pragma once

#include <functional>
#include <utility>

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

using Function = std::function<double(double)>;

/// Zero of a function that has opposite signs at low and high, to within a tolerance: by inverse
/// quadratic interpolation where that converges fast, and by bisection elsewhere (Chandrupatla
/// 1997).
double zero_between(const Function& f, double low, double high, double tolerance);

/// The speed at which a root lies on the imaginary axis, and the root there, by Newton's method
/// from a guess at speed u. Where the method does not converge, or leaves the speeds from low to
/// high, its last iterate is returned.
std::pair<double, Pair> newton(Spectrum& spectrum, double u, Pair guess, double low, double high);

/// Absolute error of the speed at which a root lies on the axis.
double error_of(const Pair& pair);

}  // namespace pipedyn
