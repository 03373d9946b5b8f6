// SPDX-License-Identifier: MIT
//
// The straight pipe's linear problem in Legendre curvatures, panel by panel: what the elimination
// (elimination.hpp) takes, and products with each part of it, in O(m).
//
// On a panel shapes, slopes and curvatures of the functions are short series of orthonormal
// Legendre polynomials p_i, in which a factor f(s) of an integrand, such as the mass per length, is
// the banded matrix f(X) of X = x, the Jacobi matrix of p_i: exact where f is a polynomial.
// (Golub and Welsch 1969, Math. Comp. 23, for X.)
#pragma once

#include <vector>

#include "pipedyn/galerkin/basis.hpp"
#include "pipedyn/galerkin/elimination.hpp"
#include "pipedyn/pipe.hpp"

namespace pipedyn {

class PanelPencil {
 public:
  /// Whether the pipe's loads and steps lie where panels end, and what varies along it does so
  /// slowly enough that matrices stay banded.
  static bool fits(const Pipe& pipe, const Basis& basis);

  /// Throws std::invalid_argument unless it fits.
  PanelPencil(const Pipe& pipe, const Basis& basis);

  /// Coordinates: theta at a root that turns, then amplitudes of curvatures, panel by panel.
  Index size() const { return size_; }
  Index panels() const { return static_cast<Index>(panels_.size()); }
  /// How many displacements and slopes are held.
  Index conditions() const;
  const Pipe& pipe() const { return pipe_; }
  const Basis& basis() const { return basis_; }
  /// That of so many functions on the same panels.
  PanelPencil coarser(Index size) const;

  /// What the elimination takes, at a speed, for lambda; it must not outlive what holds it.
  struct At {
    std::vector<PencilEntry> entries;
    std::vector<EliminationPanel> panels;
    EliminationModel model;
  };
  At at(double u) const;
  /// The same for the speed squared, s: K + s A.
  At still() const;

  /// Product of so much of each part with columns x, (size, r), in O(size) a column; where the pipe
  /// is held the columns must meet that.
  Matrix times(const Matrix& x, const LinearPart& of) const;
  /// The work done on motions x of some frequencies, their real parts and then the imaginary ones,
  /// (size, 2 r). Flow and loads that follow work at ends of panels alone: there nothing is left of
  /// a difference.
  Works works(double u, const Eigen::ArrayXd& frequencies, const Matrix& x) const;
  /// Displacements at the ends of panels where it is held across, and the slope at an end that
  /// keeps its direction, by the coordinates: (conditions, size).
  Matrix held() const;

 private:
  enum Part { mass, velocity, flux, gravity, elastic, rest, resistance, parts };
  struct Panel {
    double length;
    Index size;                        // functions with the two rigid ones
    std::vector<double> bands[parts];  // (size, 2 band + 1) each
    double station[parts][2][2];
    bool held, directed;
  };

  Pipe pipe_;
  Basis basis_;
  Index size_, band_;
  bool turns_;
  std::vector<Panel> panels_;

  template <class Entry>
  At made(const Entry& entry) const;
  /// Gives `visit` each panel with the amplitudes of its functions and place and slope of its end,
  /// all in its units. sign: -1, or 1 for bounds of the end by sizes of x.
  template <class Visit>
  void along(const Matrix& x, double sign, const Visit& visit) const;
  /// Adds so much of a part's product with amplitudes of a panel's functions.
  void add_product(const Panel& panel, int part, double share, const Matrix& z, Matrix& to) const;
  static Eigen::Matrix2d station(const Panel& panel, int part) {
    const auto& of = panel.station[part];
    return Eigen::Matrix2d{{of[0][0], of[0][1]}, {of[1][0], of[1][1]}};
  }
  /// By what factor the tables of a part enter the product that `times` is asked for.
  double share_of(const LinearPart& of, int part) const;
};

}  // namespace pipedyn
