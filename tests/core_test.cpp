// SPDX-License-Identifier: MIT
//
// The core's own test: properties of random chains and of both bases, without Python. Prints every
// check that fails; the exit status says whether any did.
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <complex>
#include <cstdio>
#include <initializer_list>
#include <memory>
#include <numbers>
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
#include "pipedyn/linear/crossings.hpp"
#include "pipedyn/linear/determinant_roots.hpp"
#include "pipedyn/linear/eigenproblem.hpp"
#include "pipedyn/linear/tracking.hpp"
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
std::string scene;

/// a^-1 b by Gauss' elimination, in loops: Eigen's factorisations take longer to compile than all
/// other tests.
template <class Table>
Table solved(Table a, Table b, typename Table::Scalar* determinant = nullptr) {
  typename Table::Scalar product = 1.0;
  for (Index k = 0; k < a.rows(); ++k) {
    Index pivot = k;
    for (Index i = k + 1; i < a.rows(); ++i) {
      if (std::abs(a(i, k)) > std::abs(a(pivot, k))) pivot = i;
    }
    for (Index j = 0; j < a.cols(); ++j) std::swap(a(k, j), a(pivot, j));
    for (Index j = 0; j < b.cols(); ++j) std::swap(b(k, j), b(pivot, j));
    product *= pivot == k ? a(k, k) : -a(k, k);
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
  if (determinant != nullptr) *determinant = product;
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
                .centrifugal = between(0.0, 2.0),
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

Matrix lower_ones(Index n) { return Matrix::Ones(n, n).triangularView<Eigen::Lower>(); }

/// The products agree with the dense operators.
void check_products(const Pipe& pipe, const Chain& chain, const Operators& dense, Dice& dice) {
  const Index n = chain.dof();
  const Matrix x = dice.matrix(n, 3), basis = lower_ones(n);
  const auto check_same = [&](const LinearPart& part, const Matrix& whole, const char* name) {
    const Matrix expected = basis.transpose() * whole * basis * x;
    check_close(chain.joint_times(x, part), expected, 1e-12, name);
  };
  const Matrix velocity = pipe.direction() * (dense.gyroscopic + dense.end_flux);
  check_same({.square = 1.0}, dense.mass, "M x");
  check_same({.velocity = 1.0}, velocity, "V x");
  check_same({.rate = 1.0}, dense.damping, "D x");
  check_same({.still = 1.0}, dense.stiffness, "K x");
  check_same({.flux = 1.0}, dense.flux, "A x");
}

/// Without weight, stiffness is what the springs' energy says.
void check_springs(const Segments& segments, const Operators& weightless, Dice& dice) {
  const Matrix x = dice.matrix(segments.length.size(), 3);
  const Matrix turns = solved<Matrix>(lower_ones(x.rows()), x);
  const Matrix energy = x.transpose() * weightless.stiffness * x;
  check_close(energy, turns.transpose() * segments.spring.asDiagonal() * turns, 1e-12,
              "twice the springs' energy");
}

/// Joint angles divided by their scale are another basis of the same operators.
void check_joint_operators(const Chain& chain, const Operators& angle, Dice& dice) {
  const Index n = chain.dof();
  const Vector scale = dice.vector(n, 0.1, 2.0);
  const Operators joint = chain.joint_operators(scale);
  const Matrix basis = lower_ones(n) * scale.asDiagonal();
  const auto check_same = [&](const Matrix Operators::* part, const char* name) {
    const Matrix expected = basis.transpose() * (angle.*part) * basis;
    check_close(joint.*part, expected, 1e-11, std::string("joint operator ") + name);
  };
  check_same(&Operators::mass, "mass");
  check_same(&Operators::gyroscopic, "gyroscopic");
  check_same(&Operators::end_flux, "end_flux");
  check_same(&Operators::damping, "damping");
  check_same(&Operators::stiffness, "stiffness");
  check_same(&Operators::flux, "flux");
}

/// The operators agree with what they stand for, computed from the motion itself.
void check_physics(const Pipe& pipe, const Segments& segments, const Operators& dense,
                   const Operators& weightless, Dice& dice) {
  const Index n = segments.length.size();
  const Vector rates = dice.vector(n, -1.0, 1.0);
  double node = 0.0, twice_kinetic = 0.0;
  for (Index j = 0; j < n; ++j) {
    const double center = node + segments.center[j] * segments.length[j] * rates[j];
    const double spin = segments.gyration_radius[j] * rates[j];
    twice_kinetic += segments.length[j] * (center * center + spin * spin);
    node += segments.length[j] * rates[j];
  }
  const auto check_number = [](double got, double expected, const char* claim) {
    check_close(Vector::Constant(1, got), Vector::Constant(1, expected), 1e-11, claim);
  };
  check_number(rates.dot(dense.mass * rates), twice_kinetic, "twice the kinetic energy");
  check(positive_definite(dense.mass), "mass is positive definite");
  check_close(dense.gyroscopic, -dense.gyroscopic.transpose(), 0.0, "gyroscopic is skew");
  const Matrix velocity = dense.gyroscopic + dense.end_flux;
  check_number(rates.dot(velocity * rates), pipe.inflow_share * pipe.sqrt_beta() * node * node,
               "the flow's power goes through the free end only");
  // With the angles as unknowns of unit determinant, no flow changes det K of a weightless chain.
  const double thrust = 30.0;
  const Matrix scaled = segments.spring.cwiseInverse().asDiagonal() *
                        (lower_ones(n).transpose() *
                         (weightless.stiffness + thrust * weightless.flux) * lower_ones(n));
  double determinant = 0.0;
  solved<Matrix>(scaled, scaled, &determinant);
  check_number(determinant, 1.0, "det K does not depend on the flow");
}

/// The routes to the operators agree for a pipe with terms, and the products with them.
void check_terms(const Pipe& pipe, const Chain& chain, Dice& dice) {
  const Operators dense = chain.operators();
  check_joint_operators(chain, dense, dice);
  check_products(pipe, chain, dense, dice);
}

/// d log det P / dlambda = tr(P^-1 dP/dlambda), in what guides leave of the joint angles.
void check_log_derivative(const Chain& chain, double u, Dice& dice) {
  using pipedyn::Complex, pipedyn::ComplexTable;
  const Vector scale = dice.vector(chain.dof(), 0.3, 3.0);
  const pipedyn::ImpedanceModel model = chain.impedance();
  const pipedyn::Complement complement(chain.held_rows(scale));
  const Matrix basis = complement.spread(Matrix::Identity(complement.dof(), complement.dof()));
  check_close(complement.gathered(basis), Matrix::Identity(basis.cols(), basis.cols()), 1e-14,
              "the basis is orthonormal");
  const Operators ops = chain.joint_operators(scale);
  const auto reduced = [&](const Matrix& of) -> ComplexTable {
    return (basis.transpose() * of * basis).cast<Complex>();
  };
  const Matrix velocity = ops.gyroscopic + ops.end_flux;
  const ComplexTable mass = reduced(ops.mass);
  const ComplexTable rate = reduced((model.coriolis < 0.0 ? -u : u) * velocity + ops.damping);
  const double centrifugal = chain.pipe().centrifugal;
  const ComplexTable still = reduced(ops.stiffness + centrifugal * u * u * ops.flux);
  const double re[] = {0.3, -2.0, 0.1}, im[] = {1.5, 7.0, 90.0};
  double found[6];
  pipedyn::motion_kernel().impedance->log_derivative(model, {u, 3, re, im}, found);
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
  check_refused([&] { Chain(Pipe{}, dice.segments(3)).guided({true}); }, "guides of another chain");
}

void check_chains() {
  Dice dice;
  for (const Index n : {1, 2, 3, 50}) {
    for (const bool aspirating : {false, true}) {
      scene = "chain of " + std::to_string(n) + (aspirating ? ", aspirating" : ", ejecting");
      const Pipe pipe = dice.pipe(aspirating);
      const Segments segments = dice.segments(n);
      const Chain chain(pipe, segments);
      check(chain.dof() == n, "dof");
      Pipe without_weight = pipe;
      without_weight.gamma = 0.0;
      const Operators dense = chain.operators();
      const Operators weightless = Chain(without_weight, segments).operators();
      check_close(dense.damping, pipe.damping * weightless.stiffness, 1e-15, "damping is elastic");
      check_products(pipe, chain, dense, dice);
      check_springs(segments, weightless, dice);
      check_joint_operators(chain, dense, dice);
      check_physics(pipe, segments, dense, weightless, dice);
      Pipe with_terms = pipe;
      with_terms.terms = dice.terms();
      check_terms(with_terms, Chain(with_terms, segments), dice);
    }
  }
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
  for (const Family family : {Family::beam, Family::legendre}) {
    check_refused([&] { Basis(family, 0); }, "a basis without functions");
    check_refused([&] { Basis(family, -1); }, "a negative number of functions");
    const Vector middle = Vector::Constant(1, 0.5);
    check_refused([&] { Basis(family, 2).evaluate(middle, 3); }, "a third derivative");
    check_refused([&] { Basis(family, 2).evaluate(middle, -1); }, "a negative derivative");
  }
}

// -------------------------------------------------------------------------------------- motion

Matrix rates_of(const Chain& chain, const Matrix& y, const Vector& u) {
  Matrix rates(y.rows(), y.cols());
  chain.rhs({y.data(), u.data(), y.cols(), u.size() == 1 ? 0 : 1}, rates.data());
  return rates;
}

Vector energies_of(const Chain& chain, const Matrix& y) {
  Vector energies(y.cols());
  const double still = 0.0;
  chain.energy({y.data(), &still, y.cols(), 0}, energies.data());
  return energies;
}

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

/// Accelerations from the equations of motion in the angles, with the dense mass matrix.
Vector dense_accelerations(const Pipe& pipe, const Segments& segments, const Vector& y, double u) {
  const auto& [l, chi, eta, spring, xi, base, damping, rest_moment, own_mass] = segments;
  const Index n = l.size();
  const Vector angle = y.head(n), rate = y.tail(n), own = own_mass.size() > 0 ? own_mass : l;
  const double coriolis = pipe.sqrt_beta() * pipe.direction() * u;
  Matrix mass(n, n), lever = Matrix::Zero(n, n);
  Vector force = Vector::Zero(n);
  for (Index k = 0; k < n; ++k) {
    const double beyond = own.tail(n - 1 - k).sum(), arm = chi[k] * l[k];
    for (Index i = 0; i < n; ++i) {
      const Index near = std::min(k, i), far = std::max(k, i);
      const double reach = own.tail(n - 1 - far).sum() + chi[far] * own[far];
      const double turn = angle[k] - angle[i];
      const double missing = (1.0 - pipe.inflow_share) * coriolis;
      force[k] -= missing * l[k] * l[i] * std::cos(turn) * rate[i];
      double coupling = l[near] * l[far] * reach;
      if (i == k) coupling = l[k] * l[k] * beyond + own[k] * (arm * arm + eta[k] * eta[k]);
      mass(k, i) = coupling * std::cos(turn);
      force[k] += coupling * std::sin(turn) * rate[i] * rate[i];
      if (i > k) force[k] += 2.0 * coriolis * l[k] * l[i] * std::cos(turn) * rate[i];
      if (i < k) lever(k, i) = l[i] * std::cos(turn);
    }
    lever(k, k) = xi[k] * l[k];
    force[k] += coriolis * l[k] * l[k] * rate[k];
    const double jet = angle[n - 1] + pipe.jet_angle;
    force[k] += pipe.centrifugal * u * u * l[k] * std::sin(jet - angle[k]);
    force[k] += pipe.gamma * l[k] * (beyond + chi[k] * own[k]) * std::sin(angle[k]);
    const double turn = angle[k] - (k > 0 ? angle[k - 1] : 0.0);
    const double turning = rate[k] - (k > 0 ? rate[k - 1] : 0.0);
    const double resisted = damping.size() > 0 ? damping[k] : pipe.damping * spring[k];
    const double rest = rest_moment.size() > 0 ? rest_moment[k] : 0.0;
    const double moment = spring[k] * turn - rest + resisted * turning;
    force[k] += moment;
    if (k > 0) force[k - 1] -= moment;
  }
  const Vector across = lever * rate;
  const Vector drag = pipe.drag * l.array() * across.array().abs() * across.array();
  force += lever.transpose() * drag;
  return solved<Matrix>(mass, -force);
}

void check_motion_of(const Pipe& pipe, const Segments& segments, double u, Dice& dice) {
  const Chain chain(pipe, segments);
  const Index n = chain.dof();
  const double tolerance = 1e-12 * static_cast<double>(1 + n);
  const Matrix y = 2.0 * dice.matrix(2 * n, 19);
  const Vector speeds = dice.vector(19, 0.0, 2.0 * u);
  const Matrix rates = rates_of(chain, y, speeds);
  check_close(rates.topRows(n), y.bottomRows(n), 0.0, "theta' is the state's");
  for (const Index j : {0, 7, 18}) {
    if (!pipe.terms.empty()) break;  // the dense equations have none
    check_close(rates.col(j).tail(n), dense_accelerations(pipe, segments, y.col(j), speeds[j]),
                tolerance, "theta'' by the dense equations");
  }
  for (Index width = 1; width < 19; ++width) {
    const Matrix some = rates_of(chain, y.leftCols(width), speeds.head(width));
    check_close(some, rates.leftCols(width), tolerance, "a batch is its members");
  }
  const Vector speed = Vector::Constant(1, u), state = y.col(0);
  const double step = 1e-4;
  Matrix jacobian(2 * n, 2 * n), differences(2 * n, 2 * n);
  chain.jacobian({state.data(), &u, 1, 0}, jacobian.data());
  for (Index j = 0; j < 2 * n; ++j) {
    const auto slope = [&](double h) -> Matrix {
      Matrix both(2 * n, 2);
      both << state, state;
      both(j, 0) += h;
      both(j, 1) -= h;
      const Matrix moved = rates_of(chain, both, speed);
      return (moved.col(0) - moved.col(1)) / (2.0 * h);
    };
    differences.col(j) = (4.0 * slope(0.5 * step) - slope(step)) / 3.0;
  }
  check_close(jacobian, differences, 1e-7, "the derivative by differences");
  check_shifted(jacobian, 1e-13, dice, [&](const double* mu, double* x) {
    std::vector<double> factors(static_cast<std::size_t>(chain.factor_numbers()));
    chain.factorise({state.data(), &u, 1, 0}, mu, factors.data());
    chain.solve(u, factors.data(), x);
  });
  const Vector drive = dice.vector(pipedyn::Drive::rows, -2.0, 2.0);
  const pipedyn::Batch driven{
      .y = state.data(), .u = &u, .members = 1, .u_step = 0, .drive = drive.data()};
  chain.jacobian(driven, jacobian.data());
  check_shifted(jacobian, 1e-13, dice, [&](const double* mu, double* x) {
    std::vector<double> factors(static_cast<std::size_t>(chain.factor_numbers()));
    chain.factorise(driven, mu, factors.data());
    chain.solve(u, factors.data(), x);
  });

  Matrix power(5, 19);
  chain.power({y.data(), speeds.data(), 19, 1}, power.data());
  const auto change = [&](double h) -> Vector {
    return (energies_of(chain, y + h * rates) - energies_of(chain, y - h * rates)) / (2.0 * h);
  };
  const double small = 1e-3 / rates.cwiseAbs().maxCoeff();
  const Vector fed = (4.0 * change(0.5 * small) - change(small)) / 3.0;
  const double size =
      energies_of(chain, y).cwiseAbs().maxCoeff() / small;  // of what cancels in a difference
  const Vector total = power.colwise().sum();
  check((total - fed).cwiseAbs().maxCoeff() < 1e-9 * size, "energy's rate is power");

  std::vector<double> worked(y.data(), y.data() + y.size());
  worked.resize(worked.size() + 19, 0.0);  // the row of the work done
  std::vector<double> with_work(worked.size());
  chain.rhs_and_power({worked.data(), speeds.data(), 19, 1}, with_work.data());
  for (Index j = 0; j < 19; ++j) {
    const double sum = power.col(j).sum();
    const double apart = with_work[static_cast<std::size_t>(y.size() + j)] - sum;
    const double rounding = 1e-13 * power.col(j).cwiseAbs().sum() * static_cast<double>(n);
    check(std::abs(apart) <= rounding, "the work's rate is the power");
  }
  check(energies_of(chain, Matrix::Zero(2 * n, 3)).isZero(0.0), "no energy at rest");
}

void check_motion() {
  Dice dice;
  const std::string before = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (const Index n : {1, 2, 3, 20}) {
      for (const bool aspirating : {false, true}) {
        scene = level + ", motion of " + std::to_string(n);
        const Segments segments = dice.segments(n);
        Pipe pipe = dice.pipe(aspirating);
        pipe.jet_angle = aspirating ? 0.0 : 0.7;
        pipe.drag = 1.5;
        check_motion_of(pipe, segments, 3.0, dice);
        Segments own_joints = segments;
        own_joints.damping = dice.vector(n, 0.0, 0.1);
        own_joints.rest_moment = dice.vector(n, -2.0, 2.0);
        own_joints.mass = segments.length.array() * (0.5 + 10.0 * own_joints.damping.array());
        check_motion_of(pipe, own_joints, 3.0, dice);
        check_motion_of(Pipe{.beta = 0.3, .aspirating = aspirating}, segments, 0.0, dice);
        pipe.terms = dice.terms();
        check_motion_of(pipe, segments, 3.0, dice);
      }
    }
    scene = level + ", sine and cosine";
    Vector x = dice.vector(1001, -2000.0, 2000.0);
    x.head(101) *= 3e-4;
    x[1000] = 1e300;
    Vector sine(1001), cosine(1001);
    pipedyn::motion_kernel().sincos(x.data(), x.size(), sine.data(), cosine.data());
    check((sine.array() - x.array().sin()).abs().maxCoeff() < 3e-16, "sine");
    check((cosine.array() - x.array().cos()).abs().maxCoeff() < 3e-16, "cosine");
  }
  pipedyn::set_vector_level(before);
  scene = "vector levels";
  check_refused([] { pipedyn::set_vector_level("none such"); }, "an unknown level");
  check_refused([&] { Chain(Pipe{}, dice.segments(3)).operators(Vector::Zero(2)); },
                "an angle too few");
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
  for (Index k = s; k < 2 * s; ++k) {  // x^k up to degree 12, of order 13
    const double sum = a.row(s - 1) * c.array().pow(k).matrix();
    const bool exact = std::abs(sum * static_cast<double>(k + 1) - 1.0) < 1e-13;
    check(exact == (k < 2 * s - 1), "the step integrates degree 12, and not 13");
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
  // f_0 / lambda_0 + sum_i error_i sum_j A_ij f_j is 0 of degrees below 7.
  const Vector error = Eigen::Map<const Vector>(radau::error, s);
  for (Index k = 0; k < s; ++k) {
    const double start = k == 0 ? 1.0 / radau::shifts[0] : 0.0;
    check(std::abs(start + error.dot(integrals.col(k))) < 1e-14, "the embedded rule is of order 7");
  }
}

// --------------------------------------------------------------------------------------- bases

struct Rule {
  Vector nodes, weights;

  Matrix product(const Matrix& a, const Matrix& b) const {
    return a.transpose() * weights.asDiagonal() * b;
  }
};

/// Gauss-Legendre rule on [0, 1]: Newton's method on P_count from the classical guesses.
Rule gauss(Index count) {
  Rule rule{Vector(count), Vector(count)};
  const double degree = static_cast<double>(count);
  for (Index i = 0; i < count; ++i) {
    double x = std::cos(std::numbers::pi * (static_cast<double>(i) + 0.75) / (degree + 0.5));
    double slope = 0.0;
    for (int step = 0; step < 8; ++step) {
      double value = x, before = 1.0;
      for (Index k = 2; k <= count; ++k) {
        const double order = static_cast<double>(k);
        before = std::exchange(value,
                               ((2.0 * order - 1.0) * x * value - (order - 1.0) * before) / order);
      }
      slope = degree * (x * value - before) / (x * x - 1.0);
      x -= value / slope;
    }
    rule.nodes[i] = 0.5 * (1.0 + x);
    rule.weights[i] = 1.0 / ((1.0 - x * x) * slope * slope);
  }
  return rule;
}

void check_bases() {
  for (const Family family : {Family::beam, Family::legendre}) {
    const bool beam = family == Family::beam;
    scene = beam ? "beam modes" : "Legendre functions";
    const Index m = 40;
    const Basis basis(family, m);
    const Rule rule = gauss(3 * m);
    const Matrix value = basis.evaluate(rule.nodes, 0), slope = basis.evaluate(rule.nodes, 1);
    const Matrix curvature = basis.evaluate(rule.nodes, 2);
    const Matrix at_clamp = basis.evaluate(Vector::Zero(1), 0);
    const Matrix slope_at_clamp = basis.evaluate(Vector::Zero(1), 1);
    const Matrix at_end = basis.evaluate(Vector::Ones(1), 0);
    const Matrix slope_at_end = basis.evaluate(Vector::Ones(1), 1);
    check(at_clamp.cwiseAbs().maxCoeff() < 1e-13, "w(0) = 0");
    check(slope_at_clamp.cwiseAbs().maxCoeff() < 1e-11, "w'(0) = 0");
    check_close(rule.weights.transpose() * slope, at_end, 1e-12, "w(1) is the integral of w'");
    check_close(rule.weights.transpose() * curvature, slope_at_end, 1e-12,
                "w'(1) is the integral of w''");
    const Vector size = basis.stiffness().cwiseSqrt().cwiseInverse();
    check_close(size.asDiagonal() * rule.product(curvature, curvature) * size.asDiagonal(),
                Matrix::Identity(m, m), 1e-11, "curvatures are orthogonal");
    if (beam) {
      check_close(rule.product(value, value), Matrix::Identity(m, m), 1e-12,
                  "modes are orthonormal");
      check_close(at_end.cwiseAbs(), Matrix::Constant(1, m, 2.0), 1e-12, "|w(1)| = 2");
      const Matrix bent_end = basis.evaluate(Vector::Ones(1), 2) * size.asDiagonal();
      check(bent_end.cwiseAbs().maxCoeff() < 1e-11, "w''(1) = 0");
      check_close(basis.stiffness().head(1).cwiseSqrt(), Vector::Constant(1, 3.5160152685), 1e-10,
                  "first frequency of the cantilever");
    }

    Dice dice;
    const Pipe pipe = dice.pipe(false);
    const Operators ops = Galerkin(pipe, basis).operators();
    const Vector above = 1.0 - rule.nodes.array();
    const Matrix falling = above.asDiagonal() * curvature - slope;  // ((1 - s) w')'
    const Matrix weight = -pipe.gamma * rule.product(value, falling);
    const Matrix elastic = basis.stiffness().asDiagonal();
    check_close(ops.mass, rule.product(value, value), 1e-12, "mass");
    check_close(ops.gyroscopic, -ops.gyroscopic.transpose(), 0.0, "gyroscopic is skew");
    check_close(ops.gyroscopic + ops.end_flux, 2.0 * pipe.sqrt_beta() * rule.product(value, slope),
                1e-11, "Coriolis term of the equation");
    check_close(ops.flux, rule.product(value, curvature), 1e-11,
                "centrifugal term of the equation");
    check_close(ops.stiffness - elastic, weight, beam ? 1e-9 : 1e-11, "weight's term");
    check_close(ops.damping, pipe.damping * elastic, 1e-15, "Kelvin-Voigt damping");
  }
}

void check_panels() {
  scene = "Legendre functions on panels";
  const Index m = 17;
  const Vector joints = (Vector(3) << 0.02, 0.3, 0.9).finished();
  const Basis basis(Family::legendre, m, joints);
  check_close(basis.ends(), (Vector(5) << 0.0, joints, 1.0).finished(), 0.0, "ends");
  check(basis.most_on_a_panel() == 5, "functions go round");
  const Rule rule = gauss(m);
  Matrix stiffness = Matrix::Zero(m, m);
  Vector angle = Vector::Zero(m);
  for (Index panel = 0; panel < 4; ++panel) {
    const double low = basis.ends()[panel], length = basis.ends()[panel + 1] - low;
    const Vector s = low + length * rule.nodes.array();
    const Matrix curvature = basis.evaluate(s, 2);
    stiffness += length * rule.product(curvature, curvature);
    angle += length * curvature.transpose() * rule.weights;
    const Vector end = Vector::Constant(1, low + length);
    check_close(basis.evaluate(end, 1).transpose(), angle, 1e-13, "w' is the integral of w''");
  }
  check_close(stiffness, Matrix::Identity(m, m), 1e-13, "curvatures are orthonormal");
  const Vector s = Vector::LinSpaced(20, 0.0, 1.0);
  check_close(Basis(Family::legendre, 60, joints).evaluate(s, 0).leftCols(m), basis.evaluate(s, 0),
              0.0, "a larger basis begins with a smaller one");
  const auto with = [&](Family family, Index size, Vector ends) {
    return [family, size, ends] { Basis(family, size, ends); };
  };
  check_refused(with(Family::beam, 9, joints), "beam modes on panels");
  check_refused(with(Family::legendre, 3, joints), "a panel without a function");
  check_refused(with(Family::legendre, 9, Vector::Constant(2, 0.5)), "a panel of no length");
  check_refused(with(Family::legendre, 9, Vector::Constant(1, 1.0)), "a joint at the end");
}

void check_high_modes() {
  const Index m = 2000;
  const Rule rule = gauss(2 * m + 60);
  for (const Family family : {Family::beam, Family::legendre}) {
    const bool beam = family == Family::beam;
    scene = beam ? "beam mode 2000" : "Legendre function 2000";
    const Basis basis(family, m);
    for (const int derivative : {0, 1, 2}) {
      const Matrix all = basis.evaluate(rule.nodes, derivative);
      check(all.allFinite(), "derivative " + std::to_string(derivative) + " is finite");
      if (derivative != (beam ? 0 : 2)) continue;
      const Matrix last = all.rightCols(3);
      check_close(rule.product(last, last), Matrix::Identity(3, 3), 1e-9,
                  "the last three are orthonormal");
    }
    check(basis.stiffness().allFinite(), "stiffness is finite");
  }
}

// ------------------------------------------------------------------- motion of reduced models

void check_quadrature() {
  scene = "Gauss collocation";
  for (const Index count : {1, 2, 7, 40}) {
    const pipedyn::Quadrature rule(count);
    const Matrix integral = rule.integral_to(rule.node);
    const Matrix weighted = rule.weight.asDiagonal() * integral;
    check_close(weighted + weighted.transpose(), rule.weight * rule.weight.transpose(), 1e-14,
                "integrates by parts exactly");
    check_close(integral * Vector::Ones(count), rule.node, 1e-14, "integral of 1");
    const Vector powers = rule.node.array().pow(static_cast<double>(count - 1));
    const Vector expected = powers.array() * rule.node.array() / static_cast<double>(count);
    check_close(integral * powers, expected, 1e-13, "integral of a power");
  }
  check_refused([] { pipedyn::Quadrature(0); }, "a quadrature without nodes");
}

/// Of a straight pipe in its second mode, whose velocity v changes sign once.
void check_drag() {
  const Basis basis(Family::beam, 2);
  const auto v = [&](const Vector& s) -> Vector { return basis.evaluate(s, 0).col(1); };
  double low = 0.5, high = 1.0;
  for (int step = 0; step < 60; ++step) {
    const double middle = 0.5 * (low + high);
    (v(Vector::Constant(1, middle))[0] * v(Vector::Ones(1))[0] > 0.0 ? high : low) = middle;
  }
  const Rule rule = gauss(40);
  const auto cubes = [&](double from, double length) {
    const Vector s = from + length * rule.nodes.array();
    return length * rule.weights.dot(v(s).cwiseAbs().array().cube().matrix());
  };
  const Vector state = Vector::Unit(4, 3);
  const double u = 0.0, expected = -0.7 * (cubes(0.0, low) + cubes(low, 1.0 - low));
  Vector power(5);
  Galerkin(Pipe{.drag = 0.7}, basis).power({state.data(), &u, 1, 0}, power.data());
  check(std::abs(power[2] - expected) < 1e-9, "drag takes kappa int |v|^3");
}

void check_reduced_motion_of(const Galerkin& model, const Pipe& pipe, Family family, Dice& dice) {
  const Index m = model.dof(), members = 11;
  const Vector scale = Basis(family, m).stiffness().cwiseSqrt().cwiseInverse();
  Matrix y = dice.matrix(2 * m, members);
  y.topRows(m) = scale.asDiagonal() * y.topRows(m);
  y.bottomRows(m) = 10.0 * scale.asDiagonal() * y.bottomRows(m);
  y.col(3) *= 4.0;  // of another level
  y.col(5).setZero();
  const Vector u = dice.vector(members, 0.0, 6.0);
  Matrix together(2 * m, members), jacobian(2 * m, 2 * m);
  const pipedyn::Batch batch{y.data(), u.data(), members, 1};
  model.rhs(batch, together.data());
  Vector energies(members);
  Matrix power(5, members);
  model.energy(batch, energies.data());
  model.power(batch, power.data());
  for (Index k = 0; k < members; ++k) {
    const Vector state = y.col(k);
    const auto rhs = [&](const Vector& at) -> Vector {
      Vector slope(2 * m);
      model.rhs({at.data(), &u[k], 1, 0}, slope.data());
      return slope;
    };
    const Vector slope = rhs(state);
    check_close(together.col(k), slope, 1e-11, "a batch is its members");
    if (k == 5) {
      check(slope.isZero(0.0) && energies[k] == 0.0, "the straight pipe at rest stays so");
      continue;
    }
    const double h = 1e-3 * state.norm() / slope.norm();
    const auto energy = [&](double t) {
      const Vector at = state + t * slope;
      double value = 0.0;
      model.energy({at.data(), &u[k], 1, 0}, &value);
      return value;
    };
    const double rate =
        (8.0 * (energy(h) - energy(-h)) - energy(2.0 * h) + energy(-2.0 * h)) / (12.0 * h);
    const double total = power.col(k).sum();
    check(std::abs(rate - total) < 1e-8 * std::abs(energies[k]) / h, "power is the energy's rate");
    model.jacobian({state.data(), &u[k], 1, 0}, jacobian.data());
    const Vector way = scale.replicate(2, 1).cwiseProduct(dice.vector(2 * m, -1.0, 1.0));
    const double step = 1e-3;
    const Vector change = (8.0 * (rhs(state + step * way) - rhs(state - step * way)) -
                           rhs(state + 2.0 * step * way) + rhs(state - 2.0 * step * way)) /
                          (12.0 * step);
    check_close(jacobian * way, change, 1e-5, "Jacobian");
  }
  const Vector rest = Vector::Zero(2 * m);
  const double three = 3.0;
  model.jacobian({rest.data(), &three, 1, 0}, jacobian.data());
  const Operators ops = model.operators(Vector::Zero(m));
  const Matrix stiffness = ops.stiffness + 9.0 * pipe.centrifugal * ops.flux;
  check_close(-ops.mass * jacobian.bottomLeftCorner(m, m), stiffness, 1e-9, "linear stiffness");
  const Matrix velocity = 3.0 * pipe.direction() * (ops.gyroscopic + ops.end_flux) + ops.damping;
  check_close(-ops.mass * jacobian.bottomRightCorner(m, m), velocity, 1e-9, "linear damping");
  check_refused([&] { model.operators(Vector::Zero(m + 1)); }, "an amplitude too many");
}

void check_reduced_motion() {
  Dice dice;
  const std::string before = pipedyn::vector_level();
  const Vector joints = (Vector(2) << 0.3, 0.7).finished();
  const pipedyn::Terms terms = {
      pipedyn::make_term("spring", 0.7, {30.0}), pipedyn::make_term("point_mass", 0.3, {0.2}),
      pipedyn::make_term("point_mass", 1.0, {0.4}), pipedyn::make_term("spring", 1.0, {2.0})};
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    scene = level + ", drag";
    check_drag();
    for (const Family family : {Family::beam, Family::legendre}) {
      for (const Index m : {1, 3, 8}) {
        for (const bool aspirating : {false, true}) {
          scene = level + ", motion of " + std::to_string(m) +
                  (family == Family::beam ? " beam modes" : " Legendre functions");
          Pipe pipe = dice.pipe(aspirating);
          pipe.drag = aspirating ? 0.7 : 0.0;
          for (const Pipe& one : {pipe, Pipe{.beta = 0.0, .aspirating = aspirating}}) {
            const Galerkin model(one, Basis(family, m));
            check_reduced_motion_of(model, one, family, dice);
          }
          if (m == 1) continue;
          scene += ", with terms";
          pipe.terms = terms;
          const Basis basis(family, m, family == Family::beam ? Vector() : joints);
          check_reduced_motion_of(Galerkin(pipe, basis), pipe, family, dice);
        }
      }
    }
  }
  pipedyn::set_vector_level(before);
  for (const double at : {0.0, -0.1, 1.1}) {
    check_refused([at] { pipedyn::make_term("spring", at, {1.0}); }, "a term off the pipe");
  }
}

// ------------------------------------------------------------------------------- modular route

using pipedyn::Scene;

constexpr double still = 0.0;

/// Of a state that is not led back to guides and pins.
Vector scene_rates(const Scene& made, const Vector& y, double u) {
  const Index n = made.dof();
  const Vector redundant = made.redundant(y.head(n), y.tail(n));
  Vector rates(6 * n);
  made.redundant_rhs({redundant.data(), &u, 1, 0}, rates.data());
  return made.angles({rates.data(), &u, 1, 0}).reshaped();
}

/// Whether a scene at rest is somewhere free to move without inertia.
bool lacks_inertia(const Scene& scene, const Vector& theta) {
  Vector y = Vector::Zero(2 * theta.size());
  y.head(theta.size()) = theta;
  return !scene_rates(scene, y, 0.0).allFinite();
}

/// w . q'' of each row, in redundant coordinates.
Vector row_accelerations(const Scene& made, const Vector& y, double u) {
  const Index n = made.dof();
  const Vector redundant = made.redundant(y.head(n), y.tail(n));
  Vector rates(6 * n);
  made.redundant_rhs({redundant.data(), &u, 1, 0}, rates.data());
  return made.weights() * rates.tail(3 * n);
}

void check_scene_of(const Pipe& pipe, Index n, Dice& dice) {
  const double u = 3.0;
  Segments segments = dice.segments(n);
  segments.damping = dice.vector(n, 0.0, 1.0);
  segments.rest_moment = dice.vector(n, -1.0, 1.0);
  Pipe with_terms = pipe;
  with_terms.terms = {pipedyn::make_term("spring", 1.0, {2.0}),
                      pipedyn::make_term("point_mass", 0.7, {0.3})};
  const Chain chain(with_terms, segments);
  const Scene plain(with_terms, segments, {}, {}, Vector());
  const Vector y = dice.vector(2 * n, -1.0, 1.0), theta = y.head(n);
  Vector expected(2 * n);
  chain.rhs({y.data(), &u, 1, 0}, expected.data());
  Vector rates(2 * n);
  plain.rhs({y.data(), &u, 1, 0}, rates.data());
  check_close(rates, expected, 0.0, "a scene of a chain moves as the chain");
  const Matrix mass = chain.operators(theta).mass, moments = dice.matrix(n, 3);
  check_close(mass * plain.solve(theta.replicate(1, 3), moments), moments, 1e-11, "M times M^-1");

  Matrix inertia = Matrix::Zero(2, 3 * n);
  inertia(0, 0) = 0.4;
  inertia(1, 3 * n - 3) = 0.3;
  inertia(1, 3 * n - 1) = 0.1;
  const Scene held(with_terms, segments, inertia, {3 * n - 3}, Vector::Zero(1));
  const Vector acceleration = scene_rates(held, y, u).tail(n);
  const Vector sums = row_accelerations(held, y, u);
  check(std::abs(sums[2]) < 1e-11 * (1.0 + acceleration.norm()), "the guide holds its node");
  Matrix by_angles = Matrix::Zero(n, 3);  // of 0.4 x_1, of 0.3 x_n + 0.1 phi_n and of x_n
  by_angles(0, 0) = 0.4 * segments.length[0] * std::cos(theta[0]);
  by_angles.col(2) = segments.length.array() * theta.array().cos();
  by_angles.col(1) = 0.3 * by_angles.col(2);
  by_angles(n - 1, 1) += 0.1;
  if (n > 1) by_angles(n - 2, 1) -= 0.1;
  const Vector missing =
      mass * (expected.tail(n) - acceleration) - by_angles.leftCols(2) * sums.head(2);
  const Vector guide = by_angles.col(2);
  const Vector left = missing - guide * (guide.dot(missing) / guide.squaredNorm());
  check(left.norm() < 1e-10 * (1.0 + (mass * acceleration).norm()),
        "what inertia lacks to the forces, the guide gives");

  Matrix met_theta = 0.3 * theta, met_omega = y.tail(n);
  held.project(met_theta, met_omega);
  const Vector met = held.redundant(met_theta, met_omega);
  check(std::abs(met[3 * n - 3]) < 1e-12, "projected angles meet the guide");
  check(std::abs(met[6 * n - 3]) < 1e-11, "projected rates keep to it");
  Vector angles(2 * n + 1), turned(2 * n + 1);
  angles << met_theta, met_omega, 0.0;
  held.rhs_and_power({angles.data(), &u, 1, 0}, turned.data());
  const Vector moving = scene_rates(held, angles.head(2 * n), u);
  check((turned.head(2 * n) - moving).norm() < 1e-9 * (1.0 + expected.norm()),
        "a state that meets the guide stays on it");
  const auto energy = [&](double h) {
    const Vector moved = angles.head(2 * n) + h * moving;
    double found;
    held.energy({moved.data(), &still, 1, 0}, &found);
    return found;
  };
  const double h = 1e-3 / std::max(1.0, moving.cwiseAbs().maxCoeff());  // one segment is at rest
  const double fed =
      (8.0 * (energy(h) - energy(-h)) - (energy(2.0 * h) - energy(-2.0 * h))) / (12.0 * h);
  check(std::abs(fed - turned[2 * n]) < 1e-9 * (std::abs(energy(0.0)) / h + 1.0),
        "energy's rate is power");
  check(!lacks_inertia(held, theta), "nothing lacks inertia");
}

/// A last segment whose only inertia is a mass of a row at its end, against the chain with that
/// mass as a term.
void check_lent_inertia(Pipe pipe, Index n, Dice& dice) {
  Segments segments = dice.segments(n);
  segments.center[n - 1] = segments.gyration_radius[n - 1] = 0.0;
  pipe.gamma = 0.0;  // a row has no weight
  const Vector y = dice.vector(2 * n, -1.0, 1.0);
  const double root = std::sqrt(0.3);
  Matrix at_end = Matrix::Zero(2, 3 * n);
  at_end(0, 3 * n - 3) = at_end(1, 3 * n - 2) = root;
  const Scene made(pipe, segments, at_end, {}, Vector());
  check(!lacks_inertia(made, y.head(n)), "a row's mass is inertia");
  check(lacks_inertia(Scene(pipe, segments, {}, {}, Vector()), y.head(n)), "none is missed");
  const Vector rates = scene_rates(made, y, 2.0);
  double energy, expected_energy;
  made.energy({y.data(), &still, 1, 0}, &energy);
  pipe.terms = {pipedyn::make_term("point_mass", 1.0, {0.3})};
  const Scene expected(pipe, segments, {}, {}, Vector());
  expected.energy({y.data(), &still, 1, 0}, &expected_energy);
  check_close(rates, scene_rates(expected, y, 2.0), 1e-11, "inertia lent is taken back");
  check(std::abs(energy / expected_energy - 1.0) < 1e-12, "so is its energy");
}

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
    const Scene made(pipe, segments, {}, held, value);
    Matrix theta = 0.3 * dice.matrix(n, 1), omega = dice.matrix(n, 1);
    const Vector missed = made.project(theta, omega);
    check(missed[0] < 1e-9, "guides and pins are met");
    Vector y(2 * n);
    y << theta, omega;
    Matrix jacobian(2 * n, 2 * n);
    made.jacobian({y.data(), &u, 1, 0}, jacobian.data());
    pipedyn::SceneSystems systems(made, [u](double, Index) { return pipedyn::Flow{.u = u}; });
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
  for (const Index n : {1, 2, 3, 20}) {
    for (const bool aspirating : {false, true}) {
      scene = "scene of " + std::to_string(n);
      Pipe pipe = dice.pipe(aspirating);
      pipe.drag = 0.7;
      check_scene_of(pipe, n, dice);
      check_lent_inertia(pipe, n, dice);
    }
  }
  scene = "refused scenes";
  const Segments good = dice.segments(3);
  const auto refused = [&](const auto& change, const std::string& claim) {
    Segments wrong = good;
    change(wrong);
    check_refused([&] { Scene(Pipe{}, wrong, {}, {}, Vector()); }, claim);
  };
  refused([](Segments& wrong) { wrong.center.resize(2); }, "a centre short");
  refused([](Segments& wrong) { wrong.damping = Vector::Ones(2); }, "a damping short");
  refused([](Segments& wrong) { wrong.length[1] = 0.0; }, "a segment without length");
  const Vector one = Vector::Zero(1);
  check_refused([&] { Scene(Pipe{}, good, Matrix::Ones(1, 10), {}, Vector()); }, "a row beyond");
  check_refused([&] { Scene(Pipe{}, good, {}, {9}, one); }, "a node beyond the end");
  check_refused([&] { Scene(Pipe{}, good, {}, {2}, one); }, "a joint that is held");
  check_refused([&] { Scene(Pipe{}, good, {}, {0}, Vector()); }, "a node without a place");
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
                .centrifugal = one_of({0.0, 0.5, 1.0, 1e6}),
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
      const double first = one_of({0.0, 1e-300, 1.0, 1e6}), second = one_of({0.0, 1.0, 1e6});
      made.push_back(pipedyn::make_term(Laws::names[law], at, {first, second}));
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
  const Vector scale = wild.dice.vector(n, 1e-3, 1e3);
  check(chain.operators(wild.states(n, 1).col(0).head(n)).mass.allFinite(), "mass is finite");
  check(chain.joint_operators(scale).stiffness.allFinite(), "joint stiffness is finite");
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

void check_wild_scene(Wild& wild) {
  const Index n = wild.size({1, 2, 3, 8});
  scene = "any scene of " + std::to_string(n);
  Pipe pipe = wild.pipe();
  const auto add_term = [&](const char* law, double number) {
    pipe.terms.push_back(pipedyn::make_term(law, wild.dice.between(0.01, 1.0), {number}));
  };
  add_term("spring", wild.one_of({0.0, 1e9}));
  add_term("point_mass", wild.one_of({0.0, 1e-9, 1e6}));
  Segments segments = wild.segments(n);
  segments.gyration_radius[n - 1] *= wild.one_of({0.0, 1.0});
  segments.rest_moment = wild.dice.vector(n, -1.0, 1.0) * wild.one_of({0.0, 1e8});
  std::vector<Index> held;
  if (n > 1) held.push_back(3 * n - 3);
  if (n > 2) held.push_back(3 * n - 2);
  Vector value = Vector::Zero(static_cast<Index>(held.size()));
  value.tail(n > 2 ? 1 : 0).setConstant(0.9);
  Matrix inertia = Matrix::Zero(1, 3 * n);
  inertia(0, 0) = wild.one_of({1e-9, 1e3});
  inertia(0, 2) = 0.1;
  const Scene made(pipe, segments, inertia, held, value);
  const Index members = wild.size({0, 1, 5, 70});
  const Matrix turned = wild.states(n, members);
  const double u = wild.speed(), untouched = -7.0;
  Vector rates = Vector::Constant(2 * n * members + 1, untouched);
  made.rhs({turned.data(), &u, members, 0}, rates.data());
  check(rates[2 * n * members] == untouched, "rates stay within their array");
  const Matrix y = made.redundant(turned.topRows(n), turned.bottomRows(n));
  Vector redundant = Vector::Constant(6 * n * members + 1, untouched);
  made.redundant_rhs({y.data(), &u, members, 0}, redundant.data());
  check(redundant[6 * n * members] == untouched, "redundant rates stay within their array");
  Vector parts = Vector::Constant(5 * members + 1, untouched);
  double* const out = parts.data();
  made.power({turned.data(), &u, members, 0}, out);
  made.energy({turned.data(), &u, members, 0}, out);
  check(parts[5 * members] == untouched, "energy and power stay within their arrays");
  Vector angles = Vector::Zero((2 * n + 1) * members), turning = angles;
  made.rhs_and_power({angles.data(), &u, members, 0}, turning.data());
  Matrix theta = turned.topRows(n), omega = turned.bottomRows(n);
  made.project(theta, omega);
}

void check_extremes() {
  Dice dice;
  Wild wild{dice};
  const std::string before = pipedyn::vector_level();
  for (const std::string& level : pipedyn::vector_levels()) {
    pipedyn::set_vector_level(level);
    for (int i = 0; i < 60; ++i) check_wild_chain(wild);
    for (int i = 0; i < 12; ++i) check_wild_reduced(wild);
    for (const Index length : {0, 1, 7, 64}) {
      const Vector x = 1e6 * dice.vector(length, -1.0, 1.0);
      Vector sine(length), cosine(length);
      pipedyn::motion_kernel().sincos(x.data(), length, sine.data(), cosine.data());
      const Vector one = sine.cwiseAbs2() + cosine.cwiseAbs2();
      check(one.isApproxToConstant(1.0, 1e-14), "sine and cosine of 1e6");
    }
  }
  pipedyn::set_vector_level(before);
  for (int i = 0; i < 60; ++i) check_wild_scene(wild);
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

  pipedyn::Sample sample(double u, Index) override {
    const Index size = 2 * cubics_.rows();
    std::vector<Index> order(size);
    for (Index i = 0; i < size; ++i) order[i] = i;
    std::shuffle(order.begin(), order.end(), shuffler_);
    pipedyn::Sample at{{}, u};
    at.values = at.slopes = pipedyn::Values(size);
    for (Index i = 0; i < size; ++i) {
      const Index branch = order[i] / 2;
      const double frequency = frequency_of(branch);
      at.values[i] = {real(branch, u), order[i] % 2 == 0 ? frequency : -frequency};
      at.slopes[i] = slope(branch, u);
    }
    at.residual = at.uncertain = at.slope_noise = at.signatures = pipedyn::Reals::Zero(size);
    at.noise = pipedyn::Reals::Constant(size, 1e-14);
    return at;
  }
  pipedyn::Pair refined(double u, const pipedyn::Pair& guess) override {
    const Index branch = static_cast<Index>(std::lround((guess.value.imag() - 5.0) / 2.0));
    return {{real(branch, u), frequency_of(branch)}, {}, {}, 0.0, 1e-15, slope(branch, u)};
  }
  pipedyn::Reals quotients(double, const pipedyn::Pairs& pairs) override {
    return pairs.values.abs2();
  }
  pipedyn::Divergences divergences(double, bool) override { return {}; }

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

/// All eigenvalues of a chain's matrices pass the check that no root is missing, and no fewer; nor
/// do they with one in place of another, or beside its own.
void check_completeness() {
  Dice dice;
  for (int trial = 0; trial < 60; ++trial) {
    scene = "roots " + std::to_string(trial);
    const Index n = 2 + trial % 9;
    const Chain chain(dice.pipe(trial % 3 == 0), dice.segments(n));
    const double u = dice.between(0.5, 8.0);
    const Operators dense = chain.operators();
    const pipedyn::ImpedanceModel flow = chain.impedance();
    const double sign = flow.coriolis < 0.0 ? -1.0 : 1.0, thrust = flow.thrust * u * u;
    Matrix step = Matrix::Zero(2 * n, 2 * n);
    step.topRightCorner(n, n).setIdentity();
    step.bottomLeftCorner(n, n) =
        -solved<Matrix>(dense.mass, dense.stiffness + thrust * dense.flux);
    step.bottomRightCorner(n, n) =
        -solved<Matrix>(dense.mass, sign * u * (dense.gyroscopic + dense.end_flux) + dense.damping);
    const Eigen::EigenSolver<Eigen::MatrixXd> solver(step, false);
    pipedyn::Approximations roots;
    for (const pipedyn::Complex value : solver.eigenvalues()) {
      if (value.imag() >= 0.0) roots.push_back({value, value.imag() == 0.0});
    }
    const pipedyn::Vector one = pipedyn::Vector::Ones(n);
    const pipedyn::ChainDeterminant of(
        std::make_shared<const Chain>(chain),
        std::make_shared<const pipedyn::Complement>(Matrix::Zero(n, 0)), pipedyn::Lapack{}, one);
    check(pipedyn::correct(of, u, roots), "eigenvalues are near the determinant's roots");
    check(pipedyn::roots_in(roots) == 2 * n, "as many roots as the matrices have");
    check(pipedyn::has_all(of, u, roots), "no root is missing");
    for (std::size_t k = 0; k < roots.size(); ++k) {
      pipedyn::Approximations wrong = roots;
      wrong[k].value *= 1.0 + 1e-4;
      check(!pipedyn::has_all(of, u, wrong), "a root is off by 1e-4");
      wrong[k].value = roots[k == 0 ? roots.size() - 1 : k - 1].value;
      check(!pipedyn::has_all(of, u, wrong), "a root stands in place of another");
      wrong.erase(wrong.begin() + static_cast<std::ptrdiff_t>(k));
      check(!pipedyn::has_all(of, u, wrong), "a root is missing");
    }
  }
}

void check_crossings() {
  Dice dice;
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
  scene = "residuals";  // eps |lambda|^2 is 200 there
  check(pipedyn::has_converged({0.0, 1e9}, 1e-5) && !pipedyn::has_converged({0.0, 1e9}, 1e-2),
        "a large residual is no eigenvalue whatever rounding explains");
}

using Complexes = Eigen::MatrixXcd;

Eigen::Map<Eigen::MatrixXd> columns(double* data, int rows, int count) {
  return {data, rows, count};
}

/// LAPACK by Eigen, as far as eigenpairs without left vectors take it, whose dgeev is off by a part
/// in a million; its zgetrs solves or fails. Factors are left to the solves.
template <bool solves>
pipedyn::Lapack broken_lapack() {
  return {
      .dgemm =
          [](char*, char*, int* m, int* n, int* k, double*, double* a, int*, double* b, int*,
             double*, double* c,
             int*) { columns(c, *m, *n) = columns(a, *k, *m).transpose() * columns(b, *k, *n); },
      .dgetrf = [](int*, int*, double*, int*, int*, int*) {},
      .dgetrs =
          [](char*, int* n, int* count, double* lu, int*, int*, double* b, int* rows, int*) {
            auto top = columns(b, *rows, *count).topRows(*n);
            top = solved<Eigen::MatrixXd>(columns(lu, *n, *n), top);
          },
      .zgetrf = [](int*, int*, pipedyn::Complex*, int*, int*, int*) {},
      .zgetrs =
          [](char* kind, int* n, int* count, pipedyn::Complex* lu, int*, int*, pipedyn::Complex* b,
             int*, int*) {
            const Eigen::Map<Complexes> matrix(lu, *n, *n);
            const Complexes factor = *kind == 'C' ? Complexes(matrix.adjoint()) : Complexes(matrix);
            Eigen::Map<Complexes> x(b, *n, *count);
            x = solved<Complexes>(factor, x);
            if (!solves) x *= std::nan("");
          },
      .dgeev =
          [](char*, char*, int* n, double* a, int*, double* real, double* imag, double*, int*,
             double* vectors, int*, double* work, int* length, int*) {
            if (*length < 0) {
              work[0] = 1.0;
              return;
            }
            const Eigen::EigenSolver<Eigen::MatrixXd> found(columns(a, *n, *n));
            columns(real, *n, 1) = (1.0 + 1e-6) * found.eigenvalues().real();
            columns(imag, *n, 1) = (1.0 + 1e-6) * found.eigenvalues().imag();
            columns(vectors, *n, *n) = found.pseudoEigenvectors();
          },
      .zgeev = nullptr,
      .dsygvd = nullptr,
  };
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
    const pipedyn::Pairs found = problem.lowest(1.0, 8, false, true);
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
    pipedyn::at_once(parts, [&](Index k) { ++calls[k]; });
    check(calls == std::vector<Index>(static_cast<std::size_t>(parts), 1),
          "each part is done once");
    for (Index failing = 0; failing < parts; ++failing) {
      check_refused(
          [&] {
            pipedyn::at_once(parts, [&](Index k) {
              if (k == failing) throw std::invalid_argument("of a part");
            });
          },
          "a part that fails");
    }
  }
  Index nested = 0;
  pipedyn::at_once(2, [&](Index k) {
    if (k == 0) pipedyn::at_once(3, [&](Index) { ++nested; });
  });
  check(nested == 3, "parts may have parts");
  std::vector<int> covered(1000);
  pipedyn::in_parts(1000, 100, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) ++covered[k];
  });
  check(covered == std::vector<int>(1000, 1), "parts cover all");
}

}  // namespace

int main() {
  check_chains();
  check_guides();
  check_motion();
  check_radau();
  check_refusals();
  check_bases();
  check_panels();
  check_high_modes();
  check_quadrature();
  check_reduced_motion();
  check_scenes();
  check_extremes();
  check_assignment();
  check_completeness();
  check_crossings();
  check_mending();
  check_threads();
  std::printf("%d checks, %d failed\n", checks, failures);
  return failures == 0 ? 0 : 1;
}
