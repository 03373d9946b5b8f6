// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/grid.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <numbers>
#include <ranges>
#include <stdexcept>
#include <string>
#include <utility>

#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

namespace {

/// Minus the logarithm of the relative tolerance of an integrand; number of factors G that are
/// counted; least number of nodes. Measured with both bases, 4 to 24 functions and random states up
/// to amplitudes of 2: rates differ by 4e-13 from those with three times the nodes and, with drag,
/// whose integrand has kinks, by 9e-8; tests/benchmark_motion.py checks 1e-10 and 1e-6.
struct Demand {
  double log_tolerance, growths;
  Index least_nodes;
  double most_more;  // most added to the log where larger errors will do; 0 with kinks
};
constexpr Demand smooth{25.0, 2.5, 7, 11.5}, with_drag{33.0, 3.5, 31, 0.0};
/// Logarithm of ten: no measured error was as large as a tenth of what was demanded.
constexpr double certain = 2.3;
/// Places on the pipe that are no further apart than this count as one: a panel between them would
/// be lost in the rounding of its ends.
constexpr double same_place = 1e-14;
const Demand& demanded(bool drag) { return drag ? with_drag : smooth; }

Index whole_points(Index count) { return whole(count, GridTables::multiple); }

/// Absolute values of the Chebyshev coefficients of the slopes on an interval, (count, m);
/// coefficients of the size of rounding errors are set to 0.
Matrix slope_series(const Basis& basis, double low, double high) {
  const Index count = 2 * basis.most_on_a_panel() + 60;
  const double size = static_cast<double>(count);
  const Vector order = Vector::LinSpaced(count, 0.0, size - 1.0);
  const Vector angle = (order.array() + 0.5) * (std::numbers::pi / size);
  Matrix transform = 2.0 / size * (angle * order.transpose()).array().cos();
  transform.col(0) *= 0.5;
  const Vector s = low + (high - low) * (0.5 * (1.0 + angle.array().cos()));
  Matrix found = Matrix::Zero(count, basis.size());
  add_inner(found, 1.0, transform, basis.evaluate(s, 1));
  found = found.cwiseAbs();
  for (Index i = 0; i < found.cols(); ++i) {
    const double least = 1e-13 * found.col(i).maxCoeff();
    found.col(i) = (found.col(i).array() < least).select(0.0, found.col(i));
  }
  return found;
}

/// Ellipses about a panel on which slopes have these Chebyshev series. drag: whether integrals end
/// at inner points.
std::vector<Ellipse> ellipses_of(const Matrix& series, bool drag) {
  const Vector order =
      Vector::LinSpaced(series.rows(), 0.0, static_cast<double>(series.rows() - 1));
  const auto sum = [&](double (*factor)(double), double eta) -> Vector {  // over factor(k eta) c_ik
    return series.transpose() * (eta * order).unaryExpr(factor);
  };
  const Demand& demand = demanded(drag);
  const Vector total = sum(std::cosh, 0.0);
  std::vector<Ellipse> ellipses;
  for (double eta = std::min(0.05, 2.0 / static_cast<double>(series.cols())); eta < 3.0;
       eta *= 1.5) {
    const Vector grown = sum(std::cosh, eta);
    double growth = 1.0;  // at least 1; functions that are 0 on the interval do not count
    for (Index i = 0; i < total.size(); ++i) {
      if (total[i] > 0.0) growth = std::max(growth, grown[i] / total[i]);
    }
    ellipses.push_back(
        {eta, demand.log_tolerance + demand.growths * std::log(growth), 2.0 * sum(std::sinh, eta)});
  }
  return ellipses;
}

/// The matrix from amplitudes in the basis to coordinates in which the mass matrix of the straight
/// uniform pipe is the identity, upper triangular. In these a mass matrix is solved without losing
/// the digits that its condition number in the basis (1e6 for 8 Legendre functions) would cost.
/// Throws std::invalid_argument if the functions of the basis are linearly dependent to rounding.
Matrix to_orthonormal(const Basis& basis) {
  const Index m = basis.size();
  if (basis.orthonormal()) return Matrix::Identity(m, m);
  Matrix mass = Matrix::Zero(m, m);
  const Quadrature rule(basis.nodes_of_products());
  for (Index panel = 0; panel + 1 < basis.ends().size(); ++panel) {
    const double low = basis.ends()[panel], length = basis.ends()[panel + 1] - low;
    const Matrix value = basis.evaluate(low + length * rule.node.array(), 0);
    mass += inner(value, length * rule.weight, value);
  }
  const Eigen::LLT<Matrix> factors(mass);
  if (factors.info() != Eigen::Success) {
    throw std::invalid_argument("m must be smaller for a motion: the mass matrix of " +
                                std::to_string(m) + " functions is singular to rounding");
  }
  return factors.matrixU();
}

}  // namespace

Panels::Panels(const Basis& basis, const Pipe& pipe)
    : pipe_mass(pipe.mass), pipe_stiffness(pipe.stiffness), rotary_inertia(pipe.rotary_inertia) {
  std::vector<double> places(basis.ends().begin(), basis.ends().end());
  places.insert(places.end(), pipe.supports.begin(), pipe.supports.end());
  std::sort(places.begin(), places.end());
  places.erase(std::unique(places.begin(), places.end()), places.end());
  const auto nearest = [&](double at) {
    const auto after = std::lower_bound(places.begin(), places.end(), at);
    if (after == places.begin()) return after;
    return after == places.end() || at - after[-1] < *after - at ? after - 1 : after;
  };
  const auto add_place = [&](double at) {
    if (std::abs(*nearest(at) - at) < same_place) return;
    places.insert(std::upper_bound(places.begin(), places.end(), at), at);
  };
  for (const double end : pipe.stiffness.ends()) add_place(end);
  for (const double end : pipe.mass.ends()) add_place(end);
  for (const Term& term : pipe.terms) {
    Laws::with(term, [&]<class Law>(const Law&) {
      if (!Law::along) add_place(term.at);
    });
  }
  ends = Eigen::Map<const Vector>(places.data(), static_cast<Index>(places.size()));
  mass = inertia = Vector::Zero(ends.size() - 1);
  for (const Term& term : pipe.terms) {
    const Index panel = static_cast<Index>(nearest(term.at) - places.begin()) - 1;
    Laws::with(term, [&]<class Law>(const Law& law) {
      if (!Law::along && panel < 0) return;  // terms at the root do not act on any motion
      (Law::along ? mass_per_length : mass[panel]) += law.mass();
      normal_mass += law.normal_mass();
      if (!Law::along) inertia[panel] += law.inertia();
      if (has_load<Law>) loads.push_back({term, Law::along ? -1 : panel});
      if constexpr (Law::applied) applied_degree = std::max(applied_degree, law.count - 1);
    });
  }
  for (const double support : pipe.supports) {
    held.push_back(std::lower_bound(places.begin(), places.end(), support) - places.begin() - 1);
  }
  if (pipe.end_held()) held.push_back(count() - 1);
  Matrix root = Matrix::Zero(basis.size(), basis.size());  // of a spring there
  if (pipe.root > 0.0 && pipe.root < std::numeric_limits<double>::infinity()) {
    const Vector slope = basis.evaluate(Vector::Zero(1), 1).row(0);
    root = pipe.root * slope * slope.transpose();
  }
  if (!pipe.stiffness.varies()) {
    elastic = basis.stiffness().asDiagonal();
    damped = elastic - root;
    return;
  }
  damped = Matrix::Zero(basis.size(), basis.size());
  const Quadrature rule(basis.nodes_of_products() + (pipe.stiffness.degree(0.0) + 1) / 2);
  for (Index panel = 0; panel < count(); ++panel) {
    const double length = ends[panel + 1] - ends[panel];
    const Vector s = ends[panel] + length * rule.node.array();
    const auto stiffness = [&](double at) { return pipe.stiffness(at); };
    const Vector weight = length * rule.weight.array() * s.unaryExpr(stiffness).array();
    const Matrix curvature = basis.evaluate(s, 2);
    damped += inner(curvature, weight, curvature);
  }
  elastic = damped + root;
}

Grid::Grid(const Basis& basis, const Matrix& from_basis, const Panels& panels, Index nodes) {
  const Index m = basis.size(), padded = whole(m, GridTables::multiple), count = panels.count();
  const Index block = nodes + 1, half = block / 2, middle = half - 1, points = count * block;
  const Index stride = whole(points, GridTables::widest);
  const Quadrature rule(nodes);
  // The mass beyond a node is integrated by the same quadrature as the forces.
  const Matrix before = legendre_integrals(legendre_values(rule.node, nodes + 1), rule.node);
  const Vector length = panels.ends.tail(count) - panels.ends.head(count);
  Vector weight = Vector::Zero(points), mass(points), beyond(points), density(nodes), arc(block);
  arc << rule.node, 1.0;
  places.resize(points);
  double carried = 0.0;  // mass beyond the panel
  for (Index panel = count - 1; panel >= 0; --panel) {
    const Index first = panel * block, end = first + nodes;
    for (Index p = first; p < end; ++p) {
      places[p] = panels.ends[panel] + length[panel] * rule.node[p - first];
      weight[p] = length[panel] * rule.weight[p - first];
      density[p - first] = panels.pipe_mass(places[p]) + panels.mass_per_length;
      mass[p] = density[p - first] * weight[p];
    }
    places[end] = panels.ends[panel + 1];
    mass[end] = panels.mass[panel];
    for (Index p = first; p <= end; ++p) {
      const double inertia = p < end ? panels.rotary_inertia * weight[p] : panels.inertia[panel];
      if (inertia == 0.0) continue;
      turning_at_.push_back(p);
      inertia_.push_back(inertia);
    }
    beyond[end] = carried;
    carried += mass[end] + mass.segment(first, nodes).sum();
    const Vector up_to = before * (rule.expansion * density);
    beyond.segment(first, nodes) = carried - length[panel] * up_to.array();
  }
  Vector bending = Vector::Zero(points);
  Matrix curvature = Matrix::Zero(points + 1, padded), turned_curvature = curvature;
  curvature.topLeftCorner(points, m) = basis.evaluate(places, 2);
  for (Index p = 0; p < points; ++p) {
    if (weight[p] != 0.0) bending[p] = weight[p] * panels.pipe_stiffness(places[p]);
  }
  slope = Matrix::Zero(points + 1, padded);
  slope.topLeftCorner(points, m) = basis.evaluate(places, 1);
  Matrix slope_by_function = Matrix::Zero(m, stride), to_basis = Matrix::Identity(m, m);
  slope_by_function.leftCols(points) = slope.topLeftCorner(points, m).transpose();
  from_basis.triangularView<Eigen::Upper>().solveInPlace(to_basis);
  Matrix orthonormal = Matrix::Zero(points + 1, padded), from = Matrix::Zero(m + 1, padded);
  add_inner(orthonormal.topLeftCorner(points, m), 1.0, slope_by_function.leftCols(points),
            to_basis);
  from.topLeftCorner(m, m) = from_basis;
  Matrix root(2, m);
  root.row(0) = basis.evaluate(Vector::Zero(1), 1);
  root.row(1) = root.row(0) * to_basis;
  const bool turns = root.row(0).cwiseAbs().maxCoeff() > 1e-9;  // not a rounding error
  turned_curvature.topLeftCorner(points, m) = curvature.topLeftCorner(points, m) * to_basis;
  // The integral up to the mirror image of a node is the whole integral minus the part beyond it.
  const Matrix integral = rule.integral_to(rule.node.head(half));
  Matrix from_sums(half, half), from_differences(half, half);
  for (Index p = 0; p < half; ++p) {
    for (Index k = 0; k < half; ++k) {
      const double here = integral(p, k), mirrored = integral(p, nodes - 1 - k);
      const double odd = p < middle ? here + mirrored - rule.weight[k] : rule.weight[k];
      from_sums(p, k) = (k < middle ? 0.5 : 0.25) * odd;  // the middle is its own mirror image
      from_differences(p, k) = 0.5 * (here - mirrored);
    }
  }
  tables = {.functions = m,
            .padded = padded,
            .panels = count,
            .nodes = nodes,
            .points = points,
            .stride = stride,
            .slope_by_function = keep(std::move(slope_by_function)),
            .slope = slope.data(),
            .orthonormal = keep(std::move(orthonormal)),
            .root_slope = turns ? keep(root) : nullptr,
            .to_basis = keep(to_basis),
            .from_basis = keep(std::move(from)),
            .from_sums = keep(std::move(from_sums)),
            .from_differences = keep(std::move(from_differences)),
            .length = keep(length),
            .curvature = keep(std::move(curvature)),
            .orthonormal_curvature = keep(std::move(turned_curvature)),
            .weight = keep(weight),
            .bending = keep(bending),
            .mass = keep(mass),
            .turning = static_cast<Index>(inertia_.size()),
            .turning_at = turning_at_.data(),
            .inertia = inertia_.data(),
            .beyond = keep(beyond),
            .place = places.data(),
            .arc = keep(arc),
            .expansion = keep(rule.expansion),
            .elastic = panels.elastic.data(),
            .damped = panels.damped.data(),
            .elastic_forces = keep(panels.elastic * to_basis),
            .damped_forces = keep(panels.damped * to_basis)};
}

Grids::Grids(Basis basis, const Pipe& pipe, Index least_nodes)
    : basis_(std::move(basis)),
      panels_(basis_, pipe),
      from_basis_(to_orthonormal(basis_)),
      drag_(pipe.drag != 0.0) {
  const Index m = basis_.size(), count = panels_.count();
  const Index more = (std::max(pipe.mass.degree(1e-12), panels_.applied_degree) + 1) / 2;
  more_nodes_ = static_cast<double>(more);
  for (Index panel = 0; panel < count; ++panel) {
    ellipses_.push_back(
        ellipses_of(slope_series(basis_, panels_.ends[panel], panels_.ends[panel + 1]), drag_));
  }
  const Demand& demand = demanded(drag_);
  const Vector straight = Vector::Zero(m);
  const auto least_for = [&](double allowed) {
    return static_cast<Index>(std::ceil(needed(straight.data(), 1, allowed)));
  };
  const Index most = std::max<Index>(4095, 4 * m) / count;  // a grid of this size takes 0.1 GB
  const Index largest = std::max({std::min<Index>(64 * m + 96, most), least_nodes, least_for(0.0)});
  const Index least = std::max({basis_.most_on_a_panel(), least_nodes, demand.least_nodes + more});
  // The number of points of a panel, its nodes and its end, is a multiple of GridTables::multiple.
  for (Index points = whole_points(least + 1);;
       points = whole_points(points + std::max<Index>(4, points / 12))) {
    const bool last = points > largest;
    if (last || points > least_for(demand.most_more)) slots_.emplace_back().nodes = points - 1;
    if (last) break;
  }
}

double Grids::needed(const double* q, Index stride, double allowed) const {
  double most = slots_.empty() ? 0.0 : static_cast<double>(slots_.front().nodes) - more_nodes_;
  for (const std::vector<Ellipse>& of_panel : ellipses_) {
    double least = std::numeric_limits<double>::infinity();
    for (const Ellipse& one : std::views::reverse(of_panel)) {  // small motions end early so
      if (least <= most) break;
      const double sum = one.demand + one.cost_of(q, stride) - allowed;
      least = std::min(least, sum / (2.0 * one.eta));
    }
    most = std::max(most, least);
  }
  return most + more_nodes_;
}

Index Grids::choose(const double* q, Index stride, double error) const {
  const Demand& demand = demanded(drag_);
  const double allowed = error > 0.0 ? std::clamp(std::log(error) + demand.log_tolerance + certain,
                                                  0.0, demand.most_more)
                                     : 0.0;
  const double least = needed(q, stride, allowed);
  Index number = 0;
  while (number + 1 < count() && static_cast<double>(slots_[number].nodes) < least) {
    ++number;
  }
  return number;
}

bool Grids::resolves(Index number, const double* q, Index stride) const {
  return number + 1 < count() || needed(q, stride) <= static_cast<double>(most_nodes());
}

double Grids::resolved(const double* q) const {
  const double nodes = static_cast<double>(most_nodes()) - more_nodes_;
  double least = std::numeric_limits<double>::infinity();
  for (const std::vector<Ellipse>& of_panel : ellipses_) {
    double most = 0.0;
    for (const Ellipse& one : of_panel) {
      const double cost = one.cost_of(q, 1), budget = 2.0 * nodes * one.eta - one.demand;
      most = std::max(most, cost > 0.0 ? budget / cost : std::numeric_limits<double>::infinity());
    }
    least = std::min(least, most);
  }
  return least;
}

const Grid& Grids::operator[](Index number) const {
  Slot& slot = slots_[static_cast<std::size_t>(number)];
  std::call_once(slot.built, [&] {
    slot.grid = std::make_unique<Grid>(basis_, from_basis_, panels_, slot.nodes);
  });
  return *slot.grid;
}

}  // namespace pipedyn
