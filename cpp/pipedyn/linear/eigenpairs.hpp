// SPDX-License-Identifier: MIT
//
// Eigenpairs of P(lambda) = lambda^2 M + lambda C + K at one flow speed, P x = 0 and y^H P = 0: all
// of them at once from matrices, O(dof^3), and how good given ones are.
#pragma once

#include <functional>

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

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

/// Several pairs with unit vectors; `left` (dof, 0) and `residual` (0) where they are not known.
struct Pairs {
  Values values;
  ComplexTable right, left;
  Reals residual;

  Pairs take(const std::vector<Index>& which) const;
};

/// Products with one table of vectors.
struct Products {
  ComplexTable mass, velocity, stiffness;  // M x, C x, K x
};

/// mu of the inverse problem about a shift with x and, if known, y (else (dof, 0)). With
/// lambda = shift + 1/mu and P(shift) = K_s,
///
///     mu [x; z] = [-K_s^-1 ((C + 2 shift M) x + M z); x],
///
/// so the lowest roots are the largest mu and survive rounding, and a singular K does no harm.
/// Where there is no term in the velocity, mu = 1 / (lambda^2 - shift^2), and x alone is the
/// vector.
struct Inverse {
  Values mu;
  ComplexTable right, left;
};

/// P at one speed.
class Operator {
 public:
  /// x = P^-1 x, or P^-H x.
  using Solver = std::function<void(ComplexVector& x, bool adjoint)>;

  Operator(Index rows, double stiffness_size) : dof(rows), size(stiffness_size) {}
  virtual ~Operator() = default;

  virtual Products multiply(const ComplexTable& x) const = 0;
  /// (dP/du) x.
  virtual ComplexTable by_speed(const Values& values, const ComplexTable& x) const = 0;
  virtual Solver factor(Complex value) const = 0;
  /// At least those of the largest |mu| that `count` roots have; none where P(shift) is singular or
  /// overflows, or the iteration does not end.
  virtual Inverse inverse(double shift, bool velocity_free, bool left, Index count) const = 0;
  /// What rounding of its entries may hide, y^H P x in eps, of each pair: no residual shows it.
  virtual Reals hidden(const Pairs& pairs) const { return Reals::Zero(pairs.values.size()); }

  const Index dof;
  const double size;  // of K, the elastic stiffness being 1
};

class DenseOperator : public Operator {
 public:
  /// M, C and K, and the derivatives of C and K by u; each (dof, dof).
  DenseOperator(const Lapack& lapack, Matrix mass, Matrix velocity, Matrix stiffness,
                Matrix velocity_rate, Matrix stiffness_rate, double size);

  Products multiply(const ComplexTable& x) const override;
  ComplexTable by_speed(const Values& values, const ComplexTable& x) const override;
  Solver factor(Complex value) const override;
  /// All of them.
  Inverse inverse(double shift, bool velocity_free, bool left, Index count) const override;
  Reals hidden(const Pairs& pairs) const override;

 private:
  Eigen::MatrixXd times(const Matrix& factor, const Eigen::MatrixXd& x) const;
  ComplexTable times(const Matrix& factor, const ComplexTable& x) const;

  const Lapack lapack_;
  const Matrix mass_, velocity_, stiffness_, velocity_rate_, stiffness_rate_;
};

/// Of each pair, those after the residual only with left vectors.
struct Assessment {
  Reals residual, uncertain;  // as of a `Pair`
  Values slope, correction;   // d lambda / du, if asked for; Newton's of lambda
  Values by_left, by_right;   // y^H (dP/dlambda) x and x^H (dP/dlambda) x
};

/// A residual that is better known than from these vectors is kept.
Assessment assess(const Operator& p, const Pairs& pairs, bool slopes);

/// The pair nearest to a good guess by two-sided Rayleigh quotient iteration, with its residual,
/// which is infinite where the iteration ends with nothing. `steps` grows by those taken.
Pair refine(const Operator& p, const Pair& guess, int& steps);

/// Growth Re lambda of oscillating pairs by their energy balance, and how far rounding may move it.
struct Growth {
  Reals rate, error;
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
