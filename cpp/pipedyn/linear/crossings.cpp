// SPDX-License-Identifier: MIT
#include "pipedyn/linear/crossings.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace pipedyn {

namespace {

/// Relative error of a crossing's speed beyond which it is no result: three digits are wanted.
constexpr double largest_error = 1e-3;

/// A message in printf's format.
template <class... Numbers>
NotConverged refusal(const char* format, Numbers... numbers) {
  char text[200];
  std::snprintf(text, sizeof text, format, numbers...);
  return NotConverged(text);
}

bool is_known(const AxisCrossing& crossing) {
  return crossing.error <= largest_error * crossing.speed + 1e-12;
}

/// What a step shows: one root of each conjugate pair; those that meet another on the real axis are
/// not followed by their cubics.
struct Scan {
  Roots roots;        // looked at
  Flags leaving;      // of the left sample's, which leave the axis at rest to the right
  Flags after;        // the same, which are unstable at the right end
  bool clear = true;  // whether the step shows all
  struct Predicted {
    Index root;
    double at;  // fraction of the step
    bool rising;
  };
  std::vector<Predicted> predicted;  // of crossings, in order along each root
};

class Search {
 public:
  Search(Spectrum& spectrum, const Range& range, const std::function<void()>& report)
      : spectrum_(spectrum), traits_(spectrum.traits), range_(range), report_(report) {}

  Sweep run() {
    const double longest = spectrum_.longest_step() * range_.scale;
    const int steps = std::max(1, static_cast<int>(std::ceil(range_.max_speed / longest)));
    std::vector<double> speeds(steps, range_.max_speed);
    for (int i = 1; i < steps; ++i) speeds[i - 1] = i * (range_.max_speed / steps);
    try {
      const SharedSample first = take(0.0);
      Roots every(first->size());
      for (Index i = 0; i < first->size(); ++i) every[i] = i;
      modes_ = ranked(*first);
      unstable_ = states(*first, every, Flags(every.size(), 0));
      sweep_.unstable_at_rest = unstable_count_ = count_unstable(*first);
      every.resize(std::min(first->size(), (traits_.squared ? 1 : 2) * range_.certain));
      const auto sure = [this](const Step& step) {
        scanned_ = scan(step);
        return scanned_.clear;
      };
      track({[this](double u) { return take(u); },
             sure,
             [this](const Step& step) { return visit(step); },
             {traits_.cluster(), 0.9, traits_.zero},
             longest},
            first, speeds, every);
    } catch (const NotConverged& error) {
      sweep_.failure = error.what();
    }
    return std::move(sweep_);
  }

 private:
  /// The sample at a speed, but for roots that never leave zero, lest one that passes be taken for
  /// them; at rest zero is exact, and without damping the axis.
  SharedSample take(double u) {
    Sample at = spectrum_.sample(u, range_.count);
    std::vector<Index> moving;
    for (Index i = spectrum_.standing(); i < at.size(); ++i) moving.push_back(i);
    if (spectrum_.standing() > 0) at = {at.take(moving), u};
    report_();
    if (traits_.squared) {
      Sample half{{.values = Values(at.size()), .slopes = Values(at.size())}, u};
      Index count = 0;
      bool twin = true;  // of two zeros the second
      for (Index i = 0; i < at.size(); ++i) {
        const Complex value = at.values[i];
        if (value == 0.0) twin = !twin;
        const bool on_axis = value.real() == 0.0 && (value.imag() > 0.0 || (value == 0.0 && !twin));
        if (!(value.real() > 0.0 || on_axis)) continue;
        half.values[count] = value * value;
        if (on_axis || value.imag() == 0.0) half.values[count].imag(0.0);
        half.slopes[count++] = 2.0 * value * at.slopes[i];
      }
      half.values.conservativeResize(count);
      half.slopes.conservativeResize(count);
      half.noise = half.slope_noise = half.signatures = Reals::Zero(count);
      at = std::move(half);
    }
    for (Index i = 0; u == 0.0 && i < at.size(); ++i) {
      Complex& value = at.values[i];
      if (magnitude(value) < traits_.zero) value = 0.0;
      if (!traits_.squared && !traits_.damped && value.imag() != 0.0) value.real(0.0);
    }
    return std::make_shared<const Sample>(std::move(at));
  }

  /// Mode of each root at rest, by frequency.
  Roots ranked(const Sample& first) const {
    if (!traits_.squared) return modes_at_rest(first.values, traits_);
    Values roots(2 * first.size());
    roots << first.values.sqrt(), -first.values.sqrt();
    Roots modes = modes_of_pairs(roots, 0.0);
    modes.resize(first.size());
    return modes;
  }

  /// Whether the place of a root on one side of the axis is known.
  bool has_sign(const Sample& at, Index i) const {
    const Complex value = at.values[i];
    if (traits_.squared) return value.imag() != 0.0 || magnitude(value) >= traits_.zero;
    return at.signatures[i] != 0 ||  // on the axis of a conservative system, where it stays
           (std::abs(value.real()) > at.noise[i] && magnitude(value) >= traits_.zero);
  }

  /// Which of some roots of a sample are unstable: by the sign of Re lambda, or as before where it
  /// has none.
  Flags states(const Sample& at, const Roots& onto, const Flags& before) const {
    const Index size = static_cast<Index>(onto.size());
    Flags result = before;
    for (Index i = 0; i < size; ++i) {
      if (onto[i] < 0) continue;
      const Complex value = at.values[onto[i]];
      if (has_sign(at, onto[i])) {
        result[i] = value.real() > 0.0 || (traits_.squared && value.imag() != 0.0);
        continue;
      }
      for (Index k = 0; k < size; ++k) {  // a pair has one state
        if (value.imag() == 0.0 || onto[k] < 0) continue;
        const Complex other = at.values[onto[k]];
        if (other == value || other == std::conj(value)) result[i] |= before[k];
      }
    }
    return result;
  }

  /// Number of unstable roots among the resolved of a sample.
  int count_unstable(const Sample& at) const {
    int count = 0;
    for (Index i = 0; i < at.size(); ++i) count += unstable_[i] ? weight(i, at.values[i]) : 0;
    return count;
  }

  /// Number of roots that one is of those looked at.
  int weight(Index i, Complex value) const {
    if (modes_[i] < 1 || modes_[i] > range_.resolved || !traits_.counts(value)) return 0;
    return traits_.lossy() ? 2 : 1;
  }

  /// Takes modes and states to the step's right sample; mode 0 for roots from outside. Returns how
  /// many unstable roots more there are for what passed the real axis.
  int move(const Step& step) {
    const bool partly = range_.count < 2 * traits_.dof;
    int passed = 0;
    const Index size = step.right->size();
    Roots modes(size, 0), every(size);
    Flags before(size, 0);
    for (Index i = 0; i < step.left->size(); ++i) {
      if (step.onto[i] < 0) continue;
      modes[step.onto[i]] = modes_[i];
      before[step.onto[i]] = unstable_[i];
      sweep_.untracked |=
          partly && modes_[i] <= range_.tracked && traits_.counts(step.start(i)) && step.lost(i);
      if (unstable_[i]) passed += weight(i, step.end(i)) - weight(i, step.start(i));
    }
    for (Index i = 0; i < size; ++i) every[i] = i;
    modes_ = std::move(modes);
    unstable_ = states(*step.right, every, before);
    for (Index i = 0; partly && i < size; ++i) {
      sweep_.untracked |= unstable_[i] && traits_.counts(step.right->values[i]) &&
                          (modes_[i] == 0 || modes_[i] > range_.tracked);
    }
    return passed;
  }

  /// Adds the crossings of a step; whether the search goes on.
  bool visit(const Step& step) {
    if (step.shortest()) scanned_ = scan(step);
    std::vector<AxisCrossing> found = crossings(step);
    unstable_count_ += move(step);
    if (sweep_.untracked) return false;
    int expected = unstable_count_;
    for (const AxisCrossing& crossing : found) expected += crossing.change;
    const int unstable = count_unstable(*step.right), missed = unstable - expected;
    if (missed % 2 != 0) {
      // Three roots that pass zero as one (two free joints), which the matching cannot show.
      Index least = 0;
      step.right->values.abs().minCoeff(&least);
      if (auto crossing = divergence(step, 0.5, missed, modes_[least])) found.push_back(*crossing);
    }
    while (!found.empty()) {
      const auto next = std::min_element(
          found.begin(), found.end(),
          [](const AxisCrossing& a, const AxisCrossing& b) { return a.speed < b.speed; });
      if ((next->speed > 0.0 || traits_.damped) && !is_known(*next)) {
        throw refusal(
            "a crossing near u = %.6g is not known to three digits: rounding hides the "
            "eigenvalue's real part",
            next->speed);
      }
      next->before = unstable_count_;
      sweep_.crossings.push_back(*next);
      unstable_count_ += next->change;
      if (range_.until_unstable && next->change > 0) return false;
      found.erase(next);
    }
    if (unstable_count_ != unstable) {
      throw refusal("%d unstable roots at u = %g, where the crossings found account for %d",
                    unstable, step.right->u, unstable_count_);
    }
    return true;
  }

  Scan scan(const Step& step) const {
    const Sample &left = *step.left, &right = *step.right;
    Scan found;
    found.after = states(right, step.onto, unstable_);
    found.leaving.assign(left.size(), 0);
    int turned = 0;
    for (Index i = 0; i < left.size(); ++i) {
      const Index j = step.onto[i];
      if (modes_[i] < 1 || modes_[i] > range_.resolved || j < 0) continue;
      const Complex start = step.start(i), end = step.end(i);
      const auto heavily_damped = [this](Complex value) {
        return !traits_.squared && value.real() < -heavy_damping * magnitude(value);
      };
      const bool stays =
          start == 0.0 || !traits_.lossy() || traits_.counts(start) == traits_.counts(end);
      if (stays && (start == 0.0 ? end : start).imag() < 0.0) continue;
      // What passes both axes in one step might pass the imaginary one on either side.
      if (!stays && found.after[i] != unstable_[i]) found.clear = false;
      if (modes_[i] > range_.certain && heavily_damped(start) && heavily_damped(end)) continue;
      found.roots.push_back(i);
      const bool real = start.imag() == 0.0 && end.imag() == 0.0;
      turned += real && found.after[i] != unstable_[i];
      if (left.u == 0.0 && (traits_.squared || step.meets[i] < 0)) {
        const double lost = std::max(right.noise[j], left.slope_noise[i] * step.length());
        const bool on_axis =
            std::abs(start.real()) <= left.noise[i] && !traits_.conservative && !traits_.squared;
        found.leaving[i] = start == 0.0 ? has_sign(right, j) && found.after[i]
                                        : on_axis && step.slopes[i].real() * step.length() > lost;
      }
      if (step.meets[i] >= 0) {
        found.clear = found.clear && is_clear_meeting(step, i);
      } else if (!traits_.squared || real) {
        scan_cubic(step, i, found);
      } else if (start != 0.0 && (start.imag() == 0.0) != (end.imag() == 0.0)) {
        found.clear = false;  // it met another
      }
    }
    // Two nu that seem to pass zero in one step may have met below and parted above it.
    if (traits_.squared && turned > 1 && left.u > 0.0) found.clear = false;
    return found;
  }

  /// Where the cubic of a root's real part passes zero, and whether it shows all that does.
  void scan_cubic(const Step& step, Index i, Scan& found) const {
    const Sample &left = *step.left, &right = *step.right;
    const Index j = step.onto[i];
    const double h = step.length(), a = step.start(i).real(), b = step.end(i).real();
    double slope = step.start_slope(i).real() * h, end_slope = step.end_slope(i).real() * h;
    double noise = std::max(left.noise[i], right.noise[j]);
    if (step.start(i) == 0.0) noise = infinite;
    // Slopes within their rounding say nothing, at any length: the line through both ends does.
    const bool hidden = std::abs(step.start_slope(i).real()) < left.slope_noise[i] ||
                        std::abs(step.end_slope(i).real()) < right.slope_noise[j];
    if (hidden) slope = end_slope = b - a;
    const double c = 3.0 * (b - a) - 2.0 * slope - end_slope, d = 2.0 * (a - b) + slope + end_slope;
    const auto cubic = [=](double t) { return a + t * (slope + t * (c + t * d)); };
    // The real part's own error; a little of the imaginary part's keeps it from being 0.
    double band = 2.0 * std::abs(b - a - 0.5 * (slope + end_slope)) + step.real_error[i] +
                  1e-4 * step.error[i];
    // On the axis all along, as in a span that guides part from all that takes energy: there two
    // roots meet and leave it, which tracking shows.
    const double largest =
        std::max({std::abs(a), std::abs(b), std::abs(slope), std::abs(end_slope)});
    if (hidden || largest <= noise) band = 0.0;

    struct Point {
      double at;
      bool positive;
    };
    std::vector<Point> points;
    const double turns = c * c - 3.0 * slope * d;
    const double far = c + std::copysign(std::sqrt(std::max(turns, 0.0)), c);
    for (const double t : {-slope / far, -far / (3.0 * d)}) {
      if (!(turns > 0.0 && t > 0.0 && t < 1.0)) continue;
      const double extremum = cubic(t);
      if (std::abs(extremum) <= band + noise && band > noise) found.clear = false;
      if (std::abs(extremum) > noise) points.push_back({t, extremum > 0.0});
    }
    std::sort(points.begin(), points.end(), [](Point p, Point q) { return p.at < q.at; });
    points.push_back({1.0, found.after[i] != 0});
    bool positive = unstable_[i] || found.leaving[i];
    double last = 0.0;
    for (const Point& point : points) {
      if (point.positive != positive) {
        const double low = cubic(last), high = cubic(point.at);
        // Without a change of sign one end lies in the noise.
        const double nearer = std::abs(low) < std::abs(high) ? last : point.at;
        const double at = low * high < 0.0 ? zero_between(cubic, last, point.at, 1e-15) : nearer;
        found.predicted.push_back({i, at, point.positive});
      }
      positive = point.positive;
      last = point.at;
    }
  }

  /// Whether the states before and after a meeting on the real axis show what passed.
  bool is_clear_meeting(const Step& step, Index i) const {
    const Index k = step.meets[i];
    const Complex a = step.start(i), b = step.start(k), c = step.end(i), d = step.end(k);
    const bool across = (a.imag() == 0.0) != (c.imag() == 0.0);
    if (traits_.squared) {  // on one side of zero, once
      const auto [low, high] = std::minmax({a.real(), b.real(), c.real(), d.real()});
      return a == 0.0 || (across && (low > 0.0 || high < 0.0));
    }
    // Whether the pair stays on one side of zero: half its sum is the centre, and the roots are no
    // further from it than at either end.
    const double reach = std::max(std::abs((a - b).real()), std::abs((c - d).real()));
    double least = infinite, most = -infinite;
    for (int p = 0; p <= 16; ++p) {
      const double total = (step.at(i, p / 16.0) + step.at(k, p / 16.0)).real();
      least = std::min(least, total);
      most = std::max(most, total);
    }
    if (most + reach < 0.0 || least - reach > 0.0) return true;
    // An imaginary pair that turns into opposite real roots, or back: at zero.
    const double opposite = std::abs((a + b).real()) + std::abs((c + d).real());
    return traits_.conservative && across && opposite < 1e-6 * (1.0 + std::abs(a) + std::abs(c));
  }

  /// Whether two growing real roots of a conservative system meet and go on as a pair: coupled-mode
  /// flutter after divergence, which crosses no axis.
  bool couple(const Step& step, Index i) const {
    const auto grows = [&](Index j) { return step.start(j).imag() == 0.0 && unstable_[j]; };
    return traits_.conservative && !traits_.squared && grows(i) && grows(step.meets[i]) &&
           step.end(i).imag() != 0.0;
  }

  /// Crossings within the step scanned last.
  std::vector<AxisCrossing> crossings(const Step& step) {
    Scan& scan = scanned_;
    std::vector<AxisCrossing> found;
    if (!scan.clear) {  // a shortest step: the states at its ends
      scan.predicted.clear();
      for (const Index i : scan.roots) {
        const bool before = unstable_[i] || scan.leaving[i], after = scan.after[i];
        if (before != after && step.meets[i] < 0) scan.predicted.push_back({i, 0.5, after});
      }
    }
    for (const Index i : scan.roots) {
      if (!scan.leaving[i]) continue;
      const Complex value(0.0, traits_.squared ? 0.0 : step.start(i).imag());
      const int change = value != 0.0 || step.end(i).imag() != 0.0 ? 2 : 1;
      double error = 0.0;
      if (value != 0.0 && traits_.damped) {  // its damping is within rounding
        error = (std::abs(step.start(i).real()) + step.left->noise[i]) / step.slopes[i].real();
      }
      found.push_back({0.0, value, change, modes_[i], error});
    }
    for (const Scan::Predicted& one : scan.predicted) {
      const bool off_axis = (one.rising ? step.end(one.root) : step.start(one.root)).imag() != 0.0;
      std::optional<AxisCrossing> met;
      if (off_axis && traits_.conservative) met = meeting(step, one.root, one.rising ? 2 : -2);
      AxisCrossing passed = met ? *met : polished(step, one);
      // An undamped root may leave the axis at rest slower than u, as with a fluid drawn from rest.
      if (step.left->u == 0.0 && !traits_.damped && !is_known(passed)) {
        const Complex value(0.0, std::abs(step.start(one.root).imag()));
        passed = {0.0, value, passed.change, passed.mode, least_unstable_speed(step, one.root)};
      }
      if (met || traits_.counts(passed.pair.value)) found.push_back(std::move(passed));
    }
    for (const Index i : scan.roots) {
      const Index k = step.meets[i];
      if (k < 0) continue;
      const int change = scan.after[i] + scan.after[k] - unstable_[i] - unstable_[k];
      const bool twice = std::find(scan.roots.begin(), scan.roots.end(), k) != scan.roots.end();
      const bool couples = change == 0 && couple(step, i);
      if ((change == 0 && !couples) || scan.leaving[i] || (twice && i > k)) continue;
      const bool odd = change % 2 != 0;  // one real root of the two passes zero
      auto passed = odd ? divergence(step, 0.5, change, modes_[i]) : std::nullopt;
      if (!odd && (traits_.squared || couples)) passed = meeting(step, i, change);
      const double middle = 0.5 * (step.left->u + step.right->u);
      const double imag = traits_.squared ? std::sqrt(step.start(i)).imag() : step.start(i).imag();
      const Complex value(0.0, odd ? 0.0 : std::abs(imag));
      found.push_back(passed ? *passed
                             : AxisCrossing{middle, value, change, modes_[i], step.length()});
    }
    // Two real roots that pass zero at one speed are one root, found twice.
    std::vector<double> still;
    for (const AxisCrossing& crossing : found) {
      if (crossing.value == 0.0 && crossing.speed > 0.0) still.push_back(crossing.speed);
    }
    std::sort(still.begin(), still.end());
    for (std::size_t i = 1; i < still.size(); ++i) {
      if (still[i] - still[i - 1] > 1e-11 * still[i]) continue;
      throw refusal("two divergences near u = %.9g cannot be distinguished", still[i - 1]);
    }
    return found;
  }

  /// Where det K(u) changes sign within the step, near its fraction t; none if it does not.
  std::optional<AxisCrossing> divergence(const Step& step, double t, int change, Index mode) {
    const double expected = step.left->u + t * step.length();
    const double slack = 1e-9 * (1.0 + step.right->u) + 0.1 * step.length();
    const double least = std::max(step.left->u - slack, 0.0), most = step.right->u + slack;
    for (const double where : {t, 0.0, 1.0, 0.5}) {
      const Pair near = spectrum_.null_pair(step.left->u + where * step.length(), {});
      // Outwards from what is expected, so that of two zeros in a step each root finds its own.
      auto found =
          pipedyn::divergence(spectrum_, near, expected, least, most, 1e-5 * step.length() + 1e-12);
      if (!found) continue;
      if (traits_.squared) found->pair = {};
      return AxisCrossing{found->speed, 0.0, change, mode, found->error, std::move(found->pair)};
    }
    return {};
  }

  /// The lowest speed, to a factor of 2, at which a root that is unstable at the end of a step from
  /// rest is so beyond rounding.
  double least_unstable_speed(const Step& step, Index root) {
    for (double u = step.right->u;; u *= 0.5) {
      const Pair lower = spectrum_.refined(0.5 * u, Pair{step.expected(root, 0.5 * u)});
      if (!(lower.value.real() > lower.uncertain)) return u;
    }
  }

  /// A crossing to rounding, by Newton's method on the model itself.
  AxisCrossing polished(const Step& step, const Scan::Predicted& predicted) {
    const Index root = predicted.root, mode = modes_[root];
    const bool real = traits_.squared || step.start(root).imag() == 0.0;
    const int change = (real ? 1 : 2) * (predicted.rising ? 1 : -1);
    if (real) {
      if (auto found = divergence(step, predicted.at, change, mode)) return *found;
    }
    if (traits_.squared) {
      const double u = bisected(step, root);
      return {u, 0.0, change, mode,
              u == step.left->u || u == step.right->u ? step.length() : 4e-16 * (1.0 + u)};
    }
    const double at = step.left->u + predicted.at * step.length();
    const double slack = 1e-9 * (1.0 + at) + 0.1 * step.length();
    Pair guess{step.expected(root, at)};
    if (step.left->right.size() > 0) guess.right = step.left->right.col(root);
    auto [u, pair] =
        newton(spectrum_, at, std::move(guess), step.left->u - slack, step.right->u + slack);
    // Where it ends without a crossing shows in where the step predicts the root.
    const auto astray = [&] {
      const double tolerance = 1e-6 * (1.0 + std::abs(pair.value));
      const double off = std::abs(pair.value - step.expected(root, u));
      return (pair.slope.real() > 0.0) != predicted.rising ||
             off > 4.0 * step.error[root] + tolerance || std::abs(pair.value.real()) > tolerance;
    };
    if (astray()) {
      u = bisected(step, root);
      const SharedSample at = take(u);
      pair = spectrum_.refined(u, at->pair(nearest(*at, step.expected(root, u))[0]));
    }
    if (!pair.converged()) {
      throw refusal(
          "the eigenvalue near %.6g%+.6gj that passes the axis at u = %g failed its residual check "
          "with %.1e",
          pair.value.real(), pair.value.imag(), u, pair.residual);
    }
    const Complex value(0.0, real ? 0.0 : std::abs(pair.value.imag()));
    return {u, value, change, mode, error_of(pair), std::move(pair)};
  }

  /// Where two roots meet on the axis and leave it, or come back to it: two pairs of a conservative
  /// system, or two nu. There the square of their difference is real, smooth in u and passes zero.
  std::optional<AxisCrossing> meeting(const Step& step, Index root, int change) {
    const Index other = step.meets[root];
    Complex centre;
    const Function square = [&](double u) {
      const double t = (u - step.left->u) / step.length();
      const Complex expected = other < 0
                                   ? step.at(root, t)  // of two that meet slopes are infinite
                                   : 0.5 * ((1.0 - t) * (step.start(root) + step.start(other)) +
                                            t * (step.end(root) + step.end(other)));
      const SharedSample at = take(u);
      const Roots near = nearest(*at, expected);
      const Complex one = at->values[near[0]], two = at->values[near[1]];
      centre = 0.5 * (one + two);
      return ((one - two) * (one - two)).real();
    };
    const double low = step.left->u, high = step.right->u;
    if (square(low) * square(high) > 0.0) return {};
    const double tolerance = 4e-16 * (1.0 + high);
    const double u = zero_between(square, low, high, tolerance), spread = 1e-3 * step.length();
    const double slope = std::abs(square(u + spread) - square(u - spread)) / (2.0 * spread);
    square(u);
    // Rounding of the roots enters through the slope of the squared difference.
    const double lost = 1e-14 * std::norm(centre);
    const double error = (slope > 0.0 ? lost / slope : step.length()) + tolerance;
    const Index twin = other < 0 ? step.reflected(root, change > 0) : other;
    const Index mode = twin < 0 ? modes_[root] : std::max(modes_[root], modes_[twin]);
    const double frequency =
        traits_.squared ? std::sqrt(std::max(-centre.real(), 0.0)) : std::abs(centre.imag());
    return AxisCrossing{u, {0.0, frequency}, change, mode, error};
  }

  /// The two roots of a sample nearest to a value.
  Roots nearest(const Sample& at, Complex value) const {
    Roots places(at.size());
    for (Index i = 0; i < at.size(); ++i) places[i] = i;
    std::partial_sort(places.begin(), places.begin() + std::min<Index>(2, at.size()), places.end(),
                      [&](Index i, Index k) {
                        return std::norm(at.values[i] - value) < std::norm(at.values[k] - value);
                      });
    return places;
  }

  /// Where the real part of the root nearest to the cubic changes its sign; an end if it does not.
  double bisected(const Step& step, Index root) {
    const Function real_part = [&](double u) {
      const SharedSample at = take(u);
      return at->values[nearest(*at, step.expected(root, u))[0]].real();
    };
    const double low = real_part(step.left->u), high = real_part(step.right->u);
    if (low * high >= 0.0) return std::abs(low) < std::abs(high) ? step.left->u : step.right->u;
    return zero_between(real_part, step.left->u, step.right->u, 1e-14);
  }

  Spectrum& spectrum_;
  const Traits& traits_;
  const Range& range_;
  const std::function<void()>& report_;
  Sweep sweep_;
  Roots modes_;     // of the left sample's roots, counted from rest, from 1; 0 for others
  Flags unstable_;  // the same, whether they are
  int unstable_count_ = 0;
  Scan scanned_;  // of the step looked at last
};

}  // namespace

Sweep crossings(Spectrum& spectrum, const Range& range, const std::function<void()>& report) {
  Sweep found = Search(spectrum, range, report).run();
  for (AxisCrossing& crossing : found.crossings) {
    if (crossing.pair.right.size() > 0) crossing.forms = spectrum.forms(crossing.pair);
  }
  return found;
}

}  // namespace pipedyn
