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
  return {of.stiffness + of.damping * lambda.one.re + of.mass * lambda.two.re,
          of.hysteretic + of.damping * lambda.one.im + of.mass * lambda.two.im};
}

/// Derivatives of an entry of P by lambda and by the speed.
inline Lanes entry_by_lambda(const PencilEntry& of, const EntryPowers& lambda) {
  return of.mass * lambda.twice + of.damping;
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

/// The product of real pivots: its sign and the logarithm of its absolute value.
struct Product {
  Pack sign = all<Pack>(1.0), logarithm{};

  void multiply(const Pack& pivot) {
    double logarithms[width];
    store(logarithms, absolute(pivot));
    for (double& one : logarithms) one = std::log(one);
    logarithm += load<Pack>(logarithms);
    sign = pivot > 0.0 ? sign : pivot < 0.0 ? -sign : Pack{};
  }
  void turn(const Bits& swapped) { sign = chosen(swapped, -sign, sign); }
};

/// Sum over pivots for the derivative of the logarithm of the determinant, and, if wanted, their
/// product.
struct PivotSums {
  Lanes slope;
  Product* product = nullptr;

  void add(const DualLanes& pivot, const DualLanes& share) {
    slope += pivot.slope * share.value;
    if (product != nullptr) product->multiply(pivot.value.re);
  }
  void add(const Lanes&, const Lanes&) {}
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
inline bool moves(const Pack& place) { return any(~equal(place, 0.0)); }

/// Rows of equations in which a column is eliminated.
template <class Number>
struct Rows {
  Number* const* at;
  Number* const* loads;  // one more number in each row, or null

  Number* operator[](Count r) const { return at[r]; }

  /// Number of the row that becomes the first in each lane: the one with the largest entry of the
  /// column, if this is more than threshold times the entry of the first row.
  Pack choice(Count count, Count column, double threshold) const {
    Pack largest = threshold * size_of(at[0][column]), place{};
    for (Count r = 1; r < count; ++r) {
      const Pack size = size_of(at[r][column]);
      place = size > largest ? all<Pack>(static_cast<double>(r)) : place;
      largest = size > largest ? size : largest;
    }
    return place;
  }

  /// Exchanges the first row with the chosen one in each lane, from a column to `last`.
  void exchange_rows(const Pack& place, Count count, Count column, Count last,
                     PivotSums& found) const {
    for (Count r = 1; r < count; ++r) {
      const Bits mask = equal(place, static_cast<double>(r));
      if (!any(mask)) continue;
      for (Count c = column; c <= last; ++c) exchange(mask, at[0][c], at[r][c]);
      if (loads != nullptr) exchange(mask, *loads[0], *loads[r]);
      found.turn(mask);
    }
  }
};

/// Reverses the exchange of the first row with the chosen one.
inline void put_back(const Pack& place, Lanes* rows, Count count) {
  if (!moves(place)) return;
  for (Count r = 1; r < count; ++r) {
    exchange(equal(place, static_cast<double>(r)), rows[0], rows[r]);
  }
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
  Count many;   // number of functions eliminated in a moving window of rows; the others follow in a
                // table, together with the carried equations
  Count force;  // unknown of the force at the end; the moment follows
  Count pivots, theta, functions, rows;  // theta: its unknown; functions, rows: of equations

  Front(const EliminationModel& model, Count p) : band(model.band) {
    const EliminationPanel& panel = model.panels[p];
    const bool last = p + 1 == model.count, turned = p == 0 && model.turns;
    size = panel.size;
    joined = !last || panel.held || panel.directed || acts_on(panel.station);
    many = size - band - (joined ? moving : 2);
    if (many < 0) many = 0;
    force = size - 2;
    pivots = force + (joined ? 2 : 0) + turned;
    theta = turned ? pivots - 1 : pivots + 1;
    functions = p > 0 ? size : size - 2 + turned;
    rows = pivots + (p > 0 ? 2 : 0);
  }

  /// Unknown that is the amplitude of a function.
  Count unknown(Count function) const {
    if (function >= 2) return size - 1 - function;
    return function == 1 ? theta : pivots;
  }
  /// Unknown of entry c of a stored pivot row: in the window entries go by functions.
  Count unknown_in_row(Count pivot, Count c) const {
    return pivot < many ? unknown(size - 1 - pivot - c) : pivot + c;
  }
  /// Number of equations from that of a pivot on that may have an entry in its column. Carried
  /// equations contain the functions that move the end.
  Count below(Count pivot) const {
    if (joined && pivot + moving >= size) return rows - pivot;
    return pivot + band < functions ? band + 1 : functions - pivot;
  }

  /// Largest numbers of rows and columns of the table, and number of columns of a row of the
  /// window: its own, and those beyond that exchanged rows have.
  static Count table_rows(Count band) { return band + moving + 2; }
  static Count table_columns(Count band) { return band + moving + 1 + border; }
  static Count window_columns(Count band) { return 3 * band + 1; }
};

/// Stored data of a pivot, one after the other: the entries of its row and the load; the factors by
/// which the row is multiplied and subtracted from each row below; the row that was exchanged with
/// the first, with the index of the last entry; the value that belongs to the pivot in the solution
/// of the transposed equations.
struct KeptPivot {
  Lanes* row;
  Count columns, rows;

  KeptPivot(Lanes* of_panel, Count pivot, Count band)
      : row(of_panel + pivot * numbers(band)),
        columns(row_length(band)),
        rows(Front::table_rows(band)) {}

  Lanes& load() const { return row[columns]; }
  Lanes* factors() const { return row + columns + 1; }
  Pack& place() const { return row[columns + 1 + rows].re; }
  Count last() const {
    double number;
    std::memcpy(&number, &row[columns + 1 + rows].im, sizeof number);
    return static_cast<Count>(number);
  }
  void set_last(Count entry) const {
    row[columns + 1 + rows].im = all<Pack>(static_cast<double>(entry));
  }
  Lanes& left() const { return row[columns + 2 + rows]; }
  static Count row_length(Count band) {
    const Count in_window = 2 * band + 1, in_table = Front::table_columns(band);
    return in_window > in_table ? in_window : in_table;
  }
  static Count numbers(Count band) { return row_length(band) + Front::table_rows(band) + 3; }
};

/// Stored data of the elimination of one of the two equations at a joint that is held.
struct KeptHold {
  Lanes row[5], factor, left;
  Pack place, share;  // share: factor that scales the other equation afterwards
};

/// Stored data of the elimination of a panel: its pivots; the conditions that hold its end; the
/// coefficients of displacement and slope in the two equations at its end, and the factors by which
/// these are scaled.
struct KeptPanel {
  Lanes* pivots;
  KeptHold holds[2];
  Lanes ends[2][2];
  Pack shares[2];
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
    carried[0][2] = carried[1][3] = number<Number>(1.0);
  }

  /// Converts the carried equations to the units of the panel that ends at the joint, across what
  /// acts there, and applies the conditions that hold the end. kept: where the elimination is
  /// stored, or null.
  void join(Count p, KeptPanel* kept) {
    const EliminationPanel& panel = model.panels[p];
    for (Count r = 0; r < 2; ++r) {
      const Pack share = scale(r);
      if constexpr (loads > 0) kept->shares[r] = share;
      into_panel(panel, length_beyond(model, p), lambda, carried[r]);
    }
    if (panel.held) hold(0, kept);
    if (panel.directed) hold(1, kept);
    if constexpr (loads > 0) {
      for (Count r = 0; r < 2; ++r) {
        for (Count c = 0; c < 2; ++c) kept->ends[r][c] = carried[r][c];
      }
    }
  }

  /// Makes w or theta (condition 0 or 1) 0 and eliminates Q or M, which is arbitrary.
  void hold(Count condition, KeptPanel* kept) {
    const Count force = 2 + condition;
    Number *const both[2] = {carried[0], carried[1]}, *const charges[2] = {both[0] + 4,
                                                                           both[1] + 4};
    const Rows<Number> rows{both, loads > 0 ? charges : nullptr};
    const Pack place = rows.choice(2, force, 1.0);
    rows.exchange_rows(place, 2, 0, 3, found);
    const Number share = inverse(carried[0][force]), factor = carried[1][force] * share;
    found.add(carried[0][force], share);
    for (Count c = 0; c < 4 + loads; ++c) {
      if constexpr (loads > 0) kept->holds[condition].row[c] = carried[0][c];
      carried[0][c] = carried[1][c] - factor * carried[0][c];
      carried[1][c] = Number{};
    }
    carried[0][condition] = carried[0][force] = Number{};
    carried[1][condition] = number<Number>(1.0);
    const Pack scaled = scale(0);
    if constexpr (loads > 0) {
      kept->holds[condition].factor = factor;
      kept->holds[condition].place = place;
      kept->holds[condition].share = scaled;
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
    const Pack share = 1.0 / largest;
    for (Number& one : carried[r]) one = one * number<Number>(share);
    if (found.product != nullptr) found.product->multiply(largest);
    return share;
  }

  /// Eliminates a column from the rows below the first, whose entries end with `last`. place: the
  /// row that was exchanged with the first; kept: where the pivot is stored, if there are loads.
  void eliminate(const Rows<Number>& rows, Count count, Count column, Count last, const Pack& place,
                 const KeptPivot* kept) {
    const Number* const pivot = rows[0];
    const Number share = inverse(pivot[column]);
    found.add(pivot[column], share);
    for (Count r = 1; r < count; ++r) {
      Number* const row = rows[r];
      const Number factor = row[column] * share;
      for (Count c = column + 1; c <= last; ++c) row[c] = less_product(row[c], factor, pivot[c]);
      if constexpr (loads > 0) {
        *rows.loads[r] = less_product(*rows.loads[r], factor, *rows.loads[0]);
        kept->factors()[r - 1] = factor;
      }
    }
    if constexpr (loads > 0) {
      for (Count c = column; c <= last; ++c) kept->row[c - column] = pivot[c];
      kept->load() = *rows.loads[0];
      kept->place() = place;
      kept->set_last(last - column);
    }
  }

  /// Eliminates the functions of a panel. kept: where the elimination is stored, or null.
  void pass(Count p, KeptPanel* kept) {
    const EliminationPanel& panel = model.panels[p];
    const Front front(model, p);
    if (front.joined) join(p, kept);
    const Count band = model.band, size = panel.size, many = front.many;
    const auto pivot_of = [&](Count pivot) {
      return KeptPivot(loads > 0 ? kept->pivots : nullptr, pivot, band);
    };
    // Row i of P starts with column i + band and goes down; `rows` point to the column of the
    // pivot.
    const Count stride = Front::window_columns(band);
    Number *begins[widest + 1], *rows[widest + 1], *charges[widest + 1];
    const auto fill = [&](Count place, Count i) {
      Number* const to = begins[place];
      const Count high = i + band < size ? i + band : size - 1, low = i > band ? i - band : 0;
      for (Count j = high; j >= low; --j) to[i + band - j] = at(panel, i, j);
      for (Count c = i + band - low + 1; c < stride; ++c) to[c] = Number{};
      for (Count c = 0; c < loads; ++c) to[stride + c] = number<Number>(load.next());
    };
    const auto take_from_pivot = [&] {
      for (Count r = 0; r <= band; ++r) {
        rows[r] = begins[r] + band - r;
        charges[r] = begins[r] + stride;
      }
    };
    Count top = size - 1, reach = band;  // function of the pivot; last entry that rows may have
    for (Count r = 0; many > 0 && r <= band; ++r) {
      begins[r] = window + r * (stride + loads);
      fill(r, top - r);
    }
    for (Count pivot = 0; pivot < many; ++pivot) {
      take_from_pivot();
      const Rows<Number> candidates{rows, loads > 0 ? charges : nullptr};
      const Pack place = candidates.choice(band + 1, 0, window_threshold);
      if (moves(place)) {
        reach = 2 * band;
        candidates.exchange_rows(place, band + 1, 0, reach, found);
      }
      const KeptPivot to = pivot_of(pivot);
      eliminate(candidates, band + 1, 0, reach < top ? reach : top, place, &to);
      if (reach > band) --reach;
      Number* const free = begins[0];
      for (Count r = 0; r < band; ++r) begins[r] = begins[r + 1];
      begins[band] = free;
      --top;
      if (pivot + 1 < many) fill(band, top - band);
    }
    const Count filled = many > 0 ? band : 0;
    if (filled > 0) take_from_pivot();
    const Count loaded = front.pivots + border - many, functions = front.functions - many;
    const auto place_of = [&](Count function) { return front.unknown(function) - many; };
    Number *table_rows[widest + moving + 2], *table_charges[widest + moving + 2];
    for (Count r = 0; r < front.rows - many; ++r) {
      Number* const row = table_rows[r] = table + r * (loaded + loads);
      table_charges[r] = row + loaded;
      for (Count c = 0; c < loaded + loads; ++c) row[c] = Number{};
      if (r < filled) {
        for (Count c = 0; c <= 2 * band && c <= top; ++c) row[place_of(top - c)] = rows[r][c];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = charges[r][c];
      } else if (r < functions) {
        const Count own = top - r;
        const Count low = own > band ? own - band : 0, high = own + band < top ? own + band : top;
        for (Count c = low; c <= high; ++c) row[place_of(c)] = at(panel, own, c);
        if (own < moving && front.joined) {
          row[front.force - many] = number<Number>(end_shape[own]);
          row[front.force + 1 - many] = number<Number>(end_slope[own]);
        }
        if (own < 2 && p > 0) row[front.pivots + 2 + own - many] = number<Number>(-1.0);
        if (own == 1 && p == 0) {
          Number& turned = row[place_of(1)];
          turned = turned + number<Number>(model.root * panel.length);
        }
        for (Count c = 0; c < loads; ++c) row[loaded + c] = number<Number>(load.next());
      } else {
        const Number* const by = carried[r - functions];
        for (Count c = 0; c < moving && c <= top; ++c) {
          row[place_of(c)] = end_shape[c] * by[0] + end_slope[c] * by[1];
        }
        for (Count k = 0; k < 2; ++k) row[front.force + k - many] = by[2 + k];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = by[4 + c];
      }
    }
    for (Count pivot = many; pivot < front.pivots; ++pivot) {
      const Count column = pivot - many, count = front.below(pivot);
      const Rows<Number> candidates{table_rows + column,
                                    loads > 0 ? table_charges + column : nullptr};
      const Pack place = candidates.choice(count, column, 1.0);
      if (moves(place)) candidates.exchange_rows(place, count, column, loaded - 1, found);
      const KeptPivot to = pivot_of(pivot);
      eliminate(candidates, count, column, loaded - 1, place, &to);
    }
    for (Count r = 0; r < 2 && p > 0; ++r) {
      const Number* const rest = table_rows[front.pivots - many + r] + front.pivots - many;
      for (Count c = 0; c < 4 + loads; ++c) carried[r][c] = rest[c];
    }
  }
};

void log_derivative(const EliminationModel& model, const Points& points, double* out,
                    double* signs) {
  struct Scratch {
    DualLanes *window, *table;
  };
  const auto [window, table] = laid_out([&](Layout& layout) {
    return Scratch{
        layout.take<DualLanes>((model.band + 1) * Front::window_columns(model.band)),
        layout.take<DualLanes>(Front::table_rows(model.band) * Front::table_columns(model.band))};
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
    const Lanes others = poles(points, elimination.lambda.one);
    put(out, points, first, elimination.found.slope - others);
    if (signs == nullptr) continue;
    put(signs, points, first, product.sign);
    put(signs + points.count, points, first, product.logarithm);
  }
}

/// Motion of a panel for each lambda: amplitudes of its functions, and force and moment at its end
/// and at its start.
struct PanelMotion {
  Lanes* amplitudes;  // (size,); the first two are w and theta at its start
  Lanes end_loads[2], start_loads[2];
};

struct VectorScratch {
  Lanes *window, *table, *columns;  // columns: for the unknowns or the equations of a panel
  KeptPanel* kept;
  PanelMotion *right, *left;
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

/// The factor by which loads are scaled so that all numbers of a solution are finite, if `last` is
/// the number that is found first.
inline Lanes size_for(const Lanes& last) { return {1.0 / (1.0 + size_of(last)), Pack{}}; }

/// Solves U z = L^-1 loads for the right null vector, where P = L U up to exchanges of rows.
void solve_right(const EliminationModel& model, const EntryPowers& lambda,
                 const VectorScratch& scratch) {
  const KeptPivot deciding(scratch.kept[0].pivots, Front(model, 0).pivots - 1, model.band);
  const Lanes size = size_for(deciding.load() * inverse(not_zero(deciding.row[0])));
  Lanes start[border] = {};  // w, theta, Q and M at the panel's start
  Lanes* const x = scratch.columns;
  for (Count p = 0; p < model.count; ++p) {
    const EliminationPanel& panel = model.panels[p];
    const Front front(model, p);
    PanelMotion& motion = scratch.right[p];
    for (Count k = 0; k < border; ++k) x[front.pivots + k] = start[k];
    for (Count own = front.pivots - 1; own >= 0; --own) {
      const KeptPivot pivot(scratch.kept[p].pivots, own, model.band);
      Lanes sum = pivot.load() * size;
      const Count last = pivot.last();
      for (Count c = 1; c <= last; ++c) {
        sum = less_product(sum, pivot.row[c], x[front.unknown_in_row(own, c)]);
      }
      x[own] = sum * inverse(not_zero(pivot.row[0]));
    }
    for (Count k = 0; k < panel.size; ++k) motion.amplitudes[k] = x[front.unknown(k)];
    for (Count k = 0; k < 2; ++k) {
      motion.start_loads[k] = start[2 + k];
      motion.end_loads[k] = front.joined ? x[front.force + k] : Lanes{};
    }
    if (p == 0) motion.start_loads[1] = (-model.root * panel.length) * motion.amplitudes[1];
    if (p + 1 == model.count) break;
    const double ratio = panel.length / model.panels[p + 1].length;
    Lanes end[2], loads[2] = {motion.end_loads[0], motion.end_loads[1]};
    set_end(panel, motion.amplitudes, end);
    if (panel.held) {  // at a support the force of the panel includes its reaction
      const Lanes* const row = scratch.kept[p].holds[0].row;
      const Lanes sum = row[1] * end[1] + row[3] * loads[1];
      loads[0] = (row[4] * size - sum) * inverse(not_zero(row[2]));
    }
    for (Count k = 0; k < 2; ++k) {
      for (Count c = 0; c < 2; ++c) {
        loads[k] = loads[k] - entry<Lanes>(panel.station[k][c], lambda) * end[c];
      }
    }
    start[0] = ratio * end[0];
    start[1] = end[1];
    start[2] = (1.0 / (ratio * ratio)) * loads[0];
    start[3] = (1.0 / ratio) * loads[1];
  }
}

/// Solves U^T s = loads, with one load on the column of each function, in the order of the pivots.
/// Returns a factor by which the solution is to be multiplied so that later numbers are finite.
Lanes solve_transposed(const EliminationModel& model, const EntryPowers& lambda,
                       const VectorScratch& scratch) {
  LoadSequence load;
  Lanes start[border] = {}, last;  // start: what remains in the columns of w, theta, Q and M
  Lanes* const rest = scratch.columns;
  for (Count p = model.count - 1; p >= 0; --p) {
    const EliminationPanel& panel = model.panels[p];
    const Front front(model, p);
    into_panel(panel, length_beyond(model, p), lambda, start);
    for (Count condition = 0; condition < 2; ++condition) {
      if (!(condition == 0 ? panel.held : panel.directed)) continue;
      KeptHold& hold = scratch.kept[p].holds[condition];
      const Count force = 2 + condition;
      hold.left = start[force] * inverse(not_zero(hold.row[force]));
      for (Count c = 0; c < 4; ++c) start[c] = start[c] - hold.row[c] * hold.left;
      start[condition] = start[force] = Lanes{};
    }
    for (Count k = 0; k < front.pivots + border; ++k) rest[k] = Lanes{};
    for (Count k = panel.size - 1; k >= 0; --k) {
      Lanes& of = rest[front.unknown(k)];
      of = {all<Pack>(load.next()), Pack{}};
      if (k < moving) of = of + end_shape[k] * start[0] + end_slope[k] * start[1];
    }
    for (Count k = 0; k < 2 && front.joined; ++k) rest[front.force + k] = start[2 + k];
    for (Count own = 0; own < front.pivots; ++own) {
      const KeptPivot pivot(scratch.kept[p].pivots, own, model.band);
      last = pivot.left() = rest[own] * inverse(not_zero(pivot.row[0]));
      const Count end = pivot.last();
      for (Count c = 1; c <= end; ++c) {
        Lanes& of = rest[front.unknown_in_row(own, c)];
        of = less_product(of, pivot.row[c], last);
      }
    }
    for (Count k = 0; k < border; ++k) start[k] = rest[front.pivots + k];
  }
  return size_for(last);
}

/// Solves L^T y = s for the left null vector, from the root on; y are the factors of the equations.
void solve_left(const EliminationModel& model, const EntryPowers& lambda,
                const VectorScratch& scratch) {
  const Lanes size = solve_transposed(model, lambda, scratch);
  Lanes both[2];  // factors of the two equations that are carried
  Lanes* const y = scratch.columns;
  for (Count p = 0; p < model.count; ++p) {
    const EliminationPanel& panel = model.panels[p];
    const Front front(model, p);
    const KeptPanel& kept = scratch.kept[p];
    PanelMotion& motion = scratch.left[p];
    for (Count r = front.pivots; r < front.rows; ++r) y[r] = both[r - front.pivots];
    for (Count own = front.pivots - 1; own >= 0; --own) {
      const KeptPivot pivot(kept.pivots, own, model.band);
      const Count count = front.below(own);
      y[own] = pivot.left() * size;
      for (Count r = 1; r < count; ++r) {
        y[own] = less_product(y[own], pivot.factors()[r - 1], y[own + r]);
      }
      put_back(pivot.place(), y + own, count);
    }
    for (Count k = 0; k < panel.size; ++k) {
      const Count row = panel.size - 1 - k;
      motion.amplitudes[k] = row < front.functions ? panel.length * y[row] : Lanes{};
    }
    for (Lanes& one : motion.end_loads) one = Lanes{};
    if (!front.joined) break;
    for (Count r = 0; r < 2; ++r) {
      both[r] = y[front.functions + r];
      for (Count k = 0; k < 2; ++k) {
        motion.end_loads[k] += panel.length * (both[r] * kept.ends[r][k]);
      }
    }
    for (Count condition = 1; condition >= 0; --condition) {
      if (!(condition == 0 ? panel.held : panel.directed)) continue;
      const KeptHold& hold = kept.holds[condition];
      both[1] = Lanes{hold.share, Pack{}} * both[0];
      both[0] = hold.left * size - hold.factor * both[1];
      put_back(hold.place, both, 2);
    }
    for (Count r = 0; r < 2; ++r) both[r] = Lanes{kept.shares[r], Pack{}} * both[r];
  }
}

/// Computes the null vectors of P and of P^T.
void null_vectors(const EliminationModel& model, const EntryPowers& lambda,
                  const VectorScratch& scratch) {
  Elimination<Lanes> elimination{model, lambda, {}, scratch.window, scratch.table, {}};
  elimination.start();
  for (Count p = model.count - 1; p >= 0; --p) elimination.pass(p, &scratch.kept[p]);
  solve_right(model, lambda, scratch);
  solve_left(model, lambda, scratch);
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
  Count numbers = 0, largest = 0;
  for (Count p = 0; p < model.count; ++p) {
    const Count size = model.panels[p].size;
    numbers += size;
    largest = size > largest ? size : largest;
  }
  struct Storage {
    VectorScratch of;
    Lanes *pivots, *right, *left;
  };
  const Storage scratch = laid_out([&](Layout& layout) {
    Storage made{};
    made.of.window = layout.take<Lanes>((band + 1) * (Front::window_columns(band) + 1));
    made.of.table = layout.take<Lanes>(Front::table_rows(band) * (Front::table_columns(band) + 1));
    made.of.columns = layout.take<Lanes>(largest + 1 + border);
    made.of.kept = layout.take<KeptPanel>(model.count);
    made.of.right = layout.take<PanelMotion>(model.count);
    made.of.left = layout.take<PanelMotion>(model.count);
    made.pivots = layout.take<Lanes>((numbers + model.count) * KeptPivot::numbers(band));
    made.right = layout.take<Lanes>(numbers);
    made.left = layout.take<Lanes>(numbers);
    return made;
  });
  Lanes *stored = scratch.pivots, *x = scratch.right, *y = scratch.left;
  for (Count p = 0; p < model.count; ++p) {
    scratch.of.kept[p] = {stored, {}, {}, {}};
    scratch.of.right[p] = {x, {}, {}};
    scratch.of.left[p] = {y, {}, {}};
    stored += (model.panels[p].size + 1) * KeptPivot::numbers(band);
    x += model.panels[p].size;
    y += model.panels[p].size;
  }
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
      for (Count i = 0; i < size; ++i) {
        const PencilEntry* const entries = panel.entries + i * wide + band - i;
        const Count low = i > band ? i - band : 0, high = i + band < size ? i + band : size - 1;
        const Lanes &x = right.amplitudes[i], &y = left.amplitudes[i];
        RowProducts row;
        for (Count j = low; j <= high; ++j) row.add(entries[j], lambda, right.amplitudes[j]);
        for (Count k = 0; i < moving && k < 2; ++k) {
          const double moved = k == 0 ? end_shape[i] : end_slope[i];
          const Lanes &load = right.end_loads[k], &other = left.end_loads[k];
          row.rest += moved * load;
          row.entries += std::fabs(moved) * size_of(load);
          sum.sums += (weight * std::fabs(moved)) *
                      (size_of(other) * size_of(x) + size_of(load) * size_of(y));
        }
        // The equations of the first two functions give the force and moment by which the panel
        // resists at its start, or those of the root.
        if (i < 2) row.rest = row.rest - right.start_loads[i];
        if (i < 2 && p == 0) row.entries += size_of(right.start_loads[i]);
        sum.add(row, weight, y, x);
        sum.add_rest(row.rest, weight, y);
      }
      Lanes end[2], dual[2];
      set_end(panel, right.amplitudes, end);
      set_end(panel, left.amplitudes, dual);
      for (Count i = 0; i < 2; ++i) {
        RowProducts row;
        for (Count c = 0; c < 2; ++c) row.add(panel.station[i][c], lambda, end[c]);
        sum.add(row, weight, dual[i], end[i]);
        // At the end of the pipe only what acts there, or what holds it, resists.
        if (p + 1 == model.count) sum.add_rest(row.rest - right.end_loads[i], weight, dual[i]);
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
