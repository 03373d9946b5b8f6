// SPDX-License-Identifier: MIT
#include "pipedyn/linear/tracking.hpp"

#include <algorithm>
#include <cmath>

namespace pipedyn {

namespace {

/// Roots of modes that need not be tracked are not worth refining with Re < -0.3 |lambda|: with 16
/// Legendre functions they have 0.56 or more at damping 1e-3, without damping 0.03 at most.
constexpr double heavy_damping = 0.3;

/// Column of each row so that the sum of their costs, (size, size), is least: rows are added one by
/// one, each along the shortest augmenting path by reduced costs (the Hungarian method).
Roots assignment(const std::vector<double>& cost, Root size) {
  // Column `size` stands for the row that is being added.
  Roots row_of(size + 1, -1), before(size + 1), columns(size);
  std::vector<double> by_row(size, 0.0), by_column(size + 1, 0.0), distance(size);
  for (Root added = 0; added < size; ++added) {
    Flags reached(size + 1, 0);
    std::fill(distance.begin(), distance.end(), infinite);
    Root column = size;
    row_of[size] = added;
    while (row_of[column] >= 0) {
      reached[column] = 1;
      const Root row = row_of[column];
      double least = infinite;
      Root next = 0;
      for (Root j = 0; j < size; ++j) {
        if (reached[j]) continue;
        const double reduced = cost[row * size + j] - by_row[row] - by_column[j];
        if (reduced < distance[j]) {
          distance[j] = reduced;
          before[j] = column;
        }
        if (distance[j] < least) {
          least = distance[j];
          next = j;
        }
      }
      for (Root j = 0; j <= size; ++j) {
        if (reached[j]) {
          by_row[row_of[j]] += least;
          by_column[j] -= least;
        } else {
          distance[j] -= least;
        }
      }
      column = next;
    }
    for (; column != size; column = before[column]) row_of[column] = row_of[before[column]];
  }
  for (Root j = 0; j < size; ++j) columns[row_of[j]] = j;
  return columns;
}

/// A step from `left` to `right` of which the match is being found.
struct Matching {
  const Sample &left, &right;
  Match& found;
  double length;

  Complex start(Root i) const { return left.values[i]; }
  Complex end(Root i) const { return right.values[found.onto[i]]; }
  Complex start_slope(Root i) const { return found.slopes[i]; }
  Complex end_slope(Root i) const { return right.slopes[found.onto[i]]; }

  /// The cubic of a root at a fraction of the step.
  Complex at(Root i, double t) const {
    const double s = 1.0 - t;
    return start(i) * ((1.0 + 2.0 * t) * s * s) + end(i) * ((3.0 - 2.0 * t) * t * t) +
           length * (start_slope(i) * (t * s * s) - end_slope(i) * (t * t * s));
  }

  /// Whether two roots are one conjugate pair that turns real, or two reals that pair up: their sum
  /// and product run smoothly through the meeting, where slopes are infinite.
  bool meet(Root i, Root k) const {
    const auto conjugate = [](Complex a, Complex b) {
      return a.imag() != 0.0 && a == std::conj(b);
    };
    const auto real = [](Complex a, Complex b) { return a.imag() == 0.0 && b.imag() == 0.0; };
    const Complex a = start(i), b = start(k), c = end(i), d = end(k);
    const bool before = conjugate(a, b), after = conjugate(c, d);
    if (!(before && after) && !(before && real(c, d)) && !(real(a, b) && after)) return false;
    const Complex da = start_slope(i), db = start_slope(k), dc = end_slope(i), dd = end_slope(k);
    const Complex sum = (a + b) - (c + d) + 0.5 * length * (da + db + dc + dd);
    const Complex product = a * b - c * d + 0.5 * length * (da * b + a * db + dc * d + c * dd);
    const Complex centre = 0.5 * (a + b);
    double room = left.size > 2 ? infinite : std::max(std::abs(centre), 1.0);
    for (Root j = 0; j < left.size; ++j) {
      if (j != i && j != k) room = std::min(room, std::abs(start(j) - centre));
    }
    return std::abs(sum) < 0.02 * room && std::abs(product) < 0.02 * room * room;
  }

  /// Which is which after a meeting is a convention: upper to upper, upper to the greater real.
  void order(Root i, Root k) const {
    const auto above = [](Complex a, Complex b) {
      return std::tuple(a.imag(), a.real()) > std::tuple(b.imag(), b.real());
    };
    if (above(start(i), start(k)) != above(end(i), end(k))) {
      std::swap(found.onto[i], found.onto[k]);
    }
  }
};

/// Whether Re lambda of a root has a sign.
bool has_sign(const Sample& at, Root i, double zero) {
  return at.signatures[i] != 0 ||  // on the axis of a conservative system, where it stays
         (std::abs(at.values[i].real()) > at.noise[i] && std::abs(at.values[i]) >= zero);
}

/// a + b t + c t^2 + d t^3.
struct Cubic {
  double a, b, c, d;

  double operator()(double t) const { return a + t * (b + t * (c + t * d)); }

  /// Where it is zero between low and high, of opposite signs there.
  double zero(double low, double high) const {
    const bool rising = (*this)(high) > 0.0;
    while (high - low > 1e-15) {
      const double middle = 0.5 * (low + high);
      (((*this)(middle) > 0.0) == rising ? high : low) = middle;
    }
    return high;
  }
};

}  // namespace

Match match(const Sample& left, const Sample& right, const Roots& tracked, const Cluster& cluster) {
  const Root size = left.size, square = std::max(size, right.size);
  const double h = right.u - left.u;
  Match found{Roots(size, -1), std::vector<double>(size, infinite), Roots(size, -1),
              std::vector<Complex>(left.slopes, left.slopes + size), false};
  const Matching step{left, right, found, h};
  std::vector<double> misfit(square * square, 0.0), cost(square * square, 0.0);
  for (Root i = 0; i < size; ++i) {
    const Complex ahead = left.values[i] + 0.5 * h * left.slopes[i];
    for (Root j = 0; j < right.size; ++j) {
      const Complex behind = right.values[j] - 0.5 * h * right.slopes[j];
      const Root at = i * square + j;
      misfit[at] = std::abs(ahead - behind);
      // Values within the step's reach settle what slopes near a meeting cannot.
      cost[at] = std::min(misfit[at], std::abs(left.values[i] - right.values[j]));
    }
  }
  const Roots columns = assignment(cost, square);
  Flags resting(size, 0);
  Roots matched;
  for (Root i = 0; i < size; ++i) {
    if (columns[i] >= right.size) continue;
    matched.push_back(i);
    found.onto[i] = columns[i];
    found.error[i] = misfit[i * square + columns[i]];
    resting[i] = left.u == 0.0 && left.values[i] == 0.0;
    if (!resting[i]) continue;
    // Zero roots at rest (free joints) have no slope of their own there, and one serves as well as
    // another: lambda leaves like u, lambda^2 like u^2.
    const Complex there = step.end(i), change = h * step.end_slope(i);
    const double linear = 0.5 * std::abs(there - change), root = std::abs(there - 0.5 * change);
    found.slopes[i] = linear < root ? there / h : 0.0;
    found.error[i] = std::min(linear, root);
  }
  for (const Root i : tracked) {
    if (found.onto[i] < 0) return found;
  }

  constexpr int points = 9;
  std::vector<Complex> curves(size * points);
  for (const Root i : matched) {
    for (int k = 0; k < points; ++k) curves[i * points + k] = step.at(i, k / (points - 1.0));
  }
  Flags zero(size), clustered(size);
  std::vector<int> signature(size);
  for (const Root i : matched) {
    const Complex a = step.start(i), b = step.end(i);
    zero[i] = std::abs(a) < cluster.zero && std::abs(b) < cluster.zero;
    clustered[i] = std::abs(cluster.damping * a + 1.0) < cluster.radius &&
                   std::abs(cluster.damping * b + 1.0) < cluster.radius;
    const int before = left.signatures[i], after = right.signatures[found.onto[i]];
    signature[i] = before != 0 && after != 0 ? 3 * before + after : 0;
  }
  std::vector<std::pair<Root, Root>> near;
  for (const Root i : tracked) {
    for (const Root k : matched) {
      // Two of one signature at either end pass through each other on the axis.
      const bool passing = signature[i] != 0 && signature[i] == signature[k];
      if (i == k || passing || (zero[i] && zero[k]) || (clustered[i] && clustered[k])) continue;
      const double reach = 3.0 * (found.error[i] + found.error[k]);
      for (int p = resting[i] && resting[k] ? 1 : 0; p < points; ++p) {
        if (std::norm(curves[i * points + p] - curves[k * points + p]) >= reach * reach) continue;
        near.emplace_back(i, k);
        break;
      }
    }
  }
  for (const auto& [i, k] : near) {
    if (found.meets[i] >= 0 || found.meets[k] >= 0 || !step.meet(i, k)) continue;
    found.meets[i] = k;
    found.meets[k] = i;
    step.order(i, k);
  }
  found.unambiguous = std::all_of(near.begin(), near.end(), [&](const auto& pair) {
    return found.meets[pair.first] >= 0 || found.meets[pair.second] >= 0;
  });
  return found;
}

Flags unstable(const Sample& at, const Roots& onto, const Flags& before, double zero) {
  const Root size = static_cast<Root>(onto.size());
  Flags result = before;
  for (Root i = 0; i < size; ++i) {
    if (onto[i] < 0) continue;
    const Complex value = at.values[onto[i]];
    if (has_sign(at, onto[i], zero)) {
      result[i] = value.real() > 0.0;
      continue;
    }
    for (Root k = 0; k < size; ++k) {  // a pair has one state
      if (value.imag() == 0.0 || onto[k] < 0) continue;
      const Complex other = at.values[onto[k]];
      if (other == value || other == std::conj(value)) result[i] |= before[k];
    }
  }
  return result;
}

Scan scan(const Step& step, const Search& search) {
  const Sample &left = step.left, &right = step.right;
  const double h = right.u - left.u;
  Scan result;
  result.after = unstable(right, step.onto, step.unstable, search.zero);
  result.leaving.assign(left.size, 0);
  for (Root i = 0; i < left.size; ++i) {
    const Root j = step.onto[i];
    if (step.modes[i] < 1 || step.modes[i] > search.resolved || j < 0) continue;
    const Complex start = left.values[i], end = right.values[j];
    const auto heavily_damped = [](Complex value) {
      return value.real() < -heavy_damping * std::abs(value);
    };
    if ((start == 0.0 ? end : start).imag() < 0.0) continue;
    if (step.modes[i] > search.certain && heavily_damped(start) && heavily_damped(end)) continue;
    result.roots.push_back(i);
    if (step.meets[i] >= 0) continue;

    const double a = start.real(), b = end.real();
    double slope = left.slopes[i].real() * h, end_slope = right.slopes[j].real() * h;
    double noise = std::max(left.noise[i], right.noise[j]);
    if (left.u == 0.0) {
      const double lost = std::max(right.noise[j], left.slope_noise[i] * h);
      const bool on_axis = std::abs(a) <= left.noise[i] && !search.conservative;
      result.leaving[i] =
          start == 0.0 ? has_sign(right, j, search.zero) && b > 0.0 : on_axis && slope > lost;
    }
    if (start == 0.0) noise = infinite;
    // Slopes within their rounding say nothing, at any length: the line through both ends does.
    const bool hidden = std::abs(left.slopes[i].real()) < left.slope_noise[i] ||
                        std::abs(right.slopes[j].real()) < right.slope_noise[j];
    if (hidden) slope = end_slope = b - a;
    const Cubic cubic{a, slope, 3.0 * (b - a) - 2.0 * slope - end_slope,
                      2.0 * (a - b) + slope + end_slope};
    // The real part's own error; a little of the imaginary part's keeps it from being 0.
    double band = 2.0 * std::abs(b - a - 0.5 * (slope + end_slope)) + 1e-4 * step.error[i];
    // Of a conservative system tracking shows where two roots meet and leave the axis.
    const double largest =
        std::max({std::abs(a), std::abs(b), std::abs(slope), std::abs(end_slope)});
    if (hidden || (search.conservative && largest <= noise)) band = 0.0;

    struct Point {
      double at;
      bool positive;
    };
    std::vector<Point> points;
    const double turns = cubic.c * cubic.c - 3.0 * cubic.b * cubic.d;
    const double far = cubic.c + std::copysign(std::sqrt(std::max(turns, 0.0)), cubic.c);
    for (const double t : {-cubic.b / far, -far / (3.0 * cubic.d)}) {
      if (!(turns > 0.0 && t > 0.0 && t < 1.0)) continue;
      const double extremum = cubic(t);
      if (std::abs(extremum) <= band + noise && band > noise) result.clear = false;
      if (std::abs(extremum) > noise) points.push_back({t, extremum > 0.0});
    }
    std::sort(points.begin(), points.end(), [](Point p, Point q) { return p.at < q.at; });
    points.push_back({1.0, result.after[i] != 0});
    bool positive = step.unstable[i] || result.leaving[i];
    double last = 0.0;
    for (const Point& point : points) {
      if (point.positive != positive) {
        const double low = cubic(last), high = cubic(point.at);
        // Without a change of sign one end lies in the noise.
        const double nearer = std::abs(low) < std::abs(high) ? last : point.at;
        const double at = low * high < 0.0 ? cubic.zero(last, point.at) : nearer;
        result.crossings.emplace_back(i, at, point.positive);
      }
      positive = point.positive;
      last = point.at;
    }
  }
  if (!result.clear) result.crossings.clear();
  return result;
}

}  // namespace pipedyn
