// SPDX-License-Identifier: MIT
//
// P(lambda) = lambda^2 M + lambda C + K of a model at one flow speed: products with it, solutions
// of linear systems with it, and its inverse problem, whose largest eigenvalues give the lowest
// roots. With a loss factor K has an imaginary part i L; the roots then do not come in conjugate
// pairs.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "pipedyn/linear/spectrum.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

/// The routines of BLAS and LAPACK that are needed, by their addresses in SciPy: the core is linked
/// with neither library. With left vectors dgeev takes 0.6 of the time of Eigen's EigenSolver,
/// which has none, at 20 rows, and a third of it at 200.
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
  void (*dggev)(char* left, char* right, int* n, double* a, int* lda, double* b, int* ldb,
                double* real, double* imag, double* below, double* vl, int* ldvl, double* vr,
                int* ldvr, double* work, int* size, int* info);
  void (*zgeev)(char* left, char* right, int* n, Complex* a, int* lda, Complex* w, Complex* vl,
                int* ldvl, Complex* vr, int* ldvr, Complex* work, int* size, double* more,
                int* info);
  void (*dsygvd)(int* kind, char* vectors, char* triangle, int* n, double* a, int* lda, double* b,
                 int* ldb, double* w, double* work, int* size, int* integers, int* integers_size,
                 int* info);
};

/// Eigenvalues mu of A x = mu B x in ascending order, and vectors with x^T B x = 1 where they are
/// asked for.
struct SymmetricPairs {
  Reals values;
  Eigen::MatrixXd vectors;
};

/// Eigenpairs of symmetric A and B. None unless B is definite, and the least pivot of its Cholesky
/// factor is greater than `least_pivot` times the greatest.
std::optional<SymmetricPairs> symmetric_pairs(const Lapack& lapack, Eigen::MatrixXd a,
                                              Eigen::MatrixXd b, bool vectors, double least_pivot);

/// Eigenvalues mu of A x = mu B x, not finite where B x = 0; not a number if they are not found.
Values general_values(const Lapack& lapack, Eigen::MatrixXd a, Eigen::MatrixXd b);

/// Number of eigenvalues of a symmetric matrix that are below zero by more than rounding.
int negative_eigenvalues(const Lapack& lapack, const Eigen::MatrixXd& of);

/// The columns of a complex table as a real linear map takes them, which is called with their real
/// parts, followed by their imaginary parts.
template <class Map>
ComplexTable mapped(const Map& map, const ComplexTable& x) {
  Eigen::MatrixXd parts(x.rows(), 2 * x.cols());
  parts << x.real(), x.imag();
  const Eigen::MatrixXd found = map(parts);
  ComplexTable result(found.rows(), x.cols());
  result.real() = found.leftCols(x.cols());
  result.imag() = found.rightCols(x.cols());
  return result;
}

/// Undamped modes in the order of rising squares of their frequencies; vectors (dof, count).
struct Modes {
  Eigen::MatrixXd vectors;
  Reals squares, masses;  // omega^2 and x^T M x of each mode
};

/// The products M x, C x and K x.
using Products = std::tuple<ComplexTable, ComplexTable, ComplexTable>;

/// A function that takes x to P^-1 x, or to P^-H x (adjoint).
using Solver = std::function<ComplexTable(const ComplexTable& x, bool adjoint)>;

/// Eigenvalues mu of the inverse problem about a shift, with right vectors x and, if they are
/// known, left vectors y (else a table (dof, 0)). With lambda = shift + 1/mu and P(shift) = K_s,
///
///     mu [x; z] = [-K_s^-1 ((C + 2 shift M) x + M z); x],
///
/// so the lowest roots are the largest mu and survive rounding, and a singular K does no harm.
/// Where P has no term in lambda, mu = 1 / (lambda^2 - shift^2), and x alone is the vector.
using Inverse = std::tuple<Values, ComplexTable, ComplexTable>;

class DenseOperator {
 public:
  /// M, C and K, the derivatives of C and K by u, and L, which is empty without a loss factor; each
  /// is (dof, dof).
  using Matrices = std::array<Matrix, 6>;

  /// Errors of the matrices by rounding: those of C and K in norm, and that of every entry of a
  /// matrix relative to the entry.
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
  /// (dP/du) x for each root and its vector x.
  ComplexTable by_speed(const Values& values, const ComplexTable& x) const;
  Solver factor(Complex value) const;
  /// All eigenpairs of the inverse problem, with right vectors, and left ones where `left` is 'V',
  /// else 'N'; none where P(shift) is singular or overflows, or where the iteration does not
  /// converge.
  Inverse inverse(double shift, bool velocity_free, char left, char right = 'V') const;
  /// Eigenvalues mu of the inverse problem, without vectors.
  Values roots(double shift, bool velocity_free) const {
    return std::get<0>(inverse(shift, velocity_free, 'N', 'N'));
  }
  /// Undamped modes of M and K, for a symmetric K; none where K + s M is definite for no s.
  std::optional<Modes> undamped_modes() const;
  bool is_hysteretic() const { return matrices_[5].size() > 0; }
  const Matrix& mass() const { return matrices_[0]; }
  const Matrix& velocity() const { return matrices_[1]; }
  const Matrix& velocity_rate() const { return matrices_[3]; }  // dC/du
  const Matrix& stiffness() const { return matrices_[2]; }
  const Matrix& hysteretic() const { return matrices_[5]; }
  const Matrix& stiffness_rate() const { return matrices_[4]; }  // dK/du
  /// The operator lambda^2 M + lambda C + K of other real matrices, which uses the same routines.
  DenseOperator with(Matrix mass, Matrix velocity, Matrix stiffness) const {
    return {lapack, {std::move(mass), std::move(velocity), std::move(stiffness)}, size, lost};
  }
  /// The operator with matrices B^T M B, B^T C B and so on, for motions that are sums of the first
  /// columns of a basis B, `some` at most.
  DenseOperator within(const Eigen::MatrixXd& basis, Index some) const;
  /// Error of y^H P x, in units of eps, that rounding of the entries of P may cause, for each pair:
  /// no residual shows it.
  Reals hidden(const Values& values, const ComplexTable& right, const ComplexTable& left) const;

  const Index dof;
  const double size;  // size of K, relative to the elastic stiffness
  const Lost lost;
  const Lapack lapack;

 private:
  template <class Number>
  Inverse inverse_of(double shift, bool velocity_free, char left, char right) const;
  Eigen::MatrixXd times(const Eigen::Ref<const Matrix>& factor, const Eigen::MatrixXd& x) const;
  ComplexTable times(int matrix, const ComplexTable& x) const;

  const Matrices matrices_;
};

/// The operator P of a model at each speed, in matrices: M, V, D, K, A and L, which is empty
/// without a loss factor, of P(lambda, u) = lambda^2 M + lambda (u V + D) + K + i L + a u^2 A.
struct Pencil {
  Lapack lapack;
  DenseOperator::Matrices matrices;
  double end_coefficient;           // a
  double size;                      // size of K at rest
  std::array<double, 6> lost = {};  // errors of the matrices by rounding, in norm
  double entries_lost = eps;        // and relative to each entry

  std::shared_ptr<DenseOperator> operator()(double u) const;
};

}  // namespace pipedyn
