// SPDX-License-Identifier: MIT
//
// Batches of states; the numbers of a chain from which its motion at any amplitude is computed in
// O(n) (sweeps.hpp holds the recursion); and the functions that are compiled for each vector level.
// Includes no other library.
#pragma once

#include <array>
#include <cstddef>

#include "pipedyn/terms/term.hpp"

namespace pipedyn {

/// Numbers of one segment that the recursion reads. l, xi, k, c and k psi are those of Segments;
/// the mass m, its centre chi and the radius of gyration eta include the masses of the pipe's terms
/// on the segment.
struct Link {
  double length;         // l
  double length_square;  // l^2
  double mass;           // m
  double added;          // further mass, with inertia only across the segment
  double first_moment;   // m chi l, about the joint; here and below m includes `added`
  double inertia;        // m (chi^2 l^2 + eta^2), about the joint
  double end_inertia;    // m ((1 - chi)^2 l^2 + eta^2), about the other end
  double own_inertia;    // m^2 eta^2
  double exchange;       // inertia - m chi l^2
  double spring;         // k
  double damping;        // c
  double rest_moment;    // k psi
  double drag_arm;       // xi l
  double drag;           // kappa l
  double weight;         // gamma p, without `added`
};

/// A term with a load, at its place on a segment.
struct SegmentTerm {
  std::ptrdiff_t segment;
  double arm;     // from the segment's joint
  double weight;  // 1, or the length that a Gauss point represents
  Term term;
};

struct StiffnessSegment;

/// Numbers of a chain and its pipe that the kernels read.
struct ChainModel {
  const Link* links;
  const StiffnessSegment* dynamic_stiffnesses;  // of small motions about the straight chain
  std::ptrdiff_t size;                          // n
  double base;                                  // length of the fixed part at the clamp
  double gravity;                               // gamma
  std::array<double, 2> down;    // direction of gravity, across and along the clamp's axis
  double coriolis;               // sqrt(beta) s
  double entry;                  // (1 - c) sqrt(beta) s
  std::array<double, 2> thrust;  // a cos psi along and a sin psi across the last segment
  bool bent;                     // whether a joint is bent at rest
  bool guided;                   // whether the end keeps the direction of the axis
  double end_spring;             // k and c of the joint between a guided end and the last segment
  double end_damping;
  bool drag;                 // kappa > 0
  const SegmentTerm* loads;  // in their order from the clamp
  std::ptrdiff_t load_count;
  // Segments at whose ends a motion in space is held, x = z = 0, ascending, and the rate k at which
  // states that miss this return to it. Supports in a plane are in modular/scene.hpp.
  const std::ptrdiff_t* held = nullptr;
  std::ptrdiff_t held_count = 0;
  double return_rate = 0.0;

  /// Whether drag, the entering flow or loads add forces that depend on the motion of places.
  bool resists() const { return drag || entry != 0.0 || load_count > 0; }
};

/// Rows of the drive, which forces a member in time besides its flow speed: the rate u' of the
/// speed, then position, velocity and acceleration of the base, x and y of each, and z of each,
/// which only motions in space read. The base carries the clamp and all rigid supports of the pipe,
/// and does not turn; states are relative to it. The numbers of applied forces may follow, see
/// terms/applied_force.hpp.
struct Drive {
  static constexpr std::ptrdiff_t rate = 0, position = 1, velocity = 3, acceleration = 5;
  static constexpr std::ptrdiff_t position_z = 7, velocity_z = 8, acceleration_z = 9, rows = 10;
};

/// States of several members, with their flow speeds and forcing. Member j has its state in column
/// j of y (2 n, members) and its speed at u[j * u_step].
struct Batch {
  const double* y;
  const double* u;
  std::ptrdiff_t members;
  std::ptrdiff_t u_step;            // 0 if all members have the same speed
  const double* moments = nullptr;  // further moments on the segments of a chain (n, members)
  const double* slopes = nullptr;   // derivative of each moment by its segment's angle; null: 0
  const double* drive = nullptr;    // (drive_rows, members); null: steady speed, base at rest
  std::ptrdiff_t drive_rows = Drive::rows;  // more if forces are applied
  const double* errors = nullptr;  // allowed relative error of quadratures (members,); null: least
  // Of chains in space, the sign of each segment in its chart (n, members); null: all 1.
  const double* charts = nullptr;
};

struct GalerkinKernel;
struct StiffnessKernel;
struct EliminationKernel;

/// Derivatives of the accelerations along an interval, of states [p, p'] with half positions.
struct MagnusInterval {
  std::ptrdiff_t half, stages, parts;
  const double* rows;            // derivatives at the stages by the state (stages, half, 2 half)
  const double *zeroth, *first;  // weights of the stages in b0 and b1 of each part (parts, stages)
  double duration;
  double unit;  // of p' in the map; that of p is 1
};

/// A periodic orbit on a mesh of `count` intervals, with n = 2 half numbers in a state. On each
/// interval accelerations are the polynomial through their values at the stages; velocities and
/// positions are its integrals.
struct OrbitPolynomials {
  std::ptrdiff_t count, half, stages;
  const double* edges;   // phases, from 0 (count + 1,)
  const double* starts;  // states where intervals begin (count, n)
  const double* rates;   // accelerations at the stages (count, stages, half)
  double frequency;
  double mirror_sign;  // factor of the states after the span, 1 or -1
  // Expansions in Legendre polynomials, on an interval of length 1, of the first integral of the
  // polynomial through the stages, (stages + 1, stages), and of its second, (stages + 2, stages).
  const double *single, *twofold;
};

/// An interval of a collocation of periodic orbits, with derivatives at its stages; n = 2 half. See
/// motion/interval_stages.hpp.
struct CollocationInterval {
  std::ptrdiff_t half, stages;
  const double* nodes;             // c (stages,)
  const double *single, *twofold;  // transposes of O and T (stages, stages)
  const double *start, *next;      // states where it and the next interval begin (n,)
  const double* states;            // at the stages (n, stages)
  double next_sign;                // of the state at its end, relative to the next one
  const double* rates;             // accelerations at the stages (stages, half)
  // For each stage, if there are loads, the rates of its state from the forces and their
  // derivatives by the speed, and then those by the state (stages, 2 + n or n, n).
  const double* linearised;
  // Derivatives of the accelerations by the frequency, (stages,) for each coordinate so many
  // numbers apart as `frequency_step`; null if they are 0.
  const double* by_frequency;
  std::ptrdiff_t frequency_step;
  std::ptrdiff_t loads;  // 3: the residual, frequency and speed; or 0
  bool speed_varies;
  double duration, frequency;
};

/// The functions of one vector level. They use the thread's scratch (vector/scratch.hpp).
struct MotionKernel {
  using Function = void (*)(const ChainModel&, const Batch&, double* out);

  const char* name;
  std::ptrdiff_t width;
  Function rhs;            // dy/dtau (2 n, members)
  Function rhs_and_power;  // dy/dtau and the sum of the powers (2 n + 1, members)
  Function jacobian;       // d(dy/dtau)/dy (members, 2 n, 2 n), each row-major
  Function energy;         // energy of each member (members,)
  Function power;          // powers of flow, joints, drag, terms and the base (5, members)
  /// Axial acceleration and depth of the pipe's end, from [q, q', q''] (3 n, members). Rows of the
  /// result (2 + 4 n, members): the integral of t . r'' along the pipe; the depth y(1) of its end
  /// relative to the base; the derivatives of the integral by q, q' and q''; the derivatives of the
  /// depth by q.
  Function axial;

  /// Computes out = y + h sum_s weights_s k_s, entry by entry.
  void (*combine)(const double* weights, const double* const* k, std::ptrdiff_t terms,
                  const double* y, const double* h, double* out, std::ptrdiff_t size);

  // Solution of (mu - J) x = b for this number of complex mu at once. Real parts stand before
  // imaginary parts in mu (2 shifts) and in the rows of b, which x replaces.
  static constexpr std::ptrdiff_t shifts = 4;
  // For J of a chain's state, in O(n). factors: an array of factor_numbers() numbers.
  std::ptrdiff_t (*factor_numbers)(const ChainModel&);
  void (*factorise)(const ChainModel&, const Batch& one, const double* mu, double* factors);
  void (*solve)(const ChainModel&, double* factors, double* b);
  // Solution of A x = b for the same number of matrices A (n, n, 2 shifts), which factors replace;
  // pivots has 4 n entries.
  void (*factorise_dense)(double* a, std::ptrdiff_t n, std::ptrdiff_t* pivots);
  void (*solve_dense)(const double* factors, const std::ptrdiff_t* pivots, std::ptrdiff_t n,
                      double* b);

  // Operations on the stages of implicit steps (rows, 8) of motion/stages.hpp; matrices are (8, 8).
  void (*mix_stages)(const double* a, const double* matrix, const double* b, const double* mu,
                     std::ptrdiff_t rows, double* out);
  double (*correct_stages)(const double* x, const double* matrix, const double* y,
                           const double* allowed, std::ptrdiff_t rows, double* w, double* z,
                           double* out);
  /// Sine and cosine of `count` numbers. The arrays have room for whole packs; sine may be x
  /// itself.
  void (*sincos)(const double* x, std::ptrdiff_t count, double* sine, double* cosine);

  // Of vector/products.hpp: c = a b or c += a b for a (rows, inner) and b (inner, columns), and the
  // solution of A X = B, where X replaces B in [A | B] with A (n, n), after whose end there is room
  // for 8 numbers; it returns false if a pivot is 0. Rows begin so many numbers apart as `step`.
  void (*multiply)(const double* a, std::ptrdiff_t a_step, const double* b, std::ptrdiff_t b_step,
                   std::ptrdiff_t rows, std::ptrdiff_t inner, std::ptrdiff_t columns, bool adds,
                   double* c, std::ptrdiff_t c_step);
  bool (*solve_real)(double* matrix, std::ptrdiff_t n, std::ptrdiff_t right, std::ptrdiff_t step);
  /// States at so many phases, (2 half, points).
  void (*orbit_states)(const OrbitPolynomials& of, const double* phases, std::ptrdiff_t points,
                       double* out);
  /// Of motion/interval_stages.hpp: derivatives of an interval's accelerations (stages half, n +
  /// loads) and of the state at its end (n, n + loads) by the state at its beginning and the loads.
  /// The residual includes what the end misses of the next interval's beginning. Returns false if
  /// a matrix is singular.
  bool (*eliminate_stages)(const CollocationInterval& of, double* rates, double* end);
  // Of motion/magnus.hpp; matrices are row-major. Exponentials of `count` matrices (n, n), and the
  // map (2 half, 2 half) of changes of the state over an interval.
  void (*exponentials)(const double* exponents, std::ptrdiff_t n, std::ptrdiff_t count,
                       double* out);
  void (*interval_map)(const MagnusInterval& along, double* out);

  // Motion of chains in space (space.hpp), of states with 4 n rows: as above, and derivatives of
  // the rates with these and their derivative by the speed before them, (members, 2 + 4 n, 4 n).
  struct Spatial {
    Function rhs, rhs_and_power, jacobian, linearise, energy, power;
  } spatial;

  const GalerkinKernel* galerkin;            // motion of reduced models
  const StiffnessKernel* dynamic_stiffness;  // linear problem of chains
  const EliminationKernel* elimination;      // linear problem of reduced models
};

extern const MotionKernel motion_baseline, motion_avx2, motion_avx512;

}  // namespace pipedyn
