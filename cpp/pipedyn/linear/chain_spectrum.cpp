// SPDX-License-Identifier: MIT
#include "pipedyn/linear/chain_spectrum.hpp"

#include <algorithm>
#include <numeric>

#include "pipedyn/vector/levels.hpp"
#include "pipedyn/vector/scratch.hpp"

namespace pipedyn {

namespace {

using Values = std::vector<Complex>;

constexpr double epsilon = std::numeric_limits<double>::epsilon();
/// Relative rounding of an entry of T, with room for what the products with it add.
constexpr double entry_rounding = 8.0 * epsilon;
/// Joint angles lose eps |lambda|^2 of a root: LAPACK's beyond this |lambda| are no starts.
constexpr double no_start = 1e7;
/// Where the log-derivative counts roots: this far from the real axis, in rad, near which the
/// unstable ones of a buckled pipe lie, and from the imaginary one.
constexpr double ray = 0.3;
/// |lambda (d log det P / dlambda - sum)| above which a root is missing: rounding leaves 1e-9 of
/// 2000 segments, and one root in place of another 1e-6 where they differ by 1e-6.
constexpr double nothing_missing = 1e-6;
/// Residual of T beyond which vectors are tried another way: most have 1e-16.
constexpr double small_residual = 1e-14;
/// Points on the upper half of the circle: a root outside by a quarter adds 1.25^-32 = 1e-3.
constexpr int circle_points = 16;
/// Six to ten do; roots in the cluster at -1 / delta, of which LAPACK finds only where it lies, took
/// up to 150.
constexpr int most_corrections = 300;
/// Coarser chains on the way from the coarsest to a long one have so many times its segments.
constexpr Index refinement = 20;
/// Most segments of a problem solved dense: 4,000 rows take LAPACK a minute.
constexpr Index dense_limit = 2000;

/// sum_k 1 / (z - lambda_k), but for the root itself, if it is one of them.
Complex poles(Complex z, const Approximations& roots, std::size_t itself = SIZE_MAX) {
  double real = 0.0, imag = 0.0;
  const auto add = [&](double x, double y) {
    const double share = 1.0 / std::max(x * x + y * y, 1e-300);
    real += x * share;
    imag -= y * share;
  };
  for (std::size_t k = 0; k < roots.size(); ++k) {
    const Complex other = roots[k].value;
    if (k != itself) add(z.real() - other.real(), z.imag() - other.imag());
    if (!roots[k].alone) add(z.real() - other.real(), z.imag() + other.imag());
  }
  return {real, imag};
}

/// LAPACK's roots of a chain at one speed, the lower of conjugates left out.
Approximations dense_roots(const Chain& chain, const Lapack& lapack, const Vector& scale, double u,
                           bool squared) {
  const Operators ops = chain.joint_operators(scale);
  const ImpedanceModel flow = chain.impedance();
  const double sign = flow.coriolis < 0.0 ? -1.0 : 1.0;
  const DenseOperator p(lapack, ops.mass, u * sign * (ops.gyroscopic + ops.end_flux) + ops.damping,
                        ops.stiffness + flow.centrifugal * u * u * ops.flux, 1.0);
  Approximations roots;
  for (const double shift : {0.97, 2.31, 0.41}) {
    for (const Complex mu : p.inverse(shift, squared, false, false).mu) {
      if (mu == 0.0) continue;
      Complex root = squared ? std::sqrt(shift * shift + 1.0 / mu) : shift + 1.0 / mu;
      if (squared && root.imag() == 0.0) roots.push_back({-root, true});
      if (squared && root.imag() < 0.0) root = -root;
      if (root.imag() >= 0.0) roots.push_back({root, root.imag() == 0.0});
    }
    if (!roots.empty()) break;
  }
  return roots;
}

void sort_by_size(Approximations& all) {
  std::sort(all.begin(), all.end(), [](const Approximation& one, const Approximation& other) {
    return std::abs(one.value) < std::abs(other.value);
  });
}

/// d log det P / dlambda.
Values derivatives_of(const Chain& chain, double u, const Values& at) {
  const Index count = static_cast<Index>(at.size());
  std::vector<double> parts(2 * count), out(2 * count);
  for (Index i = 0; i < count; ++i) {
    parts[i] = at[i].real();
    parts[count + i] = at[i].imag();
  }
  const ImpedancePoints points{u, count, parts.data(), parts.data() + count};
  motion_kernel().impedance->log_derivative(chain.impedance(), points, out.data());
  Values result(count);
  for (Index i = 0; i < count; ++i) result[i] = {out[i], out[count + i]};
  return result;
}

Index roots_in(const Approximations& all) {
  Index count = 0;
  for (const Approximation& one : all) count += one.alone ? 1 : 2;
  return count;
}

}  // namespace

bool ChainSpectrum::has_rate(double u) const {
  const ImpedanceModel model = chain_.impedance();
  bool rate = model.damping != 0.0 || u * model.coriolis != 0.0;
  for (Index j = 0; j < model.size && !rate; ++j) {
    const ImpedanceSegment& at = model.segments[j];
    rate = at.force.rate != 0.0 || at.moment.rate != 0.0;
  }
  return rate;
}

namespace {

/// Starts of the stiff roots, where roots are counted: of those below |lambda| = r there are
/// about Re(lambda d log det P / dlambda).
template <class LogDerivatives>
void add_stiff(const LogDerivatives& log_derivatives, Index total, Approximations& roots) {
  std::erase_if(roots, [](const Approximation& one) { return !(std::abs(one.value) < no_start); });
  const Index known = roots_in(roots), missing = total - known;
  std::vector<double> low(missing, std::log(no_start) - 3.0), high(missing, std::log(1e45));
  for (int halving = 0; halving < 30 && missing > 0; ++halving) {
    Values at(missing);
    for (Index i = 0; i < missing; ++i) at[i] = std::polar(std::exp(0.5 * (low[i] + high[i])), ray);
    const Values found = log_derivatives(at);
    for (Index i = 0; i < missing; ++i) {
      const double below = (at[i] * found[i]).real();
      (below < static_cast<double>(known + i) + 0.5 ? low : high)[i] = 0.5 * (low[i] + high[i]);
    }
  }
  for (Index i = 0; i < missing; ++i) {
    const double turned = (i % 2 == 0 ? 1.0 : -1.0) * (1.7 + 0.01 * static_cast<double>(i % 7));
    roots.push_back({std::polar(std::exp(low[i]), turned), true});
  }
}

/// Those near the real axis without the symmetry that keeps two real roots from being found.
Approximations parted(const Approximations& starts) {
  Approximations roots;
  for (const auto& [value, alone] : starts) {
    const double shift = 1e-3 * static_cast<double>(roots.size() % 7 + 1);
    if (!alone && std::abs(value.imag()) >= 0.3 * std::abs(value)) {
      roots.push_back({value, false});
      continue;
    }
    roots.push_back({value * Complex(1.0 + shift, 3.0 * shift), true});
    if (!alone) roots.push_back({std::conj(value) * Complex(1.0 - shift, 2.0 * shift), true});
  }
  return roots;
}

/// Roots with the conjugates that are implied, or were found as well, sorted; the first `count`.
std::optional<ChainRoots> with_conjugates(const ChainRoots& found, const Approximations& roots,
                                          Index count) {
  struct Place {
    Complex value;
    std::size_t from;
    bool mirrored;
  };
  std::vector<Place> places;
  std::vector<bool> used(found.count(), false);
  for (std::size_t i = 0; i < found.count(); ++i) {
    const Complex value = found.values[i];
    if (used[i]) continue;
    if (roots[i].alone && value.imag() != 0.0) {
      std::size_t twin = i;
      for (std::size_t k = i + 1; k < found.count(); ++k) {
        const double apart = std::abs(found.values[k] - std::conj(value));
        if (roots[k].alone && !used[k] && apart <= 1e-6 * std::abs(value)) twin = k;
      }
      if (twin == i) return std::nullopt;
      used[twin] = true;
    }
    const Complex upper(value.real() + 0.0, std::abs(value.imag()));
    places.push_back({upper, i, value.imag() < 0.0});
    if (upper.imag() != 0.0) places.push_back({std::conj(upper), i, value.imag() > 0.0});
  }
  std::sort(places.begin(), places.end(), [](const Place& one, const Place& other) {
    const auto key = [](const Place& at) {
      return std::tuple(std::abs(at.value), at.value.real(), -at.value.imag());
    };
    return key(one) < key(other);
  });
  if (static_cast<Index>(places.size()) < count) return std::nullopt;
  ChainRoots result(Values(count), found.rows);
  for (Index k = 0; k < count; ++k) result.take(k, found, places[k].from, places[k].mirrored);
  return result;
}

/// Ehrlich's and Aberth's corrections of all roots until each is as good as rounding lets it.
template <class LogDerivatives>
bool correct(const LogDerivatives& log_derivatives, Approximations& roots) {
  std::vector<std::size_t> active(roots.size());
  std::iota(active.begin(), active.end(), 0);
  std::vector<double> last(roots.size(), infinite);
  for (int step = 0; step < most_corrections && !active.empty(); ++step) {
    Values at;
    for (const std::size_t k : active) at.push_back(roots[k].value);
    const Values found = log_derivatives(at);
    std::vector<std::size_t> moving;
    for (std::size_t i = 0; i < active.size(); ++i) {
      const std::size_t k = active[i];
      if (std::isnan(std::abs(found[i]))) {  // a pivot is 0: at this root, or beside it
        if (last[k] <= 1e-8) continue;
        roots[k].value *= 1.0 + 1e-9;
        last[k] = 1e-8;
        moving.push_back(k);
        continue;
      }
      const Complex change = 1.0 / (found[i] - poles(at[i], roots, k));
      if (!std::isfinite(std::norm(change))) return false;
      const double size = std::abs(at[i]), share = std::abs(change) / (size + 1e-30);
      if (share >= last[k] && last[k] < 1e-6) continue;  // rounding
      const bool quadratic = share < 1e-8 && share < 1e-3 * last[k];
      roots[k].value = at[i] - change;
      last[k] = share;
      if (!quadratic && share > 1e-13 && std::abs(change) > 1e-16) moving.push_back(k);
    }
    active = std::move(moving);
  }
  return active.empty();
}

}  // namespace

ChainRoots::ChainRoots(Values at, std::size_t vector_rows)
    : values(std::move(at)),
      residual(count()),
      uncertain(count()),
      slope(count()),
      by_left(count()),
      by_right(count()),
      correction(count()),
      right(vector_rows * count()),
      left(vector_rows * count()),
      rows(vector_rows) {}

void ChainRoots::take(std::size_t k, const ChainRoots& others, std::size_t i, bool conjugate) {
  residual[k] = others.residual[i];
  uncertain[k] = others.uncertain[i];
  const auto put = [&](Values ChainRoots::* what, std::size_t to, std::size_t from) {
    (this->*what)[to] = conjugate ? std::conj((others.*what)[from]) : (others.*what)[from];
  };
  for (auto what : {&ChainRoots::values, &ChainRoots::slope, &ChainRoots::by_left,
                    &ChainRoots::by_right, &ChainRoots::correction}) {
    put(what, k, i);
  }
  for (std::size_t j = 0; j < rows; ++j) {
    put(&ChainRoots::right, j * count() + k, j * others.count() + i);
    put(&ChainRoots::left, j * count() + k, j * others.count() + i);
  }
}

ChainRoots ChainSpectrum::vectors_at(double u, const Values& values, bool vectors,
                                     bool loaded) const {
  const Index n = chain_.dof(), count = static_cast<Index>(values.size());
  const MotionKernel& kernel = motion_kernel();
  std::vector<double> parts(2 * count), out(11 * count), tables(vectors ? 4 * n * count : 0);
  for (Index i = 0; i < count; ++i) {
    parts[i] = values[i].real();
    parts[count + i] = values[i].imag();
  }
  const auto part = [&](Index k) { return out.data() + k * count; };
  const auto complex = [&](Index k, Index i) { return Complex(part(k)[i], part(k + 1)[i]); };
  double* const right = vectors ? tables.data() : nullptr;
  double* const left = vectors ? right + 2 * n * count : nullptr;
  kernel.impedance->pairs(
      chain_.impedance(), {u, count, parts.data(), parts.data() + count},
      {part(0), part(2), part(4), part(6), part(8), part(9), part(10), right, left, loaded},
      scratch(14 * n * kernel.width));
  ChainRoots found(values, vectors ? n : 0);
  for (Index i = 0; i < count; ++i) {
    const Complex by_lambda = complex(0, i), change = -complex(2, i) / by_lambda;
    const double rest = part(8)[i], entries = part(9)[i], sums = part(10)[i];
    const double residual = rest / (entries + sums);
    const double rounding =
        (entry_rounding * entries + epsilon * sums) / std::abs(by_lambda);
    const double uncertain = rest / std::abs(by_lambda) + rounding;
    found.residual[i] = std::isfinite(residual) ? residual : infinite;
    found.uncertain[i] = std::isfinite(uncertain) ? uncertain : infinite;
    found.correction[i] = std::abs(change) > 0.1 * rounding ? change : 0.0;
    found.slope[i] = -complex(4, i) / by_lambda;
    found.by_left[i] = by_lambda;
    found.by_right[i] = complex(6, i);
    if (!vectors) continue;
    double lengths[] = {0.0, 0.0};
    for (int side = 0; side < 2; ++side) {
      const double* const from = side == 0 ? right : left;
      ComplexTable& to = side == 0 ? found.right : found.left;
      for (Index j = 0; j < n; ++j) {
        const Complex turn(from[2 * j * count + i], from[(2 * j + 1) * count + i]);
        const Complex entry = (side == 0 ? turn : std::conj(turn)) / scale_[j];
        lengths[side] += std::norm(entry);
        to[j * count + i] = entry;
      }
      lengths[side] = std::sqrt(lengths[side]);
      for (Index j = 0; j < n; ++j) to[j * count + i] /= lengths[side];
    }
    found.by_left[i] /= lengths[0] * lengths[1];
    found.by_right[i] /= lengths[0] * lengths[0];
  }
  return found;
}

ChainRoots ChainSpectrum::at(double u, const Values& values, bool vectors) const {
  ChainRoots found = vectors_at(u, values, vectors, false);
  std::vector<std::size_t> poor;
  Values again;
  for (std::size_t i = 0; i < found.count(); ++i) {
    if (found.residual[i] <= small_residual) continue;
    poor.push_back(i);
    again.push_back(values[i]);
  }
  if (poor.empty()) return found;
  const ChainRoots other = vectors_at(u, again, vectors, true);
  for (std::size_t k = 0; k < poor.size(); ++k) {
    if (other.residual[k] < found.residual[poor[k]]) found.take(poor[k], other, k, false);
  }
  return found;
}

ChainRoots ChainSpectrum::near(double u, Complex guess, int most_steps) const {
  Complex value = guess;
  for (int step = 0; step < most_steps; ++step) {
    const Complex change = 1.0 / derivatives_of(chain_, u, {value})[0];
    if (!std::isfinite(std::norm(change))) break;
    value -= change;
    if (std::abs(change) <= 1e-12 * std::abs(value)) break;
  }
  return at(u, {value}, true);
}

ChainRoots ChainSpectrum::polished(double u, const Approximations& roots, bool squared,
                                   bool vectors) const {
  Values values;
  for (const Approximation& root : roots) values.push_back(root.value);
  ChainRoots found = at(u, values, vectors);
  for (int times = 0; times < 3; ++times) {
    bool moved = false;
    for (std::size_t i = 0; i < found.count(); ++i) {
      const Complex change = found.correction[i];
      if (change == 0.0 || !(std::abs(change) < 1e-9 * std::abs(values[i]))) continue;
      values[i] += change;
      moved = true;
    }
    if (!moved) break;
    found = at(u, values, vectors);
  }
  // By symmetry roots without partner are real, or on the imaginary axis.
  for (std::size_t i = 0; i < found.count(); ++i) {
    Complex& value = found.values[i];
    if (squared && std::abs(value.real()) <= found.uncertain[i]) value.real(0.0);
    if (roots[i].alone && std::abs(value.imag()) <= found.uncertain[i]) value.imag(0.0);
  }
  return found;
}

bool ChainSpectrum::is_complete(double u, const Approximations& roots) const {
  Values points;
  for (const Approximation& root : roots) {
    points.push_back(std::polar(std::max(std::abs(root.value), 1e-3), ray));
  }
  const Values found = derivatives_of(chain_, u, points);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double rest = std::abs(points[i] * (found[i] - poles(points[i], roots)));
    if (!(rest < nothing_missing)) return false;
  }
  return true;
}

bool ChainSpectrum::has_all_within(double u, double radius, const Approximations& roots) const {
  Values points;
  for (int i = 0; i < circle_points; ++i) {
    points.push_back(std::polar(radius, M_PI * (i + 0.5) / circle_points));
  }
  const Values found = derivatives_of(chain_, u, points);
  double missing = 0.0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    missing += (points[i] * (found[i] - poles(points[i], roots))).real() / circle_points;
  }
  return std::abs(missing) < 0.05;
}

std::optional<ChainRoots> ChainSpectrum::lowest(double u, Index count, bool vectors) const {
  const Index n = chain_.dof(), total = 2 * n;
  const bool squared = !has_rate(u);
  const auto log_derivatives = [&](const Values& at) { return derivatives_of(chain_, u, at); };
  for (Index segments = std::max<Index>(10, count + 4);; segments *= 3) {
    const bool own = 2 * segments > n;
    if ((own ? n : segments) > dense_limit) return std::nullopt;
    Approximations starts;
    if (own) {
      starts = dense_roots(chain_, lapack_, scale_, u, squared);
      add_stiff(log_derivatives, total, starts);
    } else {
      const Chain coarse = chain_.coarser(segments);
      const Vector& k = coarse.springs();
      const Vector scale = k.cwiseMax(1e-3 * k.mean() + 1e-300).cwiseSqrt().cwiseInverse();
      starts = dense_roots(coarse, lapack_, scale, u, squared);
    }
    sort_by_size(starts);
    if (!own) {
      while (roots_in(starts) > count + 6) starts.pop_back();
      for (Index finer = refinement * segments; refinement * finer < 2 * n; finer *= refinement) {
        const Chain between = chain_.coarser(finer);
        correct([&](const Values& at) { return derivatives_of(between, u, at); }, starts);
      }
    }
    for (const bool apart : {false, true}) {
      Approximations roots = apart ? parted(starts) : starts;
      if (!correct(log_derivatives, roots)) continue;
      sort_by_size(roots);
      Approximations lowest;
      std::size_t next = 0;
      while (next < roots.size() && roots_in(lowest) < count) lowest.push_back(roots[next++]);
      if (own ? !is_complete(u, roots) : !separated(u, roots, next)) continue;
      // Those of equal size, which rounding may have sorted otherwise.
      const double size = std::abs(lowest.back().value) * (1.0 + 1e-6);
      while (next < roots.size() && std::abs(roots[next].value) <= size) lowest.push_back(roots[next++]);
      const ChainRoots found = polished(u, lowest, squared, vectors);
      if (std::optional<ChainRoots> all = with_conjugates(found, lowest, count)) return all;
    }
    if (own) return std::nullopt;
  }
}

bool ChainSpectrum::separated(double u, const Approximations& roots, std::size_t least) const {
  // The circle passes where the gap between neighbours is widest.
  double widest = 1.0, radius = 0.0;
  for (std::size_t k = least; k < roots.size(); ++k) {
    const double inner = std::abs(roots[k - 1].value), outer = std::abs(roots[k].value);
    if (outer > widest * inner) {
      widest = outer / inner;
      radius = std::sqrt(inner * outer);
    }
  }
  return widest > 1.05 && has_all_within(u, radius, roots);
}

}  // namespace pipedyn
