// SPDX-License-Identifier: MIT
//
// Which eigenvalues count as on the imaginary axis: those whose real part is no larger than what
// rounding may have made of it. Here is how large that is; all of pipedyn asks for it here, by
// `Eigenproblem::rounding` or `linear/neutral.py`.
//
// Eigenvalues are computed as lambda = shift + 1 / mu. An eigensolver answers exactly for a matrix
// that is off by rounding of its norm, for which the largest |mu| stands: it moves a simple mu by
// about as much, and lambda by |lambda - shift|^2 of it. Two roots on either side of zero are
// moved by the more the nearer they are, and a double zero by the square root.
// Source: Golub and Van Loan (2013), Matrix computations, secs. 7.2 and 7.7.
#pragma once

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

/// How far rounding may have moved each of the eigenvalues of one matrix. Where residuals are known
/// (`assessed`), they tell better what cancellation leaves of small eigenvalues and that two of
/// these are a double zero, and both are left out.
Reals rounding_about(const Values& values, double shift, bool assessed);

}  // namespace pipedyn
