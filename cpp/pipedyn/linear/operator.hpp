// SPDX-License-Identifier: MIT
//
// P(lambda) = lambda^2 M + lambda C + K of a model at one flow speed: products and solves with it,
// and its inverse problem, which has the lowest roots. K may have an imaginary part i L, of a loss
// factor; the roots do not come in conjugate pairs then.
#pragma once

#include <functional>
#include <memory>
#include <vector>

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
  void (*zgeev)(char* left, char* right, int* n, Complex* a, int* lda, Complex* w, Complex* vl,
                int* ldvl, Complex* vr, int* ldvr, Complex* work, int* size, double* more,
                int* info);
  void (*dsygvd)(int* kind, char* vectors, char* triangle, int* n, double* a, int* lda, double* b,
                 int* ldb, double* w, double* work, int* size, int* integers, int* integers_size,
                 int* info);
};

/// Ascending mu of A x = mu B x, and vectors with x^T B x = 1 where they are asked for.
struct SymmetricPairs {
  Reals values;
  Eigen::MatrixXd vectors;
};

/// Of symmetric A and B; none unless B is definite, with pivots of Cholesky's factor of which the
/// least is at least so large a share of the greatest.
std::optional<SymmetricPairs> symmetric_pairs(const Lapack& lapack, Eigen::MatrixXd a,
                                              Eigen::MatrixXd b, bool vectors, double least_pivot);

/// Number of eigenvalues of a symmetric matrix below zero by more than rounding.
int negative_eigenvalues(const Lapack& lapack, const Eigen::MatrixXd& of);

/// Undamped modes, by rising square of their frequency; vectors (dof, count).
struct Modes {
  Eigen::MatrixXd vectors;
  Reals squares, masses;  // omega^2, and x^T M x of each
};

/// M x, C x and K x.
using Products = std::tuple<ComplexTable, ComplexTable, ComplexTable>;

/// x to P^-1 x, or P^-H x.
using Solver = std::function<ComplexTable(const ComplexTable& x, bool adjoint)>;

/// mu of the inverse problem about a shift with x and, if known, y (else (dof, 0)). With
/// lambda = shift + 1/mu and P(shift) = K_s,
///
///     mu [x; z] = [-K_s^-1 ((C + 2 shift M) x + M z); x],
///
/// so the lowest roots are the largest mu and survive rounding, and a singular K does no harm.
/// Where there is no term in the velocity, mu = 1 / (lambda^2 - shift^2), and x alone is the
/// vector.
using Inverse = std::tuple<Values, ComplexTable, ComplexTable>;

class DenseOperator {
 public:
  /// M, C and K, the derivatives of C and K by u, and L or none; each (dof, dof).
  using Matrices = std::array<Matrix, 6>;

  /// By what rounding matrices may be off: C and K in norm, and all in shares of their entries.
  struct Lost {
    double velocity = 0.0, stiffness = 0.0, entries = eps;
  };

  DenseOperator(const Lapack& known, Matrices matrices, double stiffness_size, Lost by_rounding)
      : dof(matrices[0].rows()),
        size(stiffness_size),
        lost(by_rounding),
        lapack(known),
        matrices_(std::move(matrices)) {}

  Products multiply(const ComplexTable& x) const;
  /// (dP/du) x of each root.
  ComplexTable by_speed(const Values& values, const ComplexTable& x) const;
  Solver factor(Complex value) const;
  /// All of them; none where P(shift) is singular or overflows, or the iteration does not end.
  Inverse inverse(double shift, bool velocity_free, bool left) const {
    return inverse(shift, velocity_free, left ? 'V' : 'N', 'V');
  }
  /// mu alone.
  Values roots(double shift, bool velocity_free) const {
    return std::get<0>(inverse(shift, velocity_free, 'N', 'N'));
  }
  /// Modes of M and K, of a symmetric K; none where no K + s M is definite.
  std::optional<Modes> undamped_modes() const;
  bool is_lossy() const { return matrices_[5].size() > 0; }
  const Matrix& mass() const { return matrices_[0]; }
  const Matrix& velocity() const { return matrices_[1]; }
  const Matrix& velocity_rate() const { return matrices_[3]; }  // dC/du
  const Matrix& stiffness() const { return matrices_[2]; }
  const Matrix& loss() const { return matrices_[5]; }
  const Matrix& stiffness_rate() const { return matrices_[4]; }  // dK/du
  /// lambda^2 M + lambda C + K of other real matrices, by the same routines.
  DenseOperator with(Matrix mass, Matrix velocity, Matrix stiffness) const {
    return {lapack, {std::move(mass), std::move(velocity), std::move(stiffness)}, size, lost};
  }
  /// The matrices B^T M B, B^T C B and so on of motions that are sums of the columns of a basis B.
  DenseOperator within(const Eigen::MatrixXd& basis) const;
  /// What rounding of its entries may hide, y^H P x in eps, of each pair: no residual shows it.
  Reals hidden(const Values& values, const ComplexTable& right, const ComplexTable& left) const;

  const Index dof;
  const double size;  // of K, the elastic stiffness being 1
  const Lost lost;
  const Lapack lapack;

 private:
  /// With those vectors of which 'V' is given, as LAPACK is asked for them.
  Inverse inverse(double shift, bool velocity_free, char left, char right) const {
    return is_lossy() ? inverse_of<Complex>(shift, velocity_free, left, right)
                      : inverse_of<double>(shift, velocity_free, left, right);
  }
  template <class Number>
  Inverse inverse_of(double shift, bool velocity_free, char left, char right) const;
  Eigen::MatrixXd times(const Eigen::Ref<const Matrix>& factor, const Eigen::MatrixXd& x) const;
  ComplexTable times(int matrix, const ComplexTable& x) const;

  const Matrices matrices_;
};

/// P of a model at each speed, in matrices: M, V, D, K, A and L or none of
/// P(lambda, u) = lambda^2 M + lambda (u V + D) + K + i L + a u^2 A.
struct Pencil {
  Lapack lapack;
  DenseOperator::Matrices matrices;
  double centrifugal;               // a
  double size;                      // of K at rest
  std::array<double, 6> lost = {};  // by what rounding each matrix may be off, in norm
  double entries_lost = eps;        // and in shares of its entries

  std::shared_ptr<DenseOperator> operator()(double u) const;
};

}  // namespace pipedyn
