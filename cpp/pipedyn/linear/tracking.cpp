// SPDX-License-Identifier: MIT
#include "pipedyn/linear/tracking.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <tuple>

namespace pipedyn {

Roots assignment(const std::vector<double>& cost, Index size) {
  // Column `size` represents the row that is being added.
  Roots row_of(size + 1, -1), before(size + 1), columns(size);
  std::vector<double> by_row(size, 0.0), by_column(size + 1, 0.0), distance(size);
  Roots open;
  for (Index row = 0; row < size; ++row) {
    Index column = 0;
    by_row[row] = Eigen::Map<const Reals>(&cost[row * size], size).minCoeff(&column);
    if (row_of[column] < 0) {
      row_of[column] = row;
    } else {
      open.push_back(row);
    }
  }
  for (const Index added : open) {
    Flags reached(size + 1, 0);
    std::fill(distance.begin(), distance.end(), infinite);
    Index column = size;
    row_of[size] = added;
    while (row_of[column] >= 0) {
      reached[column] = 1;
      const Index row = row_of[column];
      double least = infinite;
      Index next = 0;
      for (Index j = 0; j < size; ++j) {
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
      for (Index j = 0; j <= size; ++j) {
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
  for (Index j = 0; j < size; ++j) columns[row_of[j]] = j;
  return columns;
}

namespace {

/// Number of steps tried, besides four times those of the sweep, before roots are given up as too
/// close: the 36 pipes of 10 segments up to u = 20 take up to 2.7 times the steps of the sweep, and
/// 80 meetings take 19 halvings each.
constexpr int most_steps = 1600;

/// Ratio of the next step tried to the last one, after a step that was too long: roots are found
/// fast from near by, but from far away by matrices.
constexpr double step_growth = 4.0;
/// Least share of the longest step that is tried: the shortest steps are matched as they are.
constexpr double least_share = 1.0 / 16.0;

/// Curves are told apart if their distance is at least this many times the sum of their errors. For
/// 1,500 random pipes the modes of the crossings differed from those of steps of 0.05 in 26 pipes.
constexpr double errors_apart = 3.0;

/// A root that moves by more than this share of 1 + |lambda| in a shortest step is another root: at
/// a meeting each root moves by 1e-3.
constexpr double jump = 0.1;

/// Whether two roots are a conjugate pair that turns real, or two real roots that become a pair:
/// their sum and product are smooth through the meeting, where slopes are infinite.
bool meet(const Step& step, Index i, Index k) {
  const auto conjugate = [](Complex a, Complex b) { return a.imag() != 0.0 && a == std::conj(b); };
  const auto real = [](Complex a, Complex b) { return a.imag() == 0.0 && b.imag() == 0.0; };
  const Complex a = step.start(i), b = step.start(k), c = step.end(i), d = step.end(k);
  const bool before = conjugate(a, b), after = conjugate(c, d);
  if (!(before && after) && !(before && real(c, d)) && !(real(a, b) && after)) return false;
  const Complex da = step.start_slope(i), db = step.start_slope(k), dc = step.end_slope(i),
                dd = step.end_slope(k);
  const Complex sum = (a + b) - (c + d) + 0.5 * step.length() * (da + db + dc + dd);
  const Complex product = a * b - c * d + 0.5 * step.length() * (da * b + a * db + dc * d + c * dd);
  const Complex centre = 0.5 * (a + b);
  double room = step.left->size() > 2 ? infinite : std::max(std::abs(centre), 1.0);
  for (Index j = 0; j < step.left->size(); ++j) {
    if (j != i && j != k) room = std::min(room, magnitude(step.start(j) - centre));
  }
  return std::abs(sum) < 0.02 * room && std::abs(product) < 0.02 * room * room;
}

/// Whether the first of two roots is the upper one, or the greater one if they are real.
bool is_above(Complex a, Complex b) {
  return std::tuple(a.imag(), a.real()) > std::tuple(b.imag(), b.real());
}

/// Orders two roots after a meeting by a convention: the upper root continues as the upper one, or
/// as the greater real one.
void order(Step& step, Index i, Index k) {
  if (is_above(step.start(i), step.start(k)) != is_above(step.end(i), step.end(k))) {
    std::swap(step.onto[i], step.onto[k]);
  }
}

/// Index of the conjugate of a root that comes next to it in its sample, or of a real root itself;
/// -1 where the root next to it is another one.
Index mirrored(const Sample& at, Index i) {
  const Complex value = at.values[i];
  const Index k = value.imag() > 0.0 ? i + 1 : value.imag() < 0.0 ? i - 1 : i;
  if (k < 0 || k >= at.size() || at.values[k] != std::conj(value)) return -1;
  return k == i || at.slopes[k] == std::conj(at.slopes[i]) ? k : -1;
}

/// Curve of a root of the left sample.
struct Curve {
  Complex start, end, tangent, end_tangent;  // the tangents times the length of the step
  double error = 0.0, extent = 0.0;          // others within this extent of its start may be near
  int signature = 0;                         // of both ends; 0 where either has none
  bool resting = false, zero = false, clustered = false;
  double size = 0.0;    // |start|
  double lowest = 0.0;  // least size - extent of this curve and of all later ones
};

/// Memory in which `match` works, the same for all steps.
struct Work {
  Eigen::ArrayX4d there;
  Reals squares;
  Flags taken, is_image;
  std::vector<Curve> curves;
  std::vector<std::pair<Index, Index>> near;
};

/// Root of the right sample that continues each root of the left one, so that the sum of distances
/// is least. Throws NotConverged unless both have as many roots.
void find_nearest(const Sample& left, const Sample& right, double h, Work& work, Roots& nearest) {
  const Index size = left.size();
  if (right.size() != size) {
    throw not_converged("the number of eigenvalues near u = %.6g depends on rounding", right.u);
  }
  Eigen::ArrayX4d& there = work.there;
  Reals& squares = work.squares;
  Flags& taken = work.taken;
  there.resize(size, 4);  // real and imaginary parts of values, and as slopes lead back
  for (Index j = 0; j < size; ++j) {
    const Complex value = right.values[j], behind = value - 0.5 * h * right.slopes[j];
    there.row(j) << value.real(), value.imag(), behind.real(), behind.imag();
  }
  squares.resize(size);
  const auto find_squares = [&](Index i) {  // of the distances of a root of the left sample
    const Complex now = left.values[i], ahead = now + 0.5 * h * left.slopes[i];
    // Values within the reach of the step decide where slopes near a meeting cannot.
    squares =
        ((there.col(0) - now.real()).square() + (there.col(1) - now.imag()).square())
            .min((there.col(2) - ahead.real()).square() + (there.col(3) - ahead.imag()).square());
  };
  nearest.assign(size, 0);
  taken.assign(size, 0);
  bool conflict = false;  // whether one root is the nearest to two
  for (Index i = 0; i < size; ++i) {
    const bool is_lower = left.values[i].imag() < 0.0 && mirrored(left, i) >= 0;
    // The distances of a conjugate are those of its twin.
    nearest[i] = is_lower ? mirrored(right, nearest[i - 1]) : -1;
    if (nearest[i] < 0) {
      find_squares(i);
      squares.minCoeff(&nearest[i]);
    }
    conflict |= std::exchange(taken[nearest[i]], 1) != 0;
  }
  if (!conflict) return;
  std::vector<double> cost(size * size);
  for (Index i = 0; i < size; ++i) {
    find_squares(i);
    Eigen::Map<Reals>(&cost[i * size], size) = squares.sqrt();
  }
  nearest = assignment(cost, size);
}

/// Value at t in [0, 1] of the cubic that has two values and changes by its tangents at the ends.
Complex cubic(Complex start, Complex tangent, Complex end, Complex end_tangent, double t) {
  const double s = 1.0 - t;
  return start * ((1.0 + 2.0 * t) * s * s) + end * ((3.0 - 2.0 * t) * t * t) +
         (tangent * (t * s * s) - end_tangent * (t * t * s));
}

/// The curve of the conjugate of a root.
Curve image_of(const Curve& one) {
  Curve image = one;
  for (Complex Curve::* const of :
       {&Curve::start, &Curve::end, &Curve::tangent, &Curve::end_tangent}) {
    image.*of = std::conj(one.*of);
  }
  image.signature = -one.signature;
  return image;
}

/// Whether two curves need not be told apart.
bool is_exempt(const Curve& one, const Curve& other) {
  // Two roots of one signature at either end pass through each other on the axis.
  const bool passing = one.signature != 0 && one.signature == other.signature;
  return passing || (one.zero && other.zero) || (one.clustered && other.clustered);
}

/// Whether two roots of opposite signatures met: these leave the axis there. They have met, and may
/// have come back to the axis, if either has taken the place or the signature of the other. They
/// may also have met though each keeps its place: if the tangents at the start lead them together
/// within the step, and the tangents at the end, followed back, do so too.
bool have_met(const Curve& one, const Curve& other) {
  if (one.signature * other.signature >= 0) return false;
  if (!(one.start.imag() * other.start.imag() > 0.0)) return false;
  const double before = (one.start - other.start).imag(), after = (one.end - other.end).imag();
  const double closing = (other.tangent - one.tangent).imag() / before;
  const double opening = (one.end_tangent - other.end_tangent).imag() / after;
  return std::abs(one.signature) == 2 || before * after < 0.0 || std::min(closing, opening) > 1.0;
}

/// Whether two curves meet or pass so near each other that their errors hide which is which.
bool is_near(const Curve& one, const Curve& other) {
  if (have_met(one, other)) return true;
  if (is_exempt(one, other)) return false;
  const Complex start = one.start - other.start, end = one.end - other.end;
  const Complex tangent = one.tangent - other.tangent;
  const Complex end_tangent = one.end_tangent - other.end_tangent;
  const double reach = errors_apart * (one.error + other.error);
  // A cubic lies within the hull of its control points.
  const auto along = [=](Complex z) { return z.real() * start.real() + z.imag() * start.imag(); };
  const double least = std::min(
      {along(start), along(start + tangent / 3.0), along(end), along(end - end_tangent / 3.0)});
  if (least > 0.0 && least * least > reach * reach * std::norm(start)) return false;
  constexpr int points = 9;
  for (int p = one.resting && other.resting ? 1 : 0; p < points; ++p) {
    const Complex apart = cubic(start, tangent, end, end_tangent, p / (points - 1.0));
    if (std::norm(apart) < reach * reach) return true;
  }
  return false;
}

/// The curve of a root in a step; sets its slope and its error in the step.
Curve curve_of(Step& step, Index i, const Cluster& cluster) {
  const double h = step.length();
  Curve curve{.start = step.start(i),
              .end = step.end(i),
              .tangent = h * step.start_slope(i),
              .end_tangent = h * step.end_slope(i)};
  curve.error = magnitude(curve.end - curve.start - 0.5 * (curve.end_tangent + curve.tangent));
  curve.resting = step.left->u == 0.0 && curve.start == 0.0;
  if (curve.resting) {
    // Roots that are zero at rest (free joints) have no slope of their own there, and any of them
    // may continue as any other: lambda grows like u, or lambda^2 like u^2.
    const double linear = 0.5 * std::abs(curve.end - curve.end_tangent);
    const double root = std::abs(curve.end - 0.5 * curve.end_tangent);
    curve.tangent = linear < root ? curve.end : 0.0;
    curve.error = std::min(linear, root);
    step.slopes[i] = curve.tangent / h;
  }
  step.error[i] = curve.error;
  // A cubic stays within its control points.
  const Complex change = curve.end - curve.start;
  const double furthest =
      std::max({std::norm(curve.tangent / 3.0), std::norm(change - curve.end_tangent / 3.0),
                std::norm(change)});
  curve.extent = std::sqrt(furthest) + errors_apart * curve.error;
  curve.size = magnitude(curve.start);
  curve.zero = curve.size < cluster.zero && magnitude(curve.end) < cluster.zero;
  curve.clustered = cluster.holds(curve.start) && cluster.holds(curve.end);
  const double before = step.left->signatures[i], after = step.right->signatures[step.onto[i]];
  curve.signature = before != 0.0 && after != 0.0 ? static_cast<int>(3.0 * before + after) : 0;
  // A root that took another's place has met it, though both curves turn back before they touch.
  if (before * after < 0.0) curve.extent = infinite;
  if (before * after > 0.0) {  // as far as its tangents lead (`have_met`)
    const double steepest = std::max(magnitude(curve.tangent), magnitude(curve.end_tangent));
    curve.extent = std::max(curve.extent, steepest);
  }
  return curve;
}

/// Matches the two samples of a step. is_tracked: of each root of the left sample.
void match(Step& step, const Flags& is_tracked, const Cluster& cluster, Work& work) {
  const Index size = step.left->size();
  find_nearest(*step.left, *step.right, step.length(), work, step.onto);
  Flags& is_image = work.is_image;
  std::vector<Curve>& curves = work.curves;
  auto& near = work.near;
  step.meets.assign(size, -1);
  step.error.resize(size);
  step.slopes = step.left->slopes;
  curves.resize(size);
  // Of two conjugates that stay conjugate, the lower one's curve is the image of the upper one's.
  is_image.assign(size + 1, 0);
  for (Index i = 0; i < size; ++i) {
    if (i > 0 && step.start(i).imag() < 0.0 && mirrored(*step.left, i) == i - 1 &&
        mirrored(*step.right, step.onto[i - 1]) == step.onto[i] &&
        is_tracked[i] == is_tracked[i - 1]) {
      is_image[i] = 1;
      curves[i] = image_of(curves[i - 1]);
      step.error[i] = step.error[i - 1];
    } else {
      curves[i] = curve_of(step, i, cluster);
    }
  }
  double lowest = infinite;
  for (Index i = size - 1; i >= 0; --i) {
    lowest = std::min(lowest, curves[i].size - curves[i].extent);
    curves[i].lowest = lowest;
  }
  const auto has_image = [&](Index i) {
    const bool is_real = step.start(i).imag() == 0.0 && step.end(i).imag() == 0.0;
    return is_real || is_image[i] || is_image[i + 1];
  };
  near.clear();
  for (Index i = 0; i < size; ++i) {
    // As roots are sorted, no later root is near if its |lambda| cannot fall that far.
    const double highest = (1.0 + 4.0 * eps) * (curves[i].size + curves[i].extent);
    for (Index k = i + 1; k < size && curves[k].lowest <= highest; ++k) {
      if (is_image[i] && has_image(k)) continue;  // as far apart as their images
      const double room = curves[i].extent + curves[k].extent;
      if (std::norm(curves[i].start - curves[k].start) > room * room) continue;
      if ((is_tracked[i] || is_tracked[k]) && is_near(curves[i], curves[k])) near.push_back({i, k});
    }
  }
  for (Index i = 0; i < size; ++i) {  // a root that turns real or complex has met another
    const Complex a = curves[i].start, b = curves[i].end;
    if ((a.imag() == 0.0) == (b.imag() == 0.0) || curves[i].resting) continue;
    for (Index k = 0; k < size; ++k) {
      const bool together = a.imag() != 0.0 ? curves[k].start == std::conj(a)  //
                                            : curves[k].end == std::conj(b);
      if (k != i && together && !is_exempt(curves[i], curves[k])) near.push_back(std::minmax(i, k));
    }
  }
  std::ranges::sort(near);
  for (const auto& [i, k] : near) {
    if (step.meets[i] >= 0 || step.meets[k] >= 0 || !meet(step, i, k)) continue;
    step.meets[i] = k;
    step.meets[k] = i;
    order(step, i, k);
  }
  step.unambiguous = std::ranges::all_of(near, [&](const auto& pair) {
    return step.meets[pair.first] >= 0 || step.meets[pair.second] >= 0;
  });
}

}  // namespace

bool Step::shortest() const { return length() <= 2.0 * shortest_step * (1.0 + right->u); }

bool Step::lost(Index root) const {
  const Complex from = start(root), to = end(root);
  // Roots that meet move like the square root of the way that is left: by up to twice what slopes
  // predict.
  const double rate = std::max(std::abs(start_slope(root)), std::abs(end_slope(root)));
  return shortest() && std::abs(to - from) > jump * (1.0 + std::abs(from)) + 2.0 * length() * rate;
}

Index Step::reflected(Index root, bool at_end) const {
  const auto place = [&](Index i) { return at_end ? end(i) : start(i); };
  for (Index i = 0; i < left->size(); ++i) {
    if (i == root) continue;
    const double apart = std::abs(place(i) + std::conj(place(root)));
    if (apart < std::abs(place(root).real())) return i;
  }
  return -1;
}

Complex Step::at(Index root, double t) const {
  const double h = length();
  return cubic(start(root), h * start_slope(root), end(root), h * end_slope(root), t);
}

void track(const Tracking& tracking, SharedSample first, const std::vector<double>& speeds,
           const Roots& tracked) {
  double trials = most_steps + 4.0 * static_cast<double>(speeds.size());
  if (!speeds.empty()) trials += std::ceil(4.0 * (speeds[0] - first->u) / tracking.longest);
  SharedSample left = std::move(first);
  double most = tracking.longest;  // longest step that may be tried
  std::vector<SharedSample> ahead;
  Flags is_tracked(left->size(), 0), followed;
  for (const Index i : tracked) is_tracked[i] = 1;
  Step step{left, left};
  Work work;
  for (const double speed : speeds) {
    while (left->u < speed) {
      if (ahead.empty()) {
        double next = speed;
        while (next - left->u > most * (1.0 + 1e-12)) next = 0.5 * (left->u + next);
        ahead.push_back(tracking.take(next));
      }
      step.left = left;
      step.right = ahead.back();
      const double middle = 0.5 * (left->u + step.right->u);
      if (--trials < 0.0) {
        throw not_converged("eigenvalues near u = %.6g are too close to be tracked", left->u);
      }
      match(step, is_tracked, tracking.cluster, work);
      if (!tracking.good(step) && !step.shortest()) {
        most = std::max(std::min(most, 0.5 * step.length()), least_share * tracking.longest);
        ahead.push_back(tracking.take(middle));
        continue;
      }
      most = std::clamp(step_growth * step.length(), most, tracking.longest);
      if (!tracking.visit(step)) return;
      followed.resize(is_tracked.size());
      for (std::size_t i = 0; i < is_tracked.size(); ++i) followed[step.onto[i]] = is_tracked[i];
      is_tracked.swap(followed);
      left = step.right;
      ahead.pop_back();
    }
  }
}

Roots modes_of(const Values& values, const Reals& quotients, const Traits& traits) {
  if (traits.is_hysteretic()) {
    Roots modes;
    Index above = 0, below = 0;
    for (const Complex value : values) modes.push_back(traits.counts(value) ? ++above : ++below);
    return modes;
  }
  const Index size = values.size();
  struct Group {
    double square;
    Roots members;
  };
  std::vector<Group> groups;
  Roots real;
  for (Index i = 0; i < size; ++i) {
    if (values[i].imag() == 0.0) real.push_back(i);
    if (!(values[i].imag() > 0.0)) continue;
    groups.push_back({std::norm(values[i]), {i}});
    const auto conjugate = std::find(values.begin(), values.end(), std::conj(values[i]));
    if (conjugate != values.end()) groups.back().members.push_back(conjugate - values.begin());
  }
  std::ranges::stable_sort(real, {}, [&](Index i) { return quotients[i]; });
  for (std::size_t k = 0; k < real.size(); k += 2) {
    const Index i = real[k], other = real[std::min(k + 1, real.size() - 1)];
    groups.push_back({(values[i] * values[other]).real(), {i, other}});
  }
  Roots modes(size, 0);
  for (const Group& group : groups) {
    Index mode = 1;
    for (const Group& other : groups) {
      mode += other.square < group.square || (other.square == group.square && &other < &group);
    }
    for (const Index i : group.members) modes[i] = mode;
  }
  return modes;
}

std::optional<RootLoci> root_loci(Spectrum& spectrum, const std::vector<double>& speeds,
                                  Index count, Index taken,
                                  const std::function<void(Index done)>& report) {
  const Index size = static_cast<Index>(speeds.size());
  RootLoci loci{{size, count}, {size, count}, {size, count}, {size, count}};
  Index done = 0;
  const auto take = [&](double u) -> SharedSample {
    auto at = spectrum.unused_sample();
    spectrum.sample(u, taken, *at);
    report(done);
    return at;
  };
  const SharedSample first = take(speeds[0]);
  const Traits& traits = spectrum.traits;
  const Roots modes = modes_of(first->values, spectrum.quotients(first->u, *first), traits);
  Roots upper(count, -1), lower(count, -1);
  for (Index i = 0; i < first->size(); ++i) {
    const Index branch = modes[i] - 1;
    if (branch < 0 || branch >= count) continue;
    const Index other = std::exchange(upper[branch], i);
    if (other < 0) continue;
    lower[branch] = other;
    if (is_above(first->values[other], first->values[i])) std::swap(upper[branch], lower[branch]);
  }
  for (Index k = 0; k < count; ++k) {
    // With a loss factor there may be fewer roots on one side of the real axis.
    if (lower[k] < 0 && traits.is_hysteretic() && taken >= 2 * traits.dof) lower[k] = upper[k];
    if (lower[k] < 0) return {};
  }
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  const auto add_row = [&](const Sample& at) {
    for (Index k = 0; k < count; ++k) {
      const Index i = upper[k], j = traits.is_hysteretic() ? i : lower[k];
      const bool counts = traits.counts(at.values[i]);
      loci.values(done, k) = counts ? at.values[i] : Complex(none, none);
      loci.partners(done, k) =
          traits.is_hysteretic() ? std::conj(loci.values(done, k)) : at.values[j];
      loci.converged(done, k) = counts && has_converged(at.values[i], at.residual[i]) &&
                                has_converged(at.values[j], at.residual[j]);
      loci.errors(done, k) = counts ? std::max(at.uncertain[i], at.uncertain[j]) : infinite;
    }
    ++done;
  };
  add_row(*first);
  // The cluster begins beyond the last mode asked for, at -1 / delta (1 + 1 / (delta omega)^2).
  const double number = std::numbers::pi * (static_cast<double>(count) + 0.5);
  const double beyond = std::max(traits.delta * number * number, 1.0);
  const Cluster cluster{traits.cluster(), 0.5 / (beyond * beyond), traits.zero};
  Roots tracked = upper;
  tracked.insert(tracked.end(), lower.begin(), lower.end());
  bool complete = true;

  const auto visit = [&](const Step& step) {
    const Values& there = step.right->values;
    for (Index k = 0; k < count; ++k) {
      Index &up = upper[k], &low = lower[k];
      const bool was_real = step.start(up).imag() == 0.0 && step.start(low).imag() == 0.0;
      const Index onto = step.onto[up], other = step.onto[low];
      complete = complete && !(taken < 2 * traits.dof && step.lost(up));
      if (!complete) return false;
      up = onto;
      low = other;
      // The partner of a complex root is its conjugate, whichever root of the cluster that is.
      for (Index i = 0; there[up].imag() != 0.0 && i < there.size(); ++i) {
        if (there[i] != std::conj(there[up])) continue;
        low = i;
        break;
      }
      // A root that left the upper half plane comes back to it.
      const bool comes_back = traits.is_hysteretic()
                                  ? traits.counts(there[low]) && !traits.counts(there[up])
                                  : was_real || cluster.holds(there[up]);
      if (comes_back && there[up].imag() < 0.0) std::swap(up, low);
    }
    if (step.right->u == speeds[done]) add_row(*step.right);
    return true;
  };
  const auto good = [](const Step& step) { return step.unambiguous; };
  track({take, good, visit, cluster, spectrum.longest_step(first->values)}, first,
        {speeds.begin() + 1, speeds.end()}, tracked);
  report(done);
  if (!complete) return {};
  return loci;
}

}  // namespace pipedyn
