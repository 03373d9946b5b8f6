// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/panel_pencil.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "pipedyn/galerkin/quadrature.hpp"
#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

namespace {

/// The integrals from 0 of the orthonormal p_j, j < count, as sums of p_i: (count, count).
Sparse integration(Index count) {
  Sparse found(count, count);
  const auto root = [](Index k) { return std::sqrt(2.0 * static_cast<double>(k) + 1.0); };
  for (Index j = 0; j < count; ++j) {
    const double half = 0.5 / root(j);
    found.insert(j, std::max<Index>(j - 1, 0)) = j == 0 ? half : -half / root(j - 1);
    if (j + 1 < count) found.insert(j, j + 1) = half / root(j + 1);
  }
  return found;
}

/// The Jacobi matrix X, which multiplies by x, for p_i of i < count: (count, count).
Sparse jacobi(Index count) {
  Sparse found(count, count);
  for (Index i = 1; i < count; ++i) {
    const double k = static_cast<double>(i);
    found.insert(i - 1, i) = found.insert(i, i - 1) = k / std::sqrt(4.0 * k * k - 1.0);
  }
  return found;
}

/// The matrix f(X) of a factor f, given by its coefficients of p_i, by the recurrence of p_i(X).
/// All rows are exact but as many of the last ones as f has degrees.
Sparse multiplication(const Vector& f, Index count) {
  const Sparse x = jacobi(count);
  Sparse before(count, count), one(count, count);
  one.setIdentity();
  Sparse sum = f[0] * one;
  for (Index k = 0; k + 1 < f.size(); ++k) {  // X p_k = X_{k, k+1} p_{k+1} + X_{k, k-1} p_{k-1}
    Sparse next = x * one;
    if (k > 0) next -= x.coeff(k, k - 1) * before;
    next /= x.coeff(k, k + 1);
    sum += f[k + 1] * next;
    before.swap(one);
    one.swap(next);
  }
  return sum;
}

/// A profile on a panel, which lies in one stretch of it, by its coefficients of p_i in (s - a) /
/// h.
Vector series_of(const Profile& profile, double low, double length) {
  const Quadrature rule(profile.degree(0.0) + 1);
  const Vector s = low + length * rule.node.array();
  Vector found = rule.expansion * s.unaryExpr([&](double at) { return profile(at); });
  for (Index k = 0; k < found.size(); ++k)
    found[k] /= std::sqrt(2.0 * static_cast<double>(k) + 1.0);
  return found;
}

/// The shapes, slopes and curvatures of the functions of a panel as sums of p_i, i < count: each
/// (size, count). The shape of function j is of the degrees j - 4 to j.
constexpr Index reach = 4;
struct Functions {
  Sparse shape, slope, curvature;

  Functions(Index size, Index count)
      : shape(size, count), slope(size, count), curvature(size, count) {
    const Sparse integral = integration(count);
    for (Index j = 2; j < size; ++j) curvature.insert(j, j - 2) = 1.0;
    slope = curvature * integral;
    slope.coeffRef(1, 0) = 1.0;
    shape = slope * integral;
    shape.coeffRef(0, 0) = 1.0;
  }
};

constexpr double eps = std::numeric_limits<double>::epsilon();

using Reals = Eigen::ArrayXd;

/// Whether s is the end of a panel. Exact comparison is right here: the ends are numbers of the
/// basis, and so are the places of terms.
bool is_end(const Vector& ends, double s) { return (ends.array() == s).any(); }

}  // namespace

bool PanelPencil::fits(const Pipe& pipe, const Basis& basis) {
  if (basis.family() != Family::legendre) return false;
  const Vector& ends = basis.ends();
  for (const Term& term : pipe.terms) {
    bool along = false;
    Laws::with(term, [&](const auto& law) { along = law.along; });
    if (!along && !is_end(ends, term.at)) return false;
  }
  for (const Profile* const one : {&pipe.stiffness, &pipe.mass}) {
    if (one->degree(0.0) + reach + 1 > widest) return false;
    for (const double s : one->ends()) {
      if (!is_end(ends, s)) return false;
    }
  }
  return true;
}

PanelPencil::PanelPencil(const Pipe& pipe, const Basis& basis)
    : pipe_(pipe),
      basis_(basis),
      size_(0),
      band_(reach),
      turns_(pipe.root < std::numeric_limits<double>::infinity()) {
  if (!fits(pipe, basis)) {
    throw std::invalid_argument("loads and steps of the pipe must lie where panels end");
  }
  const Vector& ends = basis.ends();
  const auto numbers = basis.by_panel();
  const Index count = static_cast<Index>(numbers.size());
  Index rows = 0;
  for (Index p = 0; p < count; ++p) {
    const bool last = p + 1 == count;
    const Index own = static_cast<Index>(numbers[static_cast<std::size_t>(p)].size());
    const bool held = (last && pipe.end_held()) ||
                      std::count(pipe.supports.begin(), pipe.supports.end(), ends[p + 1]) > 0;
    panels_.push_back(
        {ends[p + 1] - ends[p], own + 2, rows, nullptr, {}, held, last && pipe.end_guided()});
    rows += own + 4;
    size_ += own;
  }
  if (turns_) ++size_;
  set_joints(rows);
  std::vector<Eigen::Triplet<double, Index>> entries[parts];
  double mass_along = 0.0, normal_along = 0.0, pulled_along = 0.0;
  Slopes<double> along;
  for (const Term& term : pipe.terms) {
    Laws::with(term, [&](const auto& law) {
      if (!law.along) return;
      const AtRest at_rest(law, 0.0);
      mass_along += law.mass();
      normal_along += law.normal_mass();
      pulled_along += at_rest.load.y;
      add(along, 1.0, at_rest.slopes);
    });
  }
  works_at_ends_ = true;  // unless what acts all along the pipe is not symmetric
  for (const auto& variables : {small_still, small_moving}) {
    const double turned = along.by[0][variables[1]], moved = along.by[2][variables[0]];
    works_at_ends_ = works_at_ends_ && turned == moved;
  }
  // The tension from weight is a polynomial of one degree more than the mass, but slopes have only
  // half the reach.
  const Index of_mass = pipe.mass.degree(0.0), of_stiffness = pipe.stiffness.degree(0.0);
  band_ = std::max(reach + of_mass, of_stiffness);
  const double flow = pipe.direction() * pipe.sqrt_beta(), jet = std::cos(pipe.jet_angle);
  double carried = 0.0, pulled = 0.0;  // mass and axial load beyond the panel
  for (Index p = count - 1; p >= 0; --p) {
    const EliminationPanel& panel = panels_[static_cast<std::size_t>(p)];
    const double low = ends[p], h = panel.length;
    const Index end = panel.first + panel.size;
    // Adds an entry of the matrix of what acts at the end, by w and theta, in units of the panel.
    const auto add_station = [&](Part part, Index i, Index j, double value) {
      entries[part].emplace_back(end + i, end + j,
                                 h * value * (i == 0 ? h : 1.0) * (j == 0 ? h : 1.0));
    };
    for (const Term& term : pipe.terms) {
      Laws::with(term, [&](const auto& law) {
        if (law.along || term.at != ends[p + 1]) return;
        add_station(mass, 0, 0, law.mass());
        add_station(mass, 1, 1, law.inertia());
        const auto [load, slopes] = AtRest(law, term.at);
        for (const int i : {0, 1}) {
          for (const int j : {0, 1}) {
            const double* const by = slopes.by[small_rows[i]];
            add_station(Part::rest, i, j, -by[small_still[j]]);
            add_station(resistance, i, j, -by[small_moving[j]]);
          }
        }
        carried += law.mass() - law.weightless();
        pulled += load.y;
      });
    }
    if (p + 1 == count) add_station(velocity, 0, 0, -pipe.entry());
    const Index degrees = panel.size + std::max(of_mass + 1, of_stiffness);
    const Functions functions(panel.size, degrees);
    const auto& [shape, slope, curvature] = functions;
    // Adds the integrals of left_i f right_j.
    const auto add = [&](Part part, const Sparse& left, const Vector& f, const Sparse& right,
                         double share) {
      if (share == 0.0) return;
      const Sparse by = left * multiplication(f, degrees), found = by * Sparse(right.transpose());
      for (Index i = 0; i < panel.size; ++i) {
        for (Sparse::InnerIterator one(found, i); one; ++one) {
          entries[part].emplace_back(panel.first + i, panel.first + one.col(), share * one.value());
        }
      }
    };
    const double h2 = h * h, h3 = h * h2, h4 = h2 * h2;
    const Vector one = Vector::Ones(1);
    Vector mass_here = series_of(pipe.mass, low, h);
    mass_here[0] += mass_along;
    add(mass, shape, mass_here, shape, h4);
    add(mass, shape, one, shape, normal_along * h4);
    add(mass, slope, one, slope, pipe.rotary_inertia * h2);
    add(velocity, shape, one, slope, 2.0 * flow * h3);
    add(flux, shape, one, curvature, jet * h2);
    add(elastic, curvature, series_of(pipe.stiffness, low, h), curvature, 1.0);
    const Sparse* const moves[] = {&shape, &slope};
    for (const int i : {0, 1}) {
      for (const int j : {0, 1}) {
        const double* const by = along.by[small_rows[i]];
        const double share = i + j == 0 ? h4 : i + j == 1 ? h3 : h2;
        add(Part::rest, *moves[i], one, *moves[j], -by[small_still[j]] * share);
        add(resistance, *moves[i], one, *moves[j], -by[small_moving[j]] * share);
      }
    }
    // The mass beyond a place, or the axial load: that of the panels beyond, and the rest of this
    // one.
    const auto beyond = [&](double& outer, const Vector& density) -> Vector {
      Vector sum = Vector::Zero(degrees);
      sum.head(density.size()) = -h * density;
      sum = integration(degrees).transpose() * sum;
      sum[0] += outer + h * density[0];
      outer += h * density[0];
      return sum.head(density.size() + 1);
    };
    add(gravity, slope, beyond(carried, mass_here), slope, h2);
    const bool pulls = pulled != 0.0 || pulled_along != 0.0;
    add(Part::rest, slope, beyond(pulled, pulled_along * one), slope, pulls ? h2 : 0.0);
  }
  for (int part = 0; part < parts; ++part) {
    tables_[part].resize(rows, rows);
    tables_[part].setFromTriplets(entries[part].begin(), entries[part].end());
  }
}

void PanelPencil::set_joints(Index rows) {
  std::vector<Eigen::Triplet<double, Index>> placed, joined;
  if (turns_) placed.emplace_back(1, 0, 1.0 / std::sqrt(panels_[0].length));
  Index column = turns_ ? 1 : 0;
  for (std::size_t p = 0; p < panels_.size(); ++p) {
    const EliminationPanel& panel = panels_[p];
    const Index first = panel.first, end = first + panel.size;
    for (Index k = 2; k < panel.size; ++k) placed.emplace_back(first + k, column++, 1.0);
    for (Index k = 0; k < std::min(panel.size, moving); ++k) {
      joined.emplace_back(end, first + k, -end_shape[k]);
      joined.emplace_back(end + 1, first + k, -end_slope[k]);
    }
    if (p == 0) continue;
    const double ratio = panels_[p - 1].length / panel.length, root = std::sqrt(ratio);
    joined.emplace_back(first, first - 2, -ratio * root);
    joined.emplace_back(first + 1, first - 1, -root);
  }
  placed_.resize(rows, size_);
  placed_.setFromTriplets(placed.begin(), placed.end());
  joints_.resize(rows, rows);
  joints_.setFromTriplets(joined.begin(), joined.end());
}

Matrix PanelPencil::along(const Matrix& x) const {
  Matrix z = placed_ * x;
  joints_.triangularView<Eigen::UnitLower>().solveInPlace(z);
  return z;
}

Index PanelPencil::conditions() const {
  Index count = 0;
  for (const EliminationPanel& panel : panels_) count += panel.held + panel.directed;
  return count;
}

PanelPencil PanelPencil::coarser(Index size) const {
  const Vector& ends = basis_.ends();
  const Index least = ends.size() + 1;
  return {pipe_, Basis(Family::legendre, std::max(size, least), ends.segment(1, ends.size() - 2), 0,
                       pipe_)};
}

void PanelPencil::make(const PencilEntry (&factors)[parts], At& found) const {
  const Index wide = 2 * band_ + 1;
  found.entries.assign(static_cast<std::size_t>(joints_.rows() * wide), {});
  found.panels = panels_;
  for (EliminationPanel& panel : found.panels) {
    PencilEntry* const entries = found.entries.data() + panel.first * wide;
    panel.entries = entries;
    for (int part = 0; part < parts; ++part) {
      const PencilEntry& factor = factors[part];
      for (Index i = 0; i < panel.size + 2; ++i) {
        for (Sparse::InnerIterator one(tables_[part], panel.first + i); one; ++one) {
          const Index j = one.col() - panel.first;
          PencilEntry& to = i < panel.size ? entries[i * wide + j - i + band_]
                                           : panel.station[i - panel.size][j - panel.size];
          to.stiffness += factor.stiffness * one.value();
          to.hysteretic += factor.hysteretic * one.value();
          to.damping += factor.damping * one.value();
          to.mass += factor.mass * one.value();
          to.stiffness_by_speed += factor.stiffness_by_speed * one.value();
          to.damping_by_speed += factor.damping_by_speed * one.value();
        }
      }
    }
  }
  found.model = {found.panels.data(),      static_cast<Index>(panels_.size()), band_, size_, turns_,
                 turns_ ? pipe_.root : 0.0};
}

void PanelPencil::at(double u, At& found) const {
  const double thrust = pipe_.end_coefficient * u;
  PencilEntry factors[parts];
  factors[elastic] = {.stiffness = 1.0, .hysteretic = pipe_.hysteresis, .damping = pipe_.damping};
  factors[gravity].stiffness = pipe_.down()[1] * pipe_.gamma;
  factors[Part::rest].stiffness = 1.0;
  factors[flux] = {.stiffness = thrust * u, .stiffness_by_speed = 2.0 * thrust};
  factors[velocity] = {.damping = u, .damping_by_speed = 1.0};
  factors[resistance].damping = 1.0;
  factors[mass].mass = 1.0;
  make(factors, found);
}

PanelPencil::At PanelPencil::by_squared_speed() const {
  PencilEntry factors[parts];
  factors[elastic].stiffness = factors[Part::rest].stiffness = 1.0;
  factors[gravity].stiffness = pipe_.down()[1] * pipe_.gamma;
  factors[flux].damping = pipe_.end_coefficient;
  At found;
  make(factors, found);
  return found;
}

Matrix PanelPencil::times(const Matrix& x, const LinearPart& of) const {
  const double stiffness = of.stiffness, damping = of.damping;
  double shares[parts];
  shares[elastic] = of.by_damping + stiffness + damping * pipe_.damping;
  shares[gravity] = pipe_.down()[1] * (of.gravity + stiffness * pipe_.gamma);
  shares[Part::rest] = stiffness;
  shares[flux] = of.flux;
  shares[velocity] = of.velocity;
  shares[resistance] = damping;
  shares[mass] = of.mass;
  Sparse table(joints_.rows(), joints_.rows());
  for (int part = 0; part < parts; ++part) {
    if (shares[part] != 0.0) table += shares[part] * tables_[part];
  }
  Matrix forces = table * along(x);
  joints_.transpose().triangularView<Eigen::UnitUpper>().solveInPlace(forces);
  Matrix out = placed_.transpose() * forces;
  if (turns_) out.row(0) += (stiffness * pipe_.root) * x.row(0);
  return out;
}

Rayleigh PanelPencil::rayleigh(double u, const Reals& frequencies, const Matrix& x) const {
  const Index count = x.cols() / 2;
  const auto both = [&](const Eigen::RowVectorXd& columns) -> Reals {
    return (columns.head(count) + columns.tail(count)).transpose().array();
  };
  // Im sum_i conj(a_i) b_i, for each motion.
  const auto skew = [&](const Matrix& a, const Matrix& b) -> Reals {
    const Matrix left = a.leftCols(count).cwiseProduct(b.rightCols(count));
    const Matrix right = a.rightCols(count).cwiseProduct(b.leftCols(count));
    return (left - right).colwise().sum().transpose().array();
  };
  const auto size = [&](const Eigen::RowVectorXd& row) -> Reals {
    return (row.head(count).array().square() + row.tail(count).array().square()).sqrt();
  };
  const Matrix z = along(x);
  Matrix bounds = placed_ * x.cwiseAbs();  // sums of absolute terms of z
  Sparse(-joints_.cwiseAbs()).triangularView<Eigen::UnitLower>().solveInPlace(bounds);
  const auto form = [&](const Sparse& table, const Matrix& of) -> Reals {
    return both(of.cwiseProduct(Matrix(table * of)).colwise().sum());
  };
  const double flow = pipe_.direction() * pipe_.sqrt_beta() - pipe_.entry();
  const double thrust = pipe_.end_coefficient * u * u * std::cos(pipe_.jet_angle);
  const double lost_term = 4.0 * eps * std::sqrt(static_cast<double>(size_));
  const Reals omega = frequencies.abs();
  Rayleigh sum;
  sum.mass = form(tables_[mass], z);
  sum.gyroscopic = u * skew(z, tables_[velocity] * z);
  const Reals strained = form(tables_[elastic], z), resisted = form(tables_[resistance], z);
  const Reals sizes = form(tables_[resistance].cwiseAbs(), z.cwiseAbs());
  sum.dissipative = pipe_.damping * strained + resisted;
  sum.circulatory = pipe_.hysteresis * strained;
  sum.error = lost_term * (omega * (pipe_.damping * strained + sizes) + sum.circulatory);
  for (const EliminationPanel& panel : panels_) {
    if (panel.held) continue;
    // Work of follower loads comes from the skew part of the stiffness of a station.
    const Sparse& still = tables_[Part::rest];
    const Index end = panel.first + panel.size;
    const double following = still.coeff(end, end + 1) - still.coeff(end + 1, end);
    const bool last = &panel == &panels_.back();
    const double h = panel.length, skewed = following + (last ? thrust * h * h : 0.0);
    const double moved = last ? u * flow * h * h * h : 0.0;
    const Reals w = size(z.row(end)), theta = size(z.row(end + 1));
    const Reals lost_w = lost_term * size(bounds.row(end)),
                lost_theta = lost_term * size(bounds.row(end + 1));
    sum.dissipative += moved * w.square();
    sum.error += std::abs(moved) * omega * (2.0 * w + lost_w) * lost_w;
    if (panel.directed) continue;
    sum.circulatory += skewed * skew(z.row(end), z.row(end + 1));
    sum.error += std::abs(skewed) * ((theta + lost_theta) * lost_w + w * lost_theta);
  }
  return sum;
}

Matrix PanelPencil::held() const {
  Matrix rows(conditions(), size_);
  Index next = 0;
  const Matrix motion = along(Matrix::Identity(size_, size_));
  for (const EliminationPanel& panel : panels_) {
    const double root = std::sqrt(panel.length);
    const Index end = panel.first + panel.size;
    if (panel.held) rows.row(next++) = panel.length * root * motion.row(end);
    if (panel.directed) rows.row(next++) = root * motion.row(end + 1);
  }
  return rows;
}

}  // namespace pipedyn
