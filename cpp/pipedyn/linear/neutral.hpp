// SPDX-License-Identifier: MIT
//
// Which eigenvalues count as lying on the imaginary axis: those whose real part is no larger than
// what rounding may have made of it. How large that is, is decided here; all of pipedyn asks for it
// here, by `Eigenproblem::rounding` or `linear/neutral.py`.
//
// Eigenvalues are computed as lambda = shift + 1 / mu. An eigensolver gives the exact eigenvalues
// of a matrix that differs from the given one by rounding of its norm, for which the largest |mu|
// is taken here. This moves a simple mu by about as much, and lambda by |lambda - shift|^2 times as
// much. Two roots on either side of zero are moved the more, the nearer they are to each other, and
// a double zero by the square root of rounding.
// Source: Golub and Van Loan (2013), Matrix computations, secs. 7.2 and 7.7.
#pragma once

#include "pipedyn/linear/spectrum.hpp"

namespace pipedyn {

/// How far rounding may have moved each of the eigenvalues of one matrix. Where residuals are known
/// (`assessed`), they tell better what cancellation leaves of small eigenvalues, and whether two of
/// these are a double zero; both effects are then left out here. The results are written to
/// `found`.
void rounding_about(const Values& values, double shift, bool assessed, Reals& found);

}  // namespace pipedyn
