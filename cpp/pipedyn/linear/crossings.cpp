// SPDX-License-Identifier: MIT
#include "pipedyn/linear/crossings.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <tuple>

namespace pipedyn {

namespace {

/// Speed, in units of the range's scale, up to which a search for the first loss of stability looks
/// for divergences at first. Nearly all cantilevers flutter before, and of a heavy one the search
/// for divergences up to four times this speed takes longer than all else.
constexpr double nearest_end = 26.0;

bool is_known(double speed, double error) { return error <= largest_error * speed + 1e-12; }

/// The root that a growing real root of the pipe without loss factor becomes with it: the nearest
/// of the growing roots.
Complex nearest_growing(Complex growing, const Values& values) {
  Complex nearest(0.0, -1.0);
  double least = infinite;
  for (const Complex value : values) {
    if (!(value.real() > 0.0) || !(magnitude(value - growing) < least)) continue;
    nearest = value;
    least = magnitude(value - growing);
  }
  return nearest;
}

/// Value at x of the polynomial through values at some places, by Neville's scheme.
template <class Number>
Number through(const std::vector<double>& at, std::vector<Number> values, double x) {
  for (std::size_t degree = 1; degree < at.size(); ++degree) {
    for (std::size_t i = 0; i + degree < at.size(); ++i) {
      const double low = at[i], high = at[i + degree];
      values[i] = ((high - x) * values[i] + (x - low) * values[i + 1]) / (high - low);
    }
  }
  return values[0];
}

/// What a step shows. It looks at one root of each conjugate pair; roots that meet another on the
/// real axis are not followed by their cubics.
struct Scan {
  Roots roots;           // the roots looked at
  Flags leaving;         // whether a left root leaves the axis at rest to the right
  Flags after;           // whether a left root is unstable at the right end
  bool clear = true;     // whether the step shows all crossings
  int static_count = 0;  // `Search::static_count` of the right sample
  struct Predicted {
    Index root;
    double at;  // fraction of the step
    bool rising;
  };
  std::vector<Predicted> predicted;  // crossings, in order along each root
};

class Search {
 public:
  Search(Spectrum& spectrum, const Range& range, const std::function<void()>& report, Trace* trace)
      : spectrum_(spectrum),
        traits_(spectrum.traits),
        range_(range),
        report_(report),
        trace_(trace) {
    if (trace != nullptr) trace->clear();
  }

  /// first_alone: whether the search ends behind the first of several divergences, or at
  /// `nearest_end`; the result is none if it would have to go on there.
  std::optional<Sweep> run(bool first_alone) {
    try {
      // Of a conservative system the first divergence may be all that is asked for.
      const bool near = first_alone && !traits_.conservative;
      const double far = range_.max_speed, end = near ? nearest_end * range_.scale : far;
      divergences_ = spectrum_.without_loss().divergences(std::min(end, far), first_alone);
      if (end < far) divergences_.known_to = std::min(divergences_.known_to, end);
      if (traits_.conservative && range_.until_unstable) {
        if (ends_with_first_divergence()) return std::move(sweep_);
        if (divergences_.known_to < range_.max_speed) return {};
      }
      const SharedSample first = take(0.0);
      const double longest = spectrum_.longest_step(first->values) * range_.scale;
      const std::vector<double> speeds = samples(longest);
      Roots every(first->size());
      for (Index i = 0; i < first->size(); ++i) every[i] = i;
      rest_ = first->values;
      modes_ = rest_modes_ = ranked(*first);
      states(*first, every, Flags(every.size(), 0), unstable_);
      static_count_ = static_count(*first);
      sweep_.unstable_at_rest = unstable_count_ = count_unstable(*first) + static_count_;
      every.resize(std::min(first->size(), (traits_.squared ? 1 : 2) * range_.certain));
      const auto good = [this](const Step& step) {
        const bool last = step.shortest() || encloses(step);
        if (!last && !step.unambiguous) return false;
        scan(step, scanned_);
        return last || scanned_.clear;
      };
      track({[this](double u) { return take(u); },
             good,
             [this](const Step& step) { return visit(step); },
             {traits_.cluster(), 0.9, traits_.zero},
             longest},
            first, speeds, every);
    } catch (const NotConverged& error) {
      sweep_.failure = error.what();
    }
    const std::vector<AxisCrossing>& found = sweep_.crossings;
    const bool ended = sweep_.untracked || (!found.empty() && found.back().change > 0);
    if (divergences_.known_to < range_.max_speed && !ended) return {};
    return std::move(sweep_);
  }

 private:
  /// Speeds that are sampled at least: those of steps up to the longest, and of one short step
  /// about each divergence, within which no other divergence lies.
  std::vector<double> samples(double longest) const {
    const std::vector<Divergence>& all = divergences_.all;
    const int steps = std::max(1, static_cast<int>(std::ceil(range_.max_speed / longest)));
    std::vector<double> speeds;
    for (int i = 1; i <= steps; ++i) speeds.push_back(i * (range_.max_speed / steps));
    for (std::size_t i = 0; i < all.size(); ++i) {
      const double u = all[i].speed, before = i > 0 ? all[i - 1].speed : 0.0;
      double reach = std::min(about(all[i]), (u - before) / 3.0);
      if (i + 1 < all.size()) reach = std::min(reach, (all[i + 1].speed - u) / 3.0);
      std::erase_if(speeds, [=](double at) { return std::abs(at - u) <= reach; });
      speeds.insert(speeds.end(), {u - reach, u + reach});
    }
    std::sort(speeds.begin(), speeds.end());
    // A step beyond the known divergences might pass one without being short.
    std::erase_if(speeds, [&](double at) { return at >= divergences_.known_to; });
    return speeds;
  }

  /// The divergence within a step, if there is one.
  const Divergence* passed(const Step& step) const {
    for (const Divergence& one : divergences_.all) {
      if (one.speed > step.left->u && one.speed <= step.right->u) return &one;
    }
    return nullptr;
  }

  /// Half the length of the step about a divergence: long enough that the root that passes zero
  /// there has a sign at its ends.
  double about(const Divergence& one) const {
    const double most = std::max(0.99 * shortest_step, traits_.zero);
    const double least = std::max(1e-9, 10.0 * one.error / (1.0 + one.speed));
    const double size = traits_.squared ? std::sqrt(2.0 * traits_.zero) : 2.0 * traits_.zero;
    const double wanted = one.distance(size) / (1.0 + one.speed);
    return std::clamp(wanted, least, std::max(most, least)) * (1.0 + one.speed);
  }

  /// Whether a step is the short one about a divergence: nearer to it, the root that passes zero
  /// has no sign.
  bool encloses(const Step& step) const {
    const Divergence* const one = passed(step);
    return one != nullptr && step.length() <= 2.1 * about(*one);
  }

  /// The greatest number of roots of a conservative system that can grow. The number of negative
  /// eigenvalues of K is Krein's index: the number of growing real roots, plus twice that of
  /// growing pairs and twice that of pairs on the axis with negative energy.
  int most_unstable(double u) const {
    int negative = divergences_.negative_at_rest;
    for (const Divergence& one : divergences_.all) negative += one.speed < u ? one.multiplicity : 0;
    return negative;
  }

  /// Adds the first divergence as a crossing, if that ends the search: a conservative system whose
  /// K is definite at rest is stable until K is singular, so no root needs to be followed. Returns
  /// whether it does.
  bool ends_with_first_divergence() {
    const std::vector<Divergence>& all = divergences_.all;
    if (divergences_.negative_at_rest > 0) return false;
    if (all.empty()) return true;
    if (all[0].multiplicity > 1) return false;
    const SharedSample first = take(0.0);
    rest_ = first->values;
    rest_modes_ = ranked(*first);
    sweep_.crossings.push_back(of(all[0], 1, 0));
    return true;
  }

  /// A divergence as a crossing. Its mode in a conservative system is the one whose frequency at
  /// rest is nearest to the Rayleigh quotient of the null vector.
  AxisCrossing of(const Divergence& one, int change, Index mode) const {
    if (traits_.conservative && one.pair.right.size() > 0) {
      const Values squares = traits_.squared ? rest_ : rest_.square().eval();
      Index nearest = 0;
      (squares.real() + one.rest_square()).abs().minCoeff(&nearest);
      mode = rest_modes_[nearest];
    }
    return {one.speed, 0.0, change, mode, one.error, traits_.squared ? Pair{} : one.pair};
  }

  /// The sample at a speed, without roots that are always zero, so that a root that passes zero is
  /// not taken for one of them. At rest, roots within rounding of zero are set to zero, and without
  /// damping oscillating roots are set on the axis.
  SharedSample take(double u) {
    const std::shared_ptr<Sample> shared = spectrum_.unused_sample();
    Sample& at = *shared;
    const Index standing = spectrum_.standing();
    Sample& every = traits_.squared || standing > 0 ? all_ : at;
    // With lambda^2 the end of a sample may divide four roots of equal magnitude.
    spectrum_.sample(u, range_.count + (traits_.squared ? 2 : 0), every);
    report_();
    if (&every != &at) {
      choose(every, standing, kept_);
      every.take(kept_, at);
      at.u = u;
    }
    if (traits_.squared) {
      for (Index i = 0; i < at.size(); ++i) {
        const Complex value = at.values[i];
        at.values[i] = value * value;
        if (value.real() == 0.0 || value.imag() == 0.0) at.values[i].imag(0.0);
        at.slopes[i] = 2.0 * value * at.slopes[i];
      }
      for (Reals* const of : {&at.noise, &at.slope_noise, &at.signatures}) of->setZero(at.size());
    }
    for (Index i = 0; u == 0.0 && i < at.size(); ++i) {
      Complex& value = at.values[i];
      if (magnitude(value) < traits_.zero) value = 0.0;
      if (!traits_.squared && !traits_.damped && value.imag() != 0.0) value.real(0.0);
    }
    return shared;
  }

  /// Finds the roots of a sample that are looked at, without the first ones, which are always zero:
  /// where lambda^2 is tracked, one of lambda and -lambda.
  void choose(const Sample& every, Index standing, Roots& kept) const {
    kept.clear();
    bool twin = true;  // whether a zero is the second of two
    for (Index i = standing; i < every.size(); ++i) {
      const Complex value = every.values[i];
      if (value == 0.0) twin = !twin;
      const bool on_axis = value.real() == 0.0 && (value.imag() > 0.0 || (value == 0.0 && !twin));
      if (!traits_.squared || value.real() > 0.0 || on_axis) kept.push_back(i);
    }
    const std::size_t most = (range_.count + 1 - standing) / 2;
    if (traits_.squared && kept.size() > most) kept.resize(most);
  }

  /// Mode of each root at rest, in the order of frequency.
  Roots ranked(const Sample& first) const {
    if (!traits_.squared) {
      return modes_of(first.values, spectrum_.quotients(0.0, first), traits_);
    }
    Values roots(2 * first.size());
    roots << first.values.sqrt(), -first.values.sqrt();
    Roots modes = modes_of(roots, -roots.square().real(), traits_);
    modes.resize(first.size());
    return modes;
  }

  /// Whether it is known on which side of the axis a root lies.
  bool has_sign(const Sample& at, Index i) const {
    const Complex value = at.values[i];
    if (traits_.squared) return value.imag() != 0.0 || magnitude(value) >= traits_.zero;
    return at.signatures[i] != 0 ||  // it stays on the axis of a conservative system
           (std::abs(value.real()) > at.noise[i] && magnitude(value) >= traits_.zero);
  }

  /// Finds which of some roots of a sample are unstable: by the sign of Re lambda, or as before if
  /// it has no sign.
  void states(const Sample& at, const Roots& onto, const Flags& before, Flags& result) const {
    const Index size = static_cast<Index>(onto.size());
    result = before;
    for (Index i = 0; i < size; ++i) {
      const Complex value = at.values[onto[i]];
      if (has_sign(at, onto[i])) {
        result[i] = value.real() > 0.0 || (traits_.squared && value.imag() != 0.0);
        continue;
      }
      for (Index k = 0; k < size; ++k) {  // both roots of a pair have one state
        const Complex other = at.values[onto[k]];
        const bool same = other == value || other == std::conj(value);
        if (value.imag() != 0.0 && same) result[i] |= before[k];
      }
    }
  }

  /// Finds the states, at the right end of a step, of the left sample's roots. A root that passes
  /// zero at a divergence shows by the sign of a real root; otherwise it is the slowest root
  /// without a sign, whose state follows from K, or beside a free turn from its state before.
  void states_after(const Step& step, Flags& after) const {
    states(*step.right, step.onto, unstable_, after);
    const Divergence* const zero = passed(step);
    if (zero == nullptr || traits_.is_hysteretic()) return;
    const bool beside_turn = zero->pair.right.size() == 0 && zero->multiplicity == 1;
    if (zero->change() == 0 && !beside_turn) return;
    const bool grows = zero->change() > 0;
    Index slowest = -1;
    for (Index i = 0; i < step.left->size(); ++i) {
      const Index j = step.onto[i];
      if (step.end(i).imag() != 0.0) continue;
      if (has_sign(*step.right, j)) {
        if (after[i] != unstable_[i] && (beside_turn || (after[i] != 0) == grows)) return;
        continue;
      }
      const double size = magnitude(step.end(i));
      if (size <= step.right->noise[j]) continue;  // a root that stays at zero
      if (slowest < 0 || size < magnitude(step.end(slowest))) slowest = i;
    }
    if (slowest >= 0) after[slowest] = beside_turn ? !unstable_[slowest] : grows;
  }

  /// Number of unstable roots among the resolved modes of a sample.
  int count_unstable(const Sample& at) const {
    int count = 0;
    for (Index i = 0; i < at.size(); ++i) count += unstable_[i] ? weight(i, at.values[i]) : 0;
    return count;
  }

  /// Number of the pipe's roots, among the resolved modes, that one root of a sample counts for.
  int weight(Index i, Complex value) const {
    if (modes_[i] < 1 || modes_[i] > range_.resolved || !traits_.counts(value)) return 0;
    return traits_.is_hysteretic() ? 2 : 1;
  }

  /// Number of growing real roots of a pipe with a loss factor, which are those without it. A
  /// growing pair next to a growing real root is the same motion: then the pair is not counted in
  /// addition.
  int static_count(const Sample& at) const {
    if (!traits_.is_hysteretic()) return 0;
    Spectrum& without_loss = spectrum_.without_loss();
    const std::shared_ptr<Sample> lossless = without_loss.unused_sample();
    without_loss.sample(at.u, range_.count, *lossless);
    std::vector<Complex> growing;
    for (Index i = without_loss.standing(); i < lossless->size(); ++i) {
      const Complex value = lossless->values[i];
      if (value.imag() == 0.0 && value.real() > lossless->noise[i]) growing.push_back(value);
    }
    int count = 0;
    for (const Complex value : growing) {
      const Complex twin = nearest_growing(value, at.values);
      const auto nearer = [=](Complex one) {
        return std::abs(one - twin) < std::abs(value - twin);
      };
      const bool is_others = std::ranges::any_of(growing, nearer);
      count += traits_.counts(twin) && !is_others ? -1 : 1;
    }
    return count;
  }

  /// Finds the modes of the roots of a step's right sample, and whether they are unstable. Sees
  /// whether a root that is not tracked became unstable, or one that is tracked was lost.
  void move(const Step& step) {
    const Flags& after = scanned_.after;
    const bool partly = range_.count < 2 * traits_.dof;
    const Index size = step.right->size();
    Roots &modes = next_modes_, &every = every_;
    Flags &before = before_, &unstable = next_unstable_;
    modes.assign(size, 0);
    before.assign(size, 0);
    every.resize(size);
    for (Index i = 0; i < step.left->size(); ++i) {
      modes[step.onto[i]] = modes_[i];
      before[step.onto[i]] = after[i];
      sweep_.untracked |=
          partly && modes_[i] <= range_.tracked && traits_.counts(step.start(i)) && step.lost(i);
    }
    for (Index i = 0; i < size; ++i) every[i] = i;
    states(*step.right, every, before, unstable);
    for (Index i = 0; partly && i < size; ++i) {
      sweep_.untracked |= unstable[i] && traits_.counts(step.right->values[i]) &&
                          (modes[i] == 0 || modes[i] > range_.tracked);
    }
  }

  /// Adds the crossings of a step; returns whether the search goes on.
  bool visit(const Step& step) {
    if (trace_ != nullptr) trace_->emplace_back(step, modes_);
    move(step);
    if (sweep_.untracked) return false;
    std::vector<AxisCrossing> found = crossings(step);
    modes_.swap(next_modes_);
    unstable_.swap(next_unstable_);
    static_count_ = scanned_.static_count;
    int expected = unstable_count_;
    for (const AxisCrossing& crossing : found) expected += crossing.change;
    const int unstable = count_unstable(*step.right) + static_count_, missed = unstable - expected;
    const auto mode_of_least = [&] {
      Index least = 0;
      step.right->values.abs2().minCoeff(&least);
      return modes_[least];
    };
    if (const Divergence* const zero = passed(step)) {
      const int known = traits_.is_hysteretic() ? 0 : zero->change(),
                change = known == 0 ? missed : known;
      const int most = zero->multiplicity + (traits_.is_hysteretic() ? 2 : 0);
      const bool possible = std::abs(change) <= most && (change - most) % 2 == 0;
      if (possible && change != 0) found.push_back(of(*zero, change, mode_of_least()));
    } else if (traits_.is_hysteretic() && step.shortest() && missed != 0 && missed % 2 == 0) {
      if (missed < 0) {
        throw not_converged(
            "a growing motion ceases to oscillate near u = %g, where a loss factor says nothing "
            "of it: a pipe with hysteresis is known up to where it loses stability",
            step.right->u);
      }
      found.push_back({step.right->u, 0.0, missed, mode_of_least(), step.length()});
    }
    while (!found.empty()) {
      const auto next = std::min_element(
          found.begin(), found.end(),
          [](const AxisCrossing& a, const AxisCrossing& b) { return a.speed < b.speed; });
      if (!is_known(next->speed, next->error) && is_at_rest(*next)) {
        *next = {0.0, next->value, next->change, next->mode, next->speed + next->error};
      }
      if ((next->speed > 0.0 || traits_.damped) && !is_known(next->speed, next->error)) {
        throw not_converged(
            "a crossing near u = %.6g is not known to three digits: rounding hides the "
            "eigenvalue's real part",
            next->speed);
      }
      next->before = unstable_count_;
      const double beside = same_speed * (1.0 + next->speed);
      next->gyroscopic =
          traits_.conservative &&
          ((next->before == 0 && most_unstable(next->speed - beside) > 0) ||
           (next->before + next->change == 0 && most_unstable(next->speed + beside) > 0));
      sweep_.crossings.push_back(*next);
      unstable_count_ += next->change;
      if (range_.until_unstable && next->change > 0) return false;
      found.erase(next);
    }
    if (unstable_count_ != unstable) {
      throw not_converged("%d unstable roots at u = %g, where the crossings found account for %d",
                          unstable, step.right->u, unstable_count_);
    }
    return true;
  }

  void scan(const Step& step, Scan& found) const {
    const Sample &left = *step.left, &right = *step.right;
    const Divergence* const zero = passed(step);
    states_after(step, found.after);
    found.leaving.assign(left.size(), 0);
    found.roots.clear();
    found.predicted.clear();
    found.clear = true;
    found.static_count = 0;
    if (traits_.conservative && most_unstable(right.u) == 0) return;  // no root can grow
    int turned = 0;
    for (Index i = 0; i < left.size(); ++i) {
      const Index j = step.onto[i];
      if (modes_[i] < 1 || modes_[i] > range_.resolved) continue;
      const Complex start = step.start(i), end = step.end(i);
      const auto heavily_damped = [this](Complex value) {
        return !traits_.squared && value.real() < -heavy_damping * magnitude(value);
      };
      const bool stays =
          start == 0.0 || !traits_.is_hysteretic() || traits_.counts(start) == traits_.counts(end);
      if (stays && (start == 0.0 ? end : start).imag() < 0.0) continue;
      // A growing root that passes the real axis becomes a root of the pipe, or ceases to be one.
      if (!stays && (found.after[i] || unstable_[i])) found.clear = false;
      if (modes_[i] > range_.certain && heavily_damped(start) && heavily_damped(end)) continue;
      found.roots.push_back(i);
      const bool real = start.imag() == 0.0 && end.imag() == 0.0;
      if (left.u == 0.0 && (traits_.squared || step.meets[i] < 0)) {
        const double lost = std::max(right.noise[j], left.slope_noise[i] * step.length());
        const bool on_axis =
            std::abs(start.real()) <= left.noise[i] && !traits_.conservative && !traits_.squared;
        found.leaving[i] = start == 0.0 ? has_sign(right, j) && found.after[i]
                                        : on_axis && step.slopes[i].real() * step.length() > lost;
      }
      if (real && !found.leaving[i] && found.after[i] != unstable_[i]) ++turned;
      const bool turns = (start.imag() == 0.0) != (end.imag() == 0.0);
      if (turns && zero != nullptr) continue;  // this pair meets at zero
      if (step.meets[i] >= 0) {
        found.clear = found.clear && is_clear_meeting(step, i);
      } else if (!traits_.squared && !real) {
        scan_cubic(step, i, found);
      } else if (!real && start != 0.0 && turns) {
        found.clear = false;  // it met another root
      }
    }
    // Real roots pass zero only at divergences.
    found.static_count = static_count(right);
    if (found.static_count != static_count_ && zero == nullptr) found.clear = false;
    if (turned > (zero == nullptr ? 0 : zero->multiplicity)) found.clear = false;
  }

  /// Finds where the cubic of a root's real part passes zero, and whether that shows all crossings
  /// of the root.
  void scan_cubic(const Step& step, Index i, Scan& found) const {
    const Sample &left = *step.left, &right = *step.right;
    const Index j = step.onto[i];
    const double h = step.length(), a = step.start(i).real(), b = step.end(i).real();
    double slope = step.start_slope(i).real() * h, end_slope = step.end_slope(i).real() * h;
    double noise = std::max(left.noise[i], right.noise[j]);
    if (step.start(i) == 0.0) noise = infinite;
    // A slope within its rounding says nothing, unless the rounding is small against the change
    // within the step: then the line through both ends is taken instead, however short the step is.
    const double small = 1e-3 * std::max(std::abs(a), std::abs(b)) / h;
    const auto is_hidden = [=](Complex rate, double rounded) {
      return std::abs(rate.real()) < rounded && rounded > small;
    };
    const bool hidden = is_hidden(step.start_slope(i), left.slope_noise[i]) ||
                        is_hidden(step.end_slope(i), right.slope_noise[j]);
    if (hidden) slope = end_slope = b - a;
    const double c = 3.0 * (b - a) - 2.0 * slope - end_slope, d = 2.0 * (a - b) + slope + end_slope;
    const auto cubic = [=](double t) { return a + t * (slope + t * (c + t * d)); };
    // The error of the real part; a small share of that of the imaginary part keeps it from being
    // 0.
    double band = 2.0 * std::abs(b - a - 0.5 * (slope + end_slope)) + 1e-4 * step.error[i];
    // A root may be on the axis throughout, for instance in a span that guides separate from all
    // that takes energy. It leaves the axis only where two roots meet, which tracking shows.
    const double largest =
        std::max({std::abs(a), std::abs(b), std::abs(slope), std::abs(end_slope)});
    if (hidden || largest <= noise) band = 0.0;

    struct Point {
      double at;
      bool positive;
    };
    std::array<Point, 3> points;
    auto end = points.begin();
    const double turns = c * c - 3.0 * slope * d;
    const double far = c + std::copysign(std::sqrt(std::max(turns, 0.0)), c);
    for (const double t : {-slope / far, -far / (3.0 * d)}) {
      // Roots of a conservative system leave the axis where two of them meet, which tracking shows.
      if (!(turns > 0.0 && t > 0.0 && t < 1.0) || traits_.conservative) continue;
      const double extremum = cubic(t);
      if (std::abs(extremum) <= band + noise && band > noise) found.clear = false;
      if (std::abs(extremum) > noise) *end++ = {t, extremum > 0.0};
    }
    std::sort(points.begin(), end, [](Point p, Point q) { return p.at < q.at; });
    *end++ = {1.0, found.after[i] != 0};
    bool positive = unstable_[i] || found.leaving[i];
    double last = 0.0;
    for (const Point& point : std::span(points.begin(), end)) {
      if (point.positive != positive) {
        const double low = cubic(last), high = cubic(point.at);
        // If the cubic does not change its sign, one end is within rounding of zero.
        const double nearer = std::abs(low) < std::abs(high) ? last : point.at;
        const double at = low * high < 0.0 ? zero_between(cubic, last, point.at, 1e-15) : nearer;
        found.predicted.push_back({i, at, point.positive});
      }
      positive = point.positive;
      last = point.at;
    }
  }

  /// Whether the states before and after a meeting on the real axis show what passed zero.
  bool is_clear_meeting(const Step& step, Index i) const {
    const Index k = step.meets[i];
    const Complex a = step.start(i), b = step.start(k), c = step.end(i), d = step.end(k);
    const bool across = (a.imag() == 0.0) != (c.imag() == 0.0);
    if (traits_.squared) {  // both roots on one side of zero, one meeting
      const auto [low, high] = std::minmax({a.real(), b.real(), c.real(), d.real()});
      return a == 0.0 || (across && (low > 0.0 || high < 0.0));
    }
    // The pair stays on one side of zero if its centre, half the sum, is further from zero than the
    // roots are from the centre at either end of the step.
    const double reach = std::max(std::abs((a - b).real()), std::abs((c - d).real()));
    double least = infinite, most = -infinite;
    for (int p = 0; p <= 16; ++p) {
      const double total = (step.at(i, p / 16.0) + step.at(k, p / 16.0)).real();
      least = std::min(least, total);
      most = std::max(most, total);
    }
    if (most + reach < 0.0 || least - reach > 0.0) return true;
    // The exception is an imaginary pair that becomes two opposite real roots, or the reverse: they
    // meet at zero.
    const double opposite = std::abs((a + b).real()) + std::abs((c + d).real());
    return traits_.conservative && across && opposite < 1e-6 * (1.0 + std::abs(a) + std::abs(c));
  }

  /// Whether two growing real roots of a conservative system meet and continue as a pair: this is
  /// coupled-mode flutter after divergence, which crosses no axis.
  bool couple(const Step& step, Index i) const {
    const auto grows = [&](Index j) { return step.start(j).imag() == 0.0 && unstable_[j]; };
    return traits_.conservative && !traits_.squared && grows(i) && grows(step.meets[i]) &&
           step.end(i).imag() != 0.0;
  }

  /// Crossings within the step scanned last.
  std::vector<AxisCrossing> crossings(const Step& step) {
    Scan& scan = scanned_;
    std::vector<AxisCrossing> found;
    if (!scan.clear) {  // for a shortest step, by the states at its ends
      scan.predicted.clear();
      for (const Index i : scan.roots) {
        const bool before = unstable_[i] || scan.leaving[i], after = scan.after[i];
        const bool one_real = step.start(i).imag() == 0.0, other_real = step.end(i).imag() == 0.0;
        const bool by_zero = one_real != other_real && passed(step) != nullptr;
        if (before == after || step.meets[i] >= 0 || traits_.squared) continue;
        if (by_zero || (one_real && other_real)) continue;
        scan.predicted.push_back({i, 0.5, after});
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
      if (off_axis && traits_.conservative) {
        const int change = one.rising ? 2 : -2;
        met = meeting(step, one.root, change).value_or(somewhere(step, one.root, change));
      }
      const bool at_rest = step.left->u == 0.0 && !traits_.damped;
      AxisCrossing crossing = met ? *met : at_rest ? near_rest(step, one) : by_newton(step, one);
      if (met || traits_.counts(crossing.pair.value)) found.push_back(std::move(crossing));
    }
    for (const Index i : scan.roots) {
      const Index k = step.meets[i];
      if (k < 0) continue;
      const int change = scan.after[i] + scan.after[k] - unstable_[i] - unstable_[k];
      const bool twice = std::find(scan.roots.begin(), scan.roots.end(), k) != scan.roots.end();
      const bool couples = change == 0 && couple(step, i);
      if ((change == 0 && !couples) || scan.leaving[i] || (twice && i > k)) continue;
      if (change % 2 != 0) continue;  // one of two real roots passes zero, at a divergence
      const auto met = traits_.squared || couples ? meeting(step, i, change) : std::nullopt;
      found.push_back(met.value_or(somewhere(step, i, change)));
    }
    return found;
  }

  /// A crossing of which nothing is known but the step in which it lies.
  AxisCrossing somewhere(const Step& step, Index root, int change) const {
    const Complex value = traits_.squared ? std::sqrt(step.start(root)) : step.start(root);
    const double middle = 0.5 * (step.left->u + step.right->u);
    return {middle, {0.0, std::abs(value.imag())}, change, modes_[root], step.length()};
  }

  /// A crossing, in the step from rest, of a root that lies on the axis at rest because nothing
  /// damps it. The speed is halved until the root is on the other side of the axis. Where rounding
  /// hides the side below that speed, as for a pipe that aspirates fluid, the root leaves the axis
  /// at rest; this is known to a factor of 2 in speed.
  AxisCrossing near_rest(const Step& step, const Scan::Predicted& predicted) {
    const Index root = predicted.root;
    const int change = predicted.rising ? 2 : -2;
    const auto there = [&](double u) { return spectrum_.refined(u, Pair{step.expected(root, u)}); };
    for (double u = step.right->u;; u *= 0.5) {
      const Pair lower = there(0.5 * u);
      const double side = predicted.rising ? lower.value.real() : -lower.value.real();
      if (side > lower.uncertain) continue;
      if (!(side < -lower.uncertain)) {
        const Complex value(0.0, std::abs(step.start(root).imag()));
        return {0.0, value, change, modes_[root], u};
      }
      const Function real_part = [&](double at) { return there(at).value.real(); };
      const double at = zero_between(real_part, 0.5 * u, u, 4e-16 * (1.0 + u));
      Pair pair = there(at);
      const Complex value(0.0, std::abs(pair.value.imag()));
      return {at, value, change, modes_[root], error_of(pair), std::move(pair)};
    }
  }

  /// Whether a root of an undamped pipe, which is on the axis at rest, leaves the axis there: at
  /// half the speed of the crossing it is not certainly on the other side. Where growth begins like
  /// the cube of the speed, rounding hides it up to a speed that looks like a crossing and is none.
  bool is_at_rest(const AxisCrossing& crossing) {
    if (traits_.damped || crossing.value == 0.0) return false;
    if (crossing.error >= crossing.speed) return true;
    const Pair lower = spectrum_.refined(0.5 * crossing.speed, Pair{crossing.value});
    const double real = lower.value.real();
    return (crossing.change > 0 ? real : -real) >= -lower.uncertain;
  }

  /// A crossing to within rounding, by Newton's method on the model itself.
  AxisCrossing by_newton(const Step& step, const Scan::Predicted& predicted) {
    const Index root = predicted.root, mode = modes_[root];
    const int change = predicted.rising ? 2 : -2;
    const double at = step.left->u + predicted.at * step.length();
    const double slack = 1e-9 * (1.0 + at) + 0.1 * step.length();
    Pair guess{step.expected(root, at)};
    if (step.left->right.size() > 0) guess.right = step.left->right.col(root);
    auto [u, pair] =
        newton(spectrum_, at, std::move(guess), step.left->u - slack, step.right->u + slack);
    // Newton's method has failed where its root is far from the one that the step predicts.
    const auto has_failed = [&] {
      const double tolerance = 1e-6 * (1.0 + std::abs(pair.value));
      const double off = std::abs(pair.value - step.expected(root, u));
      return (pair.slope.real() > 0.0) != predicted.rising ||
             off > 4.0 * step.error[root] + tolerance || std::abs(pair.value.real()) > tolerance ||
             !is_known(u, error_of(pair));
    };
    double error = 0.0;
    if (has_failed()) {
      std::tie(u, error) = bisected(step, root);
      const SharedSample at = take(u);
      pair = spectrum_.refined(u, at->pair(nearest(*at, step.expected(root, u))[0]));
    }
    if (!pair.converged()) {
      throw not_converged(
          "the eigenvalue near %.6g%+.6gj that passes the axis at u = %g failed its residual check "
          "with %.1e",
          pair.value.real(), pair.value.imag(), u, pair.residual);
    }
    const Complex value(0.0, std::abs(pair.value.imag()));
    return {u, value, change, mode, error + error_of(pair), std::move(pair)};
  }

  /// The speed at which two roots meet on the axis and leave it, or come back to it: two pairs of a
  /// conservative system, or two values nu. There the square of their difference, which is real and
  /// smooth in u, passes zero.
  std::optional<AxisCrossing> meeting(const Step& step, Index root, int change) {
    const Index met = step.meets[root], other = met < 0 ? step.reflected(root, change > 0) : met;
    Complex centre;
    double rounding = 0.0;  // what rounding of the roots may change the square by
    const Function square = [&](double u) {
      const double t = (u - step.left->u) / step.length();
      const Complex expected = other < 0
                                   ? step.at(root, t)  // slopes are infinite where two roots meet
                                   : 0.5 * ((1.0 - t) * (step.start(root) + step.start(other)) +
                                            t * (step.end(root) + step.end(other)));
      const SharedSample at = take(u);
      const Roots& near = nearest(*at, expected);
      const Complex one = at->values[near[0]], two = at->values[near[1]];
      centre = 0.5 * (one + two);
      rounding = std::abs(one - two) * (at->noise[near[0]] + at->noise[near[1]]);
      return ((one - two) * (one - two)).real();
    };
    const double low = step.left->u, high = step.right->u;
    const double before = square(low), after = square(high);
    if (before * after > 0.0) return {};
    const double tolerance = 4e-16 * (1.0 + high);
    double u = zero_between(square, low, high, tolerance);
    const double left = std::abs(square(u));
    if (left > 1e-3 * std::max(std::abs(before), std::abs(after))) return {};  // it has a jump
    // Next to the meeting, roots are known only to the square root of their rounding. Polynomials
    // through values at speeds beside it give the speed of the meeting, and those of two degrees
    // its error.
    double error = step.length() + tolerance;
    const double reach = std::min({0.005 * step.length(), u - low, high - u});
    if (reach > 1e3 * tolerance) {
      const std::vector<double> beside{-1.0, -0.75, -0.5, 0.5, 0.75, 1.0},
          few{-1.0, -0.5, 0.5, 1.0};
      std::vector<double> squares;
      std::vector<Complex> centres;
      for (const double x : beside) {
        squares.push_back(square(u + reach * x));
        centres.push_back(centre);
      }
      const auto zero_of = [](const std::vector<double>& at, const std::vector<double>& values) {
        return zero_between([&](double x) { return through(at, values, x); }, -0.5, 0.5, eps);
      };
      if (squares[2] * squares[3] < 0.0) {
        const double x = zero_of(beside, squares);
        const double other_x = zero_of(few, {squares[0], squares[2], squares[3], squares[5]});
        u += reach * x;
        centre = through(beside, centres, x);
        // Rounding of the roots enters through the slope of the squared difference.
        const double slope = std::abs(squares[3] - squares[2]) / reach;
        error = reach * std::abs(x - other_x) + rounding / slope + tolerance;
      }
    }
    const Index mode = other < 0 ? modes_[root] : std::max(modes_[root], modes_[other]);
    const double frequency =
        traits_.squared ? std::sqrt(std::max(-centre.real(), 0.0)) : std::abs(centre.imag());
    return AxisCrossing{u, {0.0, frequency}, change, mode, error};
  }

  /// Indices of a sample's roots, of which the first two are the two nearest to a value.
  const Roots& nearest(const Sample& at, Complex value) {
    Roots& places = places_;
    places.resize(at.size());
    for (Index i = 0; i < at.size(); ++i) places[i] = i;
    std::partial_sort(places.begin(), places.begin() + std::min<Index>(2, at.size()), places.end(),
                      [&](Index i, Index k) {
                        return std::norm(at.values[i] - value) < std::norm(at.values[k] - value);
                      });
    return places;
  }

  /// The speed at which the real part of the root nearest to the cubic changes its sign; an end of
  /// the step if it does not, with the length of the step as its error.
  std::pair<double, double> bisected(const Step& step, Index root) {
    const Function real_part = [&](double u) {
      const SharedSample at = take(u);
      return at->values[nearest(*at, step.expected(root, u))[0]].real();
    };
    const double low = real_part(step.left->u), high = real_part(step.right->u);
    const double left = step.left->u, right = step.right->u;
    if (low * high >= 0.0) return {std::abs(low) < std::abs(high) ? left : right, right - left};
    return {zero_between(real_part, left, right, 1e-14), 0.0};
  }

  Spectrum& spectrum_;
  const Traits& traits_;
  const Range& range_;
  const std::function<void()>& report_;
  Trace* const trace_;
  Sweep sweep_;
  Divergences divergences_;
  Values rest_;       // roots of the sample at rest
  Roots rest_modes_;  // modes of these roots
  Roots modes_;       // modes of the left sample's roots, from 1; 0 for other roots
  Flags unstable_;    // whether roots of the left sample are unstable
  // Those of the right sample, and memory in which they are found.
  Roots next_modes_, every_;
  Flags next_unstable_, before_;
  // All roots of a sample of which some are looked at, those, and roots in another order.
  Sample all_;
  Roots kept_, places_;
  int unstable_count_ = 0, static_count_ = 0;
  Scan scanned_;  // what the step looked at last shows
};

}  // namespace

Sweep crossings(Spectrum& spectrum, const Range& range, const std::function<void()>& report,
                Trace* trace) {
  std::optional<Sweep> ended;
  if (range.until_unstable) ended = Search(spectrum, range, report, trace).run(true);
  return ended ? *std::move(ended) : *Search(spectrum, range, report, trace).run(false);
}

}  // namespace pipedyn
