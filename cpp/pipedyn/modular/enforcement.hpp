// SPDX-License-Identifier: MIT
//
// Accelerations of modules under constraints that are enforced one group after the other, the
// recursion of the Modular Modeling Methodology (Orsino 2017) in the order in which it is local.
// Gauss's principle: the accelerations a of the coordinates are those that minimise
//
//   1/2 sum_e |W_e a|^2 - f^T a     under     A_r a = b_r,   r = 1..R,
//
// W_e^T W_e the inertia of module e. With C_0 = I, group r leaves a = C_r z + particular,
// C_r = C_{r-1} S_r, the columns of S_r an orthonormal basis of the null space of A_r C_{r-1}.
//
// Modules and groups come by their largest node, from the tip to the clamp, inertia before groups;
// any order gives the same a, this one keeps the work local. Only a front is held: the variables z,
// the active coordinates (those that a later module or group touches) as L z + p, and the energy
// 1/2 |R z + r|^2 - g^T z. A coordinate enters with the first that touches it, as scale times a new
// variable, and leaves after the last. When some leave, an orthogonal change of z makes the active
// ones a function of its first part y, and the energy's minimum over the rest w is taken:
//
//   R = (B, T) in (y, w) by reflections from the left,   w = T^-1 (T^-T h - B y - r),
//   g_y <- g_y - B^T T^-T h,   h = g_w.
//
// R and not the inertia R^T R, whose condition is the square of R's. On a chain the front has 7
// variables at most, so all costs O(n); inertia between far nodes makes the front larger (k
// variables cost O(k^3) a stage), not the result wrong.
#pragma once

#include <cstddef>
#include <vector>

namespace pipedyn {

/// One row of an inertia's factor: adds 1/2 (sum_i weight_i a_i)^2 to the energy.
struct InertiaRow {
  std::vector<int> coordinate;
  std::vector<double> weight;
};

/// What a group of constraints touches; rows in order, A row-major (rows, coordinates).
struct Group {
  std::vector<int> coordinate;
  int rows;
};

/// Immutable; scratch belongs to the thread.
class Enforcement {
 public:
  /// scale: size of each coordinate's acceleration against the others', such as 1/l of an angle.
  Enforcement(std::vector<double> scale, std::vector<InertiaRow> inertia,
              std::vector<Group> groups);

  /// The rows W of all inertia; q'^T W^T W q' / 2 is the kinetic energy.
  const std::vector<InertiaRow>& inertia() const { return inertia_; }

  static constexpr int complete = -1;
  static constexpr int node_size = 3;  // coordinates of a node, which come at once

  /// Entries of a group's A.
  std::ptrdiff_t matrix_size(std::size_t group) const {
    const Group& of = groups_[group];
    return static_cast<std::ptrdiff_t>(of.coordinate.size()) * of.rows;
  }

  /// Accelerations under the given forces. matrix: the groups' A one after the other, b their
  /// right-hand sides. Rows that follow from others to 1e-10 of their size are left out. Returns
  /// `complete`, or the coordinate that moves most in a direction that has no inertia; then
  /// accelerations is not written.
  int solve(const double* matrix, const double* b, const double* force,
            double* accelerations) const;

 private:
  struct Element {
    bool constraint;
    int index, node;        // among all of its kind; the largest that it touches
    std::vector<int> slot;  // of its coordinates, among the stage's active
  };
  /// Modules and groups up to one after which coordinates leave.
  struct Stage {
    std::vector<Element> elements;
    std::vector<int> coordinate;        // of each slot: those that stayed, then the entering
    std::vector<int> leaving, staying;  // slots
    int group_rows = 0;                 // largest of a group
    int inertia_rows = 0;               // all
  };
  class Front;
  struct Record;
  struct Workspace;

  /// From (1, z), the variables z at the end, to all before them, calling
  /// found(coordinate, acceleration); from (0, z) a change along z alone.
  template <class Found>
  void substitute(Workspace& work, const Found& found) const;

  std::vector<double> scale_;
  std::vector<InertiaRow> inertia_;
  std::vector<Group> groups_;
  std::vector<std::size_t> matrix_start_, row_start_;
  std::vector<Stage> stages_;
  int most_variables_ = 0;
  int most_rows_ = 0;
};

}  // namespace pipedyn
