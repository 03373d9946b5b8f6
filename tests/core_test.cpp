// SPDX-License-Identifier: MIT
//
// The core's own test, without Python: what only C++ sees, and what must hold of a core without
// vector extensions, which nothing else runs. Operators, functions and equations of motion are held
// against independent routes in Python. Prints every check that fails; the exit status says whether
// any did.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <complex>
#include <cstdio>
#include <functional>
#include <initializer_list>
#include <memory>
#include <numeric>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pipedyn/chain/chain.hpp"
#include "pipedyn/galerkin/galerkin.hpp"
#include "pipedyn/galerkin/quadrature.hpp"
#include "pipedyn/linear/complement.hpp"
#include "pipedyn/linear/determinant_roots.hpp"
#include "pipedyn/linear/eigenproblem.hpp"
#include "pipedyn/linear/neighbours.hpp"
#include "pipedyn/linear/structured.hpp"
#include "pipedyn/linear/tracking.hpp"
#include "pipedyn/linear/truncated.hpp"
#include "pipedyn/modular/systems.hpp"
#include "pipedyn/motion/radau_coefficients.hpp"
#include "pipedyn/terms/laws.hpp"
#include "pipedyn/util/threads.hpp"
#include "pipedyn/vector/levels.hpp"

namespace {

using pipedyn::Basis, pipedyn::Chain, pipedyn::Family, pipedyn::Galerkin, pipedyn::Index,
    pipedyn::LinearPart;
using pipedyn::Matrix, pipedyn::Operators, pipedyn::Pipe, pipedyn::Segments, pipedyn::Vector;

int checks = 0;
int failures = 0;
Index allocations = 0;  // where sanitizers count them
std::string scene;

/// a^-1 b by Gauss' elimination, in loops: Eigen's factorisations take longer to compile than all
/// other tests.
template <class Table>
Table solved(Table a, Table b) {
  for (Index k = 0; k < a.rows(); ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < a.rows(); ++i) {
      if (std::abs(a(i, k)) > std::abs(a(pivot, k))) pivot = i;
    }
    for (Index j = 0; j < a.cols(); ++j) std::swap(a(k, j), a(pivot, j));
    for (Index j = 0; j < b.cols(); ++j) std::swap(b(k, j), b(pivot, j));
    for (Index i = 0; i < a.rows(); ++i) {
      if (i == k) continue;
      const auto factor = a(i, k) / a(k, k);
      for (Index j = k; j < a.cols(); ++j) a(i, j) -= factor * a(k, j);
      for (Index j = 0; j < b.cols(); ++j) b(i, j) -= factor * b(k, j);
    }
  }
  for (Index i = 0; i < a.rows(); ++i) {
    for (Index j = 0; j < b.cols(); ++j) b(i, j) /= a(i, i);
  }
  return b;
}

/// Of a symmetric matrix: whether all pivots are positive.
bool positive_definite(Matrix a) {
  for (Index k = 0; k < a.rows(); ++k) {
    if (!(a(k, k) > 0.0)) return false;
    for (Index i = k + 1; i < a.rows(); ++i) {
      const double factor = a(i, k) / a(k, k);
      for (Index j = k; j < a.cols(); ++j) a(i, j) -= factor * a(k, j);
    }
  }
  return true;
}

void check(bool good, const std::string& claim) {
  ++checks;
  if (good) return;
  ++failures;
  std::printf("FAILED %s: %s\n", scene.c_str(), claim.c_str());
}

/// Largest difference of two matrices, relative to the largest entry of the second, is within
/// tolerance. No template over the expressions: it would be compiled for each of them.
void check_close(const Matrix& got, const Matrix& expected, double tolerance,
                 const std::string& claim) {
  if (got.rows() != expected.rows() || got.cols() != expected.cols()) {
    check(false, claim + " (shape)");
    return;
  }
  const double size = expected.cwiseAbs().maxCoeff();
  const double error = (got - expected).cwiseAbs().maxCoeff() / (size > 0.0 ? size : 1.0);
  check(error <= tolerance, claim + ", error " + std::to_string(error / tolerance) + " tolerances");
}

template <class Action>
void check_refused(const Action& action, const std::string& claim) {
  try {
    action();
  } catch (const std::invalid_argument&) {
    check(true, claim);
    return;
  }
  check(false, claim + " is not refused");
}

// ------------------------------------------------------------------------------- random chains

class Dice {
 public:
  double between(double low, double high) {
    return low + (high - low) * std::uniform_real_distribution<double>()(engine_);
  }
  Vector vector(Index n, double low, double high) {
    return Vector::NullaryExpr(n, [&] { return between(low, high); });
  }
  Matrix matrix(Index rows, Index columns) {
    return Matrix::NullaryExpr(rows, columns, [&] { return between(-1.0, 1.0); });
  }
  Pipe pipe(bool aspirating) {
    return Pipe{.beta = between(0.01, 0.99),
                .gamma = between(-20.0, 20.0),
                .end_coefficient = between(0.0, 2.0),
                .drag = 0.0,
                .damping = between(0.0, 0.1),
                .aspirating = aspirating,
                .inflow_share = aspirating ? 0.4 : 1.0};
  }
  pipedyn::Terms terms() {
    const auto one = [&](const char* law) {
      return pipedyn::make_term(law, between(0.01, 1.0), {between(0.1, 9.0)});
    };
    return {one("point_mass"), one("spring"),     one("damper"),    one("spring"),
            one("point_mass"), one("foundation"), one("added_mass")};
  }
  Segments segments(Index n) {
    Segments segments{.length = vector(n, 0.2, 1.0),
                      .center = vector(n, 0.0, 1.0),
                      .gyration_radius = vector(n, 0.1, 0.5) / static_cast<double>(n),
                      .spring = vector(n, 0.5, 2.0) * static_cast<double>(n),
                      .drag_point = vector(n, 0.0, 1.0),
                      .base = between(0.0, 0.3)};
    segments.length *= (1.0 - segments.base) / segments.length.sum();
    return segments;
  }

 private:
  std::mt19937_64 engine_{20260214};
};

/// d log det P / dlambda = tr(P^-1 dP/dlambda), in what guides leave of the joint angles.
void check_log_derivative(const Chain& chain, double u, Dice& dice) {
  using pipedyn::Complex, pipedyn::ComplexTable;
  const Vector scale = dice.vector(chain.dof(), 0.3, 3.0);
  const pipedyn::ChainModel model = chain.model();
  const pipedyn::Complement complement(chain.held_rows(scale));
  const Matrix basis = complement.lifted(Matrix::Identity(complement.dof(), complement.dof()));
  check_close(complement.projected(basis), Matrix::Identity(basis.cols(), basis.cols()), 1e-14,
              "the basis is orthonormal");
  const Matrix motions = scale.asDiagonal() * basis;
  const auto reduced = [&](const pipedyn::LinearPart& of) -> ComplexTable {
    return (motions.transpose() * chain.joint_times(motions, of)).cast<Complex>();
  };
  const double thrust = chain.pipe().end_coefficient * u * u;
  const ComplexTable mass = reduced({.mass = 1.0});
  const ComplexTable rate = reduced({.damping = 1.0, .velocity = u});
  const ComplexTable still = reduced({.stiffness = 1.0, .flux = thrust});
  const double re[] = {0.3, -2.0, 0.1}, im[] = {1.5, 7.0, 90.0};
  double found[6];
  pipedyn::motion_kernel().dynamic_stiffness->log_derivative(model, {u, 3, re, im}, found);
  for (Index i = 0; i < 3; ++i) {
    const Complex at(re[i], im[i]);
    const ComplexTable p = at * at * mass + at * rate + still;
    const Complex expected = solved<ComplexTable>(p, 2.0 * at * mass + rate).trace();
    const double error = std::abs(Complex(found[i], found[3 + i]) / expected - 1.0);
    check(error < 1e-9, "log derivative of the determinant, error " + std::to_string(error));
  }
}

/// Chains with the ends of some segments held.
void check_guides() {
  Dice dice;
  const std::string chosen = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (const Index n : {1, 2, 3, 12}) {
      for (const Index every : {100, 3, 2, 1}) {
        for (const bool aspirating : {false, true}) {
          scene =
              level + ": chain of " + std::to_string(n) + ", guides 1 in " + std::to_string(every);
          std::vector<bool> held(static_cast<std::size_t>(n));
          for (Index j = 0; j < n; ++j) held[j] = j % every == every - 1 && j != n / 2;
          Pipe pipe = dice.pipe(aspirating);
          pipe.terms = dice.terms();
          check_log_derivative(Chain(pipe, dice.segments(n)).guided(held), 2.0, dice);
        }
      }
    }
  }
  pipedyn::set_vector_level(chosen);
}

void check_refusals() {
  scene = "bad sizes";
  Dice dice;
  const Pipe pipe = dice.pipe(false);
  const Segments good = dice.segments(4);
  const auto check_array = [&](Vector Segments::* array, const char* name) {
    for (const Index size : {0, 3, 5}) {
      Segments bad = good;
      bad.*array = Vector::Ones(size);
      check_refused([&] { Chain(pipe, bad); }, name + (" of size " + std::to_string(size)));
    }
  };
  check_array(&Segments::length, "length");
  check_array(&Segments::center, "center");
  check_array(&Segments::gyration_radius, "gyration_radius");
  check_array(&Segments::spring, "spring");
  check_array(&Segments::drag_point, "drag_point");
  check_refused([&] { Chain(pipe, Segments{}); }, "a chain without segments");
  const Chain chain(pipe, good);
  check_refused([&] { chain.guided({true}); }, "guides of another chain");
  check_refused([&] { chain.operators(Vector::Zero(2)); }, "an angle too few");
  const auto with = [&](Family family, Index size, Vector ends) {
    return [family, size, ends] { Basis(family, size, ends); };
  };
  for (const Family family : {Family::beam, Family::legendre}) {
    check_refused(with(family, 0, Vector()), "a basis without functions");
    check_refused(with(family, -1, Vector()), "a negative number of functions");
    const Basis basis(family, 2);
    const Vector middle = Vector::Constant(1, 0.5);
    check_refused([&] { basis.evaluate(middle, 3); }, "a third derivative");
    check_refused([&] { basis.evaluate(middle, -1); }, "a negative derivative");
    check_refused([&] { Galerkin(pipe, basis).operators(Vector::Zero(3)); }, "an amplitude more");
  }
  const Vector joints = (Vector(3) << 0.02, 0.3, 0.9).finished();
  check_refused(with(Family::beam, 9, joints), "beam modes on panels");
  check_refused(with(Family::legendre, 3, joints), "a panel without a function");
  check_refused(with(Family::legendre, 9, Vector::Constant(2, 0.5)), "a panel of no length");
  check_refused(with(Family::legendre, 9, Vector::Constant(1, 1.0)), "a joint at the end");
  check_refused([] { pipedyn::Quadrature(0); }, "a quadrature without nodes");
  check_refused([] { pipedyn::set_vector_level("none such"); }, "an unknown level");
  for (const double at : {0.0, -0.1, 1.1}) {
    check_refused([at] { pipedyn::make_term("spring", at, {1.0}); }, "a term off the pipe");
  }
}

// -------------------------------------------------------------------------------------- motion

/// (mu - J) x = b with the dense J: what is left of b, relative to the sizes of what is summed.
/// solve(mu, b) turns b into x.
template <class Solve>
void check_shifted(const Matrix& jacobian, double most, Dice& dice, const Solve& solve) {
  constexpr Index shifts = pipedyn::MotionKernel::shifts;
  const Index rows = jacobian.rows();
  Matrix mu(2, shifts);
  mu << 30.0, 1.0, 20.0, 1e4, 0.0, 40.0, 3.0, 1e5;
  const Matrix b = dice.matrix(rows, 2 * shifts);
  Matrix x = b;
  solve(mu.data(), x.data());
  for (Index k = 0; k < shifts; ++k) {
    const auto re = x.col(k), im = x.col(shifts + k);
    const Vector left = mu(0, k) * re - mu(1, k) * im - jacobian * re - b.col(k);
    const Vector left_im = mu(1, k) * re + mu(0, k) * im - jacobian * im - b.col(shifts + k);
    const Vector size = re.cwiseAbs() + im.cwiseAbs();
    const Vector sum = mu.col(k).lpNorm<1>() * size + jacobian.cwiseAbs() * size;
    const double error = ((left.cwiseAbs() + left_im.cwiseAbs()).array() / sum.array()).maxCoeff();
    check(error < most * static_cast<double>(rows), "a shifted solve, " + std::to_string(error));
  }
}

/// Of a function of one number at 0, by differences of fourth order.
template <class Function>
auto derivative(const Function& of, double h) {
  const decltype(of(h)) slope =
      (8.0 * (of(h) - of(-h)) - (of(2.0 * h) - of(-2.0 * h))) / (12.0 * h);
  return slope;
}

/// What holds of any motion, of states as large as `scale`: a batch is its members, the Jacobian is
/// the derivative of the rates to within `loose`, and power is the energy's rate.
template <class Model>
void check_motion_of(const Model& model, const Vector& scale, double loose, Dice& dice) {
  const Index n = model.dof(), members = 19;
  Matrix y = scale.asDiagonal() * dice.matrix(2 * n, members);
  y.col(3) *= 4.0;  // of a reduced model on more nodes
  const Vector u = dice.vector(members, 0.0, 6.0);
  const pipedyn::Batch batch{y.data(), u.data(), members, 1};
  Matrix rates(2 * n, members), power(5, members), jacobian(2 * n, 2 * n);
  model.rhs(batch, rates.data());
  model.power(batch, power.data());
  check_close(rates.topRows(n), y.bottomRows(n), 0.0, "velocities are the state's");
  for (Index width = 1; width < members; ++width) {
    const Matrix part = y.leftCols(width);
    Matrix some(2 * n, width);
    model.rhs({part.data(), u.data(), width, 1}, some.data());
    check_close(some, rates.leftCols(width), 1e-11, "a batch is its members");
  }
  Matrix worked = Matrix::Zero(2 * n + 1, members), working(2 * n + 1, members);
  worked.topRows(2 * n) = y;
  model.rhs_and_power({worked.data(), u.data(), members, 1}, working.data());
  for (Index k = 0; k < members; ++k) {
    const double apart = std::abs(working(2 * n, k) - power.col(k).sum());
    const double rounding = 1e-12 * power.col(k).cwiseAbs().sum() * static_cast<double>(n);
    check(apart <= rounding, "the work's rate is the power");
  }
  for (const Index k : {0, 3, 7, 18}) {
    const Vector state = y.col(k), rate = rates.col(k);
    const Vector way = scale.cwiseProduct(dice.vector(2 * n, -1.0, 1.0));
    const auto moved = [&](double h) -> Vector {
      const Vector at = state + h * way;
      Vector found(2 * n);
      model.rhs({at.data(), &u[k], 1, 0}, found.data());
      return found;
    };
    model.jacobian({state.data(), &u[k], 1, 0}, jacobian.data());
    // Short steps, since the second derivative of drag jumps where the normal velocity is 0.
    check_close(jacobian * way, derivative(moved, 3e-4), loose, "the derivative by differences");
    const auto energy = [&](double h) {
      const Vector at = state + h * rate;
      double found;
      model.energy({at.data(), &u[k], 1, 0}, &found);
      return found;
    };
    const double h = 1e-3 * state.norm() / rate.norm();
    const double missed = std::abs(derivative(energy, h) - power.col(k).sum());
    check(missed < 1e-8 * std::abs(energy(0.0)) / h, "power is the energy's rate");
  }
}

/// About the straight pipe the Jacobian is that of the operators.
template <class Model>
void check_small_motions(const Model& model, const Pipe& pipe) {
  const Index n = model.dof();
  const Vector rest = Vector::Zero(2 * n);
  const double u = 3.0;
  Matrix jacobian(2 * n, 2 * n);
  model.jacobian({rest.data(), &u, 1, 0}, jacobian.data());
  const Operators ops = model.operators(Vector::Zero(n));
  const Matrix stiffness = ops.stiffness + u * u * pipe.end_coefficient * ops.flux;
  check_close(-ops.mass * jacobian.bottomLeftCorner(n, n), stiffness, 1e-9, "linear stiffness");
  const Matrix velocity = u * pipe.direction() * (ops.gyroscopic + ops.end_flux) + ops.damping;
  check_close(-ops.mass * jacobian.bottomRightCorner(n, n), velocity, 1e-9, "linear damping");
}

/// The systems of implicit steps, at rest and driven.
void check_chain_systems(const Chain& chain, Dice& dice) {
  const Index rows = 2 * chain.dof();
  const double u = 3.0;
  const Vector state = dice.vector(rows, -2.0, 2.0);
  const Vector drive = dice.vector(pipedyn::Drive::rows, -2.0, 2.0);
  Matrix jacobian(rows, rows);
  for (const double* driven : {static_cast<const double*>(nullptr), drive.data()}) {
    const pipedyn::Batch batch{
        .y = state.data(), .u = &u, .members = 1, .u_step = 0, .drive = driven};
    chain.jacobian(batch, jacobian.data());
    check_shifted(jacobian, 1e-13, dice, [&](const double* mu, double* x) {
      std::vector<double> factors(static_cast<std::size_t>(chain.factor_numbers()));
      chain.factorise(batch, mu, factors.data());
      chain.solve(factors.data(), x);
    });
  }
}

void check_motions_of_chains(bool aspirating, Dice& dice) {
  for (const Index n : {1, 2, 3, 20}) {
    scene = pipedyn::vector_level() + ", motion of " + std::to_string(n);
    const auto check_one = [&](const Pipe& pipe, const Segments& segments) {
      const Chain chain(pipe, segments);
      check_motion_of(chain, Vector::Constant(2 * n, 2.0), 1e-7, dice);
      check_chain_systems(chain, dice);
    };
    const Segments segments = dice.segments(n);
    Pipe pipe = dice.pipe(aspirating);
    pipe.drag = 1.5;
    pipe.terms = dice.terms();
    check_small_motions(Chain(pipe, segments), pipe);
    pipe.jet_angle = aspirating ? 0.0 : 0.7;
    check_one(pipe, segments);
    pipe.terms.clear();
    check_one(pipe, segments);
    Segments own_joints = segments;
    own_joints.damping = dice.vector(n, 0.0, 0.1);
    own_joints.rest_moment = dice.vector(n, -2.0, 2.0);
    own_joints.mass = segments.length.array() * (0.5 + 10.0 * own_joints.damping.array());
    check_one(pipe, own_joints);
    check_one(Pipe{.beta = 0.3, .aspirating = aspirating}, segments);
  }
}

void check_motions_of_reduced_models(bool aspirating, Dice& dice) {
  const Vector joints = (Vector(2) << 0.3, 0.7).finished();
  for (const Family family : {Family::beam, Family::legendre}) {
    const bool beam = family == Family::beam;
    for (const Index m : {1, 3, 8}) {
      scene = pipedyn::vector_level() + ", motion of " + std::to_string(m) +
              (beam ? " beam modes" : " Legendre functions");
      const auto check_one = [&](const Pipe& pipe, const Basis& basis) {
        const Galerkin model(pipe, basis);
        Vector scale(2 * m);
        scale << basis.stiffness().cwiseSqrt().cwiseInverse(),
            10.0 * basis.stiffness().cwiseSqrt().cwiseInverse();
        check_motion_of(model, scale, 1e-5, dice);
        check_small_motions(model, pipe);
      };
      Pipe pipe = dice.pipe(aspirating);
      pipe.drag = aspirating ? 0.7 : 0.0;
      check_one(pipe, Basis(family, m));
      check_one(Pipe{.beta = 0.0, .aspirating = aspirating}, Basis(family, m));
      if (m == 1) continue;
      const auto one = [](const char* law, double at, double number) {
        return pipedyn::make_term(law, at, {number});
      };
      pipe.terms = {one("spring", 0.7, 30.0), one("point_mass", 0.3, 0.2),
                    one("point_mass", 1.0, 0.4), one("spring", 1.0, 2.0)};
      check_one(pipe, Basis(family, m, beam ? Vector() : joints));
    }
  }
}

void check_motion() {
  Dice dice;
  const std::string before = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (const bool aspirating : {false, true}) {
      check_motions_of_chains(aspirating, dice);
      check_motions_of_reduced_models(aspirating, dice);
    }
    scene = level + ", sine and cosine";
    Vector x = dice.vector(1008, -2000.0, 2000.0);  // with room for whole packs
    x.head(101) *= 3e-4;
    x[1000] = 1e300;
    for (const Index length : {1001, 64, 7, 1, 0}) {
      Vector sine(1008), cosine(1008);
      pipedyn::motion_kernel().sincos(x.data(), length, sine.data(), cosine.data());
      const auto most = [&](const Vector& of) { return length > 0 ? of.cwiseAbs().maxCoeff() : 0; };
      check(most(sine.head(length).array() - x.head(length).array().sin()) < 3e-16, "sine");
      check(most(cosine.head(length).array() - x.head(length).array().cos()) < 3e-16, "cosine");
    }
  }
  pipedyn::set_vector_level(before);
}

/// The implicit method by what defines it: its stages integrate polynomials below their number
/// exactly, and its systems are those of A^-1.
void check_radau() {
  namespace radau = pipedyn::radau;
  scene = "Radau's coefficients";
  constexpr Index s = radau::stages;
  const auto table = [](const double (&of)[8][8]) -> Matrix {
    return Eigen::Map<const Matrix>(&of[0][0], 8, 8);
  };
  const Vector c = Eigen::Map<const Vector>(radau::nodes, s);
  const Matrix a = table(radau::integrals).topLeftCorner(s, s).transpose();
  Matrix powers(s, s), integrals(s, s);
  for (Index k = 0; k < s; ++k) {
    powers.col(k) = c.array().pow(k);
    integrals.col(k) = c.array().pow(k + 1) / static_cast<double>(k + 1);
  }
  check_close(a * powers, integrals, 1e-14, "stages integrate polynomials");
  for (Index k = s; k < 2 * s; ++k) {  // x^k up to degree 14, of order 15
    const double sum = a.row(s - 1) * c.array().pow(k).matrix();
    const bool exact = std::abs(sum * static_cast<double>(k + 1) - 1.0) < 1e-13;
    check(exact == (k < 2 * s - 1), "the step integrates degree 14, and not 15");
  }
  check_close(table(radau::powers).topLeftCorner(s, s).transpose() * integrals,
              Vector::LinSpaced(s, 1, s).cwiseInverse().asDiagonal().toDenseMatrix(), 1e-11,
              "the step's polynomial goes through the stages");
  Matrix by_shifts = Matrix::Zero(8, 8);
  for (Index k = 0; k < 4; ++k) {
    by_shifts(k, k) = by_shifts(4 + k, 4 + k) = radau::shifts[k];
    by_shifts(k, 4 + k) = radau::shifts[4 + k];
    by_shifts(4 + k, k) = -radau::shifts[4 + k];
  }
  const Matrix to = table(radau::to_systems), back = table(radau::to_stages);
  const Matrix same = (to * back).topLeftCorner(s, s);
  check_close(same, Matrix::Identity(s, s), 1e-12, "systems give the stages back");
  const Matrix inverse = (to * by_shifts * back).topLeftCorner(s, s).transpose();
  check_close(inverse * a, Matrix::Identity(s, s), 1e-11, "systems are those of the stages");
  const Vector end = Eigen::Map<const Vector>(radau::end_rate, s);
  check_close((end.transpose() * a).eval(), Vector::Unit(s, s - 1).transpose().eval(), 1e-13,
              "the stages give the rate at the end");
}

// ------------------------------------------------------------------------------- modular route

using pipedyn::Scene;

/// Solves about a state that meets guides and pins, of which one says nothing new, with the dense
/// J.
void check_scene_systems(Pipe pipe, Index n, Dice& dice) {
  const double u = 3.0;
  Segments segments = dice.segments(n);
  for (const bool light : {false, true}) {
    if (light) {
      segments.gyration_radius[n - 1] = segments.center[n - 1] = 0.0;
      pipe.terms = {pipedyn::make_term("point_mass", 1.0, {0.3})};
    }
    std::vector<Index> held;
    Vector value = Vector::Zero(n > 3 ? 4 : n - 1);
    if (n > 1) held = {3 * n - 3};
    if (n > 2) held.push_back(3);
    if (n > 3) held = {3 * n - 6, 3 * n - 5, 0, 1};
    if (n > 3) value << 0.1, 0.7, 0.0, segments.base + segments.length[0];
    const Scene made(pipe, segments, held, value);
    Matrix theta = 0.3 * dice.matrix(n, 1), omega = dice.matrix(n, 1);
    const Vector missed = made.project(theta, omega);
    check(missed[0] < 1e-9, "guides and pins are met");
    Vector y(2 * n);
    y << theta, omega;
    Matrix jacobian(2 * n, 2 * n);
    made.jacobian({y.data(), &u, 1, 0}, jacobian.data());
    pipedyn::SceneSystems systems(
        made, [u](double, Index) { return pipedyn::Flows{.u = pipedyn::Vector::Constant(1, u)}; });
    systems.linearise(0.0, y.data(), 0);
    check_shifted(jacobian, 1e-11, dice, [&](const double* mu, double* x) {
      systems.factorise(mu);
      systems.solve(x);
    });
  }
}

void check_scenes() {
  Dice dice;
  const std::string before = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (const Index n : {1, 2, 3, 20}) {
      scene = level + ", systems of a scene of " + std::to_string(n);
      check_scene_systems({.beta = 0.3, .gamma = 4.0}, n, dice);
      check_scene_systems({.beta = 0.3, .drag = 0.7, .damping = 0.01, .aspirating = true}, n, dice);
    }
  }
  pipedyn::set_vector_level(before);
}

// ---------------------------------------------------------------------------- random extremes

/// Any size and pipe that Python lets through, each range's ends among them.
struct Wild {
  Dice& dice;

  double one_of(std::initializer_list<double> values) {
    const auto at = static_cast<std::size_t>(dice.between(0.0, static_cast<double>(values.size())));
    return values.begin()[std::min(at, values.size() - 1)];
  }
  Index size(std::initializer_list<double> values) { return static_cast<Index>(one_of(values)); }
  Pipe pipe() {
    const bool aspirating = one_of({0.0, 1.0}) == 1.0;
    return Pipe{.beta = one_of({0.0, 1e-12, 0.5, 0.999999}),
                .gamma = one_of({-1e6, -10.0, 0.0, 10.0, 1e6}),
                .end_coefficient = one_of({0.0, 0.5, 1.0, 1e6}),
                .drag = one_of({0.0, 0.7, 1e9}),
                .damping = one_of({0.0, 1e-4, 1e6}),
                .aspirating = aspirating,
                .inflow_share = aspirating ? 0.5 : 1.0,
                .jet_angle = aspirating ? 0.0 : 1.5};
  }
  Segments segments(Index n) {
    Segments made = dice.segments(n);
    if (one_of({0.0, 1.0}) == 1.0) made.base = 0.0;
    made.length[n - 1] *= one_of({1.0, 1e-6});
    made.length *= (1.0 - made.base) / made.length.sum();
    made.spring *= one_of({0.0, 1.0, 1e8});
    made.gyration_radius.head(n - 1) *= one_of({0.0, 1.0});
    return made;
  }
  /// Coordinates and rates (2 half, members), at rest, bent, coiled or beyond all sense.
  Matrix states(Index half, Index members) {
    Matrix y = dice.matrix(2 * half, members);
    y.topRows(half) *= one_of({0.0, 1e-300, 1.0, 1e6, 1e300});
    y.bottomRows(half) *= one_of({0.0, 1.0, 1e6, 1e300});
    return y;
  }
  double speed() { return one_of({0.0, 3.0, 1e4, 1e100}); }
  /// Terms of any laws, some of them without strength or at one place.
  pipedyn::Terms terms(Index count) {
    pipedyn::Terms made;
    for (Index i = 0; i < count; ++i) {
      const auto law = static_cast<std::size_t>(dice.between(0.0, std::size(Laws::names)));
      const double at = one_of({1e-300, 0.6, 1.0, dice.between(0.01, 0.99)});
      const std::string name = Laws::names[law];
      // The second number of a mass is its radius of gyration, that of a load all along its count
      // of polynomials, which takes as many nodes.
      const double largest = name == "point_mass" ? 1e3 : name == "applied_load" ? 49.0 : 1e6;
      const double first = one_of({0.0, 1e-300, 1.0, 1e6});
      const double second = one_of({0.0, 1.0, largest});
      made.push_back(pipedyn::make_term(name, at, {first, second}));
    }
    return made;
  }
};

constexpr double within_sense = 1e7;  // of states and speeds whose rates are numbers

/// Every batch writes its own columns and nothing else, and each member is as it is alone.
template <class Model>
void check_wild_motion(const Model& model, Wild& wild) {
  const Index rows = 2 * model.dof(), members = wild.size({0, 1, 2, 7, 8, 19});
  const double untouched = -7.0;
  const Matrix y = wild.states(model.dof(), members);
  const double u = wild.speed();
  const pipedyn::Batch batch{y.data(), &u, members, 0};
  Vector energies = Vector::Constant(members + 1, untouched);
  Vector power = Vector::Constant(5 * members + 1, untouched);
  Vector all = Vector::Constant((rows + 1) * members + 1, untouched);
  model.rhs_and_power(batch, all.data());
  model.energy(batch, energies.data());
  model.power(batch, power.data());
  check(all[(rows + 1) * members] == untouched, "rates stay within their array");
  check(energies[members] == untouched && power[5 * members] == untouched,
        "energy and power stay within their arrays");
  Matrix jacobian(rows, rows);
  if (members == 0) {
    const Vector rest = Vector::Zero(rows);
    model.jacobian({rest.data(), &u, 1, 0}, jacobian.data());
    return;
  }
  const Vector first = y.col(0);
  model.jacobian({first.data(), &u, 1, 0}, jacobian.data());
  Vector alone(rows + 1);
  model.rhs_and_power({first.data(), &u, 1, 0}, alone.data());
  if (y.cwiseAbs().maxCoeff() > 2.0 || u > within_sense || !alone.allFinite()) return;
  const Matrix together = Eigen::Map<const Matrix>(all.data(), rows + 1, members);
  check_close(together.col(0), alone, 1e-9, "a member of a batch is as it is alone");
  check(jacobian.allFinite(), "the Jacobian is finite where the rates are");
}

void check_wild_chain(Wild& wild) {
  const Index n = wild.size({1, 2, 3, 8, 33});
  scene = "any chain of " + std::to_string(n);
  Pipe pipe = wild.pipe();
  const Segments segments = wild.segments(n);
  const Chain chain(pipe, segments);
  check_wild_motion(chain, wild);
  pipe.terms = wild.terms(wild.size({1, 4, 15}));
  check_wild_motion(Chain(pipe, segments), wild);
  const Matrix x = wild.dice.matrix(n, wild.size({0, 1, 5}));
  check(chain.joint_times(x, {1.0, 1.0, 1.0, 1.0, 1.0}).allFinite(), "products are finite");
  check(chain.operators(wild.states(n, 1).col(0).head(n)).mass.allFinite(), "mass is finite");
}

void check_wild_reduced(Wild& wild) {
  const Family family = wild.one_of({0.0, 1.0}) == 1.0 ? Family::beam : Family::legendre;
  const Index m = wild.size({2, 3, 5});
  scene = "any reduced model of " + std::to_string(m);
  Pipe pipe = wild.pipe();
  const Galerkin plain(pipe, Basis(family, family == Family::beam ? m - 1 : m));
  check_wild_motion(plain, wild);
  const Vector joints = family == Family::beam ? Vector() : Vector::Constant(1, 0.6);
  const Basis basis(family, m, joints);
  pipe.terms = {pipedyn::make_term("point_mass", 0.6, {wild.one_of({0.0, 1.0, 1e6})}),
                pipedyn::make_term("spring", 0.6, {3.0}),
                pipedyn::make_term("point_mass", 1.0, {0.2}),
                pipedyn::make_term("spring", 1.0, {wild.one_of({0.0, 1e9})})};
  const Galerkin with_terms(pipe, basis);
  check_wild_motion(with_terms, wild);
  Pipe loaded = pipe;
  loaded.terms = wild.terms(wild.size({1, 4, 15}));
  check_wild_motion(Galerkin(loaded, basis), wild);
  const Vector q = wild.dice.vector(m, -1.0, 1.0);
  check(positive_definite(with_terms.operators(q).mass), "mass is positive definite");
  check(with_terms.operators().stiffness.allFinite(), "stiffness is finite");
  check(basis.evaluate(Vector(), 0).size() == 0, "functions at no place");
  for (const int derivative : {0, 1, 2}) {
    const Vector ends = (Vector(3) << 0.0, 0.6, 1.0).finished();
    check(basis.evaluate(ends, derivative).allFinite(), "functions are finite at the ends");
  }
}

void check_extremes() {
  Dice dice;
  Wild wild{dice};
  const std::string before = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (int i = 0; i < 60; ++i) check_wild_chain(wild);
    for (int i = 0; i < 12; ++i) check_wild_reduced(wild);
  }
  pipedyn::set_vector_level(before);
}

// ------------------------------------------------------------------------------- eigenvalues

/// Roots whose real parts are cubics in u, each pair with a frequency of its own, in random order.
class Branches : public pipedyn::Spectrum {
 public:
  explicit Branches(const Matrix& of)
      : Spectrum({2 * of.rows(), 0.0, 1e-6, true, false, false, false}), cubics_(of) {}

  double real(Index branch, double u) const {
    const auto c = cubics_.row(branch);
    return c(0) + u * (c(1) + u * (c(2) + u * c(3)));
  }
  double slope(Index branch, double u) const {
    const auto c = cubics_.row(branch);
    return c(1) + u * (2.0 * c(2) + 3.0 * u * c(3));
  }
  Index unstable(double u) const {
    Index count = 0;
    for (Index k = 0; k < cubics_.rows(); ++k) count += real(k, u) > 0.0 ? 2 : 0;
    return count;
  }

  void sample(double u, Index, pipedyn::Sample& at) override {
    const Index size = 2 * cubics_.rows();
    std::vector<Index> order(size);
    for (Index i = 0; i < size; ++i) order[i] = i;
    std::shuffle(order.begin(), order.end(), shuffler_);
    at.u = u;
    at.values = at.slopes = pipedyn::Values(size);
    for (Index i = 0; i < size; ++i) {
      const Index branch = order[i] / 2;
      const double frequency = frequency_of(branch);
      at.values[i] = {real(branch, u), order[i] % 2 == 0 ? frequency : -frequency};
      at.slopes[i] = slope(branch, u);
    }
    at.residual = at.uncertain = at.slope_noise = at.signatures = pipedyn::Reals::Zero(size);
    at.noise = pipedyn::Reals::Constant(size, 1e-14);
  }
  pipedyn::Pair refined(double u, const pipedyn::Pair& guess, bool) override {
    const Index branch = static_cast<Index>(std::lround((guess.value.imag() - 5.0) / 2.0));
    return {{real(branch, u), frequency_of(branch)}, {}, {}, 0.0, 1e-15, slope(branch, u)};
  }
  pipedyn::Reals quotients(double, const pipedyn::Pairs& pairs) override {
    return pairs.values.abs2();
  }
  pipedyn::Divergences divergences(double, bool) override { return {}; }
  std::vector<double> numbers() const override {
    return {cubics_.data(), cubics_.data() + cubics_.size()};
  }
  bool all_roots(double u, pipedyn::Values& roots) override {
    for (pipedyn::Complex& one : roots) one = refined(u, {one}, false).value;
    return true;
  }

 private:
  static double frequency_of(Index branch) { return 5.0 + 2.0 * static_cast<double>(branch); }

  const Matrix cubics_;
  std::mt19937_64 shuffler_{1};
};

/// No permutation costs less than the assignment; whole numbers make ties.
void check_assignment() {
  Dice dice;
  for (int trial = 0; trial < 300; ++trial) {
    scene = "assignment " + std::to_string(trial);
    const Index size = 1 + trial % 6;
    std::vector<double> cost(size * size);
    for (double& one : cost) one = dice.between(0.0, 4.0);
    if (trial % 2 == 0)
      std::for_each(cost.begin(), cost.end(), [](double& x) { x = std::floor(x); });
    const auto total = [&](const pipedyn::Roots& columns) {
      double sum = 0.0;
      for (Index i = 0; i < size; ++i) sum += cost[i * size + columns[i]];
      return sum;
    };
    pipedyn::Roots found = pipedyn::assignment(cost, size), columns(size);
    std::iota(columns.begin(), columns.end(), 0);
    double least = total(columns);
    while (std::next_permutation(columns.begin(), columns.end())) {
      least = std::min(least, total(columns));
    }
    check(std::abs(total(found) - least) < 1e-12, "the assignment costs least");
    std::sort(found.begin(), found.end());
    std::iota(columns.begin(), columns.end(), 0);
    check(found == columns, "each column is taken once");
  }
}

using Complexes = Eigen::MatrixXcd;

template <class Number>
auto columns(Number* data, Index rows, Index count) {
  return Eigen::Map<Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic>>(data, rows, count);
}

/// Memory taken within its scope does not count: that of what stands for LAPACK.
struct Uncounted {
  const Index before = allocations;
  ~Uncounted() { allocations = before; }
};

/// x of A x = b or A^H x = b, for getrs, where the factors are A itself.
template <class Number>
void solve(char* kind, int* n, int* count, Number* a, int*, int*, Number* b, int* rows, int*) {
  using Table = Eigen::Matrix<Number, Eigen::Dynamic, Eigen::Dynamic>;
  const Uncounted uncounted;
  const Table factor = columns(a, *n, *n);
  auto x = columns(b, *rows, *count).topRows(*n);
  x = solved<Table>(*kind == 'C' ? Table(factor.adjoint()) : factor, x);
}

/// LAPACK by Eigen, as far as eigenpairs take it. If it is not exact, its dgeev is off by a part in
/// a million; its zgetrs solves or fails. Factors are left to the solves.
template <bool solves, bool exact = false>
pipedyn::Lapack broken_lapack() {
  using pipedyn::Complex;
  return {
      .dgemm =
          [](char*, char*, int* m, int* n, int* k, double*, double* a, int*, double* b, int*,
             double*, double* c, int*) {
            const Uncounted uncounted;
            columns(c, *m, *n) = columns(a, *k, *m).transpose() * columns(b, *k, *n);
          },
      .dgetrf = [](int*, int*, double*, int*, int*, int*) {},
      .dgetrs = solve<double>,
      .zgetrf = [](int*, int*, Complex*, int*, int*, int*) {},
      .zgetrs =
          [](char* kind, int* n, int* count, Complex* lu, int* ldlu, int* pivots, Complex* b,
             int* rows, int* info) {
            solve<Complex>(kind, n, count, lu, ldlu, pivots, b, rows, info);
            if (!solves) columns(b, *n, *count) *= std::nan("");
          },
      .dgeev =
          [](char* left, char* right, int* n, double* a, int*, double* real, double* imag,
             double* lefts, int*, double* vectors, int*, double* work, int* length, int*) {
            const Uncounted uncounted;
            if (*length < 0) {
              work[0] = 4.0 * *n;
              return;
            }
            const Eigen::EigenSolver<Eigen::MatrixXd> found(columns(a, *n, *n));
            const double off = exact ? 1.0 : 1.0 + 1e-6;
            columns(real, *n, 1) = off * found.eigenvalues().real();
            columns(imag, *n, 1) = off * found.eigenvalues().imag();
            const Eigen::MatrixXd all = found.pseudoEigenvectors();
            if (*right == 'V') columns(vectors, *n, *n) = all;
            if (*left != 'V') return;
            columns(lefts, *n, *n) =
                solved<Eigen::MatrixXd>(all.transpose(), Eigen::MatrixXd::Identity(*n, *n));
          },
      .dggev = nullptr,
      .zgeev =
          [](char*, char*, int* n, Complex* a, int*, Complex* values, Complex* lefts, int*,
             Complex* vectors, int*, Complex* work, int* length, double*, int*) {
            const Uncounted uncounted;
            if (*length < 0) {
              work[0] = 4.0 * *n;
              return;
            }
            // The vectors x of A are [x; -i x] of this real matrix, which has those of the
            // conjugate of A as well, [x; i x].
            const Complexes matrix = columns(a, *n, *n);
            Eigen::MatrixXd both(2 * *n, 2 * *n);
            both << matrix.real(), -matrix.imag(), matrix.imag(), matrix.real();
            const Eigen::EigenSolver<Eigen::MatrixXd> found(both);
            const Complexes all = found.eigenvectors();
            Complexes x(*n, *n);
            for (Index k = 0, next = 0; k < 2 * *n && next < *n; ++k) {
              x.col(next) = all.col(k).head(*n) + Complex(0.0, 1.0) * all.col(k).tail(*n);
              if (x.col(next).norm() > 1e-6) values[next++] = found.eigenvalues()[k];
            }
            columns(vectors, *n, *n) = x;
            columns(lefts, *n, *n) = solved<Complexes>(x, Complexes::Identity(*n, *n)).adjoint();
          },
      .dsygvd = nullptr,
  };
}

using SharedDeterminant = std::shared_ptr<const pipedyn::Determinant>;

SharedDeterminant determinant_of(const Chain& chain) {
  pipedyn::Complement free(chain.held_rows(chain.elastic_scale()));
  return std::make_shared<pipedyn::ChainDeterminant>(std::make_shared<const Chain>(chain),
                                                     std::move(free), broken_lapack<true, true>());
}

/// Of Legendre functions, with a panel between any two supports.
SharedDeterminant determinant_of(const Pipe& pipe, Index size) {
  const std::vector<double>& held = pipe.supports;
  const auto joints = Eigen::Map<const Vector>(held.data(), static_cast<Index>(held.size()));
  const auto pencil = std::make_shared<const pipedyn::PanelPencil>(
      pipe, Basis(Family::legendre, size, joints, 0, pipe));
  const pipedyn::Complement free(pencil->held().transpose());
  const Matrix lift = free.lifted(Matrix::Identity(free.dof(), free.dof()));
  return std::make_shared<pipedyn::PanelDeterminant>(pencil, broken_lapack<true, true>(), lift,
                                                     lift.transpose());
}

/// Roots of a model by its matrices, without its loss factor.
pipedyn::Values eigenvalues(const pipedyn::Determinant& of, double u) {
  const auto pencil = of.matrices(1.0);
  const auto& [mass, velocity, damping, stiffness, flux, lost] = pencil.matrices;
  const Index n = mass.rows();
  Matrix step = Matrix::Zero(2 * n, 2 * n);
  step.topRightCorner(n, n).setIdentity();
  step.bottomLeftCorner(n, n) =
      -solved<Matrix>(mass, stiffness + pencil.end_coefficient * u * u * flux);
  step.bottomRightCorner(n, n) = -solved<Matrix>(mass, u * velocity + damping);
  return Eigen::EigenSolver<Eigen::MatrixXd>(step, false).eigenvalues();
}

/// All eigenvalues of a chain's matrices pass the check that no root is missing, and no fewer; nor
/// do they with one in place of another, or beside its own.
void check_completeness() {
  Dice dice;
  for (int trial = 0; trial < 60; ++trial) {
    scene = "roots " + std::to_string(trial);
    const Index n = 2 + trial % 9;
    const Chain chain(dice.pipe(trial % 3 == 0), dice.segments(n));
    const double u = dice.between(0.5, 8.0);
    pipedyn::Approximations roots;
    const SharedDeterminant determinant = determinant_of(chain);
    const pipedyn::Determinant& of = *determinant;
    for (const pipedyn::Complex value : eigenvalues(of, u)) {
      if (value.imag() >= 0.0) roots.push_back({value, value.imag() == 0.0});
    }
    pipedyn::RootsMemory memory;
    check(pipedyn::correct(of, u, roots, memory), "eigenvalues are near the determinant's roots");
    check(pipedyn::roots_in(roots) == 2 * n, "as many roots as the matrices have");
    check(pipedyn::has_all(of, u, roots, memory), "no root is missing");
    for (std::size_t k = 0; k < roots.size(); ++k) {
      pipedyn::Approximations wrong = roots;
      wrong[k].value *= 1.0 + 1e-4;
      check(!pipedyn::has_all(of, u, wrong, memory), "a root is off by 1e-4");
      wrong[k].value = roots[k == 0 ? roots.size() - 1 : k - 1].value;
      check(!pipedyn::has_all(of, u, wrong, memory), "a root stands in place of another");
      wrong.erase(wrong.begin() + static_cast<std::ptrdiff_t>(k));
      check(!pipedyn::has_all(of, u, wrong, memory), "a root is missing");
    }
  }
}

using Determinants = std::function<SharedDeterminant(double number)>;
using Solver = std::function<std::unique_ptr<pipedyn::Eigenproblem>(const SharedDeterminant&)>;

/// Samples take their memory from those before, after a number of samples. Returns the last one.
std::shared_ptr<pipedyn::Sample> check_samples(pipedyn::Spectrum& spectrum, Index before) {
  std::shared_ptr<pipedyn::Sample> left;
  const Index every = 2 * spectrum.traits.dof;
  Index first = 0;
  for (Index i = 0; i < before + 12; ++i) {
    if (i == before) first = allocations;
    std::shared_ptr<pipedyn::Sample> right = spectrum.unused_sample();
    spectrum.sample(2.0 + 0.05 * static_cast<double>(i), every, *right);
    left.swap(right);
  }
  const Index taken = allocations - first;
  check(taken == 0, "further samples take " + std::to_string(taken) + " new pieces of memory");
  check(left->size() == every, "samples have every root");
  return left;
}

constexpr Index kept_samples = 12;  // a search keeps the roots of eight samples

/// So does the next search, of another number.
void check_memory_of(const Determinants& determinant, const Solver& solver) {
  std::unique_ptr<pipedyn::Eigenproblem> before;
  for (const double number : {0.0, 0.1, 0.2}) {
    const SharedDeterminant of = determinant(number);
    auto spectrum = solver(of);
    if (before != nullptr) spectrum->reuse(*before);
    auto* const recursion = dynamic_cast<pipedyn::Structured*>(spectrum.get());
    if (recursion != nullptr) recursion->assume(2.0, eigenvalues(*of, 2.0));
    const auto last = check_samples(*spectrum, before == nullptr ? kept_samples : 2);
    const bool right =
        recursion != nullptr ? last->residual.maxCoeff() < 1e-12 : last->converged().all();
    check(right, "samples are right");
    before = std::move(spectrum);
  }
}

/// Functions that are compared with more of them.
void check_memory_of_truncated() {
  const Pipe pipe{.beta = 0.2, .gamma = 10.0, .damping = 0.02};
  const auto made = [&](Index size) {
    const SharedDeterminant of = determinant_of(pipe, size);
    const pipedyn::Traits traits{size, pipe.damping, 1e-6, true, false, false, false};
    auto spectrum = std::make_shared<pipedyn::Structured>(traits, of, 1.0);
    spectrum->assume(2.0, eigenvalues(*of, 2.0));
    return spectrum;
  };
  scene = "memory, functions and more of them";
  pipedyn::Truncated both(made(10), made(14), 6);
  check_samples(both, kept_samples);
}

void check_memory() {
  Dice dice;
  const Segments segments = dice.segments(8);
  const std::vector<bool> guides{false, false, false, true, false, false, false, false};
  const Pipe plain{.beta = 0.2, .gamma = 10.0};
  Pipe pipes[] = {plain, plain, plain, plain, plain, plain};
  pipes[1].damping = 0.02;
  pipes[2].hysteresis = 0.1;
  pipes[3].beta = 0.0;
  pipes[4].terms = {pipedyn::make_term("spring", 1.0, {20.0}),
                    pipedyn::make_term("point_mass", 1.0, {0.3})};
  pipes[5].rotary_inertia = 0.01;
  for (const Pipe& pipe : pipes) {
    const auto chain = [&](double gamma) -> Chain {
      Pipe other = pipe;
      other.gamma += gamma;
      return {other, segments};
    };
    const auto functions = [&](double gamma, std::vector<double> supports) {
      Pipe other = pipe;
      other.gamma += gamma;
      other.supports = std::move(supports);
      return determinant_of(other, 10);
    };
    const std::pair<const char*, Determinants> models[] = {
        {"chain", [&](double gamma) { return determinant_of(chain(gamma)); }},
        {"guided chain", [&](double gamma) { return determinant_of(chain(gamma).guided(guides)); }},
        {"functions", [&](double gamma) { return functions(gamma, {}); }},
        {"functions on a support", [&](double gamma) { return functions(gamma, {0.6}); }},
    };
    for (const auto& [name, determinant] : models) {
      for (const int solver : {0, 1, 2}) {
        const char* const by[] = {"recursion", "matrices", "matrices that are mended"};
        scene = std::string("memory, pipe ") + std::to_string(&pipe - pipes) + ", " + name +
                " by " + by[solver];
        check_memory_of(determinant,
                        [&](const SharedDeterminant& of) -> std::unique_ptr<pipedyn::Eigenproblem> {
                          const bool damped = pipe.damping > 0.0 || pipe.hysteresis > 0.0;
                          pipedyn::Pencil pencil = of->matrices(1.0);
                          const pipedyn::Traits traits{
                              .dof = pencil.matrices[0].rows(),
                              .delta = pipe.damping,
                              .zero = 1e-6,
                              .damped = damped,
                              .conservative = false,
                              .squared = pipe.beta == 0.0,
                              .free_at_rest = !damped,
                              .loss = pipe.hysteresis,
                          };
                          if (solver == 0)
                            return std::make_unique<pipedyn::Structured>(traits, of, 1.0);
                          if (solver == 2) pencil.lapack = broken_lapack<true>();
                          return std::make_unique<pipedyn::Eigenproblem>(traits, std::move(pencil));
                        });
      }
    }
  }
}

/// Where two roots meet on the axis, one sample after another is taken to find the speed, in the
/// same memory.
void check_memory_of_search() {
  scene = "memory, two roots that meet";
  Dice dice;
  const Chain chain(Pipe{.beta = 0.0, .gamma = 10.0}, dice.segments(8));
  const pipedyn::Traits traits{
      .dof = 8,
      .delta = 0.0,
      .zero = 1e-6,
      .damped = false,
      .conservative = false,
      .squared = true,
      .free_at_rest = true,
  };
  pipedyn::Eigenproblem problem(traits, determinant_of(chain)->matrices(1.0));
  std::vector<Index> taken;
  taken.reserve(1000);
  const auto found = pipedyn::crossings(problem, {8.0, 1.0, 16, 8, 8, 8, true},
                                        [&] { taken.push_back(allocations); });
  check(found.crossings.size() == 1 && found.crossings[0].change == 2,
        "two roots meet and flutter");
  Index longest = 0, run = 0;
  for (std::size_t i = 1; i < taken.size(); ++i) {
    run = taken[i] == taken[i - 1] ? run + 1 : 0;
    longest = std::max(longest, run);
  }
  check(longest > 5, "samples in a row without new memory are " + std::to_string(longest));
}

void check_crossings() {
  Dice dice;
  Index saved = 0, all = 0;
  for (int trial = 0; trial < 50; ++trial) {
    scene = "branches " + std::to_string(trial);
    const Index pairs = 1 + trial % 7;
    Branches branches(0.3 * dice.matrix(pairs, 4));
    const double end = 3.0;
    const auto found =
        pipedyn::crossings(branches, {end, 1.0, 2 * pairs, pairs, pairs, pairs, false}, [] {});
    check(found.failure.empty() && !found.untracked, "every crossing is found");
    check(found.unstable_at_rest == branches.unstable(0.0), "unstable roots at rest");
    for (const auto& crossing : found.crossings) {
      const Index branch = crossing.mode - 1;
      check(std::abs(branches.real(branch, crossing.speed)) < 1e-13, "the cubic is zero there");
      check((branches.slope(branch, crossing.speed) > 0.0) == (crossing.change > 0),
            "a rising crossing has a positive slope");
    }
    for (int i = 1; i <= 300; ++i) {
      const double u = end * i / 300.0;
      Index unstable = found.unstable_at_rest;
      for (const auto& crossing : found.crossings)
        unstable += crossing.speed < u ? crossing.change : 0;
      check(unstable == branches.unstable(u), "the crossings account for the unstable roots");
    }
    const auto loci = pipedyn::root_loci(branches, {0.0, 1.5, end}, pairs, 2 * pairs, [](Index) {});
    for (Index k = 0; k < pairs; ++k) {
      check(loci && loci->values(2, k).real() == branches.real(k, end) &&
                loci->partners(2, k) == std::conj(loci->values(2, k)),
            "a branch stays itself");
    }
  }
  for (int trial = 0; trial < 50; ++trial) {
    scene = "neighbours " + std::to_string(trial);
    const Index pairs = 2 + trial % 5, count = 60;
    const Matrix one = 0.3 * dice.matrix(pairs, 4), change = 0.02 * dice.matrix(pairs, 4);
    std::vector<std::shared_ptr<pipedyn::Spectrum>> family;
    for (Index k = 0; k < count; ++k) {
      Matrix cubics = one + (static_cast<double>(k) / count) * change;
      cubics.col(0) = -cubics.col(0).cwiseAbs();  // stable at rest
      if (k == 17) cubics(1, 3) += 0.2;           // off the line
      family.push_back(std::make_shared<Branches>(cubics));
    }
    const std::vector<pipedyn::Range> ranges(
        count, {3.0, 1.0, 4 * pairs, 2 * pairs, 2 * pairs, 2 * pairs, true});
    std::vector<pipedyn::Sweep> found(count);
    Index samples = 0, own_samples = 0;
    pipedyn::search_together(family, ranges, [](Index) {}, [&] { ++samples; }, found);
    for (Index k = 0; k < count; ++k) {
      const auto own = pipedyn::crossings(*family[k], ranges[k], [&] { ++own_samples; });
      check(found[k].crossings.size() == own.crossings.size(), "as many crossings as alone");
      for (std::size_t i = 0; i < own.crossings.size(); ++i) {
        const auto &a = found[k].crossings[i], &b = own.crossings[i];
        check(a.speed == b.speed && a.mode == b.mode && a.change == b.change && a.error == b.error,
              "the crossing of the search alone");
      }
    }
    saved += own_samples - samples;
    all += own_samples;
  }
  check(4 * saved > all, "neighbours share samples");
  scene = "residuals";  // eps |lambda|^2 is 200 there
  check(pipedyn::has_converged({0.0, 1e9}, 1e-5) && !pipedyn::has_converged({0.0, 1e9}, 1e-2),
        "a large residual is no eigenvalue whatever rounding explains");
}

/// Damped oscillators, lambda^2 + 0.2 lambda + (i + 1)^2.
void check_mending() {
  scene = "a broken solver";
  constexpr Index size = 6;
  const Vector squares = Vector::LinSpaced(size, 1.0, size).array().square();
  const Matrix one = Matrix::Identity(size, size), none = Matrix::Zero(size, size);
  for (const bool solves : {false, true}) {
    const pipedyn::Lapack lapack = solves ? broken_lapack<true>() : broken_lapack<false>();
    const pipedyn::Pencil pencil{
        lapack, {one, none, 0.2 * one, squares.asDiagonal().toDenseMatrix(), none}, 0.0, 1.0};
    pipedyn::Eigenproblem problem({size, 0.0, 1e-6, true, false, false, false}, pencil);
    pipedyn::Pairs found;
    problem.lowest(1.0, 8, false, true, found);
    for (Index i = 0; i < found.values.size(); ++i) {
      const double exact = std::abs(pipedyn::Complex(-0.1, std::sqrt(squares[i / 2] - 0.01)));
      const double error = std::abs(std::abs(found.values[i]) - exact);
      const bool good = pipedyn::has_converged(found.values[i], found.residual[i]);
      check(good == solves, "a pair converges where it can be refined, and only there");
      check(!solves || error < 1e-13, "what is refined is right");
    }
  }
}

void check_threads() {
  for (const Index parts : {1, 2, 5, 3}) {
    std::vector<Index> calls(static_cast<std::size_t>(parts));
    pipedyn::run_on_threads(parts, [&](Index k) { ++calls[k]; });
    check(calls == std::vector<Index>(static_cast<std::size_t>(parts), 1),
          "each part is done once");
    for (Index failing = 0; failing < parts; ++failing) {
      check_refused(
          [&] {
            pipedyn::run_on_threads(parts, [&](Index k) {
              if (k == failing) throw std::invalid_argument("of a part");
            });
          },
          "a part that fails");
    }
  }
  Index nested = 0;
  pipedyn::run_on_threads(2, [&](Index k) {
    if (k == 0) pipedyn::run_on_threads(3, [&](Index) { ++nested; });
  });
  check(nested == 3, "parts may have parts");
  std::vector<int> covered(1000);
  pipedyn::in_parts(1000, 100, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) ++covered[k];
  });
  check(covered == std::vector<int>(1000, 1), "parts cover all");
}

}  // namespace

/// Sanitizers call it. Eigen takes memory by malloc, which operator new would not see.
extern "C" void __sanitizer_malloc_hook(const volatile void*, std::size_t) { ++allocations; }

int main() {
  check_guides();
  check_motion();
  check_radau();
  check_refusals();
  check_scenes();
  check_extremes();
  check_assignment();
  check_completeness();
  check_memory();
  check_memory_of_truncated();
  check_memory_of_search();
  check_crossings();
  check_mending();
  check_threads();
  std::printf("%d checks, %d failed\n", checks, failures);
  return failures == 0 ? 0 : 1;
}
