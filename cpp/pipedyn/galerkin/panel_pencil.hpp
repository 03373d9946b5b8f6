// SPDX-License-Identifier: MIT
//
// The linear problem of the straight pipe in Legendre curvatures, panel by panel: the matrices for
// the elimination (elimination.hpp), and products with each part of the pencil, in O(m).
//
// On a panel the shapes, slopes and curvatures of the functions are short series of orthonormal
// Legendre polynomials p_i. In these, a factor f(s) of an integrand, such as the mass per length,
// is the banded matrix f(X) of the Jacobi matrix X of p_i, which represents the multiplication by
// x. This is exact if f is a polynomial (Golub and Welsch 1969, Math. Comp. 23, for X).
#pragma once

#include <Eigen/SparseCore>
#include <vector>

#include "pipedyn/galerkin/basis.hpp"
#include "pipedyn/galerkin/elimination.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

class PanelPencil {
 public:
  /// Whether all loads and steps of the pipe lie at ends of panels, and whatever varies along it
  /// does so slowly enough that the matrices stay banded.
  static bool fits(const Pipe& pipe, const Basis& basis);

  /// Throws std::invalid_argument unless `fits`.
  PanelPencil(const Pipe& pipe, const Basis& basis);

  /// Number of coordinates: theta at a root that turns, then amplitudes of curvatures, panel by
  /// panel.
  Index size() const { return size_; }
  Index panels() const { return static_cast<Index>(panels_.size()); }
  /// Number of displacements and slopes that are held.
  Index conditions() const;
  const Pipe& pipe() const { return pipe_; }
  const Basis& basis() const { return basis_; }
  /// The pencil of a basis of this size on the same panels.
  PanelPencil coarser(Index size) const;

  /// Input of the elimination at a speed, for any lambda. It must not outlive the object that owns
  /// it.
  struct At {
    std::vector<PencilEntry> entries;
    std::vector<EliminationPanel> panels;
    EliminationModel model;
  };
  void at(double u, At& found) const;
  /// Input of the elimination for the square s of the speed as the unknown: K + s A.
  At by_squared_speed() const;

  /// Product of the sum of the parts, each with its factor in `of`, with columns x, (size, r), in
  /// O(size) a column. Where the pipe is held, the columns must satisfy the conditions.
  Matrix times(const Matrix& x, const LinearPart& of) const;
  /// Whether the work of forces that no potential has is known from the ends of panels alone.
  bool works_at_ends() const { return works_at_ends_; }
  /// The work done in motions x with given frequencies, first the real parts of the motions and
  /// then the imaginary parts, (size, 2 r). The work of flow and of follower loads is evaluated at
  /// the ends of panels alone, where no difference of large numbers arises.
  Rayleigh rayleigh(double u, const Eigen::ArrayXd& frequencies, const Matrix& x) const;
  /// Displacements at the ends of panels where the pipe is held across, and the slope at an end
  /// that keeps its direction, as rows by the coordinates: (conditions, size).
  Matrix held() const;

 private:
  enum Part { elastic, gravity, rest, flux, velocity, resistance, mass, parts };
  Pipe pipe_;
  Basis basis_;
  Index size_, band_;
  bool turns_, works_at_ends_;
  std::vector<EliminationPanel> panels_;  // without entries
  // The motion z of all panels has, from `first` of each on, the amplitudes of its functions,
  // followed by displacement and slope of its end, in units of the panel, divided by the square
  // root of its length: (I + joints) z = placed x.
  Sparse placed_, joints_;
  Sparse tables_[parts];  // virtual work of each part on z by z, in units of the panel

  void set_joints(Index rows);
  /// The motion z of all panels for coordinates x, (rows, r).
  Matrix along(const Matrix& x) const;
  /// factors: those of each part in the entries of the pencil.
  void make(const PencilEntry (&factors)[parts], At& found) const;
};

}  // namespace pipedyn
