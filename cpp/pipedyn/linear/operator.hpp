// SPDX-License-Identifier: MIT
//
// P(lambda) = lambda^2 M + lambda C + K of a model at one flow speed: products with it, solutions
// of linear systems with it, and its inverse problem, whose largest eigenvalues give the lowest
// roots. With a loss factor K has an imaginary part i L; the roots then do not come in conjugate
// pairs.
#pragma once

#include <array>
#include <optional>
#include <tuple>
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

/// Undamped modes in the order of rising squares of their frequencies; vectors (dof, count), or
/// none.
struct Modes {
  Eigen::MatrixXd vectors;
  Reals squares, masses;  // omega^2 and x^T M x of each mode
};

/// Room for an array or a table in the memory of another one, which grows where it has less.
template <class Array>
auto room_in(Array& of, Index size) {
  if (of.size() < size) of.resize(size);
  return of.head(size);
}
template <class Table>
Eigen::Map<Table> room_in(Table& of, Index rows, Index columns) {
  if (of.size() < rows * columns) of.resize(rows, columns);
  return {of.data(), rows, columns};
}

using Columns = Eigen::Ref<ComplexTable>;
using ColumnsRef = Eigen::Ref<const ComplexTable>;

/// The products M x, C x and K x.
struct Products {
  Columns mass, velocity, stiffness;
};

/// Eigenvalues mu of the inverse problem about a shift, with right vectors x and, if they are
/// known, left vectors y (else a table (dof, 0)). With lambda = shift + 1/mu and P(shift) = K_s,
///
///     mu [x; z] = [-K_s^-1 ((C + 2 shift M) x + M z); x],
///
/// so the lowest roots are the largest mu and survive rounding, and a singular K does no harm.
/// Where P has no term in lambda, mu = 1 / (lambda^2 - shift^2), and x alone is the vector.
struct Inverse {
  Values values;
  ComplexTable right, left;
};

/// An operator is used at one speed after another, and by one thread at a time. What its methods
/// return by reference lies in its memory, until the same method is called again.
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

  DenseOperator() = default;  // without matrices, which `renewed` takes
  DenseOperator(const Lapack& known, Matrices matrices, double stiffness_size, Lost by_rounding)
      : dof(matrices[0].rows()),
        size(stiffness_size),
        lost(by_rounding),
        lapack(known),
        matrices_(std::move(matrices)) {}

  /// The matrices, to be written for another speed or another operator of these properties.
  Matrices& renewed(const Lapack& known, Index rows, double stiffness_size, Lost by_rounding) {
    std::tie(lapack, dof, size, lost) = std::tie(known, rows, stiffness_size, by_rounding);
    return matrices_;
  }
  Products multiply(const ColumnsRef& x) const;
  /// (dP/du) x for each root and its vector x.
  Columns by_speed(const ValuesRef& values, const ColumnsRef& x) const;
  /// Factorises P, for `solve`.
  void factor(Complex value) const;
  /// Takes x to P^-1 x, or to P^-H x (adjoint).
  void solve(ComplexVector& x, bool adjoint) const;
  /// All eigenpairs of the inverse problem, with right vectors, and left ones where `left` is 'V',
  /// else 'N'; none where P(shift) is singular or overflows, or where the iteration does not
  /// converge.
  const Inverse& inverse(double shift, bool velocity_free, char left, char right = 'V') const;
  /// Eigenvalues mu of the inverse problem, without vectors.
  const Values& roots(double shift, bool velocity_free) const {
    return inverse(shift, velocity_free, 'N', 'N').values;
  }
  /// Undamped modes of M and K, for a symmetric K, with vectors or without; none where K + s M is
  /// definite for no s.
  std::optional<Modes> undamped_modes(bool vectors = true) const;
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
  const Reals& hidden(const ValuesRef& values, const ColumnsRef& right,
                      const ColumnsRef& left) const;

  Index dof = 0;
  double size = 0.0;  // size of K, relative to the elastic stiffness
  Lost lost;
  Lapack lapack = {};

 private:
  /// Memory of the eigenvalue problem.
  template <class Number>
  struct Solver {
    Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic> shifted, step, left, right;
    std::vector<Number> work;
  };
  struct Memory {
    Eigen::MatrixXd parts, product, lengths;  // real columns
    Matrix sizes;                             // |A| of a matrix A
    std::array<ComplexTable, 6> products;     // with each matrix
    ComplexTable lu;
    std::vector<int> pivots;
    std::tuple<Solver<double>, Solver<Complex>> solvers;
    Reals real, imag, more, hidden;
    Inverse inverse;
  };

  template <class Number>
  bool find_inverse(double shift, bool velocity_free, char left, char right) const;
  Eigen::Ref<Eigen::MatrixXd> times(const Eigen::Ref<const Matrix>& factor,
                                    const Eigen::Ref<const Eigen::MatrixXd>& x,
                                    Eigen::MatrixXd& product) const;
  /// Reads columns for products with them.
  void read(const ColumnsRef& x) const;
  /// The product of a matrix with the `count` columns that were read.
  Columns product(std::size_t matrix, Index count) const;

  Matrices matrices_;
  mutable Memory memory_;
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

  /// Writes the operator at a speed.
  void operator()(double u, DenseOperator& to) const;
};

}  // namespace pipedyn
