// SPDX-License-Identifier: MIT
#include "pipedyn/linear/neighbours.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace pipedyn {

namespace {

/// Share of a distance that the difference of two neighbours may be. Pipes between them differ from
/// both by less, except for the curvature of what is between, for which the rest is room.
constexpr double alike = 0.25;

/// Share of the difference of two pipes by which one between them may be off their line.
constexpr double off_line = 0.05;

/// A search, its steps, and the numbers of the model.
struct Searched {
  Sweep sweep = {};
  Trace trace = {};
  std::vector<double> numbers = {};
};

/// Place of a model on the line from one model to another, from 0 to 1; none if it is not on it.
std::optional<double> place(const std::vector<double>& of, const std::vector<double>& one,
                            const std::vector<double>& other) {
  const std::size_t size = of.size();
  if (size == 0 || one.size() != size || other.size() != size) return {};
  double along = 0.0, length = 0.0;
  for (std::size_t i = 0; i < size; ++i) {
    const double whole = other[i] - one[i];
    if (whole == 0.0) continue;
    const double weight = 1.0 / std::max(one[i] * one[i], other[i] * other[i]);
    along += weight * whole * (of[i] - one[i]);
    length += weight * whole * whole;
  }
  const double share = length > 0.0 ? along / length : 0.0;
  if (!(share >= 0.0 && share <= 1.0)) return {};
  for (std::size_t i = 0; i < size; ++i) {
    const double whole = other[i] - one[i], off = of[i] - one[i] - share * whole;
    if (!(std::abs(off) <= off_line * std::abs(whole) + 8.0 * eps * std::abs(one[i]))) return {};
  }
  return share;
}

Complex on_line(Complex one, Complex other, double share) { return one + share * (other - one); }

/// The two roots of each mode in a sample, the upper one or the greater real one first; empty where
/// a mode has not two roots.
std::vector<std::array<Index, 2>> by_mode(const Values& values, const Roots& modes) {
  const Index size = values.size();
  std::vector<std::array<Index, 2>> roots(size / 2, {-1, -1});
  const auto is_first = [&](Index i, Index k) {
    return std::pair(values[i].imag(), values[i].real()) >
           std::pair(values[k].imag(), values[k].real());
  };
  for (Index i = 0; i < size; ++i) {
    if (modes[i] < 1 || modes[i] > size / 2) return {};
    auto& [first, second] = roots[modes[i] - 1];
    if (second >= 0) return {};
    if (first >= 0) second = i;
    if (first < 0) first = i;
    if (second >= 0 && is_first(second, first)) std::swap(first, second);
  }
  return roots;
}

using Cubic = std::array<Complex, 4>;  // control points

/// Value of a cubic's blossom, which is the cubic itself where its three arguments are equal.
Complex blossom(Cubic points, double first, double second, double third) {
  std::size_t left = 3;
  for (const double t : {first, second, third}) {
    for (std::size_t p = 0; p < left; ++p) points[p] += t * (points[p + 1] - points[p]);
    --left;
  }
  return points[0];
}

/// Where a root is in a part of a step: its cubic, or the mean of those of the two roots that meet
/// on the real axis, which lie within a radius of it.
struct Body {
  Cubic points;
  double radius = 0.0;

  Body(const Step& step, Index i, double low, double high) : points(cubic_of(step, i)) {
    if (const Index k = step.meets[i]; k >= 0) {
      const Cubic met = cubic_of(step, k);
      for (std::size_t p = 0; p < points.size(); ++p) points[p] = 0.5 * (points[p] + met[p]);
      radius = 0.5 * std::max(magnitude(step.start(i) - step.start(k)),
                              magnitude(step.end(i) - step.end(k)));
    }
    if (low == step.left->u && high == step.right->u) return;
    const double t = (low - step.left->u) / step.length(),
                 z = (high - step.left->u) / step.length();
    points = {blossom(points, t, t, t), blossom(points, t, t, z), blossom(points, t, z, z),
              blossom(points, z, z, z)};
  }

  static Cubic cubic_of(const Step& step, Index i) {
    const double third = step.length() / 3.0;
    return {step.start(i), step.start(i) + third * step.start_slope(i),
            step.end(i) - third * step.end_slope(i), step.end(i)};
  }
};

/// A root in a part of a step of each of two searches.
struct Twin {
  Body one, other;
  double apart;  // most that the two differ by

  Twin(const Body& body, const Body& body_of_other) : one(body), other(body_of_other) {
    double most = 0.0;
    for (std::size_t p = 0; p < 4; ++p) {
      most = std::max(most, std::norm(one.points[p] - other.points[p]));
    }
    apart = std::sqrt(most) + std::abs(one.radius - other.radius);
  }

  /// Calls visit with the number of each control point, its real parts and their difference, until
  /// it returns false. Returns whether it never does.
  template <class Visit>
  bool real_parts(const Visit& visit) const {
    for (std::size_t p = 0; p < 4; ++p) {
      const double a = one.points[p].real() + one.radius, b = other.points[p].real() + other.radius;
      if (!visit(p, a, b, std::abs(a - b))) return false;
    }
    return true;
  }

  /// Whether the root stays on the left of the axis in both, by far more than they differ.
  /// at_rest: whether it may begin on the axis, where no damping is; seen: whether pipes between
  /// will be seen to be on the left at the end of the step.
  bool decays(bool at_rest, bool seen) const {
    return real_parts([&](std::size_t p, double a, double b, double difference) {
      if (p == 0 && at_rest && a == 0.0 && b == 0.0) return true;
      return a < 0.0 && b < 0.0 && ((p == 3 && seen) || difference <= alike * std::min(-a, -b));
    });
  }

  /// Whether the root passes the axis once to the right in both and in any between: by the signs of
  /// the coefficients of its real part in Bernstein's form, which change once.
  bool rises_once() const {
    const double rise = one.points[3].real() - one.points[0].real();
    int uncertain = 0;
    bool rises = false;
    const bool passes = real_parts([&](std::size_t, double a, double b, double difference) {
      const double low = std::min(a, b) - alike * difference;
      const double high = std::max(a, b) + alike * difference;
      if (difference > alike * rise || (rises && low <= 0.0)) return false;
      rises = low > 0.0;
      uncertain += low <= 0.0 && high >= 0.0 ? 1 : 0;
      return true;
    });
    return passes && rises && uncertain <= 1 && one.points[0].real() < 0.0 &&
           other.points[0].real() < 0.0;
  }

  /// Whether two roots are further apart than by what each of them may differ.
  bool is_far_from(const Twin& another) const {
    double least = infinite;
    for (const double t : {0.0, 0.25, 0.5, 0.75, 1.0}) {
      const Complex here = blossom(one.points, t, t, t);
      least = std::min(least, magnitude(here - blossom(another.one.points, t, t, t)));
    }
    return apart + another.apart <= alike * (least - one.radius - another.one.radius);
  }
};

/// Two searches, and what they tell about the pipes between them.
class Neighbours {
 public:
  Neighbours(const Searched& one, const Searched& other) : one_(one), other_(other) {}

  /// Whether the first losses of stability of the two are alike, as are those of all pipes between.
  bool are_alike() {
    const auto flutters = [](const Sweep& sweep) {
      return sweep.failure.empty() && !sweep.untracked && sweep.unstable_at_rest == 0 &&
             sweep.crossings.size() == 1 && sweep.crossings[0].change == 2 &&
             sweep.crossings[0].value != 0.0;
    };
    if (!flutters(one_.sweep) || !flutters(other_.sweep) || first().mode != second().mode) {
      return false;
    }
    std::vector<Part> parts;
    const auto [least, most] = std::minmax(first().speed, second().speed);
    double low = 0.0;
    for (std::size_t i = 0, k = 0; i < one_.trace.size() && k < other_.trace.size();) {
      const double end = one_.trace[i].first.right->u, twin_end = other_.trace[k].first.right->u;
      parts.push_back({&one_.trace[i], &other_.trace[k], low, std::min(end, twin_end)});
      low = parts.back().high;
      if (least <= low) break;
      i += end == low;
      k += twin_end == low;
    }
    if (parts.empty() || !(parts.back().low < least && most < parts.back().high)) return false;
    low_ = parts.back().low;
    high_ = parts.back().high;
    return std::ranges::all_of(parts, [this](const Part& part) { return are_alike(part); });
  }

  /// Where to divide the pipes between the two: where the speed is expected to pass the end of a
  /// step, or half way.
  double divide() const {
    if (one_.trace.empty() || other_.trace.empty()) return 0.5;
    if (one_.sweep.crossings.empty() || other_.sweep.crossings.empty()) return 0.5;
    const double end =
        std::min(one_.trace.back().first.right->u, other_.trace.back().first.right->u);
    const double share = (end - first().speed) / (second().speed - first().speed);
    return share > 0.0 && share < 1.0 ? share : 0.5;
  }

  /// The first loss of stability of a pipe at a place between two that are alike; none if it is not
  /// as they let one expect.
  std::optional<Sweep> between(Spectrum& spectrum, double share) const {
    const Index count = static_cast<Index>(roots_.size());
    Values starts(count);
    for (Index i = 0; i < count; ++i) starts[i] = on_line(roots_[i].first, roots_[i].second, share);
    Values there = starts;
    if (!spectrum.all_roots(low_, there)) return {};
    const Complex start = starts[flutters_];
    double room = 2.0 * start.imag();  // distance from all other roots
    for (Index i = 0; i < count; ++i) {
      const auto& [a, b] = roots_[i];
      const bool own = i == flutters_;
      const double least = own ? 1e-9 * (1.0 + magnitude(a)) : 0.5 * std::min(-a.real(), -b.real());
      if (!(there[i].real() < -least)) return {};
      if (!own) room = std::min(room, magnitude(starts[i] - start));
    }
    const auto is_there = [&](Complex value, Complex wanted) {
      return magnitude(value - wanted) < alike * room;
    };
    const double expected = first().speed + share * (second().speed - first().speed);
    const Complex value = on_line(first().value, second().value, share);
    auto [u, pair] = newton(spectrum, expected, Pair{value}, low_, high_);
    const double tolerance = 1e-6 * (1.0 + magnitude(value)), error = error_of(pair);
    const bool good = u > low_ && u < high_ && pair.converged() && pair.slope.real() > 0.0 &&
                      std::abs(pair.value.real()) <= tolerance && error <= largest_error * u &&
                      is_there(there[flutters_], start) && is_there(pair.value, value) &&
                      std::abs(u - expected) < alike * (high_ - low_);
    if (!good) return {};
    const Complex passes(0.0, std::abs(pair.value.imag()));
    Sweep sweep;
    sweep.crossings.push_back({u, passes, 2, first().mode, error, std::move(pair)});
    return sweep;
  }

 private:
  /// A range of speeds that lies in one step of each search.
  struct Part {
    const std::pair<Step, Roots>*one, *other;
    double low, high;
  };

  const AxisCrossing& first() const { return one_.sweep.crossings[0]; }
  const AxisCrossing& second() const { return other_.sweep.crossings[0]; }

  /// Whether the two searches are alike in a part. Keeps the roots at the start of the last one.
  bool are_alike(const Part& part) {
    const auto& [step, modes] = *part.one;
    const auto& [twin, twin_modes] = *part.other;
    const auto roots = by_mode(step.left->values, modes);
    const auto twins = by_mode(twin.left->values, twin_modes);
    if (roots.empty() || twins.size() != roots.size()) return false;
    const bool at_rest = part.low == 0.0, last = part.low == low_;
    std::vector<Twin> others;
    std::optional<Twin> flutters;
    for (std::size_t m = 0; m < roots.size(); ++m) {
      for (const std::size_t rank : {0, 1}) {
        const Index i = roots[m][rank], k = twins[m][rank];
        const Complex start = step.start(i), twin_start = twin.start(k);
        if (start == 0.0 || twin_start == 0.0) return false;
        if (start.imag() < 0.0 && twin_start.imag() < 0.0) continue;  // conjugates of others
        const Twin both(Body(step, i, part.low, part.high), Body(twin, k, part.low, part.high));
        const bool own = static_cast<Index>(m) + 1 == first().mode, follows = own && rank == 0;
        const Index met = step.meets[i], twin_met = twin.meets[k];
        if (own && ((met >= 0 && (last || modes[met] != first().mode)) ||
                    (twin_met >= 0 && (last || twin_modes[twin_met] != first().mode)))) {
          return false;
        }
        const bool seen = follows && part.high == low_;
        if (last && follows ? !both.rises_once() : !both.decays(at_rest, seen)) return false;
        if (follows) flutters = both;
        if (!own) others.push_back(both);
        if (!last) continue;
        const bool meets =
            (met >= 0 && step.left->u != low_) || (twin_met >= 0 && twin.left->u != low_);
        if (meets || (start.imag() == 0.0) != (twin_start.imag() == 0.0)) return false;
        if (follows) flutters_ = static_cast<Index>(roots_.size());
        roots_.emplace_back(met < 0 ? both.one.points[0] : start,
                            twin_met < 0 ? both.other.points[0] : twin_start);
      }
    }
    return flutters && std::ranges::all_of(others, [&](const Twin& another) {
             return flutters->is_far_from(another);
           });
  }

  const Searched &one_, &other_;
  double low_ = 0.0, high_ = 0.0;  // the part in which both flutter
  // Roots of both at its start, of conjugates the upper ones, and which of them flutters.
  std::vector<std::pair<Complex, Complex>> roots_;
  Index flutters_ = -1;
};

class Together {
 public:
  Together(std::span<const std::shared_ptr<Spectrum>> spectra, std::span<const Range> ranges,
           const std::function<void(Index)>& begins, const std::function<void()>& report,
           std::span<Sweep> found)
      : spectra_(spectra), ranges_(ranges), begins_(begins), report_(report), found_(found) {}

  void run() {
    const Index last = static_cast<Index>(spectra_.size()) - 1;
    if (last < 0) return;
    const Searched one = searched(0);
    if (last > 0) fill(0, one, last, searched(last));
  }

 private:
  void begin(Index i) {
    begins_(i);
    const Index before = std::exchange(latest_, i);
    if (before >= 0 && !found_[before].untracked) spectra_[i]->reuse(*spectra_[before]);
  }

  Searched searched(Index i) {
    Searched done;
    begin(i);
    const bool is_shared = shares(i) && is_on_line(i);
    if (is_shared) done.numbers = spectra_[i]->numbers();
    Trace* const trace = done.numbers.empty() ? nullptr : &done.trace;
    found_[i] = crossings(*spectra_[i], ranges_[i], report_, trace);
    if (trace != nullptr) done.sweep = found_[i];
    return done;
  }

  /// Whether a search is one whose neighbours may share it.
  bool shares(Index i) const {
    const Range& range = ranges_[i];
    const Traits& traits = spectra_[i]->traits;
    const bool every = range.count >= 2 * traits.dof && range.resolved >= traits.dof;
    return every && range.until_unstable && range.max_speed == ranges_[0].max_speed &&
           !traits.is_hysteretic() && !traits.conservative && !traits.squared;
  }

  /// Whether a pipe is the first, the middle or the last of five on a line, in order. Steps of
  /// others need not be kept: their neighbours seldom share them.
  bool is_on_line(Index i) const {
    for (const Index first : {i - 2, i, i - 4}) {
      if (first < 0 || first + 4 >= static_cast<Index>(spectra_.size())) continue;
      const auto one = spectra_[first]->numbers(), other = spectra_[first + 4]->numbers();
      double last = 0.0;
      bool in_order = true;
      for (Index k = first + 1; in_order && k < first + 4; ++k) {
        const double next = place(spectra_[k]->numbers(), one, other).value_or(-1.0);
        in_order = next >= std::exchange(last, next);
      }
      if (in_order) return true;
    }
    return false;
  }

  std::optional<double> place_of(Index i, const Searched& one, const Searched& other) const {
    if (!shares(i)) return {};
    return place(spectra_[i]->numbers(), one.numbers, other.numbers);
  }

  /// Searches the pipes between two that were searched.
  void fill(Index low, const Searched& one, Index high, const Searched& other) {
    if (high - low < 2) return;
    Neighbours neighbours(one, other);
    const Index middle =
        low + std::clamp(static_cast<Index>(neighbours.divide() * static_cast<double>(high - low)),
                         Index{1}, high - low - 1);
    if (!place_of(middle, one, other) || !neighbours.are_alike()) {
      const Searched centre = searched(middle);
      fill(low, one, middle, centre);
      fill(middle, centre, high, other);
      return;
    }
    for (Index i = low + 1; i < high; ++i) {
      begin(i);
      std::optional<Sweep> sweep;
      if (const std::optional<double> share = place_of(i, one, other)) {
        sweep = neighbours.between(*spectra_[i], *share);
      }
      found_[i] = sweep ? *std::move(sweep) : crossings(*spectra_[i], ranges_[i], report_);
      report_();
    }
  }

  const std::span<const std::shared_ptr<Spectrum>> spectra_;
  const std::span<const Range> ranges_;
  const std::function<void(Index)>& begins_;
  const std::function<void()>& report_;
  const std::span<Sweep> found_;
  Index latest_ = -1;  // the search that began last
};

}  // namespace

void search_together(std::span<const std::shared_ptr<Spectrum>> spectra,
                     std::span<const Range> ranges, const std::function<void(Index)>& begins,
                     const std::function<void()>& report, std::span<Sweep> found) {
  Together(spectra, ranges, begins, report, found).run();
}

}  // namespace pipedyn
