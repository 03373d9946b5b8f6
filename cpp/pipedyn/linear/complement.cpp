// SPDX-License-Identifier: MIT
#include "pipedyn/linear/complement.hpp"

#include <Eigen/QR>

namespace pipedyn {

Complement::Complement(const Eigen::MatrixXd& columns) : packed_(columns) {
  if (columns.cols() == 0) return;
  const Eigen::HouseholderQR<Eigen::MatrixXd> reflections(columns);
  packed_ = reflections.matrixQR();
  factors_ = reflections.hCoeffs();
}

Matrix Complement::spread(const Matrix& z) const {
  if (packed_.cols() == 0) return z;
  Matrix x = Matrix::Zero(size(), z.cols());
  x.bottomRows(dof()) = z;
  x.applyOnTheLeft(Eigen::householderSequence(packed_, factors_));
  return x;
}

Matrix Complement::gathered(Matrix x) const {
  if (packed_.cols() == 0) return x;
  x.applyOnTheLeft(Eigen::householderSequence(packed_, factors_).transpose());
  return x.bottomRows(dof());
}

ComplexTable Complement::gathered(const ComplexTable& x) const {
  if (packed_.cols() == 0) return x;
  ComplexTable z(dof(), x.cols());
  z.real() = gathered(Matrix(x.real()));
  z.imag() = gathered(Matrix(x.imag()));
  return z;
}

}  // namespace pipedyn
