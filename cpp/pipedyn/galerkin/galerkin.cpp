// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/galerkin.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "pipedyn/terms/laws.hpp"
#include "pipedyn/vector/levels.hpp"

namespace pipedyn {

namespace {

constexpr double not_a_number = std::numeric_limits<double>::quiet_NaN();

const GalerkinKernel& kernel() { return *motion_kernel().galerkin; }

MotionEffects effects_of(const Pipe& pipe, const Panels& panels) {
  return {.coriolis = 2.0 * pipe.direction() * pipe.sqrt_beta(),
          .entry = pipe.entry(),
          .thrust = pipe.thrust(),
          .gamma = pipe.gamma,
          .drag = pipe.drag,
          .damping = pipe.damping,
          .root_across = pipe.root_across,
          .down = pipe.down(),
          .normal_mass = panels.normal_mass,
          .loads = panels.loads.data(),
          .load_count = static_cast<Index>(panels.loads.size()),
          .held = panels.held.data(),
          .held_count = static_cast<Index>(panels.held.size()),
          .return_rate = ReducedMotion::return_rate};
}

/// Sums of the sizes of each function's amplitudes in all planes, (m, members) row-major, from
/// states (rows, members); with one plane the amplitudes themselves. They last until the next call.
const double* bounds(const double* y, Index m, Index planes, Index members) {
  if (planes == 1) return y;
  static thread_local Vector sums;
  sums = Eigen::Map<const Vector>(y, m * members).cwiseAbs() +
         Eigen::Map<const Vector>(y + m * members, m * members).cwiseAbs();
  return sums.data();
}

/// Calls a function of the kernel for blocks of members that need the same grid, one member alone
/// or as many as the vectors hold, and passes result i of each member k to write(k, i, result); the
/// result is NaN for members that bend more than the largest grid resolves. If the batch allows
/// errors, a finer grid than a member needs is accepted as well: blocks are then filled in falling
/// order of the numbers of their grids. finer: number of grids by which the grid is finer than the
/// motion needs; parts: number of entries of a member in batch.y, divided by that of coordinates,
/// whose sum over the planes decides on the grid; most_members: largest number of members of a
/// block.
template <class Write>
void evaluate(const GalerkinKernel::Function function, const Grids& grids, const Pipe& pipe,
              Index planes, const Batch& batch, Index results, const Write& write, Index finer = 0,
              Index parts = 2, Index most_members = std::numeric_limits<Index>::max()) {
  static thread_local std::vector<Index> grid_of, chosen;
  const MotionEffects effects = effects_of(pipe, grids.panels());
  static thread_local std::vector<double> numbers;
  const Index state = parts * planes * grids.basis().size(), members = batch.members;
  grid_of.resize(static_cast<std::size_t>(members));
  chosen.resize(static_cast<std::size_t>(members));
  std::iota(chosen.begin(), chosen.end(), Index{0});
  const double* const amplitudes = bounds(batch.y, grids.basis().size(), planes, members);
  const auto of = [&](Index k) { return amplitudes + k; };
  for (Index k = 0; k < members; ++k) {
    const double error = batch.errors == nullptr ? 0.0 : batch.errors[k];
    const Index needed = grids.choose(of(k), members, error);
    grid_of[static_cast<std::size_t>(k)] = std::min(needed + finer, grids.count() - 1);
  }
  const auto number = [](Index k) { return grid_of[static_cast<std::size_t>(k)]; };
  std::sort(chosen.begin(), chosen.end(),
            [&](Index a, Index b) { return std::pair(number(b), a) < std::pair(number(a), b); });
  const Index driven = batch.drive != nullptr ? batch.drive_rows : 0;
  for (Index first = 0; first < members;) {
    const Index* const member = chosen.data() + first;  // spare lanes repeat the last member
    const auto fits = [&](Index k) {
      return batch.errors != nullptr || number(k) == number(*member);
    };
    const Index most = std::min({motion_kernel().width, members - first, most_members});
    const Index used = std::find_if_not(member, member + most, fits) - member;
    const Index width = used == 1 ? 1 : motion_kernel().width;
    numbers.resize(static_cast<std::size_t>((state + 1 + driven + results) * width));
    double* const y = numbers.data();
    double* const u = y + state * width;
    double* const drive = u + width;
    double* const out = drive + driven * width;
    Batch block{y, u, width, 1};
    if (driven > 0) block.drive = drive;
    block.drive_rows = batch.drive_rows;
    for (Index b = 0; b < width; ++b) {
      const Index k = member[std::min(b, used - 1)];
      u[b] = batch.u[k * batch.u_step];
      for (Index i = 0; i < state; ++i) y[i * width + b] = batch.y[i * members + k];
      for (Index i = 0; i < driven; ++i) drive[i * width + b] = batch.drive[i * members + k];
    }
    function(grids[number(*member)].tables, effects, block, out);
    for (Index b = 0; b < used; ++b) {
      const Index k = member[b];
      const bool resolved = grids.resolves(number(k), of(k), members);
      for (Index i = 0; i < results; ++i) {
        write(k, i, resolved ? out[i * width + b] : not_a_number);
      }
    }
    first += used;
  }
}

/// Makes a function that writes result i of member k to the array (results, members) of a batch.
auto to_columns(double* out, Index members) {
  return [=](Index k, Index i, double result) { out[i * members + k] = result; };
}

/// Adds to stiffness, flux and unsteady flow what supports add to them if the pipe is bent: as it
/// moves, the forces that act at the supports at rest turn with respect to it. still, flow, push:
/// the generalised forces without supports, at rest, of the flow and of its acceleration.
void add_supports(const Grid& grid, const MotionEffects& effects, const Vector& q,
                  const Vector& still, const Vector& flow, const Vector& push, Operators& ops) {
  const Index m = q.size(), count = effects.held_count, block = grid.tables.nodes + 1;
  const auto slope = grid.slope.topLeftCorner(grid.places.size(), m);
  const Vector theta = slope * q;
  const Eigen::Map<const Vector> weight(grid.tables.weight, theta.size());
  Matrix before = Matrix::Zero(theta.size(), count);  // 1 if a point lies before a support
  for (Index b = 0; b < count; ++b) before.col(b).head((effects.held[b] + 1) * block).setOnes();
  const Vector across = weight.array() * theta.array().cos();
  const Matrix by = inner(slope, across, before);
  const Vector stiffness = Eigen::Map<const Matrix>(grid.tables.elastic, m, m).diagonal();
  // Forces of the supports for given forces on the pipe: any choice is valid that leaves no force
  // at an equilibrium; this one leaves the least elastic energy.
  const Vector ease = stiffness.cwiseMax(1.0).cwiseInverse();
  const Eigen::LDLT<Matrix> system(inner(by, ease, by));
  const auto turning = [&](const Vector& force) -> Matrix {
    const Vector held = system.solve(inner(by, ease, force));
    const Vector along = before * held;
    const Vector weighted = -weight.array() * theta.array().sin() * along.array();
    return inner(slope, weighted, slope);
  };
  ops.stiffness += turning(still);
  ops.flux += turning(flow);
  ops.unsteady += turning(push);
}

/// Operators about a configuration q at rest.
Operators operators_at(const Grid& grid, const Basis& basis, const MotionEffects& effects,
                       const Pipe& pipe, const Vector& q) {
  const Index m = q.size();
  const double sqrt_beta = pipe.sqrt_beta(), share = pipe.inflow_share * sqrt_beta;
  Vector y = Vector::Zero(2 * m);
  y.head(m) = q;
  MotionEffects rest = effects;  // effects independent of the flow; drag has no linear part
  rest.held_count = 0;
  rest.coriolis = rest.entry = rest.thrust[0] = rest.thrust[1] = rest.drag = 0.0;
  const MotionEffects flow{.coriolis = 2.0 * sqrt_beta,
                           .thrust = {std::cos(pipe.jet_angle), std::sin(pipe.jet_angle)}};
  const double faster[Drive::rows] = {1.0};
  GridTables tables = grid.tables;  // basis functions in place of orthonormal ones
  tables.orthonormal = tables.slope;
  const Matrix same = Matrix::Identity(m + 1, grid.slope.cols()), none = Matrix::Zero(m, m);
  tables.from_basis = same.data();
  tables.elastic_forces = tables.damped_forces = none.data();  // forces of bending are added below
  Matrix straight;
  if (q.isZero(0.0)) straight = basis.evaluate(grid.places, 0);
  Matrix found(3 * m + 3, m);
  const auto about = [&](const MotionEffects& what, double u = 1.0, const double* drive = nullptr) {
    const double* const displacements = straight.size() > 0 ? straight.data() : nullptr;
    const Batch one{.y = y.data(), .u = &u, .members = 1, .u_step = 0, .drive = drive};
    kernel().operators(tables, what, one, displacements, found.data());
    return Eigen::Map<const Matrix>(found.data() + m * m, m, 2 * m);
  };
  Operators ops(m);
  const auto by_state = about(rest);
  ops.mass = found.topRows(m);
  ops.stiffness = -by_state.leftCols(m);
  ops.damping = -by_state.rightCols(m);
  const Eigen::Map<const Matrix> elastic(grid.tables.elastic, m, m);
  ops.stiffness += elastic;
  ops.damping += effects.damping * Eigen::Map<const Matrix>(grid.tables.damped, m, m);
  const Vector still = found.row(3 * m + 2).transpose() - elastic * q;
  about(flow, 0.0, faster);  // writes to `found` again
  ops.unsteady = -by_state.leftCols(m);
  const Vector push = found.row(3 * m + 2).transpose();
  about(flow);
  ops.flux = -by_state.leftCols(m);
  const Matrix coriolis = -by_state.rightCols(m);
  ops.gyroscopic = 0.5 * (coriolis - coriolis.transpose());
  const auto end = found.middleRows(3 * m, 2);
  ops.end_flux = end.transpose() * end;
  ops.end_flux *= share;
  if (effects.held_count > 0 && !q.isZero(0.0)) {
    add_supports(grid, effects, q, still, found.row(3 * m + 2), push, ops);
  }
  return ops;
}

void require_amplitudes(Index entries, Index m) {
  if (entries != m) {
    throw std::invalid_argument("q must have " + std::to_string(m) + " entries, got " +
                                std::to_string(entries));
  }
}

}  // namespace

ReducedMotion::ReducedMotion(const Pipe& pipe, Basis basis, Index planes, Index least_nodes)
    : pipe_(pipe), basis_(std::move(basis)), planes_(planes), least_nodes_(least_nodes) {}

const Grids& ReducedMotion::grids() const {
  std::call_once(moved_, [this] { grids_ = std::make_unique<Grids>(basis_, pipe_, least_nodes_); });
  return *grids_;
}

Operators Galerkin::operators(const Vector& q) const {
  if (q.size() > 0) {
    require_amplitudes(q.size(), dof());
    const Grid& grid = grids()[grids().choose(q.data(), 1)];
    return operators_at(grid, basis(), effects_of(pipe(), grids().panels()), pipe(), q);
  }
  const Index nodes = basis().nodes_of_products() + (pipe().mass.degree(0.0) + 1) / 2;
  const Panels panels(basis(), pipe());
  const Grid grid(basis(), Matrix::Identity(dof(), dof()), panels,
                  whole(nodes + 1, GridTables::multiple) - 1);
  return operators_at(grid, basis(), effects_of(pipe(), panels), pipe(), Vector::Zero(dof()));
}

Index Galerkin::nodes(const Vector& q) const {
  require_amplitudes(q.size(), dof());
  return grids()[grids().choose(q.data(), 1)].tables.nodes;
}

std::string ReducedMotion::unresolved_sum(Vector shape) const {
  const double size = shape.cwiseAbs().maxCoeff();
  if (size > 0.0) shape /= size;
  const double most = grids().resolved(shape.data());
  if (size <= most) return "";
  const Matrix slopes = basis_.evaluate(Vector::LinSpaced(401, 0.0, 1.0), 1);
  const double largest = (slopes * shape).cwiseAbs().maxCoeff();
  char text[200];
  std::snprintf(text, sizeof text,
                "it bends the pipe by %.3g rad, and %td quadrature nodes on a panel, the most that "
                "are taken, resolve this shape up to %.3g rad",
                size * largest, grids().most_nodes(), most * largest);
  return text;
}

std::string Galerkin::unresolved(const double* q, Index stride) const {
  return unresolved_sum(
      Eigen::Map<const Vector, 0, Eigen::InnerStride<>>(q, dof(), Eigen::InnerStride<>(stride)));
}

namespace {

const GalerkinKernel::Motion& motion_in(Index planes) {
  return planes == 1 ? kernel().planar : kernel().spatial;
}

}  // namespace

void ReducedMotion::rhs(const Batch& batch, double* rates) const {
  const Index n = dof(), members = batch.members;
  std::copy(batch.y + n * members, batch.y + 2 * n * members, rates);
  evaluate(motion_in(planes_).accelerations, grids(), pipe_, planes_, batch, n,
           to_columns(rates + n * members, members));
}

void ReducedMotion::rhs_and_power(const Batch& batch, double* rates) const {
  rhs(batch, rates);
  const Index members = batch.members;
  Matrix parts(5, members);
  power(batch, parts.data());
  Eigen::Map<Eigen::RowVectorXd>(rates + 2 * dof() * members, members) = parts.colwise().sum();
}

void ReducedMotion::energy(const Batch& batch, double* out) const {
  evaluate(motion_in(planes_).energy, grids(), pipe_, planes_, batch, 1,
           to_columns(out, batch.members));
}

void ReducedMotion::power(const Batch& batch, double* out) const {
  evaluate(motion_in(planes_).power, grids(), pipe_, planes_, batch, 5,
           to_columns(out, batch.members));
}

void ReducedMotion::tips(const Batch& batch, double* out) const {
  constexpr Index finer = 2;  // 1.4 times the nodes: exact to rounding, not to the motion's 1e-10
  evaluate(motion_in(planes_).tips, grids(), pipe_, planes_, batch, tip_rows(),
           to_columns(out, batch.members), finer);
}

void Galerkin::axial(const Batch& batch, double* out) const {
  evaluate(kernel().axial, grids(), pipe(), 1, batch, 2 + 4 * dof(), to_columns(out, batch.members),
           0, 3);
}

void Galerkin::held(const Batch& batch, double* out) const {
  const Index results = supports() * (1 + dof());
  evaluate(kernel().held, grids(), pipe(), 1, batch, results, to_columns(out, batch.members));
}

namespace {

/// Writes the rows of derivatives (members, before + 2 m, 2 m) that are known for m coordinates,
/// and makes a function that writes the results of a kernel's `jacobian` to the others.
auto begin_differentiation(const Batch& batch, Index m, Index before, double* out) {
  const Index n = 2 * m, half = m * n, size = (before + n) * n;
  for (Index k = 0; k < batch.members; ++k) {
    double* const own = out + k * size;
    std::fill_n(own, before * n + half, 0.0);
    for (Index i = 0; before > 0 && i < m; ++i) own[i] = batch.y[(m + i) * batch.members + k];
    for (Index i = 0; i < m; ++i) own[(before + i) * n + m + i] = 1.0;
  }
  return [=](Index k, Index i, double result) {
    if (i < half) {
      out[k * size + before * n + half + i] = result;
    } else if (before > 0) {  // q'', and its derivative by the speed in the next row
      out[k * size + m + i - half + (i < half + m ? 0 : m)] = result;
    }
  };
}

}  // namespace

void ReducedMotion::differentiate(const Batch& batch, Index before, double* out) const {
  const Index most_members = planes_ == 1 ? std::numeric_limits<Index>::max() : 1;
  evaluate(motion_in(planes_).jacobian, grids(), pipe_, planes_, batch, dof() * (2 * dof() + 2),
           begin_differentiation(batch, dof(), before, out), 0, 2, most_members);
}

SpatialGalerkin::SpatialGalerkin(const Pipe& pipe, Basis basis, Index least_nodes)
    : ReducedMotion(pipe, std::move(basis), 2, least_nodes) {
  require_space(pipe);
}

std::string SpatialGalerkin::unresolved(const double* q, Index stride) const {
  const Index m = basis().size();
  const Eigen::Map<const Matrix, 0, Eigen::InnerStride<>> both(q, 2, m,
                                                               Eigen::InnerStride<>(stride));
  const Matrix slopes = basis().evaluate(Vector::LinSpaced(401, 0.0, 1.0), 1);
  const Matrix angles = slopes * both.transpose();
  const double turned = std::sqrt(angles.rowwise().squaredNorm().maxCoeff());
  if (turned > 3.0) {
    char text[160];
    std::snprintf(text, sizeof text,
                  "its tangent turns by %.3g rad, and the coordinates of a reduced model in three "
                  "dimensions end at pi",
                  turned);
    return text;
  }
  return unresolved_sum(both.cwiseAbs().colwise().sum());
}

}  // namespace pipedyn
