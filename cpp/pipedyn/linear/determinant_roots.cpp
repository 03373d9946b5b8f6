// SPDX-License-Identifier: MIT
#include "pipedyn/linear/determinant_roots.hpp"

#include <algorithm>
#include <numbers>
#include <numeric>
#include <tuple>

namespace pipedyn {

namespace {

/// Largest |lambda| at which LAPACK's roots serve as starts: in joint angles a root loses eps
/// |lambda|^2.
constexpr double largest_start = 1e7;
/// Largest relative change of a root by its slope, which is infinite where two roots meet.
constexpr double largest_change = 0.3;
/// Roots with |1 + delta lambda| below this belong to the cluster at -1 / delta.
constexpr double cluster_radius = 0.1;
/// Largest |Im lambda| / |lambda| of pairs that may meet the real axis within a step of a search.
constexpr double near_axis = 0.7;
/// Relative distance at which two roots are about to meet: if they are further apart, rounding
/// moves each by 1e-12.
constexpr double meeting = 1e-4;
/// Relative correction after which a root is as good as rounding lets it be, since corrections
/// converge quadratically. Where roots are close and corrections do not, the correction by vectors
/// shows it.
constexpr double last_correction = 1e-6;
/// |lambda (d log det P / dlambda - sum)| above which a root is missing: rounding leaves 1e-9 with
/// 2000 segments, and one root in the place of another 1e-6 if the two differ by 1e-6.
constexpr double nothing_missing = 1e-6;
/// Relative radius of the circle about two roots: rounding moves their sum by eps / radius.
constexpr double circle_radius = 0.05;
/// Number of points on the circle about two roots.
constexpr Index circle_points = 16;

}  // namespace

namespace {

/// Writes the values of roots and the conjugates that are implied to `known`; returns their number.
Index write_values(const Approximations& roots, Values& known) {
  room_in(known, 2 * static_cast<Index>(roots.size()));
  Index k = 0;
  for (const Approximation& one : roots) {
    known[k++] = one.value;
    if (!one.alone) known[k++] = std::conj(one.value);
  }
  return k;
}

}  // namespace

Eigen::Ref<Values> log_derivatives(const Determinant& of, double u, const ValuesRef& at,
                                   const Approximations& roots, RootsMemory& memory) {
  const auto known = room_in(memory.known, write_values(roots, memory.known));
  auto found = room_in(memory.found, at.size());
  of.log_derivatives(u, at, known, found);
  return found;
}

Index roots_in(const Approximations& all) {
  Index count = 0;
  for (const Approximation& one : all) count += one.alone ? 1 : 2;
  return count;
}

void sort_by_size(Approximations& all, RootsMemory& memory) {
  auto values = room_in(memory.at, all.size());
  for (std::size_t i = 0; i < all.size(); ++i) values[i] = all[i].value;
  memory.order = by_size(values, std::move(memory.order));
  if (std::ranges::is_sorted(memory.order)) return;
  memory.roots.clear();
  for (const Index i : memory.order) memory.roots.push_back(all[i]);
  all.swap(memory.roots);
}

Approximations dense_roots(const DenseOperator& p, bool squared) {
  Approximations roots;
  for (const double shift : shifts) {
    for (const Complex mu : p.roots(shift, squared)) {
      if (mu == 0.0) continue;
      Complex root = squared ? std::sqrt(shift * shift + 1.0 / mu) : shift + 1.0 / mu;
      if (p.is_hysteretic()) {
        roots.push_back({root, true});
        continue;
      }
      if (squared && root.imag() == 0.0) roots.push_back({-root, true});
      if (squared && root.imag() < 0.0) root = -root;
      if (root.imag() >= 0.0) roots.push_back({root, root.imag() == 0.0});
    }
    if (!roots.empty()) break;
  }
  RootsMemory memory;
  sort_by_size(roots, memory);
  return roots;
}

Approximations modal_roots(const DenseOperator& p, const Modes& modes, double loss) {
  const bool is_damped = modes.vectors.size() > 0;
  Eigen::MatrixXd damped, lost;
  if (is_damped) damped = p.velocity() * modes.vectors;
  if (loss > 0.0) lost = p.hysteretic() * modes.vectors;
  Approximations roots;
  for (Index i = 0; i < modes.squares.size(); ++i) {
    const double square = modes.squares[i], share = modes.masses[i];
    const double rate = is_damped ? modes.vectors.col(i).dot(damped.col(i)) / share : 0.0;
    if (loss > 0.0) {
      const Complex whole(square, modes.vectors.col(i).dot(lost.col(i)) / share);
      const Complex apart = std::sqrt(0.25 * rate * rate - whole);
      roots.push_back({-0.5 * rate + apart, true});
      roots.push_back({-0.5 * rate - apart, true});
      continue;
    }
    const double apart = 0.25 * rate * rate - square;
    if (apart < 0.0) {
      roots.push_back({{-0.5 * rate, std::sqrt(-apart)}});
    } else {
      const double larger = -0.5 * rate - std::sqrt(apart);
      roots.push_back({larger, true});
      roots.push_back({larger == 0.0 ? 0.0 : square / larger, true});
    }
  }
  RootsMemory memory;
  sort_by_size(roots, memory);
  return roots;
}

Index roots_at_zero(const Determinant& of, double u) {
  if (!of.turns_freely()) return 0;
  const Values at = Values::Constant(1, beside_zero);
  return std::lround((at * of.log_derivatives(u, at, Values()))[0].real());
}

void put_zeros(Approximations& roots, Index count) {
  Approximations result(count, {0.0, true, true});
  for (const Approximation& one : roots) {
    const Index size = one.alone ? 1 : 2;
    if (count < size) result.push_back(count == 0 ? one : Approximation{one.value.real(), true});
    count = std::max<Index>(count - size, 0);
  }
  roots = std::move(result);
}

void add_stiff(const Determinant& of, Index dof, double u, Approximations& roots) {
  std::erase_if(roots,
                [](const Approximation& one) { return !(std::abs(one.value) < largest_start); });
  const Index known = roots_in(roots), stiff = 2 * dof - known;
  Reals low = Reals::Constant(stiff, std::log(largest_start) - 3.0);
  Reals high = Reals::Constant(stiff, std::log(1e45));  // greater |lambda| overflow
  const Reals wanted = Reals::LinSpaced(stiff, known + 0.5, known + stiff - 0.5);
  for (int halving = 0; halving < 30 && stiff > 0; ++halving) {
    const Reals middle = 0.5 * (low + high);
    const Values at = std::polar(1.0, ray) * middle.exp().cast<Complex>();
    const Reals below = (at * of.log_derivatives(u, at, Values())).real();
    low = (below < wanted).select(middle, low);
    high = (below < wanted).select(high, middle);
  }
  for (Index i = 0; i < stiff; ++i) {
    const double turned = (i % 2 == 0 ? 1.0 : -1.0) * (1.7 + 0.01 * static_cast<double>(i % 7));
    roots.push_back({std::polar(std::exp(low[i]), turned), true});
  }
}

void join_conjugates(Approximations& roots, const Values& values, std::vector<Index>& left) {
  for (std::size_t i = 0; i < roots.size(); ++i) {
    const Complex value = values[left[i]];
    if (!roots[i].alone || value.imag() == 0.0) continue;
    const auto twin = std::find_if(left.begin() + i + 1, left.end(), [&](Index k) {
      return std::abs(values[k] - std::conj(value)) <= 1e-6 * std::abs(value);
    });
    if (twin == left.end() || !roots[twin - left.begin()].alone) continue;
    roots[i].alone = false;
    roots.erase(roots.begin() + (twin - left.begin()));
    left.erase(twin);
  }
}

namespace {

/// Adds two starts where slopes lead two roots together on the real axis: about their centre, as
/// far from it as they are expected. Whether they are real or conjugates there need not be known:
/// they start in between, where no symmetry holds corrections. The distance of the roots goes like
/// the square root of the way that is left to the meeting, so that its square is extrapolated.
/// Returns whether the two meet.
bool add_met(const Approximation& one, const Approximation& other, double further,
             Approximations& to) {
  const Complex half = 0.5 * (other.value - one.value), rate = 0.5 * (other.slope - one.slope);
  const double change = (rate * std::conj(half)).real();
  if (half == 0.0 || !(2.0 * further * change < -std::norm(half))) return false;
  const Complex centre = 0.5 * (one.value + other.value + further * (one.slope + other.slope));
  const double distance = std::sqrt(std::abs(half * half + 2.0 * further * half * rate));
  const Complex aside = std::polar(distance, 0.25 * std::numbers::pi);
  to.push_back({centre + aside, true});
  to.push_back({centre - aside, true});
  return true;
}

/// The real root that is next greater than root i, or i if there is none.
std::size_t next_real(const Approximations& roots, std::size_t i) {
  std::size_t next = i;
  for (std::size_t k = 0; k < roots.size(); ++k) {
    const double real = roots[k].value.real();
    if (!roots[k].alone || roots[k].settled || !(real > roots[i].value.real())) continue;
    if (next == i || real < roots[next].value.real()) next = k;
  }
  return next;
}

}  // namespace

void expected(const Approximations& roots, double further, Complex delta, bool paired,
              Approximations& result, RootsMemory& memory) {
  result.clear();
  // A pair that meets becomes two roots. With damping many do; without it, room for them would take
  // 2 % of a search's time, as measured.
  result.reserve(delta == 0.0 ? roots.size() + 1 : roots_in(roots));
  std::vector<char>& met = memory.marks;
  met.assign(roots.size(), 0);
  for (std::size_t i = 0; i < roots.size(); ++i) {
    const std::size_t k = roots[i].alone && paired ? next_real(roots, i) : i;
    Approximation other = roots[k];
    if (!roots[i].alone) {
      other.value = std::conj(other.value);
      other.slope = std::conj(other.slope);
    }
    if (met[i] || met[k] || roots[i].settled) continue;
    met[i] = met[k] = add_met(roots[i], other, further, result);
  }
  for (std::size_t i = 0; i < roots.size(); ++i) {
    if (met[i]) continue;
    Approximation one = roots[i];
    Complex change = further * one.slope;
    if (one.since != 0.0) {
      const Complex between = (one.value - one.value_before) / one.since;
      const Complex bend = (one.slope - between) / one.since;
      const Complex bend_before = (between - one.slope_before) / one.since;
      const double ratio = (further + one.since) / one.since;
      change += further * further * (bend + ratio * (bend - bend_before));
    }
    one.since = one.slope == 0.0 ? 0.0 : further;
    one.value_before = one.value;
    one.slope_before = one.slope;
    const bool is_clustered = magnitude(1.0 + delta * one.value) < cluster_radius;
    if (!is_clustered && magnitude(change) <= largest_change * magnitude(one.value)) {
      one.value += change;
    }
    result.push_back(one);
  }
}

namespace {

/// Moves approximations near the real axis off their symmetry about it: a root that is corrected
/// together with its conjugate never turns into two real ones, nor a real root into a complex one.
/// which: indices of the roots that begin again from their starts; on return also of the conjugates
/// that were added. Other roots go on as they are.
void break_symmetry(const Approximations& starts, Approximations& roots,
                    std::vector<std::size_t>& which) {
  for (std::size_t i = 0, count = which.size(); i < count; ++i) {
    const Complex value = starts[which[i]].value;
    const bool alone = starts[which[i]].alone;
    if (!alone && std::abs(value.imag()) >= near_axis * magnitude(value)) continue;
    const double shift = 1e-3 * static_cast<double>(i % 7 + 1);
    roots[which[i]] = {value * Complex(1.0 + shift, 3.0 * shift), true};
    if (alone) continue;
    which.push_back(roots.size());
    roots.push_back({std::conj(value) * Complex(1.0 - shift, 2.0 * shift), true});
  }
}

/// Corrects the active roots; on return the active ones are those that are not yet as good as
/// rounding lets them be. Returns whether corrections are finite.
bool correct_active(const Determinant& of, double u, Approximations& roots, RootsMemory& memory,
                    int most) {
  auto& [at, found, known, last, shifted, active, every, order, starts] = memory;
  for (Values* const one : {&at, &found}) room_in(*one, roots.size());
  last.assign(roots.size(), infinite);
  shifted.assign(roots.size(), 0);
  for (int step = 0; step < most && !active.empty(); ++step) {
    for (std::size_t i = 0; i < active.size(); ++i) at[i] = roots[active[i]].value;
    const Index count = write_values(roots, known);
    of.log_derivatives(u, at.head(active.size()), known.head(count), found.head(active.size()));
    std::size_t moving = 0;  // number of roots that go on, the first ones of `active`
    for (std::size_t i = 0; i < active.size(); ++i) {
      const std::size_t k = active[i];
      const double square = std::norm(found[i]);
      const Complex change = std::conj(found[i]) / square;
      if (std::isnan(square)) {  // a pivot is 0 at this root or beside it
        if (shifted[k]) continue;
        shifted[k] = true;
        last[k] = infinite;
        roots[k].value *= 1.0 + 1e-9;
        active[moving++] = k;
        continue;
      }
      if (!std::isfinite(std::norm(change))) return false;
      const double size = magnitude(change), share = size / (magnitude(at[i]) + 1e-30);
      if (share >= last[k] && last[k] < 1e-6) continue;  // the correction is rounding
      const bool quadratic = share < last_correction && share < 1e-3 * last[k];
      roots[k].value = at[i] - change;
      last[k] = share;
      if (!quadratic && share > 1e-13 && size > 1e-16) active[moving++] = k;
    }
    active.resize(moving);
  }
  return true;
}

}  // namespace

bool correct(const Determinant& of, double u, Approximations& roots, RootsMemory& memory,
             int most) {
  std::vector<std::size_t>& active = memory.active;
  memory.roots = roots;
  active.clear();
  for (std::size_t k = 0; k < roots.size(); ++k) {
    if (!roots[k].settled) active.push_back(k);
  }
  memory.every = active;
  if (!correct_active(of, u, roots, memory, most)) active = memory.every;
  if (active.empty()) return true;
  break_symmetry(memory.roots, roots, active);
  return correct_active(of, u, roots, memory, 2 * most) && active.empty();
}

bool has_all(const Determinant& of, double u, const Approximations& roots, RootsMemory& memory) {
  double least = infinite, most = 0.0;
  for (const Approximation& one : roots) {
    const double size = std::max(magnitude(one.value), 1e-3);
    least = std::min(least, size);
    most = std::max(most, size);
  }
  // An error of a root shows at all |lambda| of its order; here |lambda| is at most a factor 3 off.
  const Index count = std::max<Index>(8, std::ceil(std::log(most / least) / std::log(3.0)));
  auto points = room_in(memory.at, count);
  points = std::polar(1.0, ray) *
           Reals::LinSpaced(count, std::log(least), std::log(most)).exp().cast<Complex>();
  return (points * log_derivatives(of, u, points, roots, memory)).abs2().maxCoeff() <
         nothing_missing * nothing_missing;
}

void separate(const Determinant& of, double u, bool squared, Approximations& roots,
              RootsMemory& memory) {
  // A pair that met on the axis may go on as one upper root and one lower root.
  const auto upper_of = [](const Approximation& pair) {
    return pair.value.imag() < 0.0 ? std::conj(pair.value) : pair.value;
  };
  std::vector<std::size_t>& order = memory.active;
  order.clear();
  for (std::size_t i = 0; i < roots.size(); ++i) {
    if (!roots[i].alone) order.push_back(i);
  }
  const auto height = [&](std::size_t i) { return std::abs(roots[i].value.imag()); };
  std::sort(order.begin(), order.end(),
            [&](std::size_t i, std::size_t k) { return height(i) < height(k); });
  for (std::size_t lower = 0; lower < order.size(); ++lower) {
    for (std::size_t upper = lower + 1; upper < order.size(); ++upper) {
      const auto [i, other] = std::minmax(order[lower], order[upper]);
      const Complex one = upper_of(roots[i]), twin = upper_of(roots[other]);
      const Complex centre = 0.5 * (one + twin);
      if (height(order[upper]) > (1.0 + 2.0 * meeting) * height(order[lower])) break;
      if (!(std::abs(one - twin) < meeting * std::abs(one.imag()))) continue;
      Approximations rest{{std::conj(one), true}, {std::conj(twin), true}};
      for (std::size_t k = 0; k < roots.size(); ++k) {
        if (k != i && k != other) rest.push_back(roots[k]);
      }
      Values arms(circle_points);
      for (Index k = 0; k < circle_points; ++k) {
        const double turn = 2.0 * std::numbers::pi * (static_cast<double>(k) + 0.5) / circle_points;
        arms[k] = std::polar(circle_radius * std::abs(centre), turn);
      }
      const Values found = arms * log_derivatives(of, u, centre + arms, rest, memory);
      if (!(std::abs(found.mean() - 2.0) < 1e-3)) continue;
      const Complex sum = (arms * found).mean(), squares = (arms.square() * found).mean();
      Complex middle = centre + 0.5 * sum, square = 2.0 * squares - sum * sum;
      if (squared) {  // both on the axis, or symmetric about it
        middle.real(0.0);
        square.imag(0.0);
      }
      roots[i] = {middle + 0.5 * std::sqrt(square), false, true};
      roots[other] = {middle - 0.5 * std::sqrt(square), false, true};
    }
  }
}

}  // namespace pipedyn
