// SPDX-License-Identifier: MIT
//
// Batches of states, the motion of the chain at any amplitude in O(n) (what one segment
// contributes; sweeps.hpp holds the recursion), and the functions that each vector level compiles.
// Includes no other library.
#pragma once

#include <array>
#include <cstddef>

#include "pipedyn/terms/term.hpp"

namespace pipedyn {

/// One segment as the recursion reads it; l, xi, k, c, k psi as in Segments, and with the masses of
/// the pipe's terms that are on it: m, the centre of mass chi and the radius eta.
struct Link {
  double length;         // l
  double length_square;  // l^2
  double mass;           // m
  double added;          // mass besides that moves across the segment alone, chi l
  double first_moment;   // m chi l, about the joint
  double inertia;        // m (chi^2 l^2 + eta^2), about the joint
  double end_inertia;    // m ((1 - chi)^2 l^2 + eta^2), about the other end
  double own_inertia;    // m^2 eta^2
  double exchange;       // inertia - m chi l^2
  double spring;         // k
  double damping;        // c
  double rest_moment;    // k psi
  double drag_arm;       // xi l
  double drag;           // kappa l
  double weight;         // gamma p
};

/// A term with a load, at its place on a segment.
struct SegmentTerm {
  std::ptrdiff_t segment;
  double arm;     // from the segment's joint
  double weight;  // 1, or the length that a Gauss point stands for
  Term term;
};

/// What the kernels read of a chain and its pipe.
struct MotionModel {
  const Link* links;
  std::ptrdiff_t size;           // n
  double base;                   // length of the fixed part at the clamp
  double gravity;                // gamma
  double coriolis;               // sqrt(beta) s
  double entry;                  // (1 - c) sqrt(beta) s
  std::array<double, 2> thrust;  // a cos psi along and a sin psi across the last segment
  bool damped;                   // some joint is
  bool bent;                     // some joint is bent at rest
  bool guided;                   // the end keeps the direction of the axis
  double end_spring;             // k and c of the joint between it and the last segment
  double end_damping;
  bool drag;                 // kappa > 0
  const SegmentTerm* loads;  // from the clamp on
  std::ptrdiff_t load_count;

  /// Whether forces other than the joints' and Coriolis' change with the velocities.
  bool resists() const { return drag || entry != 0.0 || load_count > 0; }
};

/// Rows of what drives a member in time besides its flow speed: the rate u' of this, then position,
/// velocity and acceleration of the base, x and y of each. The base carries the clamp and whatever
/// holds the pipe rigidly, and does not turn; states are counted from it.
struct Drive {
  static constexpr std::ptrdiff_t rate = 0, position = 1, velocity = 3, acceleration = 5, rows = 7;
};

/// Member j of a batch has its state in column j of y (2 n, members), its speed at u[j * u_step].
struct Batch {
  const double* y;
  const double* u;
  std::ptrdiff_t members;
  std::ptrdiff_t u_step;            // 0 where all have one speed
  const double* moments = nullptr;  // further ones on the segments of a chain (n, members)
  const double* slopes = nullptr;   // and of each by its segment's angle, 0 where null
  const double* drive = nullptr;    // (Drive::rows, members); null at a steady speed, base at rest
  const double* errors = nullptr;   // relative, that quadratures may leave (members,); null: least
};

/// A periodic orbit on a mesh, and derivatives at its stages (motion/collocation.hpp). Arrays are
/// row-major; n = 2 half.
struct Intervals {
  std::ptrdiff_t count, stages, half;
  const double* durations;     // (count,)
  const double* starts;        // states where intervals begin (count, n)
  const double* rates;         // accelerations at the stages (count, stages, half)
  const double* linearised;    // the states' rates there by the forces, then their derivatives by
                               // the speed and the states (count, stages, 2 + n, n)
  const double* by_frequency;  // derivatives of the accelerations (half, count, stages), or null
                               // where they do not change
  bool speed_varies;
  double frequency;
  const double* nodes;  // c (stages,)
  const double* once;   // O (stages, stages)
  const double* twice;  // T
  double mirror;        // the state after the last interval is so many times the first, 1 or -1
  const double* units;  // of the state (n,), or null for maps of single intervals alone
};

struct GalerkinKernel;
struct ImpedanceKernel;
struct EliminationKernel;

/// The functions of one vector level. They use the thread's scratch (vector/scratch.hpp).
struct MotionKernel {
  using Function = void (*)(const MotionModel&, const Batch&, double* out);

  const char* name;
  std::ptrdiff_t width;
  Function rhs;            // dy/dtau (2 n, members)
  Function rhs_and_power;  // and the sum of the power (2 n + 1, members)
  Function jacobian;       // d(dy/dtau)/dy (members, 2 n, 2 n), each row-major
  Function energy;         // of each member
  Function power;          // of flow, joints, drag, the pipe's terms and the base, (5, members)
  /// Of [q, q', q''] (3 n, members): int t . r'' along the pipe and the depth y(1) of its end about
  /// the base; then the derivatives of the first by q, q' and q'', and of the second by q:
  /// (2 + 4 n, members).
  Function axial;

  /// out = y + h sum_s weights_s k_s, entry by entry.
  void (*combine)(const double* weights, const double* const* k, std::ptrdiff_t terms,
                  const double* y, const double* h, double* out, std::ptrdiff_t size);
  /// out_e = (sum_s weights_es k_s / (absolute + relative max(|y|, |next|)))^2, e = 0 and 1.
  void (*errors)(const double* const* weights, const double* const* k, std::ptrdiff_t terms,
                 const double* y, const double* next, const double* absolute,
                 const double* relative, double* const* out, std::ptrdiff_t size);

  // (mu - J) x = b for so many complex mu at once, real parts first in mu (2 shifts) and in the
  // rows of b, which become x; factors have room for the numbers that are asked for.
  static constexpr std::ptrdiff_t shifts = 4;
  // J of a chain's state, in O(n):
  std::ptrdiff_t (*factor_numbers)(const MotionModel&);
  void (*factorise)(const MotionModel&, const Batch& one, const double* mu, double* factors);
  void (*solve)(const MotionModel&, double u, double* factors, double* b);
  // A x = b of as many matrices A (n, n, 2 shifts), which become factors, with room for 4 n pivots:
  void (*factorise_dense)(double* a, std::ptrdiff_t n, std::ptrdiff_t* pivots);
  void (*solve_dense)(const double* factors, const std::ptrdiff_t* pivots, std::ptrdiff_t n,
                      double* b);

  // The stages of implicit steps (rows, 8), see motion/stages.hpp; matrices are (8, 8).
  void (*mix_stages)(const double* a, const double* matrix_a, const double* b,
                     const double* matrix_b, std::ptrdiff_t rows, double* out);
  double (*correct_stages)(const double* x, const double* matrix, const double* y,
                           const double* allowed, std::ptrdiff_t rows, double* w, double* z,
                           double* out);

  /// Derivatives of each interval's accelerations (count, stages half, n + 3) and of the state at
  /// its end (count, n, n + 3) by the first state, a share of the residual, frequency and speed.
  /// With units, the second are those of states in these, and what the state at the end misses of
  /// the next interval's beginning is part of the residual.
  /// rows: room for stages half pointers. False if a matrix is singular.
  bool (*eliminate_stages)(const Intervals&, std::ptrdiff_t first, std::ptrdiff_t last,
                           double** rows, double* rates, double* ends);
  /// Of x -> T x + r of intervals, [T | r] (count, n, columns), the products [P | R] up to the end
  /// of each, as many, from the beginning of its run: a run ends before an entry of P reaches most.
  /// Begins of runs (room for count), and how many there are.
  std::ptrdiff_t (*carry_maps)(const double* maps, std::ptrdiff_t count, std::ptrdiff_t n,
                               std::ptrdiff_t columns, double most, double* out,
                               std::ptrdiff_t* begins);

  bool (*finite)(const double* x, std::ptrdiff_t count);
  void (*sincos)(const double* x, std::ptrdiff_t count, double* sine, double* cosine);

  const GalerkinKernel* galerkin;        // the reduced model's
  const ImpedanceKernel* impedance;      // linear chains'
  const EliminationKernel* elimination;  // linear reduced models'
};

extern const MotionKernel motion_baseline, motion_avx2, motion_avx512;

}  // namespace pipedyn
