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

/// Where a root is in a step: control points of its cubic, or of the mean of the two roots that
/// meet on the real axis, which lie within a radius of it.
struct Body {
  std::array<Complex, 4> points;
  double radius = 0.0;

  Body(const Step& step, Index i) : points(control_points(step, i)) {
    const Index k = step.meets[i];
    if (k < 0) return;
    const std::array<Complex, 4> met = control_points(step, k);
    for (std::size_t p = 0; p < points.size(); ++p) points[p] = 0.5 * (points[p] + met[p]);
    radius = 0.5 * std::max(magnitude(step.start(i) - step.start(k)),
                            magnitude(step.end(i) - step.end(k)));
  }

  static std::array<Complex, 4> control_points(const Step& step, Index i) {
    const double third = step.length() / 3.0;
    return {step.start(i), step.start(i) + third * step.start_slope(i),
            step.end(i) - third * step.end_slope(i), step.end(i)};
  }

  Complex at(double t) const {
    const double s = 1.0 - t;
    return s * s * s * points[0] + 3.0 * s * t * (s * points[1] + t * points[2]) +
           t * t * t * points[3];
  }
};

/// A root in a step of each of two searches.
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

  /// Calls visit with the real parts of each control point and their difference, until it returns
  /// false. Returns whether it never does.
  template <class Visit>
  bool real_parts(const Visit& visit) const {
    for (std::size_t p = 0; p < 4; ++p) {
      const double a = one.points[p].real() + one.radius, b = other.points[p].real() + other.radius;
      if (!visit(a, b, std::abs(a - b))) return false;
    }
    return true;
  }

  /// Whether the root stays on the left of the axis in both, by far more than they differ.
  bool decays(bool at_rest) const {
    bool first = at_rest;  // without damping, roots are on the axis there
    return real_parts([&](double a, double b, double difference) {
      if (std::exchange(first, false) && a == 0.0 && b == 0.0) return true;
      return a < 0.0 && b < 0.0 && difference <= alike * std::min(-a, -b);
    });
  }

  /// Whether the root passes the axis once to the right in both and in any between: by the signs of
  /// the coefficients of its real part in Bernstein's form, which change once.
  bool rises_once() const {
    const double rise = one.points[3].real() - one.points[0].real();
    int uncertain = 0;
    bool rises = false;
    const bool passes = real_parts([&](double a, double b, double difference) {
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
      least = std::min(least, magnitude(one.at(t) - another.one.at(t)));
    }
    return apart + another.apart <= alike * (least - one.radius - another.one.radius);
  }
};

/// Two searches whose first losses of stability are alike, as are those of all pipes between them.
class Neighbours {
 public:
  Neighbours(const Searched& one, const Searched& other) : one_(one), other_(other) {}

  bool are_alike() const {
    const auto flutters = [](const Sweep& sweep) {
      return sweep.failure.empty() && !sweep.untracked && sweep.unstable_at_rest == 0 &&
             sweep.crossings.size() == 1 && sweep.crossings[0].change == 2 &&
             sweep.crossings[0].value != 0.0 && sweep.crossings[0].pair.right.size() > 0;
    };
    if (!flutters(one_.sweep) || !flutters(other_.sweep)) return false;
    if (first().mode != second().mode || one_.trace.size() != other_.trace.size()) return false;
    for (std::size_t s = 0; s < one_.trace.size(); ++s) {
      if (!are_alike(s)) return false;
    }
    return true;
  }

  /// The first loss of stability of a pipe at a place between the two; none if it is not as they
  /// let one expect.
  std::optional<Sweep> between(Spectrum& spectrum, double share) const {
    const Step &step = one_.trace.back().first, &twin = other_.trace.back().first;
    const Values &at = step.left->values, &beside = twin.left->values;
    const auto roots = by_mode(at, one_.trace.back().second);
    const auto twins = by_mode(beside, other_.trace.back().second);
    Values starts(at.size());
    std::vector<double> distances;  // of the neighbours' roots from the axis
    Index count = 0, flutters = 0;
    for (std::size_t m = 0; m < roots.size(); ++m) {
      for (const std::size_t rank : {0, 1}) {
        const Complex a = at[roots[m][rank]], b = beside[twins[m][rank]];
        if (a.imag() < 0.0) continue;
        if (static_cast<Index>(m) + 1 == first().mode && rank == 0) flutters = count;
        starts[count++] = on_line(a, b, share);
        distances.push_back(std::min(-a.real(), -b.real()));
      }
    }
    starts.conservativeResize(count);
    const std::optional<Values> there = spectrum.all_roots(step.left->u, starts);
    if (!there) return {};
    for (Index i = 0; i < count; ++i) {
      const double least =
          i == flutters ? 1e-9 * (1.0 + magnitude((*there)[i])) : 0.5 * distances[i];
      if (!((*there)[i].real() < -least)) return {};
    }
    // The distance of the root from all others, a share of which it may be off.
    double room = 2.0 * starts[flutters].imag();
    for (Index i = 0; i < count; ++i) {
      if (i != flutters) room = std::min(room, magnitude(starts[i] - starts[flutters]));
    }
    if (!(magnitude((*there)[flutters] - starts[flutters]) < alike * room)) return {};
    const double low = step.left->u, high = step.right->u;
    const double expected = first().speed + share * (second().speed - first().speed);
    const Complex value = on_line(first().value, second().value, share);
    auto [u, pair] = newton(spectrum, expected, Pair{value}, low, high);
    const double tolerance = 1e-6 * (1.0 + magnitude(value)), error = error_of(pair);
    const bool good = u > low && u < high && pair.converged() && pair.slope.real() > 0.0 &&
                      std::abs(pair.value.real()) <= tolerance && error <= largest_error * u &&
                      magnitude(pair.value - value) < alike * room &&
                      std::abs(u - expected) < alike * (high - low);
    if (!good) return {};
    Sweep sweep;
    sweep.crossings.push_back(
        {u, {0.0, std::abs(pair.value.imag())}, 2, first().mode, error, std::move(pair)});
    return sweep;
  }

 private:
  const AxisCrossing& first() const { return one_.sweep.crossings[0]; }
  const AxisCrossing& second() const { return other_.sweep.crossings[0]; }

  /// Whether the two searches are alike in a step.
  bool are_alike(std::size_t s) const {
    const auto& [step, modes] = one_.trace[s];
    const auto& [twin, twin_modes] = other_.trace[s];
    const Index size = step.left->size();
    if (step.left->u != twin.left->u || step.right->u != twin.right->u) return false;
    if (twin.left->size() != size || size != step.right->size()) return false;
    const auto roots = by_mode(step.left->values, modes);
    const auto twins = by_mode(twin.left->values, twin_modes);
    if (roots.empty() || twins.empty()) return false;
    const bool at_rest = step.left->u == 0.0, last = s + 1 == one_.trace.size();
    const auto are_same = [](Complex a, Complex b) {
      return (a.imag() > 0.0) == (b.imag() > 0.0) && (a.imag() < 0.0) == (b.imag() < 0.0);
    };
    std::vector<Twin> others;
    std::optional<Twin> flutters;
    for (std::size_t m = 0; m < roots.size(); ++m) {
      for (const std::size_t rank : {0, 1}) {
        const Index i = roots[m][rank], k = twins[m][rank];
        if (!are_same(step.start(i), twin.start(k)) || !are_same(step.end(i), twin.end(k))) {
          return false;
        }
        const Index met = step.meets[i], twin_met = twin.meets[k];
        if (step.start(i) == 0.0 || (met < 0) != (twin_met < 0)) return false;
        if (met >= 0 && modes[met] != twin_modes[twin_met]) return false;
        if (step.start(i).imag() < 0.0) continue;  // the conjugate of another
        const Twin both(Body(step, i), Body(twin, k));
        const bool own = static_cast<Index>(m) + 1 == first().mode;
        if (own && rank == 0) {
          flutters = both;
          if (met >= 0 && (last || modes[met] != first().mode)) return false;
        }
        const bool passes = last && own && rank == 0;
        if (passes ? !both.rises_once() : !both.decays(at_rest)) return false;
        if (!own) others.push_back(both);
      }
    }
    return flutters && std::ranges::all_of(others, [&](const Twin& another) {
             return flutters->is_far_from(another);
           });
  }

  const Searched &one_, &other_;
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
  Searched searched(Index i) {
    Searched done;
    begins_(i);
    done.numbers = spectra_[i]->numbers();
    const bool known = shares(i) && !done.numbers.empty();
    found_[i] = crossings(*spectra_[i], ranges_[i], report_, known ? &done.trace : nullptr);
    done.sweep = found_[i];
    return done;
  }

  /// Whether a search is one whose neighbours may share it.
  bool shares(Index i) const {
    const Range &range = ranges_[i], &same = ranges_[0];
    const Traits &traits = spectra_[i]->traits, &others = spectra_[0]->traits;
    return range.until_unstable && range.count >= 2 * traits.dof && range.resolved >= traits.dof &&
           range.max_speed == same.max_speed && traits.dof == others.dof &&
           !traits.is_hysteretic() && !traits.conservative && !traits.squared &&
           traits.damped == others.damped;
  }

  std::optional<double> place_of(Index i, const Searched& one, const Searched& other) const {
    if (!shares(i)) return {};
    return place(spectra_[i]->numbers(), one.numbers, other.numbers);
  }

  /// Searches the pipes between two that were searched.
  void fill(Index low, const Searched& one, Index high, const Searched& other) {
    if (high - low < 2) return;
    const Index middle = low + (high - low) / 2;
    const Neighbours neighbours(one, other);
    if (!place_of(middle, one, other) || !neighbours.are_alike()) {
      const Searched centre = searched(middle);
      fill(low, one, middle, centre);
      fill(middle, centre, high, other);
      return;
    }
    for (Index i = low + 1; i < high; ++i) {
      begins_(i);
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
};

}  // namespace

void search_together(std::span<const std::shared_ptr<Spectrum>> spectra,
                     std::span<const Range> ranges, const std::function<void(Index)>& begins,
                     const std::function<void()>& report, std::span<Sweep> found) {
  Together(spectra, ranges, begins, report, found).run();
}

}  // namespace pipedyn
