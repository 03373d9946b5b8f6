// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/grid.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <limits>
#include <numbers>
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
  const double step = std::numbers::pi / static_cast<double>(count);
  Vector s(count);
  Matrix transform(count, count), coefficient = Matrix::Zero(count, basis.size());
  for (Index p = 0; p < count; ++p) {
    const double angle = (static_cast<double>(p) + 0.5) * step;
    s[p] = low + (high - low) * (0.5 * (1.0 + std::cos(angle)));
    for (Index k = 0; k < count; ++k) {
      const double factor = (k == 0 ? 1.0 : 2.0) / static_cast<double>(count);
      transform(p, k) = factor * std::cos(static_cast<double>(k) * angle);
    }
  }
  add_inner(coefficient, 1.0, transform, basis.evaluate(s, 1));
  for (Index i = 0; i < basis.size(); ++i) {
    double largest = 0.0;
    for (Index k = 0; k < count; ++k) largest = std::max(largest, std::abs(coefficient(k, i)));
    for (Index k = 0; k < count; ++k) {
      const double size = std::abs(coefficient(k, i));
      coefficient(k, i) = size < 1e-13 * largest ? 0.0 : size;
    }
  }
  return coefficient;
}

/// Bounds of slopes with given Chebyshev series on the Bernstein ellipse about an interval, with
/// the semi-axes cosh(eta) and sinh(eta).
struct Ellipse {
  double eta, log_growth;  // log_growth: largest growth of a slope up to the ellipse
  Vector sums;             // 2 sum_k sinh(k eta) c_ik, (m,)
};

std::vector<Ellipse> ellipses_of(const Matrix& series) {
  const auto sum = [&series](double (*factor)(double), double eta) {  // over factor(k eta) c_ik
    Vector sums = Vector::Zero(series.cols());
    for (Index k = 0; k < series.rows(); ++k) {
      const double of_order = factor(static_cast<double>(k) * eta);
      for (Index i = 0; i < sums.size(); ++i) sums[i] += of_order * series(k, i);
    }
    return sums;
  };
  const Vector total = sum(std::cosh, 0.0);
  std::vector<Ellipse> ellipses;
  for (double eta = std::min(0.05, 2.0 / static_cast<double>(series.cols())); eta < 3.0;
       eta *= 1.5) {
    const Vector grown = sum(std::cosh, eta);
    double growth = 1.0;  // at least 1; functions that are 0 on the interval do not count
    for (Index i = 0; i < total.size(); ++i) {
      if (total[i] > 0.0) growth = std::max(growth, grown[i] / total[i]);
    }
    ellipses.push_back({eta, std::log(growth), 2.0 * sum(std::sinh, eta)});
  }
  return ellipses;
}

/// The tests that amplitudes must pass, one of them, for this number of nodes on a panel. drag:
/// whether integrals end at inner points.
std::vector<NodeTest> node_tests(const std::vector<Ellipse>& ellipses, Index nodes, bool drag) {
  const Demand& demand = demanded(drag);
  std::vector<NodeTest> tests;
  for (const Ellipse& one : ellipses) {
    const double budget = 2.0 * static_cast<double>(nodes) * one.eta - demand.log_tolerance -
                          demand.growths * one.log_growth;
    if (budget + demand.most_more > 0.0) tests.push_back({budget, one.sums});
  }
  return tests;
}

}  // namespace

Orthonormal::Orthonormal(const Basis& basis) {
  const Index m = basis.size();
  to_basis = inverse = Matrix::Identity(m, m);
  if (basis.orthonormal()) return;
  Matrix mass = Matrix::Zero(m, m);
  const Quadrature rule(basis.nodes_of_products());
  for (Index panel = 0; panel + 1 < basis.ends().size(); ++panel) {
    const double low = basis.ends()[panel], length = basis.ends()[panel + 1] - low;
    const Matrix value = basis.evaluate(low + length * rule.node.array(), 0);
    mass += inner(value, length * rule.weight, value);
  }
  const Eigen::LLT<Matrix> factors(mass);
  inverse = factors.matrixU();
  factors.matrixU().solveInPlace(to_basis);
  if (factors.info() != Eigen::Success) {
    throw std::invalid_argument("m must be smaller for a motion: the mass matrix of " +
                                std::to_string(m) + " functions is singular to rounding");
  }
}

Orthonormal::Orthonormal(Index m) : to_basis(Matrix::Identity(m, m)), inverse(to_basis) {}

Panels::Panels(const Basis& basis, const Pipe& pipe)
    : pipe_mass(pipe.mass), rotary_inertia(pipe.rotary_inertia) {
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
    });
  }
  for (const double support : pipe.supports) {
    held.push_back(std::lower_bound(places.begin(), places.end(), support) - places.begin() - 1);
  }
  if (pipe.end == End::pinned || pipe.end == End::clamped) held.push_back(count() - 1);
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

Grid::Grid(const Basis& basis, const Orthonormal& orthonormal, const Panels& panels, Index nodes)
    : rule_(nodes), length_(panels.count()), arc_(nodes + 1) {
  const Index m = basis.size(), block = nodes + 1, half = block / 2, middle = half - 1;
  const Index points = panels.count() * block;
  const Index stride = whole(points, GridTables::widest);
  places.resize(points);
  weight_ = mass = beyond_ = density_ = Vector::Zero(points);
  for (Index panel = 0; panel < panels.count(); ++panel) {
    const Index first = panel * block, end = first + nodes;
    length_[panel] = panels.ends[panel + 1] - panels.ends[panel];
    for (Index k = 0; k < nodes; ++k) {
      const Index p = first + k;
      places[p] = panels.ends[panel] + length_[panel] * rule_.node[k];
      weight_[p] = length_[panel] * rule_.weight[k];
    }
    places[end] = panels.ends[panel + 1];
  }
  set_masses(panels);
  slope = Matrix::Zero(points + 1, whole(m, GridTables::multiple));
  slope.topLeftCorner(points, m) = basis.evaluate(places, 1);
  slope_by_function_ = Matrix::Zero(m, stride);
  slope_by_function_.leftCols(points) = slope.topLeftCorner(points, m).transpose();
  orthonormal_ = slope;
  orthonormal_.setZero();
  add_inner(orthonormal_.topLeftCorner(points, m), 1.0, slope_by_function_.leftCols(points),
            orthonormal.to_basis);
  from_basis_ = Matrix::Zero(m + 1, slope.cols());
  from_basis_.topLeftCorner(m, m) = orthonormal.inverse;
  // The integral up to the mirror image of a node is the whole integral minus the part beyond it.
  const Matrix integral = rule_.integral_to(rule_.node.head(half));
  from_sums_ = from_differences_ = Matrix::Zero(half, half);
  for (Index p = 0; p < half; ++p) {
    for (Index k = 0; k < half; ++k) {
      const double here = integral(p, k), mirrored = integral(p, nodes - 1 - k);
      const double odd = p < middle ? here + mirrored - rule_.weight[k] : rule_.weight[k];
      from_sums_(p, k) = (k < middle ? 0.5 : 0.25) * odd;  // the middle is its own mirror image
      from_differences_(p, k) = 0.5 * (here - mirrored);
    }
  }
  recurrence_.resize(nodes, 3);
  for (Index k = 0; k < nodes; ++k) {
    const double order = static_cast<double>(k), twice = 2.0 * order + 1.0;
    recurrence_.row(k) << twice / (order + 1.0), order / (order + 1.0), 0.5 / twice;
    arc_[k] = rule_.node[k];
  }
  arc_[nodes] = 1.0;
  elastic_forces_ = panels.elastic * orthonormal.to_basis;
  damped_forces_ = panels.damped * orthonormal.to_basis;
  tables = {.functions = m,
            .padded = orthonormal_.cols(),
            .panels = panels.count(),
            .nodes = nodes,
            .points = points,
            .stride = stride,
            .heavy = mass[points - 1] != 0.0 ? points : points - 1,
            .slope_by_function = slope_by_function_.data(),
            .slope = slope.data(),
            .orthonormal = orthonormal_.data(),
            .to_basis = orthonormal.to_basis.data(),
            .from_basis = from_basis_.data(),
            .from_sums = from_sums_.data(),
            .from_differences = from_differences_.data(),
            .length = length_.data(),
            .weight = weight_.data(),
            .mass = mass.data(),
            .turning = static_cast<Index>(inertia_.size()),
            .turning_at = turning_at_.data(),
            .inertia = inertia_.data(),
            .density = density_.data(),
            .beyond = beyond_.data(),
            .arc = arc_.data(),
            .expansion = rule_.expansion.data(),
            .recurrence = recurrence_.data(),
            .elastic = panels.elastic.data(),
            .damped = panels.damped.data(),
            .elastic_forces = elastic_forces_.data(),
            .damped_forces = damped_forces_.data()};
}

void Grid::set_masses(const Panels& panels) {
  const Index nodes = rule_.size(), block = nodes + 1;
  // The mass beyond a node is integrated by the same quadrature as the forces.
  const Matrix before = legendre_integrals(legendre_values(rule_.node, nodes + 1), rule_.node);
  double beyond = 0.0;
  for (Index panel = panels.count() - 1; panel >= 0; --panel) {
    const Index first = panel * block, end = first + nodes;
    for (Index p = first; p < end; ++p) {
      density_[p] = panels.pipe_mass(places[p]) + panels.mass_per_length;
      mass[p] = density_[p] * weight_[p];
    }
    density_[end] = 1.0;
    mass[end] = panels.mass[panel];
    for (Index p = first; p <= end; ++p) {
      const double inertia = p < end ? panels.rotary_inertia * weight_[p] : panels.inertia[panel];
      if (inertia == 0.0) continue;
      turning_at_.push_back(p);
      inertia_.push_back(inertia);
    }
    beyond_[end] = beyond;
    beyond += mass[end] + mass.segment(first, nodes).sum();
    const Vector up_to = before * (rule_.expansion * density_.segment(first, nodes));
    beyond_.segment(first, nodes) = beyond - length_[panel] * up_to.array();
  }
}

Grids::Grids(Basis basis, const Pipe& pipe, Index least_nodes)
    : basis_(std::move(basis)),
      panels_(basis_, pipe),
      orthonormal_(basis_),
      drag_(pipe.drag != 0.0) {
  const Index m = basis_.size(), count = panels_.count();
  const Index more = (pipe.mass.degree(1e-12) + 1) / 2;
  std::vector<std::vector<Ellipse>> ellipses;
  for (Index panel = 0; panel < count; ++panel) {
    ellipses.push_back(
        ellipses_of(slope_series(basis_, panels_.ends[panel], panels_.ends[panel + 1])));
  }
  const Index most = std::max<Index>(4095, 4 * m) / count;  // a grid of this size takes 0.1 GB
  const Index largest = std::max(std::min<Index>(64 * m + 96, most), least_nodes);
  const Index least = demanded(drag_).least_nodes + more;
  // The number of points of a panel, its nodes and its end, is a multiple of GridTables::multiple.
  for (Index points = whole_points(std::max({basis_.most_on_a_panel(), least_nodes, least}) + 1);;
       points = whole_points(points + std::max<Index>(4, points / 12))) {
    const bool last = points - 1 >= largest;
    std::vector<std::vector<NodeTest>> tests;
    for (const std::vector<Ellipse>& one : ellipses) {
      tests.push_back(node_tests(one, points - 1 - more, drag_));
      if (tests.back().empty() && last) tests.back().push_back({0.0, Vector::Zero(m)});
    }
    const auto serves_none = [](const std::vector<NodeTest>& of) { return of.empty(); };
    if (std::any_of(tests.begin(), tests.end(), serves_none)) continue;
    Slot& slot = slots_.emplace_back();
    slot.nodes = points - 1;
    slot.tests = std::move(tests);
    if (last) break;
  }
}

bool Grids::Slot::resolves(const double* q, Index stride, double more) const {
  const auto passes = [&](const NodeTest& test) {
    return test.cost_of(q, stride) <= test.budget + more;
  };
  return std::all_of(tests.begin(), tests.end(), [&](const std::vector<NodeTest>& of_panel) {
    return std::any_of(of_panel.begin(), of_panel.end(), passes);
  });
}

Index Grids::choose(const double* q, Index stride, Index guess, double error) const {
  const Demand& demand = demanded(drag_);
  const double more = error > 0.0 ? std::clamp(std::log(error) + demand.log_tolerance + certain,
                                               0.0, demand.most_more)
                                  : 0.0;
  const auto serves = [&](Index number) {
    return slots_[static_cast<std::size_t>(number)].resolves(q, stride, more);
  };
  Index number = guess;
  while (number + 1 < count() && !serves(number)) ++number;
  if (number > guess) return number;
  while (number > 0 && serves(number - 1)) --number;
  return number;
}

bool Grids::resolves(Index number, const double* q, Index stride) const {
  return number + 1 < count() || slots_.back().resolves(q, stride);
}

double Grids::resolved(const double* q) const {
  double least = std::numeric_limits<double>::infinity();
  for (const std::vector<NodeTest>& of_panel : slots_.back().tests) {
    double most = 0.0;
    for (const NodeTest& test : of_panel) {
      const double cost = test.cost_of(q, 1);
      most =
          std::max(most, cost > 0.0 ? test.budget / cost : std::numeric_limits<double>::infinity());
    }
    least = std::min(least, most);
  }
  return least;
}

const Grid& Grids::operator[](Index number) const {
  Slot& slot = slots_[static_cast<std::size_t>(number)];
  std::call_once(slot.built, [&] {
    slot.grid = std::make_unique<Grid>(basis_, orthonormal_, panels_, slot.nodes);
  });
  return *slot.grid;
}

}  // namespace pipedyn
