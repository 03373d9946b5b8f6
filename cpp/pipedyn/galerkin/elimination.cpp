// SPDX-License-Identifier: MIT
//
// The elimination for one level. This source is compiled once for each level, with PIPEDYN_LEVEL
// and PIPEDYN_WIDTH set.
#include "pipedyn/galerkin/elimination.hpp"

#include "pipedyn/vector/lanes.hpp"
#include "pipedyn/vector/layout.hpp"

namespace {

using pipedyn::EliminationModel;
using pipedyn::EliminationPanel;
using pipedyn::end_shape, pipedyn::end_slope, pipedyn::moving;
using pipedyn::PairsAsked;
using pipedyn::PencilEntry;
using pipedyn::Points;
using pipedyn::widest;

/// Number of unknowns that remain in the equations after the functions of a panel: w, theta, Q and
/// M at its start.
constexpr Count border = 4;

/// Powers of lambda from which the entries of P are computed.
struct EntryPowers {
  Lanes one, two = one * one;  // lambda and its square
};

template <class Number>
Number entry(const PencilEntry& of, const EntryPowers& lambda);

template <>
inline Lanes entry<Lanes>(const PencilEntry& of, const EntryPowers& lambda) {
  return {of.stiffness + of.damping * lambda.one.re + of.mass * lambda.two.re,
          of.hysteretic + of.damping * lambda.one.im + of.mass * lambda.two.im};
}

/// Derivatives of an entry of P by lambda and by the speed.
inline Lanes entry_by_lambda(const PencilEntry& of, const EntryPowers& lambda) {
  return (2.0 * of.mass) * lambda.one + of.damping;
}
inline Lanes entry_by_speed(const PencilEntry& of, const EntryPowers& lambda) {
  return of.damping_by_speed * lambda.one + of.stiffness_by_speed;
}

template <>
inline DualLanes entry<DualLanes>(const PencilEntry& of, const EntryPowers& lambda) {
  return {entry<Lanes>(of, lambda), entry_by_lambda(of, lambda)};
}

/// A real number, of each lane or of all, as a complex number, with or without derivative.
template <class Number>
Number number(const auto& real) {
  const Lanes value{Pack{} + real, Pack{}};
  if constexpr (std::is_same_v<Number, Lanes>)
    return value;
  else
    return {value, {}};
}

#if PIPEDYN_WIDTH > 1
inline Pack chosen(const Bits& mask, const Pack& a, const Pack& b) {
  return same_bits<Pack>((same_bits<Bits>(a) & mask) | (same_bits<Bits>(b) & ~mask));
}
inline Bits equal(const Pack& a, double b) { return a == b; }
#else
inline Pack chosen(const Bits& mask, const Pack& a, const Pack& b) { return mask ? a : b; }
inline Bits equal(const Pack& a, double b) { return a == b ? -1 : 0; }
#endif
inline Lanes chosen(const Bits& mask, const Lanes& a, const Lanes& b) {
  return {chosen(mask, a.re, b.re), chosen(mask, a.im, b.im)};
}
inline DualLanes chosen(const Bits& mask, const DualLanes& a, const DualLanes& b) {
  return {chosen(mask, a.value, b.value), chosen(mask, a.slope, b.slope)};
}

inline bool any(const Bits& mask) {
  std::int64_t each[width], found = 0;
  std::memcpy(each, &mask, sizeof mask);
  for (Count i = 0; i < width; ++i) found |= each[i];
  return found != 0;
}

/// Returns a, or a small number whose square is representable, if a is 0.
inline Lanes not_zero(Lanes a) {
  const Pack size = size_of(a);
  a.re = size > 0.0 ? a.re : all<Pack>(1e-150);
  return a;
}

/// Sum over pivots for the derivative of the logarithm of the determinant, and, if wanted, their
/// real product: its sign and the logarithm of its absolute value.
struct PivotSums {
  bool multiplied = false;  // whether the product is wanted
  Lanes slope = {};
  Pack sign = all<Pack>(1.0), logarithm{};

  void add(const DualLanes& pivot, const DualLanes& share) {
    slope += pivot.slope * share.value;
    multiply(pivot.value.re);
  }
  void add(const Lanes&, const Lanes&) {}
  void multiply(const Pack& pivot) {
    if (!multiplied) return;
    double logarithms[width];
    store(logarithms, absolute(pivot));
    for (double& one : logarithms) one = std::log(one);
    logarithm += load<Pack>(logarithms);
    sign = pivot > 0.0 ? sign : pivot < 0.0 ? -sign : Pack{};
  }
  void turn(const Bits& swapped) { sign = chosen(swapped, -sign, sign); }
};

/// x - a b, with each part written as a chain of fused operations.
inline Lanes less_product(const Lanes& x, const Lanes& a, const Lanes& b) {
  return {x.re - a.re * b.re + a.im * b.im, x.im - a.re * b.im - a.im * b.re};
}
inline DualLanes less_product(const DualLanes& x, const DualLanes& a, const DualLanes& b) {
  return {less_product(x.value, a.value, b.value),
          less_product(less_product(x.slope, a.slope, b.value), a.value, b.slope)};
}

/// Factor by which another entry must be larger to be the pivot instead, far from panels' borders.
/// Growth is bounded as it is if the largest entry is the pivot, and fewer rows are exchanged
/// (Duff, Erisman and Reid 1986, ch. 5). Where panels join, the largest entry is lanes_of:
/// otherwise vectors lose four digits with three panels.
constexpr double inner_threshold = 10.0;

/// Exchanges two numbers in the lanes of a mask.
template <class Number>
void exchange(const Bits& mask, Number& a, Number& b) {
  const Number before = a;
  a = chosen(mask, b, before);
  b = chosen(mask, before, b);
}

/// Whether any entry of what acts at a station is not 0.
inline bool acts_on(const PencilEntry (&station)[2][2]) {
  for (const auto& row : station) {
    for (const PencilEntry& of : row) {
      if (of.stiffness != 0.0 || of.hysteretic != 0.0 || of.damping != 0.0 || of.mass != 0.0)
        return true;
    }
  }
  return false;
}

/// Order in which the equations of a panel are eliminated. Unknowns: curvatures by falling degree;
/// force and moment at its end; at the root, the slope there, if it turns. These are followed by w,
/// theta, Q and M at the panel's start, which the two equations carried on contain. Equations:
/// those of the functions by falling degree; the two carried ones. At the root, equations of
/// functions that do not move are left out.
struct Front {
  Count size, band;
  bool joined;  // whether forces act at the end
  Count inner;  // number of functions that are far from the border of the panel
  Count force;  // unknown of the force at the end; the moment follows
  Count pivots, columns, theta, functions, rows;  // theta: its unknown; functions: their equations

  Front(const EliminationModel& model, Count p) : band(model.band) {
    const EliminationPanel& panel = model.panels[p];
    const bool last = p + 1 == model.count, turned = p == 0 && model.turns;
    size = panel.size;
    joined = !last || panel.held || panel.directed || acts_on(panel.station);
    inner = size - band - (joined ? moving : 2);
    force = size - 2;
    pivots = force + (joined ? 2 : 0) + turned;
    theta = turned ? pivots - 1 : pivots + 1;
    columns = pivots + border;
    functions = p > 0 ? size : size - 2 + turned;
    rows = pivots + (p > 0 ? 2 : 0);
  }

  /// Unknown that is the amplitude of a function.
  Count unknown(Count function) const {
    if (function >= 2) return size - 1 - function;
    return function == 1 ? theta : pivots;
  }
  /// Last unknown in the row of a pivot whose functions reach this far beyond that of the pivot.
  Count last(Count pivot, Count reach) const {
    return pivot + reach < force ? pivot + reach : columns - 1;
  }
  /// Number of equations from that of a pivot on that may have an entry in its column. Carried
  /// equations contain the functions that move the end.
  Count below(Count pivot) const {
    if (joined && pivot + moving >= size) return rows - pivot;
    return pivot + band < functions ? band + 1 : functions - pivot;
  }

  /// Largest number of unknowns of a panel besides its functions.
  static constexpr Count others = 1 + border;
  /// Largest number of equations in which a column is eliminated, and of unknowns in one of them.
  static constexpr Count most_rows(Count band) { return band + 2; }
  static constexpr Count row_length(Count band) { return 3 * band + 3 + others; }
  /// The first unknown in an equation that is stored.
  Count first(Count equation) const { return equation > band + 1 ? equation - band - 1 : 0; }
  /// Number of numbers stored for each pivot: the load, and the entries of its row.
  static Count kept(Count band) { return 2 * band + 3 + others; }
};

/// Entries of P or of P^T for functions i and j of a panel, and of what acts at its end.
inline const PencilEntry& inside(const EliminationModel& model, const EliminationPanel& panel,
                                 Count i, Count j) {
  const Count row = model.transposed ? j : i, column = model.transposed ? i : j;
  return panel.entries[row * (2 * model.band + 1) + column - row + model.band];
}
inline const PencilEntry& at_end(const EliminationModel& model, const EliminationPanel& panel,
                                 Count i, Count j) {
  return model.transposed ? panel.station[j][i] : panel.station[i][j];
}

/// Number of functions of all panels, and two for each.
inline Count rows_of(const EliminationModel& model) {
  const EliminationPanel& last = model.panels[model.count - 1];
  return last.first + last.size + 2;
}

/// Where the pivots of a panel are stored.
inline Lanes* kept_of(const EliminationModel& model, Count p, Lanes* kept) {
  return kept + model.panels[p].first * Front::kept(model.band);
}

/// The elimination for one lambda in each lane.
template <class Number>
struct Elimination {
  /// Number of columns of loads: 1 for vectors, 0 for derivatives.
  static constexpr Count loads = std::is_same_v<Number, Lanes> ? 1 : 0;

  const EliminationModel& model;
  EntryPowers lambda;
  Number* table;  // scratch
  PivotSums found = {};
  Number carried[2][border + loads] = {};  // equations at a joint, in units of the panel before it
  double load = 0.5;  // load on the latest equation; irregular, so that it excites every motion
  // Rows in which the pivot is eliminated: each points to where its first unknown would stand.
  Number* rows[Front::most_rows(widest)] = {};
  Number charges[Front::most_rows(widest)] = {};  // loads of these rows
  Count live = 0, slot = 0;                       // their number; place of the next row

  /// Eliminates all panels. kept: where the pivots are stored, for vectors.
  void run(Lanes* kept) {
    // Beyond a free end nothing resists, Q = M = 0.
    carried[0][2] = carried[1][3] = number<Number>(1.0);
    for (Count p = model.count - 1; p >= 0; --p) pass(p, kept_of(model, p, kept));
  }

  /// Scales a carried equation so that its largest entry is 1.
  void scale(Number (&row)[border + loads]) {
    Pack largest = size_of(row[0]);
    for (Count c = 1; c < border; ++c) {
      const Pack size = size_of(row[c]);
      largest = size > largest ? size : largest;
    }
    largest = largest > 0.0 ? largest : all<Pack>(1.0);
    for (Number& one : row) one = one * number<Number>(1.0 / largest);
    found.multiply(largest);
  }

  /// Converts the carried equations to the units of the panel that ends at the joint, across what
  /// acts there, and applies the conditions that hold the end. kept: where the equation is stored
  /// that gives the force beyond a support.
  void join(Count p, Lanes* kept) {
    const EliminationPanel& panel = model.panels[p];
    const double ratio = p + 1 < model.count ? panel.length / model.panels[p + 1].length : 1.0;
    for (auto& row : carried) {
      scale(row);
      row[0] = ratio * row[0];
      row[2] = (1.0 / (ratio * ratio)) * row[2];
      row[3] = (1.0 / ratio) * row[3];
      for (Count c = 0; c < 2; ++c) {
        for (Count k = 0; k < 2; ++k) {
          row[c] = row[c] - row[2 + k] * entry<Number>(at_end(model, panel, k, c), lambda);
        }
      }
    }
    if (panel.held) hold(0, kept);
    if (panel.directed) hold(1, kept);
  }

  /// Makes w or theta (condition 0 or 1) 0 and eliminates Q or M, which is arbitrary.
  void hold(Count condition, Lanes* kept) {
    const Count force = 2 + condition;
    auto& [first, second] = carried;
    const Bits swapped =
        equal(size_of(second[force]) > size_of(first[force]) ? all<Pack>(1.0) : Pack{}, 1.0);
    for (Count c = 0; c < border + loads; ++c) exchange(swapped, first[c], second[c]);
    found.turn(swapped);
    const Number share = inverse(first[force]), factor = second[force] * share;
    found.add(first[force], share);
    for (Count c = 0; c < border + loads; ++c) {
      if constexpr (loads > 0) kept[c] = first[c];
      first[c] = second[c] - factor * first[c];
      second[c] = Number{};
    }
    first[condition] = first[force] = Number{};
    second[condition] = number<Number>(1.0);
    scale(first);
  }

  /// Sets the entries of one more row, and its load, from the first pivot on that is eliminated
  /// from it. Those of an equation are stored from its `first` unknown on.
  void set_row(Count p, const Front& front, Count pivot) {
    const Count band = model.band, equation = pivot + live, last = front.last(equation, 2 * band);
    const Count length = Front::row_length(band), whole = Front::most_rows(band) * length;
    Number* const row = rows[live] = table + slot - front.first(equation);
    slot = slot + 2 * length <= whole ? slot + length : 0;
    Number& charge = charges[live++];
    // Far from the border all entries but the last `band` are set below.
    const bool far = equation + band < front.force;
    for (Count c = far ? equation + band + 1 : pivot; c <= last; ++c) row[c] = Number{};
    const Count carries = equation - front.functions;
    if (carries >= 0) {
      const Number* const by = carried[carries];
      for (Count c = 0; c < moving && c < front.size; ++c) {
        row[front.unknown(c)] = end_shape[c] * by[0] + end_slope[c] * by[1];
      }
      for (Count k = 0; k < 2; ++k) row[front.force + k] = by[2 + k];
      if constexpr (loads > 0) charge = by[border];
    } else {
      const EliminationPanel& panel = model.panels[p];
      const Count own = front.size - 1 - equation;
      const Count low = own > band ? own - band : 0;
      const Count high = own + band < front.size ? own + band : front.size - 1;
      const PencilEntry* of = &inside(model, panel, own, low);
      for (Count c = low; c <= high; ++c, of += model.transposed ? 2 * band : 1) {
        row[front.unknown(c)] = entry<Number>(*of, lambda);
      }
      if (own < moving && front.joined) {
        row[front.force] = number<Number>(end_shape[own]);
        row[front.force + 1] = number<Number>(end_slope[own]);
      }
      if (own < 2 && p > 0) row[front.pivots + 2 + own] = number<Number>(-1.0);
      if (own == 1 && p == 0) {
        Number& turned = row[front.theta];
        turned = turned + number<Number>(model.root * panel.length);
      }
      load += load < 1.0 ? 0.382 : -0.618;
      if constexpr (loads > 0) charge = number<Number>(load);
    }
  }

  /// Exchanges the first row in each lane with the one with the largest entry of the column, if
  /// this is more than threshold times the entry of the first row, up to column `last`. Returns
  /// whether any rows are exchanged.
  bool exchange_rows(Count column, Count last, double threshold) {
    Pack largest = threshold * size_of(rows[0][column]), place{};
    for (Count r = 1; r < live; ++r) {
      const Pack size = size_of(rows[r][column]);
      place = size > largest ? all<Pack>(static_cast<double>(r)) : place;
      largest = size > largest ? size : largest;
    }
    if (!any(~equal(place, 0.0))) return false;
    for (Count r = 1; r < live; ++r) {
      const Bits mask = equal(place, static_cast<double>(r));
      if (!any(mask)) continue;
      for (Count c = column; c <= last; ++c) exchange(mask, rows[0][c], rows[r][c]);
      if constexpr (loads > 0) exchange(mask, charges[0], charges[r]);
      found.turn(mask);
    }
    return true;
  }

  /// Eliminates a column from the rows below the first, whose entries end with `last`.
  void eliminate(Count column, Count last) {
    const Number* const pivot = rows[0];
    const Number share = inverse(pivot[column]);
    found.add(pivot[column], share);
    for (Count r = 1; r < live; ++r) {
      Number* const row = rows[r];
      const Number factor = row[column] * share;
      for (Count c = column + 1; c <= last; ++c) row[c] = less_product(row[c], factor, pivot[c]);
      if constexpr (loads > 0) charges[r] = less_product(charges[r], factor, charges[0]);
    }
  }

  /// Eliminates the functions of a panel.
  void pass(Count p, Lanes* kept) {
    const Front front(model, p);
    if (front.joined) join(p, loads > 0 ? kept + front.pivots * Front::kept(model.band) : nullptr);
    Count reach = model.band;  // how far the functions in the row of a pivot are from its own
    live = 0;
    for (Count pivot = 0; pivot < front.pivots; ++pivot) {
      for (const Count count = front.below(pivot); live < count;) set_row(p, front, pivot);
      const Count farthest = front.last(pivot, 2 * model.band);
      const double threshold = pivot < front.inner ? inner_threshold : 1.0;
      if (exchange_rows(pivot, farthest, threshold)) reach = 2 * model.band;
      eliminate(pivot, front.last(pivot, reach));
      if constexpr (loads > 0) {
        Lanes* const row = kept + pivot * Front::kept(model.band);
        row[0] = charges[0];
        for (Count c = pivot; c <= farthest; ++c) row[1 + c - pivot] = rows[0][c];
      }
      if (reach > model.band) --reach;
      --live;
      for (Count r = 0; r < live; ++r) {
        rows[r] = rows[r + 1];
        if constexpr (loads > 0) charges[r] = charges[r + 1];
      }
    }
    for (Count r = 0; r < live; ++r) {
      for (Count c = 0; c < border; ++c) carried[r][c] = rows[r][front.pivots + c];
      if constexpr (loads > 0) carried[r][border] = charges[r];
    }
  }
};

/// Scratch memory for the rows of an elimination.
template <class Number>
Number* take_table(Layout& layout, const EliminationModel& model) {
  return layout.take<Number>(Front::most_rows(model.band) * Front::row_length(model.band));
}

void log_derivative(const EliminationModel& model, const Points& points, double* out,
                    double* signs) {
  DualLanes* const table =
      laid_out([&](Layout& layout) { return take_table<DualLanes>(layout, model); });
  for (Count first = 0; first < points.count; first += width) {
    Elimination<DualLanes> elimination{model, {lanes_of(points, first)}, table};
    const PivotSums& found = elimination.found;
    elimination.found.multiplied = signs != nullptr;
    elimination.run(nullptr);
    const Lanes others = poles(points, elimination.lambda.one);
    put(out, points, first, found.slope - others);
    if (signs == nullptr) continue;
    put(signs, points, first, found.sign);
    put(signs + points.count, points, first, found.logarithm);
  }
}

/// Forces and moments on a panel for each lambda, at its end and at its start.
struct PanelLoads {
  Lanes end[2], start[2];
};

/// Motion of all panels: amplitudes of the functions of each, from its `first` on, of which the
/// first two are w and theta at its start.
struct PanelMotions {
  Lanes* amplitudes;
  PanelLoads* loads;  // (count,)

  PanelMotions(Layout& layout, const EliminationModel& model)
      : amplitudes(layout.take<Lanes>(rows_of(model))),
        loads(layout.take<PanelLoads>(model.count)) {}
};

/// Displacement and slope of the end of a panel.
inline void set_end(const EliminationPanel& panel, const Lanes* amplitudes, Lanes (&end)[2]) {
  end[0] = end[1] = Lanes{};
  for (Count k = 0; k < moving && k < panel.size; ++k) {
    end[0] += end_shape[k] * amplitudes[k];
    end[1] += end_slope[k] * amplitudes[k];
  }
  if (panel.held) end[0] = Lanes{};
  if (panel.directed) end[1] = Lanes{};
}

/// Computes the null vector of P, or of P^T if the model is transposed, as motions of the panels.
/// table, columns and kept are scratch: for rows, for the unknowns of a panel and for pivots.
void null_vector(const EliminationModel& model, const EntryPowers& lambda, Lanes* table,
                 Lanes* columns, Lanes* kept, const PanelMotions& motions) {
  Elimination<Lanes>{model, lambda, table}.run(kept);
  const Count band = model.band;
  // Loads are scaled so that all numbers are finite: the last pivot is nearly 0.
  const Lanes* const deciding = kept + (Front(model, 0).pivots - 1) * Front::kept(band);
  const Lanes size{1.0 / (1.0 + size_of(deciding[0] * inverse(not_zero(deciding[1])))), Pack{}};
  Lanes start[border] = {};  // w, theta, Q and M at the panel's start
  Lanes* const x = columns;
  for (Count p = 0; p < model.count; ++p) {
    const EliminationPanel& panel = model.panels[p];
    const Front front(model, p);
    const Lanes* const pivots = kept_of(model, p, kept);
    Lanes* const amplitudes = motions.amplitudes + panel.first;
    PanelLoads& found = motions.loads[p];
    for (Count k = 0; k < border; ++k) x[front.pivots + k] = start[k];
    for (Count own = front.pivots - 1; own >= 0; --own) {
      const Lanes* const row = pivots + own * Front::kept(band);
      Lanes sum = row[0] * size;
      for (Count c = own + 1; c <= front.last(own, 2 * band); ++c) {
        sum = less_product(sum, row[1 + c - own], x[c]);
      }
      x[own] = sum * inverse(not_zero(row[1]));
    }
    for (Count k = 0; k < panel.size; ++k) amplitudes[k] = x[front.unknown(k)];
    for (Count k = 0; k < 2; ++k) {
      found.start[k] = start[2 + k];
      found.end[k] = front.joined ? x[front.force + k] : Lanes{};
    }
    if (p == 0) found.start[1] = (-model.root * panel.length) * amplitudes[1];
    if (p + 1 == model.count) break;
    const double ratio = panel.length / model.panels[p + 1].length;
    Lanes end[2], loads[2] = {found.end[0], found.end[1]};
    set_end(panel, amplitudes, end);
    if (panel.held) {  // at a support the force of the panel includes its reaction
      const Lanes* const row = pivots + front.pivots * Front::kept(band);
      const Lanes sum = row[1] * end[1] + row[3] * loads[1];
      loads[0] = (row[4] * size - sum) * inverse(not_zero(row[2]));
    }
    for (Count k = 0; k < 2; ++k) {
      for (Count c = 0; c < 2; ++c) {
        loads[k] = loads[k] - entry<Lanes>(at_end(model, panel, k, c), lambda) * end[c];
      }
    }
    start[0] = ratio * end[0];
    start[1] = end[1];
    start[2] = (1.0 / (ratio * ratio)) * loads[0];
    start[3] = (1.0 / ratio) * loads[1];
  }
}

/// Products of a row of P and of its derivatives with a vector.
struct RowProducts {
  Lanes rest, by_lambda, by_u;
  Pack entries{};  // sum of absolute values

  void add(const PencilEntry& of, const EntryPowers& lambda, const Lanes& x) {
    const Lanes value = entry<Lanes>(of, lambda);
    rest += value * x;
    by_lambda += entry_by_lambda(of, lambda) * x;
    by_u += entry_by_speed(of, lambda) * x;
    entries += size_of(value) * size_of(x);
  }
};

/// Sums over all panels and stations of products with two vectors.
struct PairSums {
  Lanes value, by_lambda, by_u, by_right;
  Pack rest{}, entries{}, sums{};

  /// Adds the products of a row, y and x being the entries of the vectors that belong to it.
  void add(const RowProducts& row, double weight, const Lanes& y, const Lanes& x) {
    by_lambda += weight * (y * row.by_lambda);
    by_u += weight * (y * row.by_u);
    by_right += weight * (conjugate(x) * row.by_lambda);
    entries += weight * (size_of(y) * row.entries);
  }
  void add_rest(const Lanes& of_row, double weight, const Lanes& y) {
    value += weight * (y * of_row);
    rest += weight * (size_of(y) * size_of(of_row));
  }
};

void pairs(const EliminationModel& model, const Points& points, const PairsAsked& out) {
  const Count band = model.band, wide = 2 * band + 1;
  struct Scratch {
    Lanes *table, *columns, *kept;
    PanelMotions right, left;
  };
  const Scratch scratch = laid_out([&](Layout& layout) {
    return Scratch{take_table<Lanes>(layout, model),
                   layout.take<Lanes>(rows_of(model) + Front::others),
                   layout.take<Lanes>(rows_of(model) * Front::kept(band)),
                   {layout, model},
                   {layout, model}};
  });
  const auto& [table, columns, kept, rights, lefts] = scratch;
  EliminationModel transposed = model;
  transposed.transposed = true;
  for (Count first = 0; first < points.count; first += width) {
    const EntryPowers lambda{lanes_of(points, first)};
    null_vector(model, lambda, table, columns, kept, rights);
    null_vector(transposed, lambda, table, columns, kept, lefts);
    PairSums sum;
    Count coordinate = 0;
    const auto coordinates = [&](const Lanes& right, const Lanes& left, double scale) {
      if (out.right != nullptr)
        put(out.right + 2 * coordinate * points.count, points, first, scale * right);
      if (out.left != nullptr)
        put(out.left + 2 * coordinate * points.count, points, first, scale * left);
      ++coordinate;
    };
    if (model.turns) {
      coordinates(rights.amplitudes[1], lefts.amplitudes[1], 1.0);
    }
    for (Count p = 0; p < model.count; ++p) {
      const EliminationPanel& panel = model.panels[p];
      const PanelLoads &load = rights.loads[p], &other = lefts.loads[p];
      const Lanes* const right = rights.amplitudes + panel.first;
      const Lanes* const left = lefts.amplitudes + panel.first;
      const Count size = panel.size;
      const double weight = 1.0 / panel.length, scale = 1.0 / std::sqrt(panel.length);
      for (Count k = 2; k < size; ++k) coordinates(right[k], left[k], scale);
      for (Count i = 0; i < size; ++i) {
        const PencilEntry* const entries = panel.entries + i * wide + band - i;
        const Count low = i > band ? i - band : 0, high = i + band < size ? i + band : size - 1;
        const Lanes &x = right[i], &y = left[i];
        RowProducts row;
        for (Count j = low; j <= high; ++j) row.add(entries[j], lambda, right[j]);
        for (Count k = 0; i < moving && k < 2; ++k) {
          const double moved = k == 0 ? end_shape[i] : end_slope[i];
          row.rest += moved * load.end[k];
          row.entries += std::fabs(moved) * size_of(load.end[k]);
          sum.sums += (weight * std::fabs(moved)) *
                      (size_of(other.end[k]) * size_of(x) + size_of(load.end[k]) * size_of(y));
        }
        // The equations of the first two functions give the force and moment by which the panel
        // resists at its start, or those of the root.
        if (i < 2) row.rest = row.rest - load.start[i];
        if (i < 2 && p == 0) row.entries += size_of(load.start[i]);
        sum.add(row, weight, y, x);
        sum.add_rest(row.rest, weight, y);
      }
      Lanes end[2], dual[2];
      set_end(panel, right, end);
      set_end(panel, left, dual);
      for (Count i = 0; i < 2; ++i) {
        RowProducts row;
        for (Count c = 0; c < 2; ++c) row.add(panel.station[i][c], lambda, end[c]);
        sum.add(row, weight, dual[i], end[i]);
        // At the end of the pipe only what acts there, or what holds it, resists.
        if (p + 1 == model.count) sum.add_rest(row.rest - load.end[i], weight, dual[i]);
      }
    }
    put(out.value, points, first, sum.value);
    put(out.by_lambda, points, first, sum.by_lambda);
    put(out.by_u, points, first, sum.by_u);
    if (out.by_right != nullptr) put(out.by_right, points, first, sum.by_right);
    put(out.rest, points, first, sum.rest);
    put(out.entries, points, first, sum.entries);
    put(out.sums, points, first, sum.sums);
  }
}

}  // namespace

namespace pipedyn {

const EliminationKernel PIPEDYN_NAMED(elimination) = {.log_derivative = ::log_derivative,
                                                      .pairs = ::pairs};

}  // namespace pipedyn
