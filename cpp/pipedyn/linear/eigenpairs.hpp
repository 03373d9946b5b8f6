// SPDX-License-Identifier: MIT
//
// Eigenpairs of P(lambda) = lambda^2 M + lambda C + K at one flow speed, P x = 0 and y^H P = 0: all
// of them at once from matrices, O(dof^3), and how good given ones are. Vectors of several pairs
// are tables (dof, count), row by row.
#pragma once

#include <functional>
#include <vector>

#include "pipedyn/linear/tracking.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

using ComplexTable = std::vector<Complex>;

/// The routines of BLAS and LAPACK that are needed, by address, as SciPy has them: the core is
/// linked with neither. Compared with Eigen's EigenSolver, which has no left vectors, dgeev takes
/// with them 0.6 of the time at 20 rows and a third at 200.
struct Lapack {
  void (*dgemm)(char* trans_a, char* trans_b, int* m, int* n, int* k, double* alpha, double* a,
                int* lda, double* b, int* ldb, double* beta, double* c, int* ldc);
  void (*dgetrf)(int* rows, int* columns, double* a, int* lda, int* pivots, int* info);
  void (*dgetrs)(char* trans, int* n, int* columns, double* lu, int* ldlu, int* pivots, double* b,
                 int* ldb, int* info);
  void (*zgetrf)(int* rows, int* columns, Complex* a, int* lda, int* pivots, int* info);
  void (*zgetrs)(char* trans, int* n, int* columns, Complex* lu, int* ldlu, int* pivots, Complex* b,
                 int* ldb, int* info);
  void (*dgeev)(char* left, char* right, int* n, double* a, int* lda, double* real, double* imag,
                double* vl, int* ldvl, double* vr, int* ldvr, double* work, int* size, int* info);
};

/// Pairs with unit vectors, each table (dof, count), and what else is known of them.
struct Pairs {
  Index count;
  const Complex *values, *right;
  const Complex* left = nullptr;
  const double* residual = nullptr;   // better known than from these vectors
  const Complex* by_speed = nullptr;  // (dP/du) x
};

/// P at one speed.
class Operator {
 public:
  Operator(Index rows, double stiffness_size) : dof(rows), size(stiffness_size) {}
  virtual ~Operator() = default;

  /// M x, C x and K x, one after the other, each (dof, count).
  virtual ComplexTable multiply(const Complex* x, Index count) const = 0;
  /// x = P(value)^-1 x and y = P(value)^-H y, each (dof).
  virtual void solve(Complex value, ComplexTable& x, ComplexTable& y) const = 0;
  /// What rounding of its entries may hide, y^H P x in eps, of each pair: no residual shows it.
  virtual std::vector<double> hidden(const Pairs& pairs) const {
    return std::vector<double>(pairs.count, 0.0);
  }

  const Index dof;
  const double size;  // of K, the elastic stiffness being 1
};

/// mu with x and y, if asked for, of the inverse problem about a shift.
struct Inverse {
  std::vector<Complex> mu;
  ComplexTable right, left;
};

class DenseOperator : public Operator {
 public:
  /// Matrices (dof, dof).
  DenseOperator(const Lapack& lapack, Matrix mass, Matrix velocity, Matrix stiffness, double size);

  ComplexTable multiply(const Complex* x, Index count) const override;
  void solve(Complex value, ComplexTable& x, ComplexTable& y) const override;
  std::vector<double> hidden(const Pairs& pairs) const override;

  /// All of the inverse problem (see `pipedyn.linear.eigensolver`), 2 dof pairs; dof where there is
  /// no term in the velocity, with mu = 1 / (lambda^2 - shift^2). None where P(shift) is singular
  /// or overflows, or the iteration does not end.
  Inverse inverse(double shift, bool velocity_free, bool left, bool right = true) const;

 private:
  /// out = factor x, x and out (dof, columns).
  void times(const Matrix& factor, const double* x, Index columns, double* out) const;

  const Lapack lapack_;
  const Matrix mass_, velocity_, stiffness_;
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

Assessment assess(const Operator& p, const Pairs& pairs);

/// The pair nearest to a good guess, (dof) each, by two-sided Rayleigh quotient iteration.
struct Refined {
  Complex value;
  ComplexTable right, left;
  double residual;  // infinite where the iteration ends with nothing
  int steps;
};

Refined refine(const Operator& p, Refined guess, int most_steps);

/// Growth Re lambda of oscillating pairs by their energy balance, and how far rounding may move it.
struct Growth {
  std::vector<double> rate, error;
};

/// With lambda = sigma + i omega the imaginary part of x^H P x = 0 is
///
///     sigma (2 omega x^H M x + Im x^H C x) = -omega Re x^H C x - Im x^H K x.
///
/// On the right only damping and what the ends do is left, so that rounding is small against it,
/// while that of lambda is eps |lambda|^2. The left vector obeys the same balance; where the two
/// disagree, vectors are not exact.
Growth growth(const Operator& p, const Pairs& pairs);

}  // namespace pipedyn
