// SPDX-License-Identifier: MIT
#include "pipedyn/galerkin/panel_pencil.hpp"

#include <Eigen/SparseCore>
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "pipedyn/galerkin/quadrature.hpp"
#include "pipedyn/terms/laws.hpp"

namespace pipedyn {

namespace {

using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;

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
  panels_.resize(static_cast<std::size_t>(count));
  double mass_along = 0.0, normal_along = 0.0;
  Slopes<double> along;
  for (const Term& term : pipe.terms) {
    Laws::with(term, [&](const auto& law) {
      if (!law.along) return;
      mass_along += law.mass();
      normal_along += law.normal_mass();
      add(along, 1.0, AtRest(law, 0.0).slopes);
    });
  }
  // The tension from weight is a polynomial of one degree more than the mass, but slopes have only
  // half the reach.
  const Index of_mass = pipe.mass.degree(0.0), of_stiffness = pipe.stiffness.degree(0.0);
  band_ = std::max(reach + of_mass, of_stiffness);
  const double flow = pipe.direction() * pipe.sqrt_beta(), jet = std::cos(pipe.jet_angle);
  double carried = 0.0, pulled = 0.0;  // mass and axial load beyond the panel
  for (Index p = count - 1; p >= 0; --p) {
    const double low = ends[p], h = ends[p + 1] - low;
    Panel& panel = panels_[static_cast<std::size_t>(p)];
    panel = {};
    panel.length = h;
    panel.size = static_cast<Index>(numbers[static_cast<std::size_t>(p)].size()) + 2;
    size_ += panel.size - 2;
    const bool last = p + 1 == count;
    panel.directed = last && pipe.is_guided();
    panel.held = (last && (pipe.end == End::pinned || pipe.end == End::clamped)) ||
                 std::count(pipe.supports.begin(), pipe.supports.end(), ends[p + 1]) > 0;
    // Adds an entry of the matrix of what acts at the end, by w and theta, in units of the panel.
    const auto add_station = [&](Part part, Index i, Index j, double value) {
      panel.station[part][i][j] += h * value * (i == 0 ? h : 1.0) * (j == 0 ? h : 1.0);
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
        carried += law.mass();
        pulled += load.y;
      });
    }
    if (last) add_station(velocity, 0, 0, -pipe.entry());
    const Index wide = 2 * band_ + 1, degrees = panel.size + std::max(of_mass + 1, of_stiffness);
    for (auto& band : panel.bands) band.assign(static_cast<std::size_t>(panel.size * wide), 0.0);
    const Functions functions(panel.size, degrees);
    const auto& [shape, slope, curvature] = functions;
    // Adds the integrals of left_i f right_j.
    const auto add = [&](Part part, const Sparse& left, const Vector& f, const Sparse& right,
                         double share) {
      if (share == 0.0) return;
      const Sparse by = left * multiplication(f, degrees), found = by * Sparse(right.transpose());
      for (Index i = 0; i < panel.size; ++i) {
        for (Sparse::InnerIterator one(found, i); one; ++one) {
          const Index place = i * wide + one.col() - i + band_;
          panel.bands[part][static_cast<std::size_t>(place)] += share * one.value();
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
    add(Part::rest, slope, one, slope, pulled * h2);
    const Sparse* const moves[] = {&shape, &slope};
    for (const int i : {0, 1}) {
      for (const int j : {0, 1}) {
        const double* const by = along.by[small_rows[i]];
        const double share = i + j == 0 ? h4 : i + j == 1 ? h3 : h2;
        add(Part::rest, *moves[i], one, *moves[j], -by[small_still[j]] * share);
        add(resistance, *moves[i], one, *moves[j], -by[small_moving[j]] * share);
      }
    }
    // The weight beyond a place: what the panels beyond carry, and the rest of this one.
    Vector weight = Vector::Zero(degrees);
    weight.head(mass_here.size()) = -h * mass_here;
    weight = integration(degrees).transpose() * weight;
    weight[0] += carried + h * mass_here[0];
    add(gravity, slope, weight.head(of_mass + 2), slope, h2);
    carried += h * mass_here[0];
  }
  if (turns_) ++size_;
}

Index PanelPencil::conditions() const {
  Index count = 0;
  for (const Panel& panel : panels_) count += panel.held + panel.directed;
  return count;
}

PanelPencil PanelPencil::coarser(Index size) const {
  const Vector& ends = basis_.ends();
  const Index least = ends.size() + 1;
  return {pipe_, Basis(Family::legendre, std::max(size, least), ends.segment(1, ends.size() - 2), 0,
                       pipe_)};
}

template <class Entry>
PanelPencil::At PanelPencil::made(const Entry& entry) const {
  At found;
  const Index wide = 2 * band_ + 1;
  Index entries = 0;
  for (const Panel& panel : panels_) entries += panel.size * wide;
  found.entries.resize(static_cast<std::size_t>(entries));
  PencilEntry* next = found.entries.data();
  for (const Panel& panel : panels_) {
    const Index own = panel.size * wide;
    for (Index e = 0; e < own; ++e) {
      next[e] = entry([&](int part) { return panel.bands[part][static_cast<std::size_t>(e)]; });
    }
    EliminationPanel made{panel.length, panel.size, next, {}, panel.held, panel.directed};
    for (Index i = 0; i < 2; ++i) {
      for (Index j = 0; j < 2; ++j) {
        made.station[i][j] = entry([&](int part) { return panel.station[part][i][j]; });
      }
    }
    found.panels.push_back(made);
    next += own;
  }
  found.model = {found.panels.data(),      static_cast<Index>(panels_.size()), band_, size_, turns_,
                 turns_ ? pipe_.root : 0.0};
  return found;
}

PanelPencil::At PanelPencil::at(double u) const {
  const double thrust = pipe_.centrifugal * u * u, by_speed = 2.0 * pipe_.centrifugal * u;
  return made([&](const auto& of) -> PencilEntry {
    return {of(elastic) + pipe_.gamma * of(gravity) + of(rest) + thrust * of(flux),
            pipe_.hysteresis * of(elastic),
            u * of(velocity) + pipe_.damping * of(elastic) + of(resistance),
            of(mass),
            by_speed * of(flux),
            of(velocity)};
  });
}

PanelPencil::At PanelPencil::still() const {
  return made([&](const auto& of) -> PencilEntry {
    return {of(elastic) + pipe_.gamma * of(gravity) + of(rest),
            0.0,
            pipe_.centrifugal * of(flux),
            0.0,
            0.0,
            0.0};
  });
}

double PanelPencil::share_of(const LinearPart& of, int part) const {
  switch (part) {
    case mass:
      return of.mass;
    case velocity:
      return of.velocity;
    case flux:
      return of.flux;
    case gravity:
      return of.gravity + of.stiffness * pipe_.gamma;
    case elastic:
      return of.by_damping + of.stiffness + of.damping * pipe_.damping;
    case rest:
      return of.stiffness;
    default:
      return of.damping;
  }
}

template <class Visit>
void PanelPencil::along(const Matrix& x, double sign, const Visit& visit) const {
  using Row = Eigen::RowVectorXd;
  Row w = Row::Zero(x.cols()), theta = turns_ ? Row(x.row(0)) : w;
  Index first = turns_ ? 1 : 0;
  for (const Panel& panel : panels_) {
    const double h = panel.length;
    Matrix z(panel.size, x.cols()), place(2, x.cols());
    z.row(0) = w / h;
    z.row(1) = theta;
    z.bottomRows(panel.size - 2) = std::sqrt(h) * x.middleRows(first, panel.size - 2);
    place.row(0) = z.row(0) + z.row(1) + 0.5 * z.row(2);
    if (panel.size > 3) place.row(0) += sign * std::sqrt(3.0) / 6.0 * z.row(3);
    place.row(1) = z.row(1) + z.row(2);
    visit(panel, z, place);
    w = h * place.row(0);
    theta = place.row(1);
    first += panel.size - 2;
  }
}

Matrix PanelPencil::times(const Matrix& x, const LinearPart& of) const {
  using Row = Eigen::RowVectorXd;
  const Index columns = x.cols();
  Matrix out = Matrix::Zero(x.rows(), columns);
  std::vector<Matrix> rows;  // forces on each panel's functions, in its units
  std::vector<Matrix> at_ends;
  double shares[parts];
  for (int part = 0; part < parts; ++part) shares[part] = share_of(of, part);
  along(x, -1.0, [&](const Panel& panel, const Matrix& z, const Matrix& place) {
    Matrix forces = Matrix::Zero(panel.size, columns), loads = Matrix::Zero(2, columns);
    for (int part = 0; part < parts; ++part) {
      if (shares[part] == 0.0) continue;
      add_product(panel, part, shares[part], z, forces);
      loads += shares[part] * station(panel, part) * place;
    }
    rows.push_back(std::move(forces));
    at_ends.push_back(std::move(loads));
  });
  Index first = out.rows();
  Row force = Row::Zero(columns), moment = force;
  for (std::size_t p = panels_.size(); p-- > 0;) {
    const Panel& panel = panels_[p];
    const double h = panel.length, root = std::sqrt(h);
    const Matrix& own = rows[p];
    force += at_ends[p].row(0) / (h * h);
    moment += at_ends[p].row(1) / h;
    first -= panel.size - 2;
    out.middleRows(first, panel.size - 2) = own.bottomRows(panel.size - 2) / root;
    out.row(first) += 0.5 * h * root * force + root * moment;
    if (panel.size > 3) out.row(first + 1) -= std::sqrt(3.0) / 6.0 * h * root * force;
    moment += own.row(1) / h + h * force;
    force += own.row(0) / (h * h);
  }
  if (turns_) {
    out.row(0) = moment + (of.stiffness * pipe_.root) * x.row(0);
  }
  return out;
}

void PanelPencil::add_product(const Panel& panel, int part, double share, const Matrix& z,
                              Matrix& to) const {
  const Index wide = 2 * band_ + 1;
  for (Index i = 0; i < panel.size; ++i) {
    const Index low = std::max<Index>(0, i - band_), high = std::min(panel.size - 1, i + band_);
    for (Index j = low; j <= high; ++j) {
      const double entry = panel.bands[part][static_cast<std::size_t>(i * wide + j - i + band_)];
      if (entry != 0.0) to.row(i) += share * entry * z.row(j);
    }
  }
}

Works PanelPencil::works(double u, const Reals& frequencies, const Matrix& x) const {
  const Index count = x.cols() / 2;
  const auto both = [&](const Eigen::RowVectorXd& columns) -> Reals {
    return (columns.head(count) + columns.tail(count)).transpose().array();
  };
  const auto inner = [](const Matrix& a, const Matrix& b) -> Eigen::RowVectorXd {
    return a.cwiseProduct(b).colwise().sum();
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
  std::vector<Matrix> bounds;  // sums of absolute terms of each end's displacement and slope
  along(x.cwiseAbs(), 1.0,
        [&](const Panel&, const Matrix&, const Matrix& place) { bounds.push_back(place); });
  const double flow = pipe_.direction() * pipe_.sqrt_beta() - pipe_.entry();
  const double thrust = pipe_.centrifugal * u * u * std::cos(pipe_.jet_angle);
  const double lost_term = 4.0 * eps * std::sqrt(static_cast<double>(size_));
  const Reals omega = frequencies.abs();
  Works sum(count);
  std::size_t p = 0;
  along(x, -1.0, [&](const Panel& panel, const Matrix& z, const Matrix& place) {
    const auto product = [&](int part) {
      Matrix found = Matrix::Zero(panel.size, x.cols());
      add_product(panel, part, 1.0, z, found);
      return found;
    };
    const double share = 1.0 / panel.length;
    const Matrix& bound = bounds[p];
    sum.mass += share * both(inner(z, product(mass)) + inner(place, station(panel, mass) * place));
    sum.gyroscopic += share * u * skew(z, product(velocity));
    const Reals strained = share * both(inner(z, product(elastic)));
    const Reals resisted = share * both(inner(z, product(resistance)) +
                                        inner(place, station(panel, resistance) * place));
    sum.resisted += pipe_.damping * strained + resisted;
    sum.circulated += pipe_.hysteresis * strained;
    sum.lost += lost_term *
                (omega * (pipe_.damping * strained + resisted.abs()) + pipe_.hysteresis * strained);
    // Work of follower loads comes from the skew part of the stiffness of a station.
    const bool last = ++p == panels_.size();
    const double following = panel.station[Part::rest][0][1] - panel.station[Part::rest][1][0];
    const double h = panel.length, skewed = following + (last ? thrust * h * h : 0.0);
    const double moved = last ? u * flow * h * h * h : 0.0;
    const Reals w = size(place.row(0)), theta = size(place.row(1));
    const Reals lost_w = lost_term * size(bound.row(0)),
                lost_theta = lost_term * size(bound.row(1));
    if (panel.held) return;
    sum.resisted += share * moved * w.square();
    sum.lost += share * std::abs(moved) * omega * (2.0 * w + lost_w) * lost_w;
    if (panel.directed) return;
    sum.circulated += share * skewed * skew(place.row(0), place.row(1));
    sum.lost += share * std::abs(skewed) * ((theta + lost_theta) * lost_w + w * lost_theta);
  });
  return sum;
}

Matrix PanelPencil::held() const {
  Matrix rows(conditions(), size_);
  Index next = 0;
  const Index columns = rows.rows() > 0 ? size_ : 0;
  along(Matrix::Identity(size_, columns), -1.0,
        [&](const Panel& panel, const Matrix&, const Matrix& place) {
          if (panel.held) rows.row(next++) = panel.length * place.row(0);
          if (panel.directed) rows.row(next++) = place.row(1);
        });
  return rows;
}

}  // namespace pipedyn
