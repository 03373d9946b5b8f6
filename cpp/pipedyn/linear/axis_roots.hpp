// SPDX-License-Identifier: MIT
//
// Roots on the imaginary axis, from guesses near by: the speed at which one passes, with its error.
#pragma once

#include <functional>
#include <utility>

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

using Function = std::function<double(double)>;

/// Zero of a function with opposite signs at low and high, to a tolerance, by inverse quadratic
/// interpolation where it serves and bisection elsewhere (Chandrupatla 1997).
double zero_between(const Function& f, double low, double high, double tolerance);

/// A root on the imaginary axis by Newton's method from a guess at speed u, or the iterate at which
/// it ends without, as where it leaves the speeds from low to high.
std::pair<double, Pair> newton(Spectrum& spectrum, double u, Pair guess, double low, double high);

/// Of the speed at which a root lies on the axis.
double error_of(const Pair& pair);

}  // namespace pipedyn
