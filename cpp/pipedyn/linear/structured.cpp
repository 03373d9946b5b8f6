// SPDX-License-Identifier: MIT
#include "pipedyn/linear/structured.hpp"

#include <algorithm>
#include <limits>
#include <numbers>
#include <numeric>
#include <tuple>

#include "pipedyn/linear/axis_roots.hpp"

namespace pipedyn {

namespace {

/// Residual beyond which vectors are computed in another way: most have 1e-16.
constexpr double small_residual = 1e-14;
/// Relative error of the speed of a crossing, by the determinant, beyond which the energy balance
/// computes the growth.
constexpr double faint_growth = 1e-8;
/// Least and greatest number of points on the upper half of a circle that counts roots inside. An
/// unknown root that lies outside by a factor f adds f^(-2 points): at most `outside`, if it lies
/// no nearer than the last known root.
constexpr Index least_arc_points = 8, most_arc_points = 128;
constexpr double outside = 1e-2;
/// Least ratio of the magnitudes of neighbouring roots between which a circle may pass: since the
/// known roots are subtracted, they may be near.
constexpr double least_gap = 1.002;
/// Most corrections of the roots of one speed as starts at another speed; roots that are not good
/// then get twice as many more (`correct`).
constexpr int most_near = 8;
/// Most corrections of the roots of another model as starts, since a few of them are far from the
/// roots of this model.
constexpr int most_assumed = 40;
/// Dense starts in flow are sums of modes at rest: half as many modes as roots are wanted, and this
/// many more. For a chain of 264 segments held at both ends that takes a seventh of the time.
constexpr Index modes_beyond = 12;
/// Ratio of the magnitudes of neighbouring roots beyond which a gap is as good as any; next to zero
/// roots it is infinite.
constexpr double widest_needed = 10.0;
/// Number of parts into which a range with more than one divergence is divided. Halves would have
/// zeros next to their circles and take more points than the parts that hold none (measured for
/// spans: twice as many as eight parts).
constexpr Index division = 8;
/// Ratio of the numbers of segments of successive chains between the coarsest and a long one: 5 and
/// 80 take as long, measured from 1,000 to 100,000 segments.
constexpr Index refinement = 20;

}  // namespace

Structured::Structured(const Traits& traits, std::shared_ptr<const Determinant> of,
                       double stiffness_size)
    : Eigenproblem(traits,
                   [of, stiffness_size, pencil = std::optional<Pencil>()](
                       double u, DenseOperator& to) mutable {
                     if (!pencil) pencil = of->matrices(stiffness_size);
                     (*pencil)(u, to);
                   }),
      of_(std::move(of)),
      zeros_at_rest_(pipedyn::roots_at_zero(*of_, 0.0)),
      zeros_in_flow_(pipedyn::roots_at_zero(*of_, shifts[0])) {}

Pairs Structured::at(double u, const ValuesRef& values, bool vectors) const {
  Pairs found;
  at(u, values, vectors, found);
  return found;
}

void Structured::at(double u, const ValuesRef& values, bool vectors, Pairs& found,
                    const std::vector<Index>& places) const {
  const bool own = vectors || traits.conservative;  // else nothing reads by_right
  const auto place = [&](Index i) { return places.empty() ? i : places[i]; };
  of_->pairs(u, values, vectors, own, false, found, places);
  Pairs& other = memory_.again;
  other.make_room(values.size());  // not only in the sample that first needs it
  // A pivot may be 0 at a root: vectors are then computed this far beside it, and are off as much.
  for (const double aside : {0.0, 1e-12}) {
    std::vector<Index>& poor = memory_.poor;
    poor.clear();
    poor.reserve(values.size());
    for (Index i = 0; i < values.size(); ++i) {
      const double residual = found.residual[place(i)];
      const bool good =
          aside == 0.0 ? residual <= small_residual && values[i] != 0.0 : std::isfinite(residual);
      if (!good) poor.push_back(i);
    }
    if (poor.empty()) break;
    if (aside == 0.0 && of_->is_pivoted()) continue;  // its vectors are always loaded
    auto again = room_in(memory_.found, poor.size());
    for (std::size_t k = 0; k < poor.size(); ++k) {
      again[k] = values[poor[k]] + aside * (1.0 + std::abs(values[poor[k]]));
    }
    of_->pairs(u, again, vectors, own, true, other);
    for (std::size_t k = 0; k < poor.size(); ++k) {
      const Index i = poor[k], to = place(i);
      if (values[i] != 0.0 && !(other.residual[k] < found.residual[to])) continue;
      found.put(to, other, k);
      found.values[to] = values[i];
    }
  }
}

/// Finds pairs of the given roots, corrected by their vectors as far as these allow: the first
/// entries of `found`, which may have more.
void Structured::refine_roots(double u, const Approximations& roots, bool vectors,
                              Pairs& found) const {
  auto values = room_in(memory_.values, roots.size());
  std::vector<Index>& moved = memory_.some;
  moved.resize(roots.size());
  for (std::size_t i = 0; i < roots.size(); ++i) values[i] = roots[i].value;
  at(u, values, vectors, found);
  std::iota(moved.begin(), moved.end(), 0);
  for (int times = 0; times < 3; ++times) {
    std::erase_if(moved, [&](Index i) {
      const double size = magnitude(found.corrections[i]);
      return roots[i].settled || !(size < 1e-9 * magnitude(values[i])) || size == 0.0;
    });
    if (moved.empty()) break;
    auto next = room_in(memory_.at, moved.size());
    for (std::size_t k = 0; k < moved.size(); ++k) {
      next[k] = values[moved[k]] += found.corrections[moved[k]];
    }
    at(u, next, vectors, found, moved);
  }
  for (std::size_t i = 0; i < roots.size(); ++i) {
    if (roots[i].settled && roots[i].value == 0.0) found.residual[i] = found.uncertain[i] = 0.0;
  }
  // By symmetry, roots without a partner are real, or on the imaginary axis.
  for (std::size_t i = 0; i < roots.size(); ++i) {
    Complex& value = found.values[i];
    if (is_squared(u) && std::abs(value.real()) <= found.uncertain[i]) value.real(0.0);
    const bool is_real = roots[i].alone && !traits.is_hysteretic();
    if (is_real && std::abs(value.imag()) <= found.uncertain[i]) value.imag(0.0);
  }
}

/// Whether none of the `least` lowest roots is missing; false also where that is unknown. A circle
/// about zero passes through the first wide gap beyond these roots; if roots are paired its upper
/// half shows all. On it, the mean of lambda times (log-derivative less the known roots' part) is
/// the number of missing roots.
bool Structured::has_lowest(double u, const Approximations& roots, std::size_t least) const {
  const auto size = [&](std::size_t k) { return magnitude(roots[k].value); };
  double widest = 1.0, radius = 0.0;
  for (std::size_t k = least; k < roots.size(); ++k) {
    widest = std::max(widest, std::min(size(k) / size(k - 1), widest_needed));
  }
  if (!(widest > least_gap)) return false;
  for (std::size_t k = least; radius == 0.0 && k < roots.size(); ++k) {
    if (!(size(k) / size(k - 1) > 0.5 * (1.0 + widest))) continue;
    radius = size(k - 1) > 0.0 ? std::sqrt(size(k) * size(k - 1)) : 0.5 * size(k);
  }
  const double apart = std::log(magnitude(roots.back().value) / radius);
  const auto half = static_cast<Index>(std::ceil(-0.5 * std::log(outside) / apart));
  for (Index arc = std::clamp(half, least_arc_points, most_arc_points); arc <= most_arc_points;
       arc *= 2) {
    auto points = room_in(memory_.at, traits.is_hysteretic() ? 2 * arc : arc);
    for (Index i = 0; i < points.size(); ++i) {
      points[i] = std::polar(radius, std::numbers::pi * (i + 0.5) / static_cast<double>(arc));
    }
    const auto rates = pipedyn::log_derivatives(*of_, u, points, roots, memory_);
    if (std::abs((points * rates).mean().real()) < 0.05) return true;
  }
  return false;
}

bool Structured::from(Approximations& roots, double u, Index count, bool vectors, int most,
                      Pairs& found) {
  if (!correct(*of_, u, roots, memory_, most)) return false;
  separate(*of_, u, is_squared(u), roots, memory_);
  sort_by_size(roots, memory_);
  std::size_t next = 0;
  for (Index number = 0; number < count; ++next) {
    if (next == roots.size()) return false;
    number += roots[next].alone ? 1 : 2;
  }
  const bool every = roots_in(roots) >= 2 * traits.dof;
  if (!(every ? has_all(*of_, u, roots, memory_) : has_lowest(u, roots, next))) return false;
  Pairs& all = memory_.refined;
  refine_roots(u, roots, vectors, all);
  for (std::size_t i = 0; i < roots.size(); ++i) {
    const Complex slope = all.slopes[i];
    roots[i].settled = roots[i].value == 0.0;
    roots[i].slope = roots[i].settled || !std::isfinite(std::norm(slope)) ? 0.0 : slope;
  }
  memory_.some.resize(roots.size());
  std::iota(memory_.some.begin(), memory_.some.end(), 0);
  if (!traits.is_hysteretic()) join_conjugates(roots, all.values, memory_.some);
  all.noise = all.slope_noise = all.signatures = all.uncertain;  // room for those of a sample
  if (!with_conjugates(roots, count, found)) return false;
  keep(u, roots, most_near);
  return true;
}

void Structured::keep(double u, Approximations& roots, int most) {
  std::ranges::rotate(memory_.samples, memory_.samples.begin() + 1);
  Known& latest = memory_.samples.back();
  std::tie(latest.u, latest.most) = std::tie(u, most);
  latest.roots.swap(roots);
}

/// The `count` lowest of the refined roots `memory_.some` and of the conjugates that they imply,
/// sorted. Returns false if roots are paired and one of these is complex without a conjugate.
bool Structured::with_conjugates(const Approximations& roots, Index count, Pairs& result) const {
  const Pairs& found = memory_.refined;
  const bool paired = !traits.is_hysteretic();
  std::vector<Complex>& values = memory_.both;
  std::vector<Index>&order = memory_.order, &which = memory_.which, &from = memory_.from;
  for (auto* const one : {&from, &which}) one->clear();
  values.clear();
  for (std::size_t i = 0; i < roots.size(); ++i) {
    const Complex refined = found.values[memory_.some[i]];
    const Complex value(refined.real() + 0.0, refined.imag() + 0.0);  // -0 is 0
    values.push_back(value);
    from.push_back(i);
    if (roots[i].alone || value.imag() == 0.0) continue;
    values.push_back(std::conj(value));
    from.push_back(i);
  }
  order = by_size(Eigen::Map<const Values>(values.data(), values.size()), std::move(order));
  if (static_cast<Index>(order.size()) < count) return false;
  order.resize(count);
  for (const Index i : order) which.push_back(memory_.some[from[i]]);
  found.take(which, result);
  for (Index k = 0; k < count; ++k) {
    const Complex value = values[order[k]];
    if (paired && roots[from[order[k]]].alone && value.imag() != 0.0) return false;
    if (value.imag() == std::exchange(result.values[k], value).imag()) continue;
    for (Values* const of : {&result.slopes, &result.by_left, &result.by_right}) {
      (*of)[k] = std::conj((*of)[k]);
    }
    for (ComplexTable* const of : {&result.right, &result.left}) {
      of->col(k) = of->col(k).conjugate();
    }
  }
  return true;
}

Approximations Structured::starts_of(const DenseOperator& p, double u,
                                     const std::optional<Modes>& modes) const {
  return modes ? modal_roots(p, *modes, traits.loss) : dense_roots(p, is_squared(u));
}

const Structured::Known* Structured::nearest_known(double u) const {
  const auto apart = [u](const Known& one) { return std::abs(u - one.u); };
  const auto near = std::ranges::min_element(memory_.samples, {}, apart);
  return near->u == infinite ? nullptr : &*near;
}

void Structured::reuse(Spectrum& other) {
  auto* const same = dynamic_cast<Structured*>(&other);
  if (same == nullptr || same == this || same->traits.dof != traits.dof) return;
  Eigenproblem::reuse(other);
  std::swap(memory_, same->memory_);
  for (Known& one : memory_.samples) one.u = infinite;
  of_->reuse(*same->of_);
}

bool Structured::from_known(double u, Index count, bool vectors, Pairs& found) {
  const Known* const near = nearest_known(u);
  const auto is_zero = [](const Approximation& one) { return one.settled; };
  if (near == nullptr || roots_in(near->roots) < count) return false;
  if (std::ranges::count_if(near->roots, is_zero) != roots_at_zero(u)) return false;
  Approximations& starts = memory_.starts;
  expected(near->roots, u - near->u, traits.cluster(), !traits.is_hysteretic(), starts, memory_);
  return from(starts, u, count, vectors, near->most, found);
}

bool Structured::by_recursion(double u, Index count, bool vectors, Pairs& found) {
  const Index n = of_->size(), zeros = roots_at_zero(u), coarsest = of_->enough_for(count);
  const bool every = count >= 2 * traits.dof;
  const Index wanted = count + 6 + 2 * of_->held();  // further roots that show a gap
  if (from_known(u, count, vectors, found)) return true;
  // Roots that are too far away are followed half way first.
  const Known* const near = nearest_known(u);
  const bool is_near = near != nullptr && from_known(0.5 * (near->u + u), count, false, found);
  if (is_near && from_known(u, count, vectors, found)) return true;
  for (Index size = coarsest;; size *= 3) {
    const bool own = 2 * size > n || (u == 0.0 && knows_modes());
    if ((own ? n : size) > dense_limit) return false;
    Approximations starts;
    if (!own) {
      DenseOperator coarse;
      of_->coarser(size)->matrices(1.0)(u, coarse);
      starts = starts_of(coarse, u, u == 0.0 ? coarse.undamped_modes() : std::nullopt);
    } else if (u == 0.0 && every && is_squared(u)) {  // no vectors are needed
      const DenseOperator p = of_->free_at_rest();
      const std::optional<Modes> modes = p.undamped_modes(false);
      starts = modes ? modal_roots(p, *modes, 0.0) : dense_roots(Eigenproblem::at(u), true);
    } else if (u == 0.0) {
      starts = starts_of(Eigenproblem::at(u), u, modes_at_rest());
    } else {
      const DenseOperator& p = Eigenproblem::at(u);
      const Index some = wanted / 2 + modes_beyond;
      const bool few = knows_modes() && 4 * some < 3 * traits.dof && modes_at_rest();
      starts = few ? dense_roots(p.within(modes_at_rest()->vectors, some), is_squared(u))
                   : dense_roots(p, is_squared(u));
    }
    if (!every) {
      while (roots_in(starts) > wanted) starts.pop_back();
    }
    put_zeros(starts, zeros);
    if (own && every) {
      add_stiff(*of_, traits.dof, u, starts);
    } else if (!own) {
      for (Index finer = refinement * size; refinement * finer < 2 * n; finer *= refinement) {
        correct(*of_->coarser(finer), u, starts, memory_);
      }
    }
    if (from(starts, u, count, vectors, most_corrections, found)) return true;
    if (own) return false;
  }
}

void Structured::lowest(double u, Index count, bool left, bool high, Pairs& found) {
  const auto good = [](const Pairs& pairs) { return pairs.converged().count(); };
  count = std::min(count, 2 * traits.dof);
  factorised_ += 2;
  const bool is_known = by_recursion(u, count, high || traits.damped, found);
  // At rest nothing grows without damping. In flow these roots are as accurate as those of any
  // energy balance.
  if (is_known && !traits.damped) found.by_left.setZero();
  if (is_known && (good(found) == count || traits.dof > dense_limit)) return;
  if (traits.dof > dense_limit)
    throw NotConverged(
        "eigenvalues are too close to be told apart: ask for fewer, or fewer segments");
  Pairs dense;
  Eigenproblem::lowest(u, count, left, high, dense);
  if (!is_known || good(found) < good(dense)) found = std::move(dense);
}

void Structured::assume(double u, const Values& roots) {
  Approximations& starts = memory_.starts;
  starts.clear();
  for (const Complex value : roots) {
    const bool alone = traits.is_hysteretic() || value.imag() == 0.0;
    if (value.imag() >= 0.0 || alone) starts.push_back({value, alone, value == 0.0});
  }
  keep(u, starts, most_assumed);
}

std::vector<double> Structured::numbers() const {
  std::vector<double> found = of_->numbers();
  if (!found.empty()) found.push_back(traits.damped ? 1.0 : 0.0);
  return found;
}

bool Structured::all_roots(double u, Values& values) {
  Approximations& roots = memory_.starts;
  roots.clear();
  for (const Complex start : values) roots.push_back({start, start.imag() == 0.0});
  factorised_ += 2;
  const bool found = zeros_in_flow_ == 0 && roots_in(roots) == 2 * traits.dof &&
                     correct(*of_, u, roots, memory_, most_near) &&
                     roots_in(roots) == 2 * traits.dof && has_all(*of_, u, roots, memory_);
  if (!found || static_cast<Index>(roots.size()) != values.size()) return false;
  for (Index i = 0; i < values.size(); ++i) values[i] = roots[i].value;
  return true;
}

void Structured::assess(double u, Pairs& pairs) {
  if (pairs.uncertain.size() > 0) return;
  const Index count = pairs.values.size();
  if (traits.dof <= dense_limit) {
    Eigenproblem::assess(u, pairs);
    if (pairs.left.cols() == 0) return;
  } else {  // what recursions do not give is unknown
    pairs.uncertain = Reals::Constant(count, infinite);
    for (Values* const one : {&pairs.slopes, &pairs.by_left, &pairs.by_right}) {
      *one = Values::Constant(count, std::numeric_limits<double>::quiet_NaN());
    }
  }
  const Pairs better = at(u, pairs.values, false);
  for (Index i = 0; i < count; ++i) {
    if (!has_converged(better.values[i], better.residual[i])) continue;
    pairs.uncertain[i] = better.uncertain[i];
    pairs.slopes[i] = better.slopes[i];
  }
}

std::optional<Forms> Structured::forms(const Pair& pair) const { return of_->forms(pair); }

void Structured::rayleigh(double u, const RealsRef& frequencies, const ColumnsRef& vectors,
                          Rayleigh& found) {
  std::optional<Rayleigh> known = of_->rayleigh(u, frequencies, vectors);
  if (!known) return Eigenproblem::rayleigh(u, frequencies, vectors, found);
  found = *std::move(known);
}

Reals Structured::quotients(double u, const Pairs& pairs) {
  if (is_squared(u) || pairs.right.size() == 0) return Eigenproblem::quotients(u, pairs);
  return of_->quotients(u, pairs.right);
}

Pair Structured::refined(double u, const Pair& guess, bool vectors) {
  Complex value = guess.value, rate;
  for (int step = 0; step < 8; ++step) {
    of_->log_derivatives(u, Eigen::Map<Values>(&value, 1), Values(), Eigen::Map<Values>(&rate, 1));
    const Complex change = 1.0 / rate;
    if (!std::isfinite(std::norm(change))) break;
    value -= change;
    if (std::abs(change) <= 1e-8 * std::abs(value)) break;  // convergence is quadratic
  }
  Approximations& root = memory_.starts;
  root.assign(1, {value});
  Pairs& found = memory_.one;
  refine_roots(u, root, vectors, found);
  // Where the flow does hardly any work on a mode, as on one whose tip is held by a mass, its
  // energy balance gives a more accurate growth. It takes O(n^2), so it is used only there.
  const bool hidden = found.uncertain[0] > faint_growth * u * std::abs(found.slopes[0].real());
  if (hidden && traits.dof <= dense_limit) {
    if (!vectors) refine_roots(u, root, true, found);
    balance(u, found);
  }
  return found.pair(0);
}

/// Replaces the growth by that of the energy balance of vectors, where that is more accurate than
/// the determinant.
void Structured::balance(double u, Pairs& pairs) {
  pairs.by_left = of_->by_lambda(u, pairs);
  improve(u, pairs, pairs.uncertain);
}

void Structured::find_growth(double u, Pairs& found) {
  Eigenproblem::find_growth(u, found);
  // The recursion of a chain has no difference of nearly equal numbers, so no energy balance is
  // better.
  const bool on_axis = u == 0.0 && !traits.damped;
  if (on_axis || !of_->is_pivoted() || traits.dof > dense_limit) return;
  std::vector<Index> hidden;
  for (Index i = 0; i < found.size(); ++i) {
    const Complex value = found.values[i];
    const bool own = value.imag() > 0.0 || (value.imag() < 0.0 && traits.is_hysteretic());
    if (own && std::abs(value.real()) <= found.noise[i]) hidden.push_back(i);
  }
  if (hidden.empty()) return;
  Pairs better = at(u, found.values(hidden), true);
  balance(u, better);
  for (std::size_t k = 0; k < hidden.size(); ++k) {
    const Complex value = found.values[hidden[k]];
    if (!(better.uncertain[k] < found.noise[hidden[k]])) continue;
    for (Index i = 0; i < found.size(); ++i) {
      const bool twin = found.values[i] == std::conj(value) && !traits.is_hysteretic();
      if (i != hidden[k] && !twin) continue;
      found.values[i].real(better.values[k].real());
      found.noise[i] = better.uncertain[k];
    }
  }
}

namespace {

/// How near to a whole number a mean of log-derivatives must be to count as a number of zeros: the
/// error falls like a power of the number of points, and a mean is as near as this by chance once
/// in 500.
constexpr double near_whole = 1e-3;

/// Number of zeros of the determinant in the disc about the real interval from low to high: the
/// mean of (u - centre) d log det / du on its circle, whose upper half shows all. None where a zero
/// lies too near the circle.
std::optional<int> zeros_within(const Determinant& of, double low, double high) {
  const double centre = 0.5 * (low + high), radius = 0.5 * (high - low);
  for (Index points = 8; points <= 128; points *= 2) {
    Values arms(points);
    for (Index i = 0; i < points; ++i) {
      arms[i] = std::polar(radius, std::numbers::pi * (i + 0.5) / static_cast<double>(points));
    }
    const double number = (arms * of.static_determinants(centre + arms).slope).real().mean();
    if (std::abs(number - std::round(number)) < near_whole) {
      return static_cast<int>(std::lround(number));
    }
  }
  return {};
}

}  // namespace

/// det K at some speeds, or very near a speed at which a pivot is 0.
StaticDeterminants Structured::static_determinants(Reals u) const {
  for (int tries = 0;; ++tries) {
    StaticDeterminants found = of_->static_determinants(u);
    const auto lost = found.slope.real().isNaN();
    if (tries == 3 || !lost.any()) return found;
    u += lost.cast<double>() * (eps * (1.0 + u));
  }
}

/// Adds ranges that hold divergences. A range without zeros in its disc is left out; a range with a
/// single zero is confirmed by the sign of det K at its ends; other ranges are divided.
void Structured::isolate(const Bracket& range, bool first, std::vector<Bracket>& found) const {
  const auto& [low, high, before, after, none] = range;
  const double length = high - low;
  const bool changes = !(before * after > 0.0), shortest = length < same_speed * (1.0 + high);
  const std::optional<int> number = zeros_within(*of_, low, high);
  if (number == 0 && !changes) return;
  if (changes && (number == 1 || shortest)) {
    found.push_back({low, high, before, after, 1});
  } else if (shortest) {
    if (number.value_or(0) > 1) found.push_back({low, high, before, after, *number});
  } else {
    const Reals ends = Reals::LinSpaced(division + 1, low, high);
    const Reals signs = static_determinants(ends.segment(1, division - 1)).sign;
    const auto sign = [&](Index i) {
      return i == 0 ? before : i == division ? after : signs[i - 1];
    };
    for (Index i = 0; i < division && !(first && found.size() > 1); ++i) {
      isolate({ends[i], ends[i + 1], sign(i), sign(i + 1)}, first, found);
    }
  }
}

/// The zero of det K in a range with one zero, by Newton's method, kept in the range.
double Structured::zero_in(const Bracket& range) const {
  double low = range.low, high = range.high, u = 0.5 * (low + high), step = infinite;
  for (int steps = 1; steps < 100 && std::abs(step) > 4e-16 * (1.0 + u); ++steps) {
    const StaticDeterminants at = static_determinants(Reals::Constant(1, u));
    (at.sign[0] * range.before > 0.0 ? low : high) = u;
    const bool is_slow = steps % 8 == 0 && std::abs(step) > 1e-6 * (1.0 + u);
    const double slope = at.slope[0].real();
    double next = std::isfinite(slope) ? u - 1.0 / slope : u;  // det K is 0
    if (!(next >= low && next <= high) || is_slow) next = 0.5 * (low + high);
    step = next - u;
    u = next;
  }
  return u;
}

Divergences Structured::divergences(double max_speed, bool first) {
  // With panels, motions that K leaves free give no pivot of the order of lambda at a complex
  // speed.
  if (zeros_in_flow_ > 0 && of_->is_pivoted()) return Eigenproblem::divergences(max_speed, first);
  Divergences result;
  if (traits.conservative) result.negative_at_rest = of_->negative_at_rest();
  ++factorised_;
  if (of_->thrust() == 0.0) return result;
  const Reals ends{{least_speed, 1.0001 * max_speed}};
  const Reals signs = static_determinants(ends).sign;
  std::vector<Bracket> ranges;
  isolate({ends[0], ends[1], signs[0], signs[1]}, first, ranges);
  for (const Bracket& one : ranges) {
    const bool is_single = one.zeros == 1;
    const double u = is_single ? zero_in(one) : 0.5 * (one.low + one.high);
    if (u > max_speed) continue;
    result.all.push_back(is_single ? divergence_at(u)
                                   : Divergence{u, one.high - one.low, {}, one.zeros});
  }
  if (first && result.all.size() > 1) {
    result.known_to = 0.5 * (result.all[0].speed + result.all[1].speed);
  }
  return result;
}

std::optional<Divergence> Structured::divergence_near(double guess, double reach) {
  if (zeros_in_flow_ > 0 && of_->is_pivoted()) return Eigenproblem::divergence_near(guess, reach);
  const Reals ends{{std::max(guess - reach, least_speed), guess + reach}};
  const Reals signs = static_determinants(ends).sign;
  if (signs[0] * signs[1] > 0.0) return {};
  return divergence_at(zero_in({ends[0], ends[1], signs[0], signs[1]}));
}

/// The divergence at a speed where K is singular: null vectors of K, and the error of the speed.
Divergence Structured::divergence_at(double u) const {
  const double tolerance = 4e-16 * (1.0 + u);
  if (roots_at_zero(u) > 0) {
    // The vectors here are those of the roots at zero. Rounding scatters the zeros at which
    // Newton's method would arrive from neighbouring numbers u.
    const Reals beside = u + eps * (1.0 + u) * Reals::LinSpaced(9, -4.0, 4.0);
    const Reals off = (beside - static_determinants(beside).slope.real().inverse() - u).abs();
    return {u, off.isNaN().select(0.0, off).maxCoeff() + tolerance};
  }
  Pairs found;
  of_->pairs(u, Values::Zero(1), true, false, false, found);
  // Where two guides form a clamp, nothing beyond it moves with a vector that starts at the first
  // one.
  if (!(found.residual[0] <= small_residual)) found = at(u, Values::Zero(1), true);
  Pair pair = found.pair(0);
  pair.uncertain *= std::abs(pair.by_value);
  if (!of_->is_pivoted()) {
    // Where the part beyond a joint is singular by itself, as half of a guided pipe is, rounding
    // scales the parts of a vector differently: so the mean of the vectors at two very near speeds
    // is taken.
    const double apart = 1e-6 * (1.0 + u);
    const Pairs below = at(u - apart, Values::Zero(1), true);
    const Pairs above = at(u + apart, Values::Zero(1), true);
    const auto mean = [](const ComplexTable& a, const ComplexTable& b) -> ComplexVector {
      return (a.col(0) + std::copysign(1.0, a.col(0).dot(b.col(0)).real()) * b.col(0)).normalized();
    };
    pair.right = mean(below.right, above.right);
    pair.left = mean(below.left, above.left);
  }
  const Forms of = *forms(pair);
  pair.by_value = u * of.velocity + of.damping;
  pair.slope = 2.0 * of_->thrust() * u * of.flux;
  const double rate = std::abs(pair.slope);
  const double error = (rate > 0.0 ? pair.uncertain / rate : infinite) + tolerance;
  return {u, error, std::move(pair), 1, of.mass.real()};
}

}  // namespace pipedyn
