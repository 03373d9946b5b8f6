// SPDX-License-Identifier: MIT
//
// The elimination of one vector level. This source is compiled once for each, with PIPEDYN_LEVEL
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

/// Displacement of a panel's end by the amplitude of its second curvature, -sqrt(3) / 6.
constexpr double bent = -0.28867513459481287;
/// Displacement and slope of a panel's end by its first four functions.
constexpr double end_shape[4] = {1.0, 1.0, 0.5, bent}, end_slope[4] = {0.0, 1.0, 1.0, 0.0};
/// Functions whose end moves.
constexpr Count moving = 4;
/// Places of a panel's border, counted from its Q: M and, of its start, w, theta, Q and M.
enum Border : Count { end_force, end_moment, start_shape, start_slope, start_force, start_moment };
constexpr Count border = 6;

/// What entries of P take of lambda.
struct EntryPowers {
  Lanes one, two;

  explicit EntryPowers(const Lanes& lambda) : one(lambda), two(lambda * lambda) {}
};

template <class Number>
Number entry(const PencilEntry& of, const EntryPowers& lambda);

template <>
inline Lanes entry<Lanes>(const PencilEntry& of, const EntryPowers& lambda) {
  return {of.still + of.rate * lambda.one.re + of.square * lambda.two.re,
          of.loss + of.rate * lambda.one.im + of.square * lambda.two.im};
}

/// Its derivatives by lambda and by the speed.
inline Lanes entry_by_lambda(const PencilEntry& of, const EntryPowers& lambda) {
  return (2.0 * of.square) * lambda.one + of.rate;
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

/// a, or something small, of which the square is a number, where it is 0.
inline Lanes not_zero(Lanes a) {
  const Pack size = size_of(a);
  a.re = size > 0.0 ? a.re : all<Pack>(1e-150);
  return a;
}

/// The product of pivots, its phase apart from its size.
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

/// What the derivative of the logarithm sums, and the product.
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

/// x - a b, each part a chain of fused operations.
inline Lanes less_product(const Lanes& x, const Lanes& a, const Lanes& b) {
  return {x.re - a.re * b.re + a.im * b.im, x.im - a.re * b.im - a.im * b.re};
}
inline DualLanes less_product(const DualLanes& x, const DualLanes& a, const DualLanes& b) {
  return {less_product(x.value, a.value, b.value),
          less_product(less_product(x.slope, a.slope, b.value), a.value, b.slope)};
}

/// How many times larger another entry must be to be the pivot instead: then growth is bounded as
/// with the largest, and fewer rows are exchanged (Duff, Erisman and Reid 1986, ch. 5).
constexpr double threshold = 4.0;

/// Exchanges two numbers in the lanes of a mask.
template <class Number>
void exchange(const Bits& mask, Number& a, Number& b) {
  const Number before = a;
  a = chosen(mask, b, before);
  b = chosen(mask, before, b);
}

/// Rows of which some are eliminated from a column on.
template <class Number>
struct Rows {
  Number* const* at;
  Number* const* loads = nullptr;  // of each row one number more, or none

  Number* operator[](Count r) const { return at[r]; }

  /// Puts a row with a large enough entry of a column first, of rows first to last - 1; whether any
  /// moves.
  bool choose(Count first, Count last, Count column, Count columns, PivotSums& found) const {
    Pack largest = threshold * size_of(at[first][column]);
    Pack place = all<Pack>(static_cast<double>(first));
    for (Count r = first + 1; r < last; ++r) {
      const Pack size = size_of(at[r][column]);
      place = size > largest ? all<Pack>(static_cast<double>(r)) : place;
      largest = size > largest ? size : largest;
    }
    if (!any(~equal(place, static_cast<double>(first)))) return false;
    for (Count r = first + 1; r < last; ++r) {
      const Bits mask = equal(place, static_cast<double>(r));
      if (!any(mask)) continue;
      for (Count c = column; c < columns; ++c) exchange(mask, at[first][c], at[r][c]);
      if (loads != nullptr) exchange(mask, *loads[first], *loads[r]);
      found.turn(mask);
    }
    return true;
  }
};

/// How many functions of a panel are eliminated in a moving window of rows, before the others and
/// what is carried are in one table.
inline Count windowed(Count size, Count band) {
  const Count most = size - band - moving;
  return most > 0 ? most : 0;
}
/// Rows and columns of that table, at most.
inline Count table_rows(Count band) { return band + moving + 2; }
inline Count table_columns(Count band) { return band + 2 + border + 1; }
/// Columns of a row of the window: its own, and those that rows exchanged with it have beyond.
inline Count window_columns(Count band) { return 3 * band + 1; }
/// Numbers of a pivot's row of the window that are kept: entries and a load.
inline Count kept_columns(Count band) { return 2 * band + 2; }

/// The rows of the pivots of a panel: of the window (windowed, 2 band + 2), then of the table.
struct Pivots {
  Lanes *window, *table;
};

/// Loads on the equations, irregular to excite every motion.
struct LoadSequence {
  double weight = 0.5;

  double next() {
    weight += weight < 1.0 ? 0.382 : -0.618;
    return weight;
  }
};

/// Of one lambda a lane.
template <class Number>
struct Elimination {
  /// Columns of loads: vectors need one, derivatives none.
  static constexpr Count loads = std::is_same_v<Number, Lanes> ? 1 : 0;

  const EliminationModel& model;
  EntryPowers lambda;
  PivotSums found;
  Number *window, *table;        // scratch
  Number carried[2][4 + loads];  // the equations at a joint, in units of the panel before it
  LoadSequence load = {};

  /// Entry of P of functions i and j of a panel; transposed: of P^T.
  template <bool transposed>
  Number at(const EliminationPanel& panel, Count i, Count j) const {
    const Count row = transposed ? j : i, column = transposed ? i : j;
    return entry<Number>(panel.entries[row * (2 * model.band + 1) + column - row + model.band],
                         lambda);
  }

  /// Beyond the free end nothing resists.
  void start() {
    for (auto& row : carried) {
      for (Number& one : row) one = Number{};
    }
    carried[0][2] = carried[1][3] = number(1.0, Number{});
  }

  /// Into the units of the panel that ends there, past what acts there and holds it. keep: takes
  /// the row of a pivot, by place 0 or 1, before the equations change.
  template <bool transposed, class Keep>
  void join(const EliminationPanel& panel, double length_beyond, const Keep& keep) {
    const double ratio = panel.length / length_beyond;
    for (auto& row : carried) {
      row[0] = ratio * row[0];
      row[2] = (1.0 / (ratio * ratio)) * row[2];
      row[3] = (1.0 / ratio) * row[3];
      for (Count c = 0; c < 2; ++c) {
        for (Count k = 0; k < 2; ++k) {
          const PencilEntry& of = transposed ? panel.station[c][k] : panel.station[k][c];
          row[c] = row[c] - row[2 + k] * entry<Number>(of, lambda);
        }
      }
    }
    if (panel.held) hold(0, keep);
    if (panel.directed) hold(1, keep);
  }

  /// w or theta is 0, and Q or M any.
  template <class Keep>
  void hold(Count place, const Keep& keep) {
    constexpr Count columns = 4 + loads;
    Number ordered[2][columns];  // the force first
    const Count force = 2 + place;
    for (Count r = 0; r < 2; ++r) {
      for (Count c = 0, next = 1; c < columns; ++c) {
        ordered[r][c == force ? 0 : next++] = carried[r][c];
      }
    }
    Number* const both[2] = {ordered[0], ordered[1]};
    const Rows<Number> sorted{both};
    sorted.choose(0, 2, 0, columns, found);
    const Number share = inverse(ordered[0][0]), factor = ordered[1][0] * share;
    found.add(ordered[0][0], share);
    keep(place, ordered[0]);
    for (Count c = 0, next = 1; c < columns; ++c) {
      carried[0][c] = Number{};
      carried[1][c] = Number{};
      if (c == force) continue;
      carried[0][c] = ordered[1][next] - factor * ordered[0][next];
      ++next;
    }
    carried[0][place] = Number{};
    carried[1][place] = number(1.0, Number{});
    scale(0);
  }

  /// Makes the largest entry of an equation 1.
  void scale(Count r) {
    Pack largest = size_of(carried[r][0]);
    for (Count c = 1; c < 4; ++c) {
      const Pack size = size_of(carried[r][c]);
      largest = size > largest ? size : largest;
    }
    largest = largest > 0.0 ? largest : all<Pack>(1.0);
    const Lanes share{1.0 / largest, Pack{}};
    for (Number& one : carried[r]) one = one * constant(share);
    if (found.product != nullptr) found.product->multiply({largest, Pack{}});
  }
  static Lanes constant_of(const Lanes& x, Lanes) { return x; }
  static DualLanes constant_of(const Lanes& x, DualLanes) { return {x, {}}; }
  static Number constant(const Lanes& x) { return constant_of(x, Number{}); }

  /// Eliminates a panel. kept: where its pivots' rows go, or none.
  template <bool transposed>
  void pass(const EliminationPanel& panel, const Pivots* kept) {
    const Count band = model.band, wide = 2 * band + 1, size = panel.size;
    const Count many = windowed(size, band), stride = window_columns(band);
    // Row i of P begins with column i + band, and is taken from the column of the pivot on.
    Number *begins[widest + 1], *rows[widest + 1], *charges[widest + 1];
    const auto fill = [&](Count place, Count i) {
      Number* const to = begins[place];
      const Count high = i + band < size ? i + band : size - 1, low = i > band ? i - band : 0;
      for (Count j = high; j >= low; --j) to[i + band - j] = at<transposed>(panel, i, j);
      for (Count c = i + band - low + 1; c < stride; ++c) to[c] = Number{};
      for (Count c = 0; c < loads; ++c) to[stride + c] = number(load.next(), Number{});
    };
    const auto take_from_pivot = [&] {
      for (Count r = 0; r <= band; ++r) {
        rows[r] = begins[r] + band - r;
        charges[r] = begins[r] + stride;
      }
    };
    Count top = size - 1, filled = 0;
    if (many > 0) {
      for (Count r = 0; r <= band; ++r) {
        begins[r] = window + r * (stride + loads);
        fill(r, top - r);
      }
      Count lowest = size;  // column that rows exchanged so far may reach
      const Rows<Number> candidates{rows, loads > 0 ? charges : nullptr};
      for (Count step = 0;; --top) {
        take_from_pivot();
        if (candidates.choose(0, band + 1, 0, wide, found)) lowest = top - 2 * band;
        const Count last = top - lowest > band ? top - lowest : band;
        const Number* const pivot = rows[0];
        const Number share = inverse(pivot[0]);
        found.add(pivot[0], share);
        for (Count r = 1; r <= band; ++r) {
          const Number factor = rows[r][0] * share;
          for (Count c = 1; c <= last; ++c) rows[r][c] = less_product(rows[r][c], factor, pivot[c]);
          for (Count c = 0; c < loads; ++c) {
            charges[r][c] = less_product(charges[r][c], factor, charges[0][c]);
          }
        }
        Lanes* const to = kept == nullptr ? nullptr : kept->window + step * kept_columns(band);
        keep_row(to, pivot, wide);
        keep_row(to == nullptr ? to : to + wide, charges[0], loads);
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
    const Count curvatures = top - 1, loaded = curvatures + border, count = curvatures + 4;
    const Count columns = loaded + loads;
    Number* table_rows[widest + moving + 2];
    for (Count r = 0; r < count; ++r) table_rows[r] = table + r * columns;
    const Rows<Number> all_rows{table_rows};
    const auto place = [&](Count column) {
      return column >= 2 ? top - column : curvatures + start_shape + column;
    };
    for (Count r = 0; r < count; ++r) {
      Number* const row = all_rows[r];
      for (Count c = 0; c < columns; ++c) row[c] = Number{};
      if (r < filled) {
        for (Count c = 0; c < wide && c <= top; ++c) row[place(top - c)] = rows[r][c];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = charges[r][c];
      } else if (r <= top) {
        const Count own = top - r;
        const Count low = own > band ? own - band : 0, high = own + band < top ? own + band : top;
        for (Count c = low; c <= high; ++c) row[place(c)] = at<transposed>(panel, own, c);
        if (own < moving) {
          row[curvatures + end_force] = number(end_shape[own], Number{});
          row[curvatures + end_moment] = number(end_slope[own], Number{});
        }
        if (own < 2) row[curvatures + start_force + own] = number(-1.0, Number{});
        for (Count c = 0; c < loads; ++c) row[loaded + c] = number(load.next(), Number{});
      } else {
        const Number* const by = carried[r - top - 1];
        for (Count c = 0; c < moving && c <= top; ++c) {
          row[place(c)] = end_shape[c] * by[0] + end_slope[c] * by[1];
        }
        row[curvatures + end_force] = by[2];
        row[curvatures + end_moment] = by[3];
        for (Count c = 0; c < loads; ++c) row[loaded + c] = by[4 + c];
      }
    }
    for (Count c = 0; c < curvatures + 2; ++c) {
      // What is carried acts on the functions that move the end, the last.
      const Count last = c + moving <= top && c + band < top ? c + band + 1 : count;
      all_rows.choose(c, last, c, columns, found);
      const Number* const pivot = all_rows[c];
      const Number share = inverse(pivot[c]);
      found.add(pivot[c], share);
      keep_row(kept == nullptr ? nullptr : kept->table + c * columns, pivot, columns);
      for (Count r = c + 1; r < last; ++r) {
        Number* const row = all_rows[r];
        const Number factor = row[c] * share;
        for (Count k = c + 1; k < columns; ++k) row[k] = less_product(row[k], factor, pivot[k]);
      }
    }
    for (Count r = 0; r < 2; ++r) {
      const Number* const rest = all_rows[count - 2 + r] + curvatures + start_shape;
      for (Count c = 0; c < 4 + loads; ++c) carried[r][c] = rest[c];
      scale(r);
    }
  }
  static void keep_row(Lanes* to, const Lanes* row, Count columns) {
    for (Count c = 0; to != nullptr && c < columns; ++c) to[c] = row[c];
  }
  static void keep_row(Lanes*, const DualLanes*, Count) {}

  /// At the root, where w is 0, and theta or M + k theta: leaves two equations in Q and the other,
  /// triangular.
  void end(Number (&last)[2][2 + loads]) {
    const double spring = model.turns ? model.root * model.panels[0].length : 0.0;
    for (Count r = 0; r < 2; ++r) {
      last[r][0] = carried[r][2];
      last[r][1] = model.turns ? carried[r][1] - spring * carried[r][3] : carried[r][3];
      for (Count c = 0; c < loads; ++c) last[r][2 + c] = carried[r][4 + c];
    }
    Number* const both[2] = {last[0], last[1]};
    const Rows<Number> rows{both};
    rows.choose(0, 2, 0, 2 + loads, found);
    const Number share = inverse(last[0][0]);
    found.add(last[0][0], share);
    for (Count c = 1; c < 2 + loads; ++c)
      last[1][c] = last[1][c] - (last[1][0] * share) * last[0][c];
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
    const auto keep = [](Count, const DualLanes*) {};
    for (Count p = model.count - 1; p >= 0; --p) {
      const double beyond = model.panels[p + 1 < model.count ? p + 1 : p].length;
      elimination.join<false>(model.panels[p], beyond, keep);
      elimination.pass<false>(model.panels[p], nullptr);
    }
    DualLanes last[2][2];
    elimination.end(last);
    const Lanes others = poles(points, elimination.lambda.one);
    put(out, points, first, elimination.found.slope - others);
    if (signs == nullptr) continue;
    put(signs, points, first, product.phase.re);
    put(signs + points.count, points, first, product.logarithm);
  }
}

/// A panel's functions in a motion, and force and moment at its end, for each lambda.
struct PanelMotion {
  Lanes* amplitudes;  // (size,), the first two being w and theta at its start
  Lanes force, moment;
};

struct VectorScratch {
  Lanes *window, *table;
  Pivots* pivots;
  Lanes (*holds)[2][5];
  PanelMotion *right, *left;
};

/// The null vector of P, or of P^T.
template <bool transposed>
void null_vector(const EliminationModel& model, const EntryPowers& lambda,
                 const VectorScratch& scratch, PanelMotion* motions) {
  Elimination<Lanes> elimination{model, lambda, {}, scratch.window, scratch.table, {}};
  elimination.start();
  for (Count p = model.count - 1; p >= 0; --p) {
    const double beyond = model.panels[p + 1 < model.count ? p + 1 : p].length;
    const auto keep = [&](Count place, const Lanes* row) {
      for (Count c = 0; c < 5; ++c) scratch.holds[p][place][c] = row[c];
    };
    elimination.template join<transposed>(model.panels[p], beyond, keep);
    elimination.template pass<transposed>(model.panels[p], &scratch.pivots[p]);
  }
  Lanes last[2][3];
  elimination.end(last);
  const Lanes second = last[1][2] * inverse(not_zero(last[1][1]));
  // Scaled so that all that follows is finite.
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
    const Count band = model.band, wide = 2 * band + 1, many = windowed(panel.size, band);
    const Count curvatures = panel.size - many - 2, loaded = curvatures + border;
    x[0] = start[0];
    x[1] = start[1];
    const auto place_of = [&](Count c) -> Lanes& {  // of a column before the start's
      if (c < curvatures) return x[curvatures + 1 - c];
      return c == curvatures + end_force ? motion.force : motion.moment;
    };
    for (Count c = curvatures + 1; c >= 0; --c) {
      const Lanes* const row = scratch.pivots[p].table + c * (loaded + 1);
      Lanes sum = row[loaded] * size;
      for (Count k = c + 1; k < curvatures + 2; ++k) sum = sum - row[k] * place_of(k);
      for (Count k = 0; k < 4; ++k) sum = sum - row[curvatures + start_shape + k] * start[k];
      place_of(c) = sum * inverse(not_zero(row[c]));
    }
    for (Count step = many - 1; step >= 0; --step) {
      const Lanes* const row = scratch.pivots[p].window + step * kept_columns(band);
      const Count own = panel.size - 1 - step;
      Lanes sum = row[wide] * size;
      for (Count c = 1; c < wide && c <= own; ++c) sum = sum - row[c] * x[own - c];
      x[own] = sum * inverse(not_zero(row[0]));
    }
    if (p + 1 == model.count) break;
    const double ratio = panel.length / model.panels[p + 1].length;
    Lanes end[2], forces[2] = {motion.force, motion.moment};
    for (Count k = 0; k < moving && k < panel.size; ++k) {
      end[0] += end_shape[k] * x[k];
      end[1] += end_slope[k] * x[k];
    }
    if (panel.held) {  // there the panel's force is what holds it, too
      end[0] = Lanes{};
      const Lanes* const row = scratch.holds[p][0];
      const Lanes sum = row[2] * end[1] + row[3] * motion.moment;
      forces[0] = (row[4] * size - sum) * inverse(not_zero(row[0]));
    }
    for (Count k = 0; k < 2; ++k) {
      for (Count c = 0; c < 2; ++c) {
        const PencilEntry& of = transposed ? panel.station[c][k] : panel.station[k][c];
        forces[k] = forces[k] - entry<Lanes>(of, lambda) * end[c];
      }
    }
    start[0] = ratio * end[0];
    start[1] = end[1];
    start[2] = (1.0 / (ratio * ratio)) * forces[0];
    start[3] = (1.0 / ratio) * forces[1];
  }
}

/// Sums over all panels and stations of what two vectors give.
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
  Count numbers = 0, in_windows = 0;
  for (Count p = 0; p < model.count; ++p) {
    numbers += model.panels[p].size;
    in_windows += windowed(model.panels[p].size, band) * kept_columns(band);
  }
  const Count in_tables = model.count * table_rows(band) * table_columns(band);
  struct Storage {
    VectorScratch of;
    Lanes *windows, *tables, *right, *left;
  };
  const Storage scratch = laid_out([&](Layout& layout) {
    Storage made{};
    made.of.window = layout.take<Lanes>((band + 1) * (window_columns(band) + 1));
    made.of.table = layout.take<Lanes>(table_rows(band) * table_columns(band));
    made.of.pivots = layout.take<Pivots>(model.count);
    made.of.holds = reinterpret_cast<Lanes(*)[2][5]>(layout.take<Lanes>(10 * model.count));
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
    scratch.of.pivots[p] = {windows, tables};
    scratch.of.right[p] = {x, {}, {}};
    scratch.of.left[p] = {y, {}, {}};
    windows += windowed(size, band) * kept_columns(band);
    tables += table_rows(band) * table_columns(band);
    x += size;
    y += size;
  }
  const bool own = out.by_right != nullptr;
  for (Count first = 0; first < points.count; first += width) {
    const EntryPowers lambda(taken(points, first));
    null_vector<false>(model, lambda, scratch.of, scratch.of.right);
    null_vector<true>(model, lambda, scratch.of, scratch.of.left);
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
        // The first two give what the panel resists by at its start, which the next row takes.
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
      // At the end nothing but what acts there resists, or what holds it.
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
