// SPDX-License-Identifier: MIT
//
// Eigenpairs of P(lambda) = lambda^2 M + lambda C + K at one flow speed, P x = 0 and y^H P = 0: all
// of them at once from matrices, O(dof^3), and how good given ones are. Vectors of several pairs
// are tables (dof, count), row by row.
#pragma once

#include <complex>
#include <vector>

#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Complex = std::complex<double>;
using ComplexTable = std::vector<Complex>;

/// The routines of LAPACK that are needed, by address, as SciPy has them: the core is linked with
/// no LAPACK. Measured beside Eigen's EigenSolver, dgeev takes half of the time at 20 rows and a
/// third at 200, with left vectors, which that does not have.
struct Lapack {
  void (*dgetrf)(int* rows, int* columns, double* a, int* lda, int* pivots, int* info);
  void (*dgetrs)(char* trans, int* n, int* columns, double* lu, int* ldlu, int* pivots, double* b,
                 int* ldb, int* info);
  void (*dgeev)(char* left, char* right, int* n, double* a, int* lda, double* real, double* imag,
                double* vl, int* ldvl, double* vr, int* ldvr, double* work, int* size, int* info);
};

/// The matrices of P, each (dof, dof).
struct Quadratic {
  Eigen::Map<const Matrix> mass, velocity, stiffness;
};

/// mu with x, and y if asked for, of the inverse problem about a shift.
struct Inverse {
  std::vector<Complex> mu;
  ComplexTable right, left;
};

/// All of the inverse problem (see `pipedyn.linear.eigensolver`), 2 dof pairs; dof where there is
/// no term in the velocity, with mu = 1 / (lambda^2 - shift^2). None where P(shift) is singular or
/// overflows, or the iteration does not end.
Inverse inverse(const Lapack& lapack, const Quadratic& p, double shift, bool velocity_free,
                bool left);

/// Pairs with unit vectors, each table (dof, count), and what else is known of them.
struct Pairs {
  Index dof, count;
  const Complex *values, *right;
  const Complex* left;      // or null
  const Complex* by_speed;  // (dP/du) x, or null
  const double* residual;   // better known than from these vectors, or null
  double size;              // of K, the elastic stiffness being 1
};

/// M x, C x and K x, each (dof, count), and what rounding of the matrices themselves may hide, in
/// eps (count), or null.
struct Products {
  const Complex *mass, *velocity, *stiffness;
  const double* formed;
};

/// Of each pair, those after the residual only with left vectors.
struct Assessment {
  std::vector<double> residual;     // |P x| / (|lambda^2 M x| + |lambda C x| + size |x|)
  std::vector<double> uncertain;    // how far residual and rounding may have moved lambda
  std::vector<Complex> slope;       // d lambda / du; 0 without by_speed
  std::vector<Complex> correction;  // Newton's, of lambda
  std::vector<Complex> by_left;     // y^H (dP/dlambda) x
  std::vector<Complex> by_right;    // x^H (dP/dlambda) x
};

Assessment assess(const Pairs& pairs, const Products& products);
Assessment assess(const Pairs& pairs, const Quadratic& p);

}  // namespace pipedyn
