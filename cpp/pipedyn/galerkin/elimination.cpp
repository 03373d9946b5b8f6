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
using pipedyn::PairsAsked;
using pipedyn::PencilEntry;
using pipedyn::Points;
using pipedyn::widest;

/// Displacement of the end of a panel for a unit amplitude of its second curvature, -sqrt(3) / 6.
constexpr double bent = -0.28867513459481287;
/// Displacement and slope of the end of a panel for unit amplitudes of its first four functions.
constexpr double end_shape[4] = {1.0, 1.0, 0.5, bent}, end_slope[4] = {0.0, 1.0, 1.0, 0.0};
/// Number of functions whose displacement or slope at the end of the panel is not 0.
constexpr Count moving = 4;
/// Number of unknowns that remain in the equations after the functions of a panel: w, theta, Q and
/// M at its start.
constexpr Count border = 4;

/// Powers of lambda from which the entries of P are computed.
struct EntryPowers {
  Lanes one, two, twice;  // lambda, its square and 2 lambda

  explicit EntryPowers(const Lanes& lambda)
      : one(lambda), two(lambda * lambda), twice(2.0 * lambda) {}
};

template <class Number>
Number entry(const PencilEntry& of, const EntryPowers& lambda);

template <>
inline Lanes entry<Lanes>(const PencilEntry& of, const EntryPowers& lambda) {
  return {of.still + of.rate * lambda.one.re + of.square * lambda.two.re,
          of.loss + of.rate * lambda.one.im + of.square * lambda.two.im};
}

/// Derivatives of an entry of P by lambda and by the speed.
inline Lanes entry_by_lambda(const PencilEntry& of, const EntryPowers& lambda) {
  return of.square * lambda.twice + of.rate;
}
inline Lanes entry_by_speed(const PencilEntry& of, const EntryPowers& lambda) {
  return of.rate_by_speed * lambda.one + of.still_by_speed;
}

template <>
inline DualLanes entry<DualLanes>(const PencilEntry& of, const EntryPowers& lambda) {
  return {entry<Lanes>(of, lambda), entry_by_lambda(of, lambda)};
}

inline Lanes number(double x, Lanes) { return {all<Pack>(x), Pack{}}; }
inline DualLanes number(double x, DualLanes) { return {number(x, Lanes{}), {}}; }

#if PIPEDYN_WIDTH > 1
inline Pack chosen(const Bits& mask, const Pack& a, const Pack& b) {
  return same_bits<Pack>((same_bits<Bits>(a) & mask) | (same_bits<Bits>(b) & ~mask));
}
#else
inline Pack chosen(const Bits& mask, const Pack& a, const Pack& b) { return mask ? a : b; }
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

inline Bits equal(const Pack& a, double b) {
#if PIPEDYN_WIDTH > 1
  return a == b;
#else
  return a == b ? -1 : 0;
#endif
}

/// Returns a, or a small number whose square is representable, if a is 0.
inline Lanes not_zero(Lanes a) {
  const Pack size = size_of(a);
  a.re = size > 0.0 ? a.re : all<Pack>(1e-150);
  return a;
}

/// The product of pivots, with its phase and the logarithm of its absolute value kept separately.
struct Product {
  Lanes phase{all<Pack>(1.0), Pack{}};
  Pack logarithm{};

  void multiply(const Lanes& pivot) {
    double re[width], im[width], logarithms[width];
    const Lanes by = phase * pivot;
    store(re, by.re);
    store(im, by.im);
    for (Count i = 0; i < width; ++i) {
      const double size = std::hypot(re[i], im[i]), share = size > 0.0 ? 1.0 / size : 0.0;
      logarithms[i] = std::log(size);
      re[i] *= share;
      im[i] *= share;
    }
    phase = {load<Pack>(re), load<Pack>(im)};
    logarithm += load<Pack>(logarithms);
  }
  void turn(const Bits& swapped) { phase = chosen(swapped, -1.0 * phase, phase); }
};

/// Sum over pivots for the derivative of the logarithm of the determinant, and, if wanted, their
/// product.
struct PivotSums {
  Lanes slope;
  Product* product = nullptr;

  void add(const DualLanes& pivot, const DualLanes& share) {
    slope += pivot.slope * share.value;
    if (product != nullptr) product->multiply(pivot.value);
  }
  void add(const Lanes& pivot, const Lanes&) {
    if (product != nullptr) product->multiply(pivot);
  }
  void turn(const Bits& swapped) {
    if (product != nullptr) product->turn(swapped);
  }
};

/// x - a b, with each part written as a chain of fused operations.
inline Lanes less_product(const Lanes& x, const Lanes& a, const Lanes& b) {
  return {x.re - a.re * b.re + a.im * b.im, x.im - a.re * b.im - a.im * b.re};
}
inline DualLanes less_product(const DualLanes& x, const DualLanes& a, const DualLanes& b) {
  return {less_product(x.value, a.value, b.value),
          less_product(less_product(x.slope, a.slope, b.value), a.value, b.slope)};
}

/// Factor by which another entry must be larger to be the pivot instead, in the window of a panel.
/// Growth is bounded as it is if the largest entry is the pivot, and fewer rows are exchanged
/// (Duff, Erisman and Reid 1986, ch. 5). Where panels join, the largest entry is taken: otherwise
/// vectors lose four digits with three panels.
constexpr double window_threshold = 10.0;

/// Exchanges two numbers in the lanes of a mask.
template <class Number>
void exchange(const Bits& mask, Number& a, Number& b) {
  const Number before = a;
  a = chosen(mask, b, before);
  b = chosen(mask, before, b);
}

/// Whether a choice of pivot rows exchanges any row with the first.
inline bool moves(const Pack& place, Count first) {
  return any(~equal(place, static_cast<double>(first)));
}

/// Rows of equations in which columns are eliminated.
template <class Number>
struct Rows {
  Number* const* at;
  Number* const* loads = nullptr;  // one more number in each row, or none

  Number* operator[](Count r) const { return at[r]; }

  /// Number of the row, from first to last - 1, that becomes the first in each lane: the row with
  /// the largest entry of the column, if this is more than threshold times the entry of the first
  /// row.
  Pack choice(Count first, Count last, Count column, double threshold = 1.0) const {
    Pack largest = threshold * size_of(at[first][column]);
    Pack place = all<Pack>(static_cast<double>(first));
    for (Count r = first + 1; r < last; ++r) {
      const Pack size = size_of(at[r][column]);
      place = size > largest ? all<Pack>(static_cast<double>(r)) : place;
      largest = size > largest ? size : largest;
    }
    return place;
  }

  /// Exchanges the first row with the chosen pivot row in each lane.
  void exchange_rows(const Pack& place, Count first, Count last, Count column, Count columns,
                     PivotSums& found) const {
    for (Count r = first + 1; r < last; ++r) {
      const Bits mask = equal(place, static_cast<double>(r));
      if (!any(mask)) continue;
      for (Count c = column; c < columns; ++c) exchange(mask, at[first][c], at[r][c]);
      if (loads != nullptr) exchange(mask, *loads[first], *loads[r]);
      found.turn(mask);
    }
  }

  /// Chooses the row with the largest entry of a column and exchanges it with the first.
  Pack choose(Count first, Count last, Count column, Count columns, PivotSums& found) const {
    const Pack place = choice(first, last, column);
    if (moves(place, first)) exchange_rows(place, first, last, column, columns, found);
    return place;
  }
};

/// Reverses the exchange of rows by a choice of pivot rows.
inline void put_back(const Pack& place, Lanes* rows, Count first, Count last) {
  if (!moves(place, first)) return;
  for (Count r = first + 1; r < last; ++r) {
    exchange(equal(place, static_cast<double>(r)), rows[first], rows[r]);
  }
}

/// Whether any entry of what acts at a station is not 0.
inline bool acts_on(const PencilEntry (&station)[2][2]) {
  for (const auto& row : station) {
    for (const PencilEntry& of : row) {
      if (of.still != 0.0 || of.loss != 0.0 || of.rate != 0.0 || of.square != 0.0) return true;
    }
  }
  return false;
}

/// Number of unknown forces at the end of a panel, with equations of their own: 0 if the end is
/// free.
inline Count forces_at_end(const EliminationModel& model, Count p) {
  const EliminationPanel& panel = model.panels[p];
  const bool free = p + 1 == model.count && !panel.held && !panel.directed;
  return free && !acts_on(panel.station) ? 0 : 2;
}
/// Number of functions of a panel that are eliminated in a moving window of rows, before the other
/// functions and the carried equations are put into one table.
inline Count windowed(Count size, Count band, Count forces) {
  const Count most = size - band - (forces > 0 ? moving : 2);
  return most > 0 ? most : 0;
}
/// Largest numbers of rows and columns of this table.
inline Count table_rows(Count band) { return band + moving + 2; }
inline Count table_columns(Count band) { return band + 4 + border + 1; }
/// One past the last row of the table with an entry in a column. The carried equations contain the
/// functions that move the end, which come last.
inline Count rows_below(Count column, Count band, Count curvatures, Count forces) {
  const Count top = curvatures + 1, count = top + 1 + forces;
  const bool carried = forces > 0 && column + moving > top;
  return carried || column + band >= top ? count : column + band + 1;
}
/// Number of columns of a row of the window: its own, and those beyond that exchanged rows have.
inline Count window_columns(Count band) { return 3 * band + 1; }
/// Stored data of a pivot, one after the other: `columns` entries of its row and the load; the
/// factors by which the row is multiplied and subtracted from each row below; the row that was
/// exchanged with the first, with the index of the last entry; the value that belongs to the pivot
/// in the solution of the transposed equations.
struct KeptPivot {
  Lanes* row;
  Count columns, rows;

  /// Stores the row up to an entry, beyond which it is 0.
  void keep(const Lanes* pivot, Count last, const Lanes& load, const Pack& place, const Lanes* by,
            Count below) const {
    for (Count c = 0; c <= last; ++c) row[c] = pivot[c];
    row[columns] = load;
    for (Count r = 0; r < below; ++r) row[columns + 1 + r] = by[r];
    row[columns + 1 + rows] = {place, all<Pack>(static_cast<double>(last))};
  }
  const Lanes& load() const { return row[columns]; }
  Lanes* factors() const { return row + columns + 1; }
  const Pack& place() const { return row[columns + 1 + rows].re; }
  Count last() const {
    double number;
    std::memcpy(&number, &row[columns + 1 + rows].im, sizeof number);
    return static_cast<Count>(number);
  }
  Lanes& left() const { return row[columns + 2 + rows]; }
  static Count numbers(Count columns, Count rows) { return columns + rows + 3; }
};

/// Stored data of the elimination of one of two equations at a joint or at the root.
struct KeptJoint {
  Lanes row[5], factor, left;
  Pack place, share;  // share: factor that scales the other equation afterwards
};

/// Stored data of the elimination of a panel: of the functions in the window, of the table, and
/// of the conditions that hold the end; then the coefficients of displacement and slope in the two
/// equations at its end, and the factors that scale those left at its start.
struct KeptPanel {
  Lanes *windows, *tables;
  Count band, forces, curvatures;
  KeptJoint holds[2];
  Lanes ends[2][2];
  Pack shares[2];

  KeptPivot window(Count step) const {
    const Count columns = 2 * band + 1;
    return {windows + step * KeptPivot::numbers(columns, band), columns, band};
  }
  KeptPivot table(Count step) const {
    const Count columns = curvatures + forces + border, rows = curvatures + forces + 2;
    return {tables + step * KeptPivot::numbers(columns, rows), columns, rows};
  }
  static Count window_numbers(Count size, Count band, Count forces) {
    return windowed(size, band, forces) * KeptPivot::numbers(2 * band + 1, band);
  }
  static Count table_numbers(Count band) {
    return table_rows(band) * KeptPivot::numbers(table_columns(band) - 1, table_rows(band));
  }
};

/// Loads on the equations, irregular so that they excite every motion.
struct LoadSequence {
  double weight = 0.5;

  double next() {
    weight += weight < 1.0 ? 0.382 : -0.618;
    return weight;
  }
};

/// Converts the coefficients of displacement, slope, force and moment beyond the end of a panel,
/// such as those of an equation, to the coefficients inside the panel: across what acts there, and
/// in the units of the panel.
template <class Number>
void into_panel(const EliminationPanel& panel, double length_beyond, const EntryPowers& lambda,
                Number* row) {
  const double ratio = panel.length / length_beyond;
  row[0] = ratio * row[0];
  row[2] = (1.0 / (ratio * ratio)) * row[2];
  row[3] = (1.0 / ratio) * row[3];
  for (Count c = 0; c < 2; ++c) {
    for (Count k = 0; k < 2; ++k) {
      row[c] = row[c] - row[2 + k] * entry<Number>(panel.station[k][c], lambda);
    }
  }
}

/// Length of the panel beyond the end of panel p; for the last panel its own length.
inline double length_beyond(const EliminationModel& model, Count p) {
  return model.panels[p + 1 < model.count ? p + 1 : p].length;
}

/// The elimination for one lambda in each lane.
template <class Number>
struct Elimination {
  /// Number of columns of loads: 1 for vectors, 0 for derivatives.
  static constexpr Count loads = std::is_same_v<Number, Lanes> ? 1 : 0;

  const EliminationModel& model;
  EntryPowers lambda;
  PivotSums found;
  Number *window, *table;        // scratch
  Number carried[2][4 + loads];  // equations at a joint, in units of the panel before it
  LoadSequence load = {};

  /// Entry of P for functions i and j of a panel.
  Number at(const EliminationPanel& panel, Count i, Count j) const {
    return entry<Number>(panel.entries[i * (2 * model.band + 1) + j - i + model.band], lambda);
  }

  /// Sets the equations at the free end: beyond it nothing resists, Q = M = 0.
  void start() {
    for (auto& row : carried) {
      for (Number& one : row) one = Number{};
    }
    carried[0][2] = carried[1][3] = number(1.0, Number{});
  }

  /// Converts the carried equations to the units of the panel that ends at the joint, across what
  /// acts there, and applies the conditions that hold the end. kept: where the elimination is
  /// stored, or null.
  void join(Count p, KeptPanel* kept) {
    const EliminationPanel& panel = model.panels[p];
    for (auto& row : carried) into_panel(panel, length_beyond(model, p), lambda, row);
    if (panel.held) hold(0, kept);
    if (panel.directed) hold(1, kept);
  }

  /// Makes w or theta (place 0 or 1) 0 and eliminates Q or M, which is arbitrary.
  void hold(Count place, KeptPanel* kept) {
    constexpr Count columns = 4 + loads;
    Number ordered[2][columns];  // with the force first
    const Count force = 2 + place;
    for (Count r = 0; r < 2; ++r) {
      for (Count c = 0, next = 1; c < columns; ++c) {
        ordered[r][c == force ? 0 : next++] = carried[r][c];
      }
    }
    Number* const both[2] = {ordered[0], ordered[1]};
    const Rows<Number> sorted{both};
    const Pack first = sorted.choose(0, 2, 0, columns, found);
    const Number share = inverse(ordered[0][0]), factor = ordered[1][0] * share;
    found.add(ordered[0][0], share);
    for (Count c = 0, next = 1; c < columns; ++c) {
      carried[0][c] = Number{};
      carried[1][c] = Number{};
      if (c == force) continue;
      carried[0][c] = ordered[1][next] - factor * ordered[0][next];
      ++next;
    }
    carried[0][place] = Number{};
    carried[1][place] = number(1.0, Number{});
    const Pack scaled = scale(0);
    if constexpr (loads > 0) {
      KeptJoint& to = kept->holds[place];
      for (Count c = 0; c < columns; ++c) to.row[c] = ordered[0][c];
      to.factor = factor;
      to.place = first;
      to.share = scaled;
    }
  }

  /// Scales an equation so that its largest entry is 1; returns the factor.
  Pack scale(Count r) {
    Pack largest = size_of(carried[r][0]);
    for (Count c = 1; c < 4; ++c) {
      const Pack size = size_of(carried[r][c]);
      largest = size > largest ? size : largest;
    }
    largest = largest > 0.0 ? largest : all<Pack>(1.0);
    const Lanes share{1.0 / largest, Pack{}};
    for (Number& one : carried[r]) one = one * constant(share);
    if (found.product != nullptr) found.product->multiply({largest, Pack{}});
    return share.re;
  }
  static Lanes constant_of(const Lanes& x, Lanes) { return x; }
  static DualLanes constant_of(const Lanes& x, DualLanes) { return {x, {}}; }
  static Number constant(const Lanes& x) { return constant_of(x, Number{}); }

  /// Eliminates the functions of a panel. kept: where the elimination is stored, or null.
  void pass(Count p, KeptPanel* kept) {
    const EliminationPanel& panel = model.panels[p];
    const Count forces = forces_at_end(model, p);
    if (forces > 0) join(p, kept);
    const Count band = model.band, wide = 2 * band + 1, size = panel.size;
    const Count many = windowed(size, band, forces), stride = window_columns(band);
    // Row i of P starts with column i + band and goes down; `rows` point to the column of the
    // pivot.
    Number *begins[widest + 1], *rows[widest + 1], *charges[widest + 1];
    Number factors[widest + moving + 1];
    const auto fill = [&](Count place, Count i) {
      Number* const to = begins[place];
      const Count high = i + band < size ? i + band : size - 1, low = i > band ? i - band : 0;
      for (Count j = high; j >= low; --j) to[i + band - j] = at(panel, i, j);
      for (Count c = 0; c < loads; ++c) to[stride + c] = number(load.next(), Number{});
    };
    const auto take_from_pivot = [&] {
      for (Count r = 0; r <= band; ++r) {
        rows[r] = begins[r] + band - r;
        charges[r] = begins[r] + stride;
      }
    };
    Count top = size - 1, filled = 0;
    Count lowest = size;               // lowest column that rows exchanged so far may reach
    const auto reach = [&](Count r) {  // last entry of a row that is set; others are 0
      const Count own = r + band < top ? r + band : top, before = top - lowest;
      return own > before ? own : before;
    };
    if (many > 0) {
      for (Count r = 0; r <= band; ++r) {
        begins[r] = window + r * (stride + loads);
        fill(r, top - r);
      }
      const Rows<Number> candidates{rows, loads > 0 ? charges : nullptr};
      for (Count step = 0;; --top) {
        take_from_pivot();
        const Pack first = candidates.choice(0, band + 1, 0, window_threshold);
        if (moves(first, 0)) {
          for (Count r = 0; r <= band; ++r) {  // clears entries that no row has reached so far
            for (Count c = reach(r) + 1; c < wide; ++c) rows[r][c] = Number{};
          }
          candidates.exchange_rows(first, 0, band + 1, 0, wide, found);
          lowest = top - 2 * band;
        }
        const Count last = top - lowest > band ? top - lowest : band;
        const Number* const pivot = rows[0];
        const Number share = inverse(pivot[0]);
        found.add(pivot[0], share);
        for (Count r = 1; r <= band; ++r) {
          const Number factor = factors[r - 1] = rows[r][0] * share;
          for (Count c = 1; c <= last; ++c) rows[r][c] = less_product(rows[r][c], factor, pivot[c]);
          for (Count c = 0; c < loads; ++c) {
            charges[r][c] = less_product(charges[r][c], factor, charges[0][c]);
          }
        }
        if constexpr (loads > 0) {
          kept->window(step).keep(pivot, last, charges[0][0], first, factors, band);
        }
        Number* const free = begins[0];
        for (Count r = 0; r < band; ++r) begins[r] = begins[r + 1];
        begins[band] = free;
        if (++step == many) break;
        fill(band, top - 1 - band);
      }
      --top;
      filled = band;
      take_from_pivot();
    }
    const Count curvatures = top - 1, pivots = curvatures + forces, count = pivots + 2;
    const Count loaded = pivots + border, columns = loaded + loads;
    if constexpr (loads > 0) {
      kept->forces = forces;
      kept->curvatures = curvatures;
      for (Count r = 0; r < 2; ++r) {
        for (Count c = 0; c < 2; ++c) kept->ends[r][c] = carried[r][c];
      }
    }
    Number* table_rows[widest + moving + 2];
    for (Count r = 0; r < count; ++r) table_rows[r] = table + r * columns;
    const Rows<Number> all_rows{table_rows};
    const auto place = [&](Count column) { return column >= 2 ? top - column : pivots + column; };
    for (Count r = 0; r < count; ++r) {
      Number* const row = all_rows[r];
      for (Count c = 0; c < columns; ++c) row[c] = Number{};
      if (r < filled) {
        for (Count c = 0; c <= reach(r) && c <= top; ++c) row[place(top - c)] = rows[r][c];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = charges[r][c];
      } else if (r <= top) {
        const Count own = top - r;
        const Count low = own > band ? own - band : 0, high = own + band < top ? own + band : top;
        for (Count c = low; c <= high; ++c) row[place(c)] = at(panel, own, c);
        if (own < moving && forces > 0) {
          row[curvatures] = number(end_shape[own], Number{});
          row[curvatures + 1] = number(end_slope[own], Number{});
        }
        if (own < 2) row[pivots + 2 + own] = number(-1.0, Number{});
        for (Count c = 0; c < loads; ++c) row[loaded + c] = number(load.next(), Number{});
      } else {
        const Number* const by = carried[r - top - 1];
        for (Count c = 0; c < moving && c <= top; ++c) {
          row[place(c)] = end_shape[c] * by[0] + end_slope[c] * by[1];
        }
        row[curvatures] = by[2];
        row[curvatures + 1] = by[3];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = by[4 + c];
      }
    }
    for (Count c = 0; c < pivots; ++c) {
      const Count last = rows_below(c, band, curvatures, forces);
      const Pack first = all_rows.choose(c, last, c, columns, found);
      const Number* const pivot = all_rows[c];
      const Number share = inverse(pivot[c]);
      found.add(pivot[c], share);
      for (Count r = c + 1; r < last; ++r) {
        Number* const row = all_rows[r];
        const Number factor = factors[r - c - 1] = row[c] * share;
        for (Count k = c + 1; k < columns; ++k) row[k] = less_product(row[k], factor, pivot[k]);
      }
      if constexpr (loads > 0) {
        kept->table(c).keep(pivot, loaded - 1, pivot[loaded], first, factors, last - c - 1);
      }
    }
    for (Count r = 0; r < 2; ++r) {
      const Number* const rest = all_rows[pivots + r] + pivots;
      for (Count c = 0; c < 4 + loads; ++c) carried[r][c] = rest[c];
      const Pack share = scale(r);
      if constexpr (loads > 0) kept->shares[r] = share;
    }
  }

  /// At the root, w = 0 and either theta = 0 or M + k theta = 0: leaves two triangular equations in
  /// Q and the other unknown.
  void end(Number (&last)[2][2 + loads], KeptJoint* kept) {
    const double spring = model.turns ? model.root * model.panels[0].length : 0.0;
    for (Count r = 0; r < 2; ++r) {
      last[r][0] = carried[r][2];
      last[r][1] = model.turns ? carried[r][1] - spring * carried[r][3] : carried[r][3];
      for (Count c = 0; c < loads; ++c) last[r][2 + c] = carried[r][4 + c];
    }
    Number* const both[2] = {last[0], last[1]};
    const Rows<Number> rows{both};
    const Pack first = rows.choose(0, 2, 0, 2 + loads, found);
    const Number share = inverse(last[0][0]), factor = last[1][0] * share;
    found.add(last[0][0], share);
    for (Count c = 1; c < 2 + loads; ++c) last[1][c] = last[1][c] - factor * last[0][c];
    if constexpr (loads > 0) {
      kept->factor = factor;
      kept->place = first;
    }
    const Number next = inverse(last[1][1]);
    found.add(last[1][1], next);
  }
};

void log_derivative(const EliminationModel& model, const Points& points, double* out,
                    double* signs) {
  struct Scratch {
    DualLanes *window, *table;
  };
  const auto [window, table] = laid_out([&](Layout& layout) {
    return Scratch{layout.take<DualLanes>((model.band + 1) * window_columns(model.band)),
                   layout.take<DualLanes>(table_rows(model.band) * table_columns(model.band))};
  });
  for (Count first = 0; first < points.count; first += width) {
    Product product;
    Elimination<DualLanes> elimination{model,
                                       EntryPowers(taken(points, first)),
                                       {{}, signs != nullptr ? &product : nullptr},
                                       window,
                                       table,
                                       {}};
    elimination.start();
    for (Count p = model.count - 1; p >= 0; --p) elimination.pass(p, nullptr);
    DualLanes last[2][2];
    elimination.end(last, nullptr);
    const Lanes others = poles(points, elimination.lambda.one);
    put(out, points, first, elimination.found.slope - others);
    if (signs == nullptr) continue;
    put(signs, points, first, product.phase.re);
    put(signs + points.count, points, first, product.logarithm);
  }
}

/// Motion of a panel for each lambda: amplitudes of its functions, and force and moment at its end.
struct PanelMotion {
  Lanes* amplitudes;  // (size,); the first two are w and theta at its start
  Lanes force, moment;
};

struct VectorScratch {
  Lanes *window, *table, *columns;  // columns: for the functions and the border of a panel or more
  KeptPanel* kept;
  PanelMotion *right, *left;
};

/// The two equations at the root: triangular, with a load.
struct Root {
  Lanes last[2][3];
  KeptJoint kept;
};

/// Solves U z = L^-1 loads for the right null vector, where P = L U up to exchanges of rows.
void solve_right(const EliminationModel& model, const EntryPowers& lambda, const Root& root,
                 const VectorScratch& scratch) {
  PanelMotion* const motions = scratch.right;
  const auto& last = root.last;
  const Lanes second = last[1][2] * inverse(not_zero(last[1][1]));
  // The factor `size` scales the loads so that all later numbers are finite.
  const Lanes size{1.0 / (1.0 + size_of(second)), Pack{}};
  Lanes start[4];  // w, theta, Q and M at the panel's start
  start[2] = (last[0][2] - last[0][1] * second) * size * inverse(not_zero(last[0][0]));
  start[0] = Lanes{};
  start[1] = model.turns ? second * size : Lanes{};
  start[3] = model.turns ? (-model.root * model.panels[0].length) * start[1] : second * size;
  for (Count p = 0; p < model.count; ++p) {
    const EliminationPanel& panel = model.panels[p];
    PanelMotion& motion = motions[p];
    Lanes* const x = motion.amplitudes;
    const KeptPanel& kept = scratch.kept[p];
    const Count many = windowed(panel.size, model.band, kept.forces);
    const Count curvatures = kept.curvatures, pivots = curvatures + kept.forces;
    x[0] = start[0];
    x[1] = start[1];
    const auto place_of = [&](Count c) -> Lanes& {  // unknown of a column before those of `start`
      if (c < curvatures) return x[curvatures + 1 - c];
      return c == curvatures ? motion.force : motion.moment;
    };
    for (Count c = pivots - 1; c >= 0; --c) {
      const KeptPivot pivot = kept.table(c);
      const Lanes* const row = pivot.row;
      Lanes sum = pivot.load() * size;
      for (Count k = c + 1; k < pivots; ++k) sum = less_product(sum, row[k], place_of(k));
      for (Count k = 0; k < border; ++k) sum = less_product(sum, row[pivots + k], start[k]);
      place_of(c) = sum * inverse(not_zero(row[c]));
    }
    for (Count step = many - 1; step >= 0; --step) {
      const KeptPivot pivot = kept.window(step);
      const Lanes* const row = pivot.row;
      const Count own = panel.size - 1 - step;
      Lanes sum = pivot.load() * size;
      const Count end = pivot.last();
      for (Count c = 1; c <= end && c <= own; ++c) sum = less_product(sum, row[c], x[own - c]);
      x[own] = sum * inverse(not_zero(row[0]));
    }
    if (kept.forces == 0) motion.force = motion.moment = Lanes{};
    if (p + 1 == model.count) break;
    const double ratio = panel.length / model.panels[p + 1].length;
    Lanes end[2], forces[2] = {motion.force, motion.moment};
    for (Count k = 0; k < moving && k < panel.size; ++k) {
      end[0] += end_shape[k] * x[k];
      end[1] += end_slope[k] * x[k];
    }
    if (panel.held) {  // at a support the force of the panel includes its reaction
      end[0] = Lanes{};
      const Lanes* const row = kept.holds[0].row;
      const Lanes sum = row[2] * end[1] + row[3] * motion.moment;
      forces[0] = (row[4] * size - sum) * inverse(not_zero(row[0]));
    }
    for (Count k = 0; k < 2; ++k) {
      for (Count c = 0; c < 2; ++c) {
        forces[k] = forces[k] - entry<Lanes>(panel.station[k][c], lambda) * end[c];
      }
    }
    start[0] = ratio * end[0];
    start[1] = end[1];
    start[2] = (1.0 / (ratio * ratio)) * forces[0];
    start[3] = (1.0 / ratio) * forces[1];
  }
}

/// Solves U^T s = loads, with one load on the column of each function, in the order of the pivots.
/// Returns a factor by which the solution is to be multiplied so that later numbers are finite.
Pack solve_transposed(const EliminationModel& model, const EntryPowers& lambda, Root& root,
                      const VectorScratch& scratch) {
  LoadSequence load;
  Lanes start[4] = {};  // what remains in the columns of w, theta, Q and M
  Lanes* const rest = scratch.columns;
  for (Count p = model.count - 1; p >= 0; --p) {
    const EliminationPanel& panel = model.panels[p];
    KeptPanel& kept = scratch.kept[p];
    const Count many = windowed(panel.size, model.band, kept.forces);
    into_panel(panel, length_beyond(model, p), lambda, start);
    for (Count place = 0; place < 2; ++place) {
      if (!(place == 0 ? panel.held : panel.directed)) continue;
      KeptJoint& joint = kept.holds[place];
      const Count force = 2 + place;
      joint.left = start[force] * inverse(not_zero(joint.row[0]));
      for (Count c = 0, next = 1; c < 4; ++c) {
        if (c != force) start[c] = start[c] - joint.row[next++] * joint.left;
      }
      start[place] = start[force] = Lanes{};
    }
    // The columns are ordered as in the window, by falling degree, and then as in the table.
    const Count pivots = kept.curvatures + kept.forces;
    Lanes *const in_table = rest + many, *const at_start = in_table + pivots;
    const auto column_of = [&](Count function) {
      return function >= 2 ? rest + (panel.size - 1 - function) : at_start + function;
    };
    for (Count k = panel.size - 1; k >= 0; --k) {
      Lanes& of = *column_of(k);
      of = {all<Pack>(load.next()), Pack{}};
      if (k < moving) of = of + end_shape[k] * start[0] + end_slope[k] * start[1];
    }
    for (Count k = 0; k < kept.forces; ++k) in_table[kept.curvatures + k] = start[2 + k];
    at_start[2] = at_start[3] = Lanes{};
    for (Count step = 0; step < many; ++step) {
      const KeptPivot pivot = kept.window(step);
      const Count own = panel.size - 1 - step;
      const Lanes left = pivot.left() = rest[step] * inverse(not_zero(pivot.row[0]));
      const Count end = pivot.last();
      for (Count c = 1; c <= end && c <= own; ++c) {
        Lanes& of = *column_of(own - c);
        of = less_product(of, pivot.row[c], left);
      }
    }
    for (Count c = 0; c < pivots; ++c) {
      const KeptPivot pivot = kept.table(c);
      const Lanes left = pivot.left() = in_table[c] * inverse(not_zero(pivot.row[c]));
      for (Count k = c + 1; k < pivot.columns; ++k) {
        in_table[k] = less_product(in_table[k], pivot.row[k], left);
      }
    }
    for (Count k = 0; k < border; ++k) start[k] = at_start[k];
  }
  const double spring = model.turns ? model.root * model.panels[0].length : 0.0;
  const Lanes other = model.turns ? start[1] - spring * start[3] : start[3];
  root.kept.row[0] = start[2] * inverse(not_zero(root.last[0][0]));
  root.kept.row[1] =
      (other - root.last[0][1] * root.kept.row[0]) * inverse(not_zero(root.last[1][1]));
  return 1.0 / (1.0 + size_of(root.kept.row[1]));
}

/// Solves L^T y = s for the left null vector, from the root on; y are the factors of the equations.
void solve_left(const EliminationModel& model, const EntryPowers& lambda, Root& root,
                const VectorScratch& scratch) {
  const Lanes size{solve_transposed(model, lambda, root, scratch), Pack{}};
  Lanes both[2];  // factors of the two equations that are carried
  both[1] = root.kept.row[1] * size;
  both[0] = root.kept.row[0] * size - root.kept.factor * both[1];
  put_back(root.kept.place, both, 0, 2);
  for (Count p = 0; p < model.count; ++p) {
    const EliminationPanel& panel = model.panels[p];
    const KeptPanel& kept = scratch.kept[p];
    PanelMotion& motion = scratch.left[p];
    const Count band = model.band, many = windowed(panel.size, band, kept.forces);
    const Count curvatures = kept.curvatures, top = curvatures + 1;
    const Count pivots = curvatures + kept.forces;
    Lanes* const rows = scratch.columns;
    const auto set = [&](Count function, const Lanes& y) {
      motion.amplitudes[function] = panel.length * y;
    };
    for (Count r = 0; r < 2; ++r) rows[pivots + r] = Lanes{kept.shares[r], Pack{}} * both[r];
    for (Count c = pivots - 1; c >= 0; --c) {
      const KeptPivot pivot = kept.table(c);
      const Count last = rows_below(c, band, curvatures, kept.forces);
      rows[c] = pivot.left() * size;
      for (Count r = c + 1; r < last; ++r) {
        rows[c] = less_product(rows[c], pivot.factors()[r - c - 1], rows[r]);
      }
      put_back(pivot.place(), rows, c, last);
    }
    for (Count r = 0; r < 2; ++r) both[r] = rows[pivots + r];
    const Count filled = many > 0 ? band : 0;
    for (Count r = filled; r <= top; ++r) set(top - r, rows[r]);
    for (Count step = many - 1; step >= 0; --step) {
      const KeptPivot pivot = kept.window(step);
      const Count own = panel.size - 1 - step;
      for (Count r = band; r > 0; --r) rows[r] = rows[r - 1];
      rows[0] = pivot.left() * size;
      for (Count r = 1; r <= band; ++r) {
        rows[0] = less_product(rows[0], pivot.factors()[r - 1], rows[r]);
      }
      put_back(pivot.place(), rows, 0, band + 1);
      set(own - band, rows[band]);
    }
    for (Count r = 0; many > 0 && r < band; ++r) set(panel.size - 1 - r, rows[r]);
    motion.force = motion.moment = Lanes{};
    if (kept.forces == 0) break;
    for (Count r = 0; r < 2; ++r) {
      motion.force += panel.length * (both[r] * kept.ends[r][0]);
      motion.moment += panel.length * (both[r] * kept.ends[r][1]);
    }
    for (Count place = 1; place >= 0; --place) {
      if (!(place == 0 ? panel.held : panel.directed)) continue;
      const KeptJoint& joint = kept.holds[place];
      both[1] = Lanes{joint.share, Pack{}} * both[0];
      both[0] = joint.left * size - joint.factor * both[1];
      put_back(joint.place, both, 0, 2);
    }
  }
  if (!model.turns) scratch.left[0].amplitudes[1] = Lanes{};
  scratch.left[0].amplitudes[0] = Lanes{};
}

/// Computes the null vectors of P and of P^T.
void null_vectors(const EliminationModel& model, const EntryPowers& lambda,
                  const VectorScratch& scratch) {
  Elimination<Lanes> elimination{model, lambda, {}, scratch.window, scratch.table, {}};
  elimination.start();
  for (Count p = model.count - 1; p >= 0; --p) elimination.pass(p, &scratch.kept[p]);
  Root root;
  elimination.end(root.last, &root.kept);
  solve_right(model, lambda, root, scratch);
  solve_left(model, lambda, root, scratch);
}

/// Sums over all panels and stations of products with two vectors.
struct PairSums {
  Lanes value, by_lambda, by_u, by_right;
  Pack rest{}, entries{}, sums{};

  void add(const PencilEntry& of, double weight, const EntryPowers& lambda, const Lanes& y,
           const Lanes& x, bool own, const Lanes& dual) {
    const Lanes both = weight * (y * x);
    const Lanes rate = entry_by_lambda(of, lambda);
    by_lambda += rate * both;
    by_u += entry_by_speed(of, lambda) * both;
    if (own) by_right += rate * (weight * (conjugate(dual) * x));
  }
};

void pairs(const EliminationModel& model, const Points& points, const PairsAsked& out) {
  const Count band = model.band, wide = 2 * band + 1;
  Count numbers = 0, in_windows = 0, largest = 0;
  for (Count p = 0; p < model.count; ++p) {
    const Count size = model.panels[p].size;
    numbers += size;
    in_windows += KeptPanel::window_numbers(size, band, forces_at_end(model, p));
    largest = size > largest ? size : largest;
  }
  const Count in_tables = model.count * KeptPanel::table_numbers(band);
  struct Storage {
    VectorScratch of;
    Lanes *windows, *tables, *right, *left;
  };
  const Storage scratch = laid_out([&](Layout& layout) {
    Storage made{};
    made.of.window = layout.take<Lanes>((band + 1) * (window_columns(band) + 1));
    made.of.table = layout.take<Lanes>(table_rows(band) * table_columns(band));
    made.of.columns = layout.take<Lanes>(largest + 2 + border + table_rows(band));
    made.of.kept = layout.take<KeptPanel>(model.count);
    made.of.right = layout.take<PanelMotion>(model.count);
    made.of.left = layout.take<PanelMotion>(model.count);
    made.windows = layout.take<Lanes>(in_windows);
    made.tables = layout.take<Lanes>(in_tables);
    made.right = layout.take<Lanes>(numbers);
    made.left = layout.take<Lanes>(numbers);
    return made;
  });
  Lanes *windows = scratch.windows, *tables = scratch.tables, *x = scratch.right, *y = scratch.left;
  for (Count p = 0; p < model.count; ++p) {
    const Count size = model.panels[p].size;
    scratch.of.kept[p] = {windows, tables, band, 0, 0, {}, {}, {}};
    scratch.of.right[p] = {x, {}, {}};
    scratch.of.left[p] = {y, {}, {}};
    windows += KeptPanel::window_numbers(size, band, forces_at_end(model, p));
    tables += KeptPanel::table_numbers(band);
    x += size;
    y += size;
  }
  const bool own = out.by_right != nullptr;
  for (Count first = 0; first < points.count; first += width) {
    const EntryPowers lambda(taken(points, first));
    null_vectors(model, lambda, scratch.of);
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
      coordinates(scratch.of.right[0].amplitudes[1], scratch.of.left[0].amplitudes[1], 1.0);
    }
    for (Count p = 0; p < model.count; ++p) {
      const EliminationPanel& panel = model.panels[p];
      const PanelMotion &right = scratch.of.right[p], &left = scratch.of.left[p];
      const Count size = panel.size;
      const double weight = 1.0 / panel.length, scale = 1.0 / std::sqrt(panel.length);
      for (Count k = 2; k < size; ++k) coordinates(right.amplitudes[k], left.amplitudes[k], scale);
      Lanes end[2], dual[2];
      Pack end_sizes[2] = {}, dual_sizes[2] = {};
      for (Count k = 0; k < moving && k < size; ++k) {
        const double shape[2] = {end_shape[k], end_slope[k]};
        for (Count c = 0; c < 2; ++c) {
          end[c] += shape[c] * right.amplitudes[k];
          dual[c] += shape[c] * left.amplitudes[k];
          end_sizes[c] += std::fabs(shape[c]) * size_of(right.amplitudes[k]);
          dual_sizes[c] += std::fabs(shape[c]) * size_of(left.amplitudes[k]);
        }
      }
      for (Count i = 0; i < size; ++i) {
        const PencilEntry* const row = panel.entries + i * wide + band - i;
        const Count low = i > band ? i - band : 0, high = i + band < size ? i + band : size - 1;
        Lanes rest, rate, by_u;
        Pack entries{};
        for (Count j = low; j <= high; ++j) {
          const Lanes& z = right.amplitudes[j];
          const Lanes of = entry<Lanes>(row[j], lambda);
          rest += of * z;
          rate += entry_by_lambda(row[j], lambda) * z;
          by_u += entry_by_speed(row[j], lambda) * z;
          entries += size_of(of) * size_of(z);
        }
        const Lanes& other = left.amplitudes[i];
        sum.by_lambda += weight * (other * rate);
        sum.by_u += weight * (other * by_u);
        if (own) sum.by_right += weight * (conjugate(right.amplitudes[i]) * rate);
        if (i < moving) {
          rest += end_shape[i] * right.force + end_slope[i] * right.moment;
          entries +=
              std::fabs(end_shape[i]) * size_of(right.force) + end_slope[i] * size_of(right.moment);
        }
        // The equations of the first two functions give the force and moment by which the panel
        // resists at its start. The next row uses them.
        if (i < 2) {
          if (p == 0) {
            const bool turned = i == 1 && model.turns;
            if (!turned) continue;
            rest += (model.root * panel.length) * right.amplitudes[1];
          } else {
            const EliminationPanel& before = model.panels[p - 1];
            const PanelMotion& past = scratch.of.right[p - 1];
            const double ratio = before.length / panel.length;
            if (i == 0 && before.held) continue;
            Lanes force = i == 0 ? past.force : past.moment;
            Lanes at_joint[2] = {(1.0 / ratio) * right.amplitudes[0], right.amplitudes[1]};
            for (Count c = 0; c < 2; ++c) {
              force = force - entry<Lanes>(before.station[i][c], lambda) * at_joint[c];
            }
            rest = rest - (i == 0 ? 1.0 / (ratio * ratio) : 1.0 / ratio) * force;
          }
        }
        sum.value += weight * (other * rest);
        sum.rest += weight * (size_of(other) * size_of(rest));
        sum.entries += weight * (size_of(other) * entries);
      }
      if (panel.held) end[0] = dual[0] = Lanes{};
      if (panel.directed) end[1] = dual[1] = Lanes{};
      for (Count i = 0; i < 2; ++i) {
        for (Count c = 0; c < 2; ++c) {
          const PencilEntry& of = panel.station[i][c];
          sum.add(of, weight, lambda, dual[i], end[c], own, end[i]);
          sum.entries +=
              weight * (size_of(entry<Lanes>(of, lambda)) * (size_of(dual[i]) * size_of(end[c])));
        }
      }
      const Lanes* const forces[2] = {&right.force, &right.moment};
      const Lanes* const others[2] = {&left.force, &left.moment};
      for (Count c = 0; c < 2; ++c) {
        sum.sums +=
            weight * (size_of(*others[c]) * end_sizes[c] + size_of(*forces[c]) * dual_sizes[c]);
      }
      if (p + 1 < model.count) continue;
      // At the end of the pipe only what acts there, or what holds it, resists.
      const bool held[2] = {panel.held, panel.directed};
      for (Count i = 0; i < 2; ++i) {
        if (held[i]) continue;
        Lanes rest = Lanes{} - *forces[i];
        for (Count c = 0; c < 2; ++c) rest += entry<Lanes>(panel.station[i][c], lambda) * end[c];
        sum.value += weight * (dual[i] * rest);
        sum.rest += weight * (size_of(dual[i]) * size_of(rest));
      }
    }
    if (model.turns) {
      sum.entries += model.root * (size_of(scratch.of.right[0].amplitudes[1]) *
                                   size_of(scratch.of.left[0].amplitudes[1]));
    }
    put(out.value, points, first, sum.value);
    put(out.by_lambda, points, first, sum.by_lambda);
    put(out.by_u, points, first, sum.by_u);
    if (own) put(out.by_right, points, first, sum.by_right);
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
