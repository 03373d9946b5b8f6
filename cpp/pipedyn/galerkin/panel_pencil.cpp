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

/// A polynomial on a panel, given by its coefficients of the orthonormal p_i in (s - a) / h.
using Polynomial = std::vector<double>;

/// The polynomial of a profile on a panel, which lies in one stretch of the profile.
Polynomial polynomial_of(const Profile& profile, double low, double length) {
  if (!profile.varies()) return {1.0};
  const Quadrature rule(profile.degree(0.0) + 1);
  const Matrix values = legendre_values(rule.node, rule.size());
  Polynomial found(static_cast<std::size_t>(rule.size()), 0.0);
  double largest = 0.0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    const Index k = static_cast<Index>(i);
    for (Index p = 0; p < rule.size(); ++p) {
      found[i] += rule.weight[p] * profile(low + length * rule.node[p]) * values(p, k);
    }
    found[i] *= std::sqrt(2.0 * static_cast<double>(k) + 1.0);
    largest = std::max(largest, std::abs(found[i]));
  }
  while (found.size() > 1 && std::abs(found.back()) < 1e-16 * largest) found.pop_back();
  return found;
}

/// The integral of p_j from 0 as a series, `lower` p_{j-1} + `upper` p_{j+1}; for j = 0, `lower`
/// belongs to p_0.
struct Integral {
  double lower, upper;

  explicit Integral(Index j) {
    const auto root = [](Index k) { return std::sqrt(2.0 * static_cast<double>(k) + 1.0); };
    const double half = 0.5 / root(j);
    upper = half / root(j + 1);
    lower = j == 0 ? half : -half / root(j - 1);
  }
};

/// The integral of a polynomial from each place to 1.
Polynomial beyond(const Polynomial& f) {
  Polynomial found(f.size() + 1, 0.0);
  for (std::size_t j = 0; j < f.size(); ++j) {
    const Integral by(static_cast<Index>(j));
    found[j + 1] -= f[j] * by.upper;
    found[j == 0 ? 0 : j - 1] -= f[j] * by.lower;
  }
  found[0] += f[0];
  return found;
}

/// Series of p_i for the shape, slope or curvature of function j: the coefficients of p_{j-4} ..
/// p_j; those of polynomials that do not exist are 0.
constexpr Index reach = 4;
using Series = std::array<double, reach + 1>;

struct Functions {
  std::vector<Series> shape, slope, curvature;

  explicit Functions(Index size)
      : shape(size, Series{}), slope(size, Series{}), curvature(size, Series{}) {
    const auto integrate = [](const Series& of, Index j, Series& to) {
      for (Index t = 0; t <= reach; ++t) {
        const Index i = j - reach + t;
        if (i < 0 || of[t] == 0.0) continue;
        const Integral by(i);
        to[t + 1] += of[t] * by.upper;
        to[i == 0 ? t : t - 1] += of[t] * by.lower;
      }
    };
    shape[0][reach] = 1.0;
    if (size > 1) {
      slope[1][reach - 1] = 1.0;
      integrate(slope[1], 1, shape[1]);
    }
    for (Index j = 2; j < size; ++j) {
      curvature[j][reach - 2] = 1.0;
      integrate(curvature[j], j, slope[j]);
      integrate(slope[j], j, shape[j]);
    }
  }
};

/// A banded matrix with the entries (i, i - half .. i + half) of each row.
struct Band {
  Index size, half;
  std::vector<double> entries;

  Band(Index rows, Index width)
      : size(rows), half(width), entries(static_cast<std::size_t>(rows * (2 * width + 1)), 0.0) {}
  double& operator()(Index i, Index j) {
    return entries[static_cast<std::size_t>(i * (2 * half + 1) + j - i + half)];
  }
  double at(Index i, Index j) const {
    if (j < 0 || j >= size || std::abs(i - j) > half) return 0.0;
    return entries[static_cast<std::size_t>(i * (2 * half + 1) + j - i + half)];
  }
};

/// f(X), of which the first `rows` rows are exact, by the recurrence of p_i(X). The matrix has as
/// many rows more as the degree of f, so that the truncation of X does not reach the first rows.
Band multiplication(const Polynomial& f, Index rows) {
  const Index degree = static_cast<Index>(f.size()) - 1, size = rows + degree;
  const auto next_to = [](Index i) {  // X_{i, i + 1}
    const double k = static_cast<double>(i) + 1.0;
    return k / std::sqrt(4.0 * k * k - 1.0);
  };
  Band sum(size, degree), before(size, degree), one(size, degree);
  for (Index i = 0; i < size; ++i) one(i, i) = 1.0;
  for (Index k = 0;; ++k) {
    for (std::size_t e = 0; e < sum.entries.size(); ++e) {
      sum.entries[e] += f[static_cast<std::size_t>(k)] * one.entries[e];
    }
    if (k == degree) return sum;
    Band next(size, degree);  // X p_k = next_to(k) p_{k+1} + next_to(k - 1) p_{k-1}
    for (Index i = 0; i < size; ++i) {
      const Index low = std::max<Index>(0, i - k - 1), high = std::min(size - 1, i + k + 1);
      for (Index j = low; j <= high; ++j) {
        double value = i + 1 < size ? next_to(i) * one.at(i + 1, j) : 0.0;
        if (i > 0) value += next_to(i - 1) * one.at(i - 1, j);
        if (k > 0) value -= next_to(k - 1) * before.at(i, j);
        next(i, j) = value / next_to(k);
      }
    }
    before = std::move(one);
    one = std::move(next);
  }
}

/// Adds share times the integrals of left_i f right_j to a band of half-bandwidth `half`.
void add_integrals(const std::vector<Series>& left, const Polynomial& f,
                   const std::vector<Series>& right, double share, Index half,
                   std::vector<double>& to) {
  const Index size = static_cast<Index>(left.size());
  const bool constant = f.size() == 1;
  const Band by = constant ? Band(0, 0) : multiplication(f, size);
  for (Index i = 0; i < size; ++i) {
    const Index low = std::max<Index>(0, i - half), high = std::min(size - 1, i + half);
    for (Index j = low; j <= high; ++j) {
      double sum = 0.0;
      for (Index t = 0; t <= reach; ++t) {
        const Index k = i - reach + t;
        if (left[i][t] == 0.0) continue;
        if (constant) {
          const Index other = k - j + reach;
          if (other >= 0 && other <= reach) sum += left[i][t] * right[j][other];
          continue;
        }
        for (Index s = 0; s <= reach; ++s) {
          if (right[j][s] != 0.0) sum += left[i][t] * by.at(k, j - reach + s) * right[j][s];
        }
      }
      to[static_cast<std::size_t>(i * (2 * half + 1) + j - i + half)] +=
          share * (constant ? f[0] : 1.0) * sum;
    }
  }
}

constexpr double eps = std::numeric_limits<double>::epsilon();

using Reals = Eigen::ArrayXd;

/// Whether s is the end of a panel. Exact comparison is right here: the ends are numbers of the
/// basis, and so are the places of terms.
bool is_end(const Vector& ends, double s) { return (ends.array() == s).any(); }

Index degree_of(const Polynomial& f) { return static_cast<Index>(f.size()) - 1; }

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
  std::vector<Polynomial> masses, stiffnesses, weights;
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
  for (Index p = 0; p < count; ++p) {
    const double low = ends[p], length = ends[p + 1] - low;
    Polynomial mass_here = polynomial_of(pipe.mass, low, length);
    mass_here[0] += mass_along;
    masses.push_back(mass_here);
    stiffnesses.push_back(polynomial_of(pipe.stiffness, low, length));
    // The polynomial of the tension from weight is of one degree more, but slopes have only half
    // the reach.
    band_ = std::max({band_, reach + degree_of(mass_here), degree_of(stiffnesses.back())});
  }
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
    const Functions functions(panel.size);
    const auto& [shape, slope, curvature] = functions;
    for (auto& band : panel.bands) {
      band.assign(static_cast<std::size_t>(panel.size * (2 * band_ + 1)), 0.0);
    }
    const auto add = [&](Part part, const auto& left, const Polynomial& f, const auto& right,
                         double share) {
      if (share != 0.0) add_integrals(left, f, right, share, band_, panel.bands[part]);
    };
    const double h2 = h * h, h3 = h * h2, h4 = h2 * h2;
    const Polynomial& mass_here = masses[static_cast<std::size_t>(p)];
    Polynomial moved = mass_here;
    moved[0] += normal_along;
    add(mass, shape, moved, shape, h4);
    add(mass, slope, {1.0}, slope, pipe.rotary_inertia * h2);
    add(velocity, shape, {1.0}, slope, 2.0 * flow * h3);
    add(flux, shape, {1.0}, curvature, jet * h2);
    add(elastic, curvature, stiffnesses[static_cast<std::size_t>(p)], curvature, 1.0);
    add(Part::rest, slope, {1.0}, slope, pulled * h2);
    const std::vector<Series>* const moves[] = {&shape, &slope};
    for (const int i : {0, 1}) {
      for (const int j : {0, 1}) {
        const double* const by = along.by[small_rows[i]];
        const double share = i + j == 0 ? h4 : i + j == 1 ? h3 : h2;
        add(Part::rest, *moves[i], {1.0}, *moves[j], -by[small_still[j]] * share);
        add(resistance, *moves[i], {1.0}, *moves[j], -by[small_moving[j]] * share);
      }
    }
    Polynomial weight = beyond(mass_here);
    for (double& one : weight) one *= h;
    weight[0] += carried;
    add(gravity, slope, weight, slope, h2);
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
  std::vector<Vector> found;
  Vector w = Vector::Zero(size_), theta = w;
  Index first = 0;
  if (turns_) theta[first++] = 1.0;
  for (const Panel& panel : panels_) {
    const double h = panel.length, root = std::sqrt(h);
    w += h * theta;
    w[first] += 0.5 * h * root;
    if (panel.size > 3) w[first + 1] -= std::sqrt(3.0) / 6.0 * h * root;
    theta[first] += root;
    first += panel.size - 2;
    if (panel.held) found.push_back(w);
    if (panel.directed) found.push_back(theta);
  }
  Matrix rows(static_cast<Index>(found.size()), size_);
  for (std::size_t k = 0; k < found.size(); ++k) rows.row(static_cast<Index>(k)) = found[k];
  return rows;
}

}  // namespace pipedyn
